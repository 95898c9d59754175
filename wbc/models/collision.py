"""Distances between the links of a robot, and between them and obstacles: the nearest pairs, with their derivatives.

Placements are Pinocchio's; distances and witness points come from :mod:`wbc.models.near_pairs`. A pair of shapes that
was far cannot be near before the shapes have moved as far, so few pairs are measured in a tick. Meshes stand for their
convex hulls.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, final

import numpy as np
import pinocchio as pin

from wbc import checks
from wbc.errors import InvalidInput, NotSupported, UnknownName
from wbc.models.coal_ import coal_shape, memory_of
from wbc.models.geometry import Cylinder, Geometry, Shape
from wbc.models.model import RobotModel, RobotState
from wbc.models.pinocchio_ import PinocchioModel
from wbc.models.separation import always_apart
from wbc.tolerances import HUGE
from wbc.types import Index, Mat, Vec

#: Rows that there are by default besides two for each pair that has one in the reference configuration, and the most.
_ROWS, _MOST_ROWS = 64, 1024
#: By how much, as a share of the reach, a pair must be nearer to take the row of another.
_NEARER = 0.1
#: Time step of differences of the poses of obstacles [s], and an acceleration beyond which a pose jumps [m/s², rad/s²].
_STEP, _JUMPS = 1e-4, 1e2


@final
@dataclass(frozen=True)
class Obstacle:
    """Something in the world to keep away from: a shape at ``pose``, an SE3, or a function of time [s] giving one.

    Raises:
        InvalidInput: the shape is none, or the pose at time 0 is none.

    Example:
        >>> import numpy as np, pinocchio
        >>> from wbc.models.collision import Obstacle
        >>> from wbc.models.geometry import Box, Sphere
        >>> table = Obstacle("table", Box((1.0, 1.0, 0.05)), pinocchio.SE3(np.eye(3), np.array([0.5, 0.0, 0.2])))
        >>> ball = Obstacle("ball", Sphere(0.1), lambda t: pinocchio.SE3(np.eye(3), np.array([1.0 - t, 0.0, 0.5])))
        >>> table.moves, ball.moves
        (False, True)
    """

    name: str
    shape: Shape
    pose: Any
    _first: Any = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not isinstance(self.shape, Shape):
            raise InvalidInput(f"obstacle {self.name!r}: {self.shape!r} is no Box, Sphere, Cylinder or Mesh")
        object.__setattr__(self, "_first", self.at(0.0))

    @classmethod
    def between(cls, name: str, start: Mat, end: Mat, rate: float, radius: float) -> Obstacle:
        """A rod between two points that move, such as a limb of a person: places (N, 3) [m] at ``rate`` [1/s].

        Its length is that in the middle of all; before and after the motion it stays.

        Raises:
            InvalidInput: places of other shapes or that are not finite, a rate that is not positive.

        Example:
            >>> import numpy as np
            >>> from wbc.models.collision import Obstacle
            >>> start, end = np.zeros((2, 3)), np.array([[0.0, 0.0, 0.4], [0.4, 0.0, 0.0]])
            >>> arm = Obstacle.between("arm", start, end, 10.0, 0.05)
            >>> arm.at(0.1).translation.round(3), arm.at(0.1).rotation[:, 2].round(3)
            (array([0.2, 0. , 0. ]), array([1., 0., 0.]))
        """
        start = checks.array("start", start, (None, 3))
        end, rate = checks.array("end", end, start.shape), checks.number("rate", rate, low=0.0, strict=True)
        length = float(np.median(np.linalg.norm(end - start, axis=1)))
        return cls(name, Cylinder(radius, length), partial(_along, start, end, rate))

    @property
    def moves(self) -> bool:
        """Whether the pose is a function of time."""
        return callable(self.pose)

    def at(self, t: float) -> Any:
        """The pose at time t [s].

        Raises:
            InvalidInput: it is no SE3, not finite, as large as no place is, or not a rotation.
        """
        pose = self.pose(t) if callable(self.pose) else self.pose
        name = f"the pose of obstacle {self.name!r} at {t:g} s"
        if not isinstance(pose, pin.SE3):
            shown = checks.shown(pose)
            raise InvalidInput(f"{name} is {shown}; a pose is a pinocchio.SE3 or a function of time giving one")
        for number in pose.homogeneous.ravel().tolist():
            if not -HUGE < number < HUGE:
                raise InvalidInput(f"{name} has the number {number:g}; each must be finite and below {HUGE:g}")
        checks.rotation(name, pose.rotation)
        return pose

    def still(self) -> Obstacle:
        """The same where it was at t = 0, still a function of time if it was one: that function is not called."""
        first = self._first
        return replace(self, pose=lambda _: first) if self.moves else self


def obstacles_in(name: str, value: Any) -> list[Obstacle]:
    """``value``, an argument called ``name``, as a list of obstacles.

    Raises:
        InvalidInput: it is none.
    """
    found = checks.items(name, value, "obstacles")
    return [checks.instance(f"{name}[{i}]", one, Obstacle, "an Obstacle") for i, one in enumerate(found)]


@final
class Distances:
    """Pairs of shapes of two links (or a link and an obstacle) within ``reach`` [m], for one model.

    Of two links those shapes count that are nearest, and others that are further by less than half the reach.
    ``read(state)`` fills, row by row:

    which (count,)         index of the pair in ``pairs``, −1 where a row is empty
    distance (count,)      d [m], negative inside one another; ``reach`` where there is no pair
    jacobian (count, nv)   ∂d/∂q = nᵀ (J₂ − J₁) at the nearest points, n the unit normal from the first to the second
    rate (count,)          ∂d/∂t of obstacles that move
    drift (count,)         d²d/dt² at a = 0; NaN in states without drifts

    A pair nearer than ``close`` [m] has rows also for up to nine points of each shape that would be nearest if the
    shapes were turned against each other by 0.005 or 0.1 rad: d is how far these points are apart along the normal of
    the nearest. In states with drifts they are up to twelve, for a turn by 0.005 rad or what the shapes turn in
    ``ahead``, 0.1 rad at least, and there are such rows also while one of the points could be nearer than ``margin``
    after ``ahead``. Balls have none.

    A pair keeps its rows from reading to reading: it has the first row that is free when it comes within reach, and
    gives it back only where another needs it. Where there are too few rows, those are kept that would be nearest after
    ``ahead`` [s] at the velocity of now; what takes the row of another must be nearer by a tenth of ``reach``.
    ``missing`` counts the pairs within reach that lack a row. In states with drifts, where the
    robot cannot stop at once, a pair that approaches at u [m/s] is within reach also at margin + 2 u ``ahead``.

    Distances depend on the state alone; what was measured before only spares work. The first reading measures all
    pairs, and so does the first after a ``reset``, which makes all rows free.

    Left out are shapes that no joint moves against each other, those of neighbouring links, and what two joints or
    fewer cannot bring within ``margin``. With ``pairs=None`` also what is nearer than that in the reference
    configuration: such links overlap by construction, ``excluded`` lists them.

    Args:
        model: a robot from :func:`wbc.models.load`.
        pairs: pairs of names of links and obstacles to look at; None: all.
        obstacles: what stands in the world.
        self_collision: with ``pairs=None``, whether links are kept apart from links.
        count: number of rows, at most as many as there can be; None: 64 and two for each pair that has one in the
            reference configuration, at most 1024.

    Raises:
        NotSupported: the model has no shapes.
        UnknownName: a pair names neither a link with a shape nor an obstacle.
        InvalidInput: two obstacles of one name, a link named like one, no pair left, a mesh without a volume.
        ModelError: a mesh file that cannot be read, by its path.

    Source: ∂d/∂q by the envelope theorem (Gilbert, Johnson, IEEE J. Robotics Automation 1985).

    Example:
        >>> import wbc
        >>> from wbc.models.collision import Distances
        >>> robot = wbc.load("arm")
        >>> distances = Distances(robot, count=2, reach=1.0)
        >>> distances.read(robot.state())
        >>> len(distances.which), bool(distances.distance.min() > 0)
        (2, True)
    """

    def __init__(
        self,
        model: RobotModel,
        *,
        pairs: Iterable[tuple[str, str]] | None = None,
        obstacles: Sequence[Obstacle] = (),
        self_collision: bool = True,
        count: int | None = None,
        reach: float = 0.2,
        margin: float = 0.0,
        ahead: float = 0.0,
        close: float | None = None,
    ) -> None:
        checks.instance("model", model, RobotModel, "a robot from wbc.load(...)")
        if not isinstance(model, PinocchioModel) or not model.collisions:
            raise NotSupported(f"{model.name} has no collision shapes, so nothing is known about distances")
        self.model, self.reach = model, checks.number("reach", reach, low=0.0, strict=True)
        self.ahead, self.margin = checks.number("ahead", ahead, low=0.0), margin
        self.close = -np.inf if close is None else close
        self._obstacles = tuple(obstacles_in("obstacles", obstacles))
        self._geometry = pin.GeometryModel()
        self._owners: list[str] = []
        self._add_shapes(model.collisions)
        self._allow(pairs, checks.truth("self_collision", self_collision))
        self._kinematics = model.pinocchio.createData()
        touching = self._touching(margin) if pairs is None else []
        first = len(self._owners) - len(self._obstacles)
        moving = frozenset(first + i for i, obstacle in enumerate(self._obstacles) if obstacle.moves)
        low, high = model.limits.q_min, model.limits.q_max
        apart = always_apart(model.pinocchio, self._geometry, low, high, margin, moving=moving)
        for pair in [*touching, *apart]:
            self._geometry.removeCollisionPair(pair)
        self.excluded = tuple(dict.fromkeys((self._owners[p.first], self._owners[p.second]) for p in touching))
        self._prepare()
        self._number_rows(None if count is None else int(checks.number("count", count, low=1)))

    # ---- compile
    def _add_shapes(self, collisions: Iterable[Geometry]) -> None:
        """All shapes of links and obstacles."""
        model = self.model
        links = {geometry.link for geometry in collisions}
        for geometry in collisions:
            frame = model.pinocchio.frames[model.frames[geometry.link]]
            origin = pin.SE3(geometry.origin.rotation, np.array(geometry.origin.xyz))
            self._add(geometry.link, frame.parentJoint, frame.placement * origin, geometry.shape)
        self._to_shape = []
        for obstacle in self._obstacles:
            if obstacle.name in self._owners:
                raise InvalidInput(
                    f"obstacle {obstacle.name!r} has the name of "
                    + ("a link" if obstacle.name in links else "another; each needs its own")
                )
            self._to_shape.append(self._add(obstacle.name, 0, obstacle.at(0.0), obstacle.shape))

    def _add(self, owner: str, joint: int, placement: Any, shape: Shape) -> Any:
        """Returns where the middle of the shape is in its own coordinates, an SE3."""
        body, middle = coal_shape(shape)
        body.computeLocalAABB()
        name = f"{owner}#{len(self._owners)}"
        self._geometry.addGeometryObject(pin.GeometryObject(name, joint, 0, placement * middle, body))
        self._owners.append(owner)
        return middle

    def _allow(self, pairs: Iterable[tuple[str, str]] | None, self_collision: bool) -> None:
        """Choose the pairs of shapes that are looked at."""
        joints = [shape.parentJoint for shape in self._geometry.geometryObjects]
        parents = self.model.pinocchio.parents
        wanted = None if pairs is None else self._named(pairs)
        for j, second in enumerate(joints):
            for i, first in enumerate(joints[:j]):
                names = frozenset((self._owners[i], self._owners[j]))
                is_self = not (self._is_obstacle(i) or self._is_obstacle(j))
                near = first == second or (is_self and (parents[second] == first or parents[first] == second))
                chosen = (self_collision or not is_self) if wanted is None else names in wanted
                if chosen and not near:
                    self._geometry.addCollisionPair(pin.CollisionPair(i, j))

    def _named(self, pairs: Iterable[tuple[str, str]]) -> set[frozenset[str]]:
        known, found = list(dict.fromkeys(self._owners)), set()
        for pair in pairs:
            for name in pair:
                if name not in known:
                    raise UnknownShape(name, known)
            found.add(frozenset(pair))
        return found

    def _is_obstacle(self, shape: int) -> bool:
        return shape >= len(self._owners) - len(self._obstacles)

    def _touching(self, margin: float) -> list[Any]:
        """Pairs of the robot's own shapes that are near in its reference configuration."""
        model, geometry = self.model, self._geometry
        data = memory_of(geometry)
        pin.updateGeometryPlacements(model.pinocchio, self._kinematics, geometry, data, np.array(model.q0))
        pin.computeDistances(geometry, data)
        return [
            pin.CollisionPair(pair.first, pair.second)
            for pair, result in zip(geometry.collisionPairs, data.distanceResults, strict=True)
            if result.min_distance <= margin and not (self._is_obstacle(pair.first) or self._is_obstacle(pair.second))
        ]

    def _prepare(self) -> None:
        """Everything of a constant size."""
        # Compiled; only who avoids collisions waits for it.
        from wbc.models.compiled.nearest import LINES
        from wbc.models.near_pairs import NearPairs

        model, geometry = self.model, self._geometry
        chosen = [(pair.first, pair.second) for pair in geometry.collisionPairs]
        if not chosen:
            raise InvalidInput(f"{model.name}: no pair of shapes is left to keep apart")
        #: Names of the two links, or link and obstacle, of each pair of shapes.
        self.pairs = tuple((self._owners[i], self._owners[j]) for i, j in chosen)
        number = {names: i for i, names in enumerate(dict.fromkeys(self.pairs))}
        self._near = NearPairs(
            model.pinocchio, geometry, [number[names] for names in self.pairs],
            reach=self.reach, margin=self.margin, ahead=self.ahead, close=self.close,
        )  # fmt: skip
        start = geometry.ngeoms - len(self._obstacles)
        moving = zip(range(start, geometry.ngeoms), self._obstacles, self._to_shape, strict=True)
        self._moving = {shape: (obstacle, middle) for shape, obstacle, middle in moving if obstacle.moves}
        self._lines = LINES

    def _number_rows(self, count: int | None) -> None:
        """Memory for so many rows."""
        from wbc.models.compiled.pair_rows import LAYOUT

        model, near = self.model.pinocchio, self._near
        pin.updateGeometryPlacements(model, self._kinematics, self._geometry, near.data, np.array(self.model.q0))
        lines = near.read(np.zeros((6, model.nv)), np.zeros(model.nv), speeds=False)
        if count is None:
            count = min(_ROWS + 2 * len(np.unique(lines // self._lines)), _MOST_ROWS)
        self.count = count = min(count, len(self.pairs) * (self._lines if self.close > -np.inf else 1))
        rows = LAYOUT.arrays(np.array([len(self.pairs) * self._lines, count, model.nv]))
        _, self._row_of, self.which, self.distance, self.jacobian, self.rate, self.drift = rows
        self.distance.fill(self.reach)
        self.which.fill(-1)
        self._row_of.fill(-1)  # the row that each pair had last; −1: none
        self._held, self.missing = self.which.copy(), 0  # the pair that had each row last
        near.write_to(rows)

    def reset(self) -> None:
        """Make all rows free, and forget what was measured."""
        self._near.forget()
        self._held.fill(-1)
        self._row_of.fill(-1)

    # ---- the tick
    def read(self, state: RobotState) -> None:
        """Measure the pairs of this state.

        Raises:
            InvalidInput: an obstacle has no pose at this time or beside it; what was measured before is kept.
        """
        J = state.joint_columns  # and with them the placements of the joints
        near = self._near
        near.numbers[2] = self.ahead
        pin.updateGeometryPlacements(self.model.pinocchio, state.data, self._geometry, near.data)
        for shape, (obstacle, middle) in self._moving.items():
            here = obstacle.at(state.t)
            near.data.oMg[shape], near.own[shape] = here * middle, _motion(obstacle, here, state.t)
        lines = near.read(J, state.v, speeds=state.drifts)
        self.missing = 0
        if (self._row_of[lines] < 0).any():
            self._give_rows(lines, near.soon)
        near.write()

    def _give_rows(self, lines: Index, soon: Vec) -> None:
        """Give rows to lines that have none; ``soon`` says how near each will be."""
        held, at = self._held, self._row_of[lines]
        taken = set(at.tolist())
        free = [row for row in range(self.count) if row not in taken]
        free.sort(key=lambda row: held[row] >= 0)  # rows that nobody has had come first
        order = np.argsort(soon, kind="stable")
        for i in order[at[order] < 0].tolist():
            if free:
                row = free.pop(0)
            else:
                with_row = np.flatnonzero(at >= 0)
                last = int(with_row[np.argmax(soon[with_row])])
                if soon[i] >= soon[last] - _NEARER * self.reach:
                    break
                row, at[last] = int(at[last]), -1
            if held[row] >= 0:
                self._row_of[held[row]] = -1
            at[i], held[row], self._row_of[lines[i]] = row, lines[i], row
        self.missing = len(np.unique(lines[at < 0] // self._lines))


def _motion(obstacle: Obstacle, here: Any, t: float) -> Vec:
    """Twist of an obstacle about the world's origin and its derivative (12,), at time t and the pose ``here``.

    Where the pose or its velocity jumps, the twist is the slower of the two before and after, and the derivative 0.
    """
    before = pin.log6(here * obstacle.at(t - _STEP).inverse()).vector / _STEP
    after = pin.log6(obstacle.at(t + _STEP) * here.inverse()).vector / _STEP
    change = (after - before) / _STEP
    if _speed(change, here) < _JUMPS:
        return np.concatenate([0.5 * (before + after), change])
    slower = before if _speed(before, here) <= _speed(after, here) else after
    return np.concatenate([slower, np.zeros(6)])


def _speed(twist: Vec, pose: Any) -> float:
    """The largest entry that a twist about the world's origin has about the middle of a pose."""
    return float(np.abs([*(twist[:3] + np.cross(twist[3:], pose.translation)), *twist[3:]]).max())


@final
class UnknownShape(UnknownName):
    """Neither a link with a collision shape nor an obstacle."""

    kind = "link or obstacle"


def _along(start: Mat, end: Mat, rate: float, t: float) -> Any:
    """The pose halfway between two places (N, 3), z towards the second."""
    k = min(max(round(t * rate), 0), len(start) - 1)
    turned = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), end[k] - start[k])
    return pin.SE3(turned.matrix(), 0.5 * (start[k] + end[k]))
