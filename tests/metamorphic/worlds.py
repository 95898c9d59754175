"""A robot with what is asked of it, as numbers that a test can mirror, turn, weigh and measure in another unit."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

import wbc
from tasks import CenterOfMass, ContactForce, JointLimits, Orientation, Point, Position, Posture, Sole
from wbc.models.pinocchio_ import PinocchioModel
from wbc.types import Status

OWN = Path(wbc.__file__).parent / "models" / "robots"
LEVELS = {"velocity": wbc.VelocityLevel(), "acceleration": wbc.AccelerationLevel(), "torque": wbc.InverseDynamics()}
HIERARCHIES = {"weighted": wbc.Weighted(), "strict": wbc.Strict(), "scaled": wbc.Scaled()}
FORCE_WEIGHT, CONTACT_WEIGHT = 1e-3, 1e-6  # on each N of a contact: the task's, the contact's own
OWN_WEIGHT = CONTACT_WEIGHT + LEVELS["torque"].regularisation  # what is on every N and N m, whatever the units
#: Frame whose position, frame whose orientation is a task, and the contacts.
ASKED = {
    "arm": ("tool", "tool", ()),
    "quadruped": ("front_left_foot", "trunk", ("front_right_foot", "rear_left_foot", "rear_right_foot")),
    "humanoid": ("left_hand", "torso", ("left_sole", "right_sole")),
}


def loaded(file: Path, base: str) -> PinocchioModel:
    """The robot of this file."""
    return wbc.load(str(file), base=base, feet=[])  # type: ignore[arg-type]


@dataclass(frozen=True)
class World:
    """A robot, its state, the targets, the limits (by joint) and the numbers that carry units of length or mass."""

    robot: PinocchioModel
    q: np.ndarray
    v: np.ndarray
    place: str
    place_target: np.ndarray
    direction: str
    direction_target: np.ndarray
    com_target: np.ndarray | None
    posture: np.ndarray
    limits: dict[str, dict[str, Any]]
    contacts: tuple[str, ...]
    axes: np.ndarray = field(default_factory=lambda: np.eye(3))
    length: float = 1.0  # lengths are so many times what they are in metres
    mass: float = 1.0  # masses are so many times what they are in kilograms
    copies: int = 1  # of every task, with this part of its weight each
    repeated: int = 1  # how often each limit is given
    backwards: bool = False  # tasks and contacts in the other order

    def tasks(self, level: str) -> list[list[Any]]:
        """Three levels of tasks."""
        linear = 1.0 / self.length**2
        force, moment = (
            (FORCE_WEIGHT + OWN_WEIGHT) / (self.mass * self.length**power) ** 2 - OWN_WEIGHT for power in (1, 2)
        )

        def many(make: Callable[..., Any], weight: float) -> list[Any]:
            return [make(weight=weight / self.copies, name=f"{make.__name__}{i}") for i in range(self.copies)]

        def place(**settings: Any) -> Any:
            return Position(self.place, target=self.place_target, kp=80.0, **settings)

        def direction(**settings: Any) -> Any:
            return Orientation(self.direction, target=self.direction_target, kp=60.0, **settings)

        def com(**settings: Any) -> Any:
            return CenterOfMass(target=self.com_target, kp=50.0, **settings)

        def posture(**settings: Any) -> Any:
            return Posture(self.posture, kp=20.0, **settings)

        def forces(frame: str) -> Callable[..., Any]:
            weights = np.array([force] * 3 + [moment] * 3)[: 6 if frame.endswith("_sole") else 3]

            def force_on(*, weight: float, name: str) -> Any:
                return ContactForce(frame, target=0.0 * weights, weight=weight * weights, name=f"{name} {frame}")

            return force_on

        first = many(direction, 0.5) + ([] if self.com_target is None else many(com, linear))
        last = many(posture, 1e-2)
        if level == "torque":
            last += [task for frame in self.contacts for task in many(forces(frame), 1.0)]
        levels = [first, many(place, 2.0 * linear), last]
        return [level[::-1] for level in levels] if self.backwards else levels

    def feet(self) -> list[Any]:
        """The contacts that hold."""
        common: dict[str, Any] = {"friction": 0.6, "force_weight": CONTACT_WEIGHT}
        contacts: list[Any] = []
        for frame in self.contacts:
            if frame.endswith("_sole"):
                contacts.append(Sole(frame, half_size=self.length * np.array([0.11, 0.05]), **common))
            else:
                contacts.append(Point(frame, radius=self.length * 0.02, axes=self.axes, **common))
        return contacts[::-1] if self.backwards else contacts

    def command(self, level: str, hierarchy: str) -> wbc.Command:
        """The command of one tick."""
        out = {"torque": set(), "acceleration": {"tau_max"}, "velocity": {"tau_max", "a_max"}}[level]
        limits = {key: value for key, value in self.limits.items() if key not in out}
        stack = wbc.Stack(
            self.tasks(level), contacts=self.feet(),
            subject_to=[JointLimits(**limits, name=f"limits {i}") for i in range(self.repeated)],
        )  # fmt: skip
        controller = wbc.Controller(self.robot, stack, level=LEVELS[level], hierarchy=HIERARCHIES[hierarchy], dt=2e-3)
        return controller.tick(0.0, self.q, self.v)

    def answer(self, level: str, hierarchy: str) -> Answer:
        """What the command says, by name."""
        command = self.command(level, hierarchy)
        robot, nb = self.robot, self.robot.nb
        motion = command.v if level == "velocity" else command.a
        torque = level == "torque"
        return Answer(
            status=command.status, fallback_level=command.fallback_level, base=motion[:nb].copy(),
            joints=dict(zip(robot.joint_names, motion[nb:], strict=True)),
            tau=dict(zip(robot.joint_names, command.tau, strict=True)) if torque else {},
            f={frame: command.f[frame].copy() for frame in self.contacts} if torque else {},
        )  # fmt: skip


@dataclass(frozen=True)
class Answer:
    """A command by names: motion of the base and the joints, torques, forces."""

    status: Status
    fallback_level: str
    base: np.ndarray
    joints: dict[str, float]
    tau: dict[str, float]
    f: dict[str, np.ndarray]

    def vector(self, like: Answer) -> np.ndarray:
        """All numbers, each kind over its largest in ``like``, in the order of ``like``."""
        motion = np.concatenate([self.base, [self.joints[name] for name in like.joints]])
        size = max(1e-3, np.abs(like.base).max(initial=0.0), *map(abs, like.joints.values()))
        parts = [motion / size]
        if like.tau:
            parts.append(np.array([self.tau[name] for name in like.tau]) / max(map(abs, like.tau.values())))
        if like.f:
            force = np.concatenate([self.f[name] for name in like.f])
            parts.append(force / np.abs(np.concatenate(list(like.f.values()))).max())
        return np.concatenate(parts)


def drawn(name: str, rng: np.random.Generator) -> World:
    """A world around the stance of one of our robots: errors of centimetres, some limits that hold the robot back."""
    robot = loaded(OWN / f"{name}.urdf", "fixed" if name == "arm" else "floating")
    stance = wbc.load(name).q0
    q = stance.copy()
    q[robot.nq - robot.nj :] += rng.normal(0.0, 0.1, robot.nj)
    q[robot.nq - robot.nj :] = np.clip(q[robot.nq - robot.nj :], robot.limits.q_min + 0.05, robot.limits.q_max - 0.05)
    if robot.nb:
        q = robot.integrate(q, np.concatenate([rng.normal(0.0, 0.1, 6), np.zeros(robot.nj)]))
    v = rng.normal(0.0, 0.2, robot.nv)
    state = robot.state()
    state.update(0.0, q, v)
    place, direction, contacts = ASKED[name]
    tilt = turn(rng.normal(0.0, 0.2, 3))
    joints, joint_q, joint_v = robot.joint_names, q[robot.nq - robot.nj :], v[robot.nb :]
    near = {joint: bool(rng.random() < 0.2) for joint in joints}
    room = {joint: 0.002 if near[joint] else 1.0 for joint in joints}
    limits = {
        "lower": {joint: at - (0.001 + room[joint]) for joint, at in zip(joints, joint_q, strict=True)},
        "upper": {joint: at + (0.001 + room[joint]) for joint, at in zip(joints, joint_q, strict=True)},
        "v_max": {joint: abs(speed) + 0.5 for joint, speed in zip(joints, joint_v, strict=True)},
        "a_max": {joint: rng.uniform(20.0, 60.0) if contacts == () else rng.uniform(30.0, 100.0) for joint in joints},
        "tau_max": dict(zip(joints, robot.limits.tau_max * rng.uniform(0.3, 1.0, robot.nj), strict=True)),
    }
    return World(
        robot, q, v, place, state.frame(place).position + rng.normal(0.0, 0.15, 3), direction,
        tilt @ state.frame(direction).rotation, None if name == "arm" else state.com + rng.normal(0.0, 0.03, 3),
        stance, limits, contacts,
    )  # fmt: skip


def turn(vector: np.ndarray) -> np.ndarray:
    """The rotation about ``vector`` by its length, in closed form (Rodrigues)."""
    angle = float(np.linalg.norm(vector))
    x, y, z = vector / angle if angle else vector
    K = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + np.sin(angle) * K + (1.0 - np.cos(angle)) * K @ K


def quaternion(R: np.ndarray) -> np.ndarray:
    """(x, y, z, w) of a rotation by less than half a turn."""
    w = 0.5 * np.sqrt(1.0 + np.trace(R))
    return np.array([*(np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]]) / (4.0 * w)), w])


def rotation(quaternion: np.ndarray) -> np.ndarray:
    """The rotation of (x, y, z, w)."""
    half = np.arccos(np.clip(quaternion[3], -1.0, 1.0))
    axis = quaternion[:3] / max(np.linalg.norm(quaternion[:3]), 1e-300)
    return turn(2.0 * half * axis)


def rewritten(name: str, folder: Path, change: Callable[[ET.Element], None]) -> PinocchioModel:
    """One of our robots with its description changed."""
    tree = ET.parse(OWN / f"{name}.urdf")
    change(tree.getroot())
    file = folder / f"{name}.urdf"
    tree.write(file)
    return loaded(file, "fixed" if name == "arm" else "floating")


# ---- the same world, seen otherwise: another world, and how to read its answer
Back = Callable[[Answer], Answer]
S = np.diag([1.0, -1.0, 1.0])
WRENCH = np.array([1.0, -1.0, 1.0, -1.0, 1.0, -1.0])


def _other(name: str) -> str:
    return name.replace("left", "*").replace("right", "left").replace("*", "right")


def mirrored(w: World) -> tuple[World, Back]:
    """Left and right exchanged: y becomes −y; what turns about x or z turns the other way."""
    robot = w.robot
    axes = {
        joint.get("name"): np.array([float(x) for x in joint.find("axis").get("xyz").split()])  # type: ignore[union-attr]
        for joint in ET.parse(OWN / f"{robot.name}.urdf").getroot().iter("joint") if joint.find("axis") is not None
    }  # fmt: skip
    sign = {joint: float(-S @ axes[joint] @ axes[_other(joint)]) for joint in robot.joint_names}
    names, nb, at = robot.joint_names, robot.nb, robot.nq - robot.nj

    def joints(values: np.ndarray) -> np.ndarray:
        found = {_other(joint): sign[joint] * value for joint, value in zip(names, values, strict=True)}
        return np.array([found[joint] for joint in names])

    def configuration(q: np.ndarray) -> np.ndarray:
        x, y, z, w_ = q[3:7]
        return np.concatenate([S @ q[:3], [-x, y, -z, w_], joints(q[at:])])

    def twist(v: np.ndarray) -> np.ndarray:
        return np.concatenate([S @ v[:3], -S @ v[3:6], joints(v[nb:])])

    def limit(key: str) -> dict[str, float]:
        return {_other(joint): value for joint, value in w.limits[key].items()}

    limits = {key: limit(key) for key in w.limits}
    for joint in names:
        if sign[joint] < 0.0:
            pair = limits["lower"][_other(joint)], limits["upper"][_other(joint)]
            limits["lower"][_other(joint)], limits["upper"][_other(joint)] = -pair[1], -pair[0]

    def back(answer: Answer) -> Answer:
        return replace(
            answer, base=np.concatenate([S @ answer.base[:3], -S @ answer.base[3:]]),
            joints={_other(joint): sign[joint] * value for joint, value in answer.joints.items()},
            tau={_other(joint): sign[joint] * value for joint, value in answer.tau.items()},
            f={_other(frame): WRENCH[: len(f)] * f for frame, f in answer.f.items()},
        )  # fmt: skip

    assert w.com_target is not None
    return replace(
        w, q=configuration(w.q), v=twist(w.v), place=_other(w.place), place_target=S @ w.place_target,
        direction_target=S @ w.direction_target @ S, com_target=S @ w.com_target, posture=configuration(w.posture),
        limits=limits, contacts=tuple(_other(frame) for frame in w.contacts),
    ), back  # fmt: skip


def turned(w: World, rng: np.random.Generator) -> tuple[World, Back]:
    """Turned about the vertical and shifted, the ground with it."""
    R, shift = turn(np.array([0.0, 0.0, rng.uniform(-2.5, 2.5)])), rng.uniform(-3.0, 3.0, 3)

    def configuration(q: np.ndarray) -> np.ndarray:
        return np.concatenate([R @ q[:3] + shift, quaternion(R @ rotation(q[3:7])), q[7:]])

    assert w.com_target is not None
    return replace(
        w, q=configuration(w.q), place_target=R @ w.place_target + shift, direction_target=R @ w.direction_target,
        com_target=R @ w.com_target + shift, axes=R @ w.axes,
    ), lambda answer: answer  # fmt: skip


def _scaled(element: ET.Element, keys: tuple[str, ...], factor: float) -> None:
    for key in keys:
        text = element.get(key)
        if text is not None:
            element.set(key, " ".join(repr(factor * float(x)) for x in text.split()))


INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def heavier(w: World, k: float, folder: Path) -> tuple[World, Back]:
    """All masses k times as large, and what motors can do."""

    def change(root: ET.Element) -> None:
        for inertial in root.iter("inertial"):
            _scaled(inertial.find("mass"), ("value",), k)  # type: ignore[arg-type]
            _scaled(inertial.find("inertia"), INERTIA, k)  # type: ignore[arg-type]

    def back(answer: Answer) -> Answer:
        tau = {joint: value / k for joint, value in answer.tau.items()}
        return replace(answer, tau=tau, f={frame: f / k for frame, f in answer.f.items()})

    limits = w.limits | {"tau_max": {joint: k * value for joint, value in w.limits["tau_max"].items()}}
    return replace(
        w, robot=rewritten(w.robot.name, folder, change), limits=limits, mass=k
    ), back  # fmt: skip


def renamed(w: World, rng: np.random.Generator, folder: Path) -> tuple[World, Back]:
    """The joints under other names, which puts them in another order; tasks, contacts in the other order too."""
    order = dict(zip(w.robot.joint_names, rng.permutation(w.robot.nj), strict=True))
    new = {joint: f"j{number:02d}_{joint}" for joint, number in order.items()}
    old = {name: joint for joint, name in new.items()}

    def change(root: ET.Element) -> None:
        for joint in root.iter("joint"):
            joint.set("name", new.get(joint.get("name", ""), joint.get("name", "")))

    robot = rewritten(w.robot.name, folder, change)

    def joints(values: np.ndarray) -> np.ndarray:
        found = dict(zip(w.robot.joint_names, values, strict=True))
        return np.array([found[old[name]] for name in robot.joint_names])

    def back(answer: Answer) -> Answer:
        return replace(
            answer, joints={old[name]: value for name, value in answer.joints.items()},
            tau={old[name]: value for name, value in answer.tau.items()},
        )  # fmt: skip

    at = robot.nq - robot.nj
    return replace(
        w, robot=robot, q=np.concatenate([w.q[:at], joints(w.q[at:])]), backwards=True,
        v=np.concatenate([w.v[: robot.nb], joints(w.v[robot.nb :])]),
        posture=np.concatenate([w.posture[:at], joints(w.posture[at:])]),
        limits={key: {new[joint]: value for joint, value in by.items()} for key, by in w.limits.items()},
    ), back  # fmt: skip


def measured(w: World, k: float, folder: Path) -> tuple[World, Back]:
    """Another unit of length, of which a metre has k: forces are k, torques k² times as large, angles as they were."""

    def change(root: ET.Element) -> None:
        for origin in root.iter("origin"):
            _scaled(origin, ("xyz",), k)
        for inertia in root.iter("inertia"):
            _scaled(inertia, INERTIA, k * k)
        for shape in [*root.iter("visual"), *root.iter("collision")]:
            for part in shape.iter():
                _scaled(part, ("size", "radius", "length"), k)

    robot = rewritten(w.robot.name, folder, change)
    robot.pinocchio.gravity.linear *= k
    robot.gravity = k * robot.gravity

    def configuration(q: np.ndarray) -> np.ndarray:
        return np.concatenate([k * q[:3], q[3:]]) if robot.nb else q

    def back(answer: Answer) -> Answer:
        return replace(
            answer, base=np.concatenate([answer.base[:3] / k, answer.base[3:]]),
            tau={joint: value / k**2 for joint, value in answer.tau.items()},
            f={frame: np.concatenate([f[:3] / k, f[3:] / k**2]) for frame, f in answer.f.items()},
        )  # fmt: skip

    limits = w.limits | {"tau_max": {joint: k**2 * value for joint, value in w.limits["tau_max"].items()}}
    return replace(
        w, robot=robot, q=configuration(w.q), v=np.concatenate([k * w.v[:3], w.v[3:]]) if robot.nb else w.v,
        place_target=k * w.place_target, com_target=None if w.com_target is None else k * w.com_target,
        posture=configuration(w.posture), limits=limits, length=k,
    ), back  # fmt: skip
