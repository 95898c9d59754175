"""Odd robots in closed loops against an independent oracle: ``python -m tests.families.odd_robots --count 1000``.

Trees of joints whose axes meet, are parallel or equal, with ranges of centimetres, joints without limits and gears, in
units a hundred times smaller, on floating and planar bases; limits also on accelerations and jerks; weights from 1e-6
to 1e6; ticks from 0.3 to 16 ms; targets at rest, that jump, swing, are far out of reach or followed. While the loop
runs, tasks change and the stack is replaced. Beside the oracle's verdict, what the robot is told to do must keep the
limits on velocities, accelerations and positions wherever the state allows it.
"""

from __future__ import annotations

import contextlib
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import wbc
import wbc.tasks as T
from tests.families.oracle import FEASIBLE, Verdict, judge, undamped
from tests.families.progress import Family, Ticks
from wbc.errors import WbcError
from wbc.qp.solvers import usable

KINDS = ("plain", "ties", "collinear", "tight", "mimic", "small", "floating", "planar", "planar")
LEVELS = (wbc.VelocityLevel(), wbc.AccelerationLevel(), wbc.InverseDynamics())
HIERARCHIES = (wbc.Weighted(), wbc.Strict(), wbc.Scaled())
SOLVERS = ("pdas", "pdas", "daqp", "proxqp", "clarabel", "piqp", "osqp")
#: The deceleration that position limits count on where no acceleration limit says otherwise.
BRAKING = 20.0


