"""The motion of a run in the world: where every link and every force arrow is, at a few moments."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, final

import numpy as np

from wbc.models.along import placed
from wbc.models.pinocchio_ import PinocchioModel
from wbc.report import measure
from wbc.types import Index, Mat, Vec

if TYPE_CHECKING:
    from wbc.control.recorder import Run
    from wbc.models.collision import Obstacle
    from wbc.models.model import RobotModel, RobotState

WEIGHT_LENGTH = 0.5  # an arrow as long as this [m] is the robot's weight
CONE = 0.15  # a friction cone is as high as this [m]
PUSH_LENGTH = 0.5  # the largest push is as long as this [m]


@final
@dataclass(frozen=True, eq=False)
class Motion:
    """k moments of a run: ``times`` (k,) [s]; per link positions (k, 3) [m] and rotations (k, 3, 3).

    ``forces`` (k, contacts, 2, 3): an arrow for the force on the robot at each contact, its tip at the contact;
    ``commanded``: the same for the commanded forces, none where no others were measured. ``cones`` {contact: (k, m,
    3)}: a line around its friction cone, all at one point while it carries nothing. ``pushes`` (k, 2, 3): the same for
    the push, of length 0 while there is none. ``com`` (k, 3): the centre of mass; ``targets`` {task: (k, 3)} [m];
    ``support``: per moment the hull of the contacts that carry (m, 3), None without.
    """

    times: Vec
    links: dict[str, tuple[Mat, Mat]]
    forces: Mat
    commanded: Mat
    cones: dict[str, Mat]
    pushes: Mat
    com: Mat
    targets: dict[str, Mat]
    support: list[Mat | None]

    @property
    def reach(self) -> tuple[Vec, Vec]:
        """The least and the largest coordinates of all places that the links go to (3,) [m]."""
        points = np.vstack([position for position, _ in self.links.values()])
        return points.min(axis=0), points.max(axis=0)

    @property
    def extent(self) -> tuple[Vec, float]:
        """Middle of all places the links go to (3,) [m], and how large that room is [m]."""
        low, high = self.reach
        return 0.5 * (low + high), max(float(np.linalg.norm(high - low)), 0.5)


def motion(
    run: Run, robot: RobotModel, rows: Index, links: Iterable[str], obstacles: Sequence[Obstacle] = ()
) -> Motion:
    """Place the links of ``robot`` at the given rows of the run, with its contact forces and pushes, and ``obstacles``
    by their names."""
    q = np.asarray(run.columns.get("plant.q", run["q"]), dtype=np.float64)
    state, rest = robot.state(), np.zeros(robot.nv)
    standing = {obstacle.name: obstacle for obstacle in obstacles}
    wanted = [link for link in links if link not in standing]
    places = placed(robot, q[rows], {link: link for link in wanted})
    contacts = _contacts(run, robot)
    forces = np.zeros((len(rows), len(contacts), 2, 3))
    both = all(column.startswith("plant.") and column.removeprefix("plant.") in run for _, column in contacts)
    commanded = np.zeros((len(rows), len(contacts) if both else 0, 2, 3))
    edges = _cones(run)
    cones = {name: np.zeros((len(rows), len(edge), 3)) for name, edge in edges.items()}
    com, aims = np.empty((len(rows), 3)), points(run, robot)
    targets = {task: np.empty((len(rows), 3)) for task in aims}
    support: list[Mat | None] = []
    carrying, told = measure.standing(run), np.asarray(run["q"], dtype=np.float64)
    pushes, pushed, longest = np.zeros((len(rows), 2, 3)), _pushed_frame(run, robot), _largest_push(run)
    per_newton = WEIGHT_LENGTH / max(robot.weight, 1e-9)
    for i, row in enumerate(rows):
        state.update(0.0, q[row], rest)
        for k, (point, column) in enumerate(contacts):
            tip = point.at(state)
            forces[i, k] = tip - per_newton * np.nan_to_num(run[column][row, :3]), tip
            name = column.removeprefix("plant.")
            if both:
                commanded[i, k] = tip - per_newton * np.nan_to_num(run[name][row, :3]), tip
            if (contact := name.removeprefix("f.")) in cones:
                open_now = contact not in carrying or carrying[contact][row]
                cones[contact][i] = tip + edges[contact] * float(open_now)
        com[i] = state.com
        ground = [c for name, c in soles(run, robot, state).items() if name not in carrying or carrying[name][row]]
        around = hull(np.vstack([*ground, np.zeros((0, 3))]))
        support.append(around)
        if longest > 0.0:
            tip = _pushed_point(state, pushed)
            pushes[i] = tip - (PUSH_LENGTH / longest) * run["push"][row], tip
        if aims:
            state.update(0.0, told[row], rest)
            for task, (about, axes) in aims.items():
                targets[task][i] = state.frame(about).position if about else state.com
                targets[task][i, list(axes)] += run[f"error.{task}"][row, list(axes.values())]
    t = measure.clock(run)[rows]
    for name, obstacle in standing.items():
        poses = [obstacle.at(float(time)) for time in t]
        places[name] = np.array([p.translation for p in poses]), np.array([p.rotation for p in poses])
    return Motion(t, places, forces, commanded, cones, pushes, com, targets, support)


def points(run: Run, robot: RobotModel) -> dict[str, tuple[str, dict[int, int]]]:
    """{task: (frame, {axis of the world: row of the error})} of the tasks about the place of a point of ``robot``.

    The frame is "" for the centre of mass.
    """
    found = {}
    for task, about in run.meta.get("tasks", {}).items():
        labels = enumerate(zip(about.get("labels") or (), about.get("units") or (), strict=False))
        rows = {"xyz".index(label): k for k, (label, unit) in labels if unit == "m" and label in ("x", "y", "z")}
        frame = str(about.get("point"))
        if rows and "point" in about and f"error.{task}" in run and (not frame or frame in robot.frame_names):
            found[task] = (frame, rows)
    return found


def soles(run: Run, robot: RobotModel, state: RobotState) -> dict[str, Mat]:
    """Corners (k, 3) of every contact of the run, one for a point, where ``state`` has them."""
    found = {}
    for name, contact in run.meta.get("contacts", {}).items():
        if contact.get("frame") not in robot.frame_names:
            continue
        rotation, point = state.frame(contact["frame"]).rotation, ContactPoint.of(robot, contact["frame"]).at(state)
        x, y = contact.get("half_size") or (0.0, 0.0)
        signs = ((1, 1), (1, -1), (-1, -1), (-1, 1)) if x else ((0, 0),)
        found[name] = np.array([point + rotation @ np.array([sx * x, sy * y, 0.0]) for sx, sy in signs])
    return found


def hull(corners: Mat) -> Mat | None:
    """Those of the corners (k, 2 or more) that are their hull seen from above, around it; None if it has no area."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return np.asarray(corners[ConvexHull(corners[:, :2]).vertices]) if len(corners) > 2 else None
    except (QhullError, ValueError):  # flat, or not finite
        return None


def quaternions(rotations: Mat) -> Mat:
    """Unit quaternions w x y z (k, 4) of rotations (k, 3, 3), w >= 0."""
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(rotations).as_quat().T
    return np.asarray(np.where(w < 0, -1.0, 1.0)[:, None] * np.column_stack([w, x, y, z]))


@final
@dataclass(frozen=True, eq=False)
class ContactPoint:
    """Where a foot touches level ground: ``origin`` (3,) in the axes of ``frame``, and ``below`` it by so much [m]."""

    frame: str
    origin: Vec
    below: float

    @classmethod
    def of(cls, robot: RobotModel, frame: str) -> ContactPoint:
        """The point that the robot's own description of its feet gives; the frame's origin if it says nothing."""
        foot = robot.feet.get(frame) if isinstance(robot, PinocchioModel) else None
        if foot is None:
            return cls(frame, np.zeros(3), 0.0)
        return cls(frame, np.array(foot.origin), foot.radius if foot.kind == "point" else 0.0)

    def at(self, state: RobotState) -> Vec:
        """The point in the world (3,)."""
        frame = state.frame(self.frame)
        return np.asarray(frame.position + frame.rotation @ self.origin - [0.0, 0.0, self.below])


def _contacts(run: Run, robot: RobotModel) -> list[tuple[ContactPoint, str]]:
    """Point and force column of every contact whose frame the run names; the ground is taken as level."""
    found = []
    for name, contact in run.meta.get("contacts", {}).items():
        column = f"plant.f.{name}" if f"plant.f.{name}" in run else f"f.{name}"
        if column in run and contact.get("frame") in robot.frame_names:
            found.append((ContactPoint.of(robot, contact["frame"]), column))
    return found


def _cones(run: Run) -> dict[str, Mat]:
    """A line (m, 3) [m] around the friction cone of each contact, below its apex, whence forces on the robot come."""
    turn = np.linspace(0.0, 2.0 * np.pi, 13)
    circle, apex = np.column_stack([np.cos(turn), np.sin(turn)]), np.zeros((1, 3))
    found = {}
    for name, contact in run.meta.get("contacts", {}).items():
        if contact.get("friction"):
            rim = np.column_stack([float(contact["friction"]) * circle, -np.ones(len(turn))])
            sides = [part for k in (6, 3, 9) for part in (apex, rim[k : k + 1])]
            found[name] = CONE * np.vstack([apex, rim, *sides])
    return found


def _largest_push(run: Run) -> float:
    return float(np.linalg.norm(run["push"], axis=1).max(initial=0.0)) if "push" in run else 0.0


def _pushed_frame(run: Run, robot: RobotModel) -> str | None:
    """The frame that a disturbance of the run says is pushed: it stands there in quotes."""
    lines = [str(line) for line in run.meta.get("disturbances", []) if str(line).startswith("push")]
    return next((name for name in robot.frame_names if any(f"'{name}'" in line for line in lines)), None)


def _pushed_point(state: RobotState, frame: str | None) -> Vec:
    return np.array(state.com if frame is None else state.frame(frame).position)