def tree(rng: np.random.Generator, kind: str, unit: float) -> str:
    """A URDF of one to eight joints."""
    joints = int(rng.integers(1, 9))

    def link(name: str, mass: float, inertia: float, at: Any) -> str:
        x, y, z = at
        i = inertia * unit**5
        return (
            f'<link name="{name}"><inertial><origin xyz="{x} {y} {z}"/><mass value="{mass * unit**3}"/>'
            f'<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        )

    parts = [link("base", 5.0, 0.1, (0, 0, 0))]
    for i in range(joints):
        mass, at = rng.uniform(0.2, 3.0), rng.uniform(-0.2, 0.2, 3) * unit
        axis, turn = rng.normal(size=3), rng.uniform(-1.0, 1.0, 3)
        x, y, z = rng.uniform(-0.3, 0.3, 3) * unit
        if kind == "ties":
            mass, at, axis, turn, (x, y, z) = 1.0, np.array([0, 0, 0.1]), np.eye(3)[rng.integers(3)], np.zeros(3), (
                0, 0, 0.3 * unit)  # fmt: skip
        if kind == "collinear":
            axis, turn, (x, y, z) = np.eye(3)[0], np.zeros(3), (0, 0, 0)
        axis = axis / np.linalg.norm(axis)
        parent = "base" if i == 0 else f"l{i - 1 if rng.uniform() < 0.85 else int(rng.integers(i))}"
        sort = str(rng.choice(["prismatic", "continuous", "revolute"], p=[0.2, 0.12, 0.68]))
        size = unit if sort == "prismatic" else 1.0
        low, high = (0.01, 0.01) if kind == "tight" else rng.uniform(0.1, 2.5, 2)
        ends = "" if sort == "continuous" else f'lower="{-low * size}" upper="{high * size}"'
        effort = 10.0 ** rng.uniform(-0.5, 2.5) * unit ** (4 if sort == "prismatic" else 5)
        gear = kind == "mimic" and i > 0 and sort == "revolute" and rng.uniform() < 0.5
        ratio = rng.choice([-1.0, 0.5, 2.0])
        parts += [
            link(f"l{i}", mass, mass * rng.uniform(0.01, 0.05), at),
            f'<joint name="j{i}" type="{sort}"><parent link="{parent}"/><child link="l{i}"/>'
            f'<origin xyz="{x} {y} {z}" rpy="{turn[0]} {turn[1]} {turn[2]}"/>'
            f'<axis xyz="{axis[0]} {axis[1]} {axis[2]}"/>'
            f'<limit {ends} velocity="{rng.uniform(0.3, 5.0) * size}" effort="{effort}"/>'
            + (f'<mimic joint="j0" multiplier="{ratio}" offset="0"/>' if gear else "")
            + "</joint>",
        ]
    return '<robot name="odd">' + "".join(parts) + "</robot>"


def weight(rng: np.random.Generator) -> float:
    """Ordinary, or from 1e-6 to 1e6."""
    return float(10.0 ** (rng.uniform(-6.0, 6.0) if rng.uniform() < 0.4 else rng.uniform(-2.0, 2.0)))


def target(rng: np.random.Generator, size: float) -> Any:
    """A place: at rest, far away, that jumps or that swings."""
    centre, reach, rate = rng.normal(size=3) * size, rng.normal(size=3) * 0.3 * size, rng.uniform(0.5, 20.0)
    match rng.integers(4):
        case 0:
            return centre
        case 1:
            return 100.0 * centre
        case 2:
            return lambda t: centre + reach * np.sign(np.sin(40.0 * rate * t))
        case _:
            return lambda t: (
                centre + reach * np.sin(rate * t), rate * reach * np.cos(rate * t), -rate**2 * reach * np.sin(rate * t)
            )  # fmt: skip


def stack(robot: Any, level: Any, rng: np.random.Generator, unit: float) -> wbc.Stack:
    """Up to four tasks in levels, and limits."""
    links = [name for name in robot.frame_names if name[0] == "l" and name[1:].isdigit()]
    heavy = weight(rng) / unit**2
    makers: list[Callable[[str], Any]] = [
        lambda link: T.Position(link, target=target(rng, 0.4 * unit), weight=heavy, kp=float(10 ** rng.uniform(0, 3))),
        lambda link: T.Position(link, target=T.Follow(np.zeros(3)), weight=heavy),
        lambda link: T.Orientation(link, target=np.eye(3), weight=weight(rng)),
        lambda link: T.CenterOfMass(target=target(rng, 0.3 * unit), weight=heavy),
        lambda link: T.Damping(weight=weight(rng)),
        lambda link: T.Gaze(link, axis=[0, 0, 1], target=rng.normal(size=3) * unit, weight=weight(rng)),
        lambda link: T.ManipulabilityTask(link, target=float(rng.exponential(1.0)), weight=weight(rng)),
    ]
    made = [makers[rng.integers(len(makers))](str(rng.choice(links))) for _ in range(int(rng.integers(0, 4)))]
    if not made or rng.uniform() < 0.8:
        made.append(T.Posture(robot.q0, weight=1e-2 * weight(rng)))
    made = list({task.name: task for task in made}.values())
    cuts = sorted(set(rng.integers(1, len(made) + 1, size=rng.integers(0, 3)).tolist()))
    levels = [list(part) for part in np.split(np.array(made, dtype=object), cuts) if len(part)]
    limits: list[Any] = [limit() for limit in (T.JointPositionLimits, T.JointVelocityLimits) if rng.uniform() < 0.7]
    if rng.uniform() < 0.5:
        most = float(10.0 ** rng.uniform(0.5, 2.5))
        limits.append(T.JointAccelerationLimits(most))
        limits += [T.JointJerkLimits(most * float(10.0 ** rng.uniform(0.5, 3.0)))] if rng.uniform() < 0.5 else []
    limits += [T.TorqueLimits()] if level.dynamics and rng.uniform() < 0.6 else []
    if not robot.nb and rng.uniform() < 0.15:
        limits.append(T.HalfSpaceLimit(links[-1], normal=[0, 0, 1], offset=-0.5 * unit))
    return wbc.Stack(levels, subject_to=[*limits, *T.mimic_joints(robot)])


def change(control: wbc.Controller, rng: np.random.Generator, again: Callable[[], wbc.Stack]) -> None:
    """What users do between ticks."""
    listed = control.stack.tasks
    task: Any = listed[rng.integers(len(listed))]
    with contextlib.suppress(WbcError):
        match rng.integers(5):
            case 0:
                task.active = not task.active
            case 1:
                task.weight = weight(rng)
            case 2 if hasattr(task, "kp"):
                task.kp = float(10.0 ** rng.uniform(-1.0, 2.5))
            case 3:
                control.replace(again())
            case _:
                for other in listed:
                    if isinstance(getattr(other, "target", None), T.Follow):
                        other.target.push(0.3 * rng.normal(size=3))


def kept(control: wbc.Controller, decided: wbc.Command) -> Verdict:
    """Whether the joints are told to stay within their limits, where they are within them and can be."""
    limits, robot, dt = control.model.limits, control.model, control.dt
    of = {type(limit): limit for limit in control.stack.subject_to}
    state: Any = control.state
    q, q_next = (x[robot.nq - robot.nj :] for x in (state.q, decided.q))
    v, v_next = (x[robot.nb :] for x in (state.v, decided.v))
    most = of[T.JointAccelerationLimits].a_max if T.JointAccelerationLimits in of else np.inf
    if T.JointVelocityLimits in of and (np.abs(v) <= limits.v_max + 1e-9).all():
        if (np.abs(v_next) > limits.v_max + FEASIBLE).any():
            return Verdict("wrong", "faster than the velocity limits")
    if decided.status.ok and (np.abs(v_next - v) > dt * most * (1.0 + 1e-6) + 1e-9).any():
        return Verdict("wrong", "beyond the acceleration limits")
    if T.JointPositionLimits in of:
        B, room = min(BRAKING, most), np.where(v > 0.0, limits.q_max - q, q - limits.q_min)
        able = (v**2 / (2.0 * B) + 0.5 * dt * np.abs(v) <= room + 1e-9) & (q >= limits.q_min) & (q <= limits.q_max)
        if (able & (np.maximum(q_next - limits.q_max, limits.q_min - q_next) > FEASIBLE)).any():
            return Verdict("wrong", "beyond the position limits")
    return Verdict("right")


def ticked(case: int, ticks: int) -> Ticks:
    """The controller, each of its commands, and what it is; nothing where the combination is refused."""
    rng = np.random.default_rng([case, 11])
    kind = str(rng.choice(KINDS))
    unit = 1e-2 if kind == "small" else 1.0
    with warnings.catch_warnings(), tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "odd.urdf"
        path.write_text(tree(rng, kind, unit))
        warnings.simplefilter("ignore")
        robot: Any = wbc.load(str(path), base=kind if kind in ("floating", "planar") else "fixed")
        level, hierarchy = LEVELS[rng.integers(3)], HIERARCHIES[rng.integers(3)]
        solver = str(rng.choice(SOLVERS))
        dt, near = float(10.0 ** rng.uniform(-3.5, -1.8)), 0.002 if kind == "tight" else 0.02
        try:
            control = wbc.Controller(
                robot, stack(robot, level, rng, unit), level=undamped(level, hierarchy), hierarchy=hierarchy, dt=dt,
                solver=solver if solver in usable() else "pdas",
            )  # fmt: skip
        except WbcError:
            return
        q = robot.integrate(robot.q0, near * rng.normal(size=robot.nv))
        v = 0.05 * unit * rng.normal(size=robot.nv)
        for tick in range(ticks):
            if tick % 7 == 6:
                change(control, rng, lambda: stack(robot, level, rng, unit))
            decided = control.tick(dt * tick, q, v)
            yield control, decided, f"{kind} {level.name} {type(hierarchy).__name__}"
            q, v = decided.q, decided.v
            if not np.isfinite(q).all() or np.abs(v).max() > 1e4:
                return


def judged(control: wbc.Controller, decided: wbc.Command, *, optimum: bool = True) -> Verdict:
    """The oracle's word, or that a limit of the joints is broken that was not said to be relaxed."""
    verdict = judge(control, decided, optimum=optimum)
    limits = Verdict("right") if decided.fallback_level == "relaxed" else kept(control, decided)
    return limits if limits.word == "wrong" else verdict


FAMILY = Family(ticked, every=5, judge=judged)

if __name__ == "__main__":
    FAMILY.command(__doc__, ticks=40)
