"""Distances between the shapes of a robot, and between them and obstacles: the nearest pairs, with their derivatives.

Distances and witness points are coal's, placements Pinocchio's. A pair that was far cannot be near before its shapes
have moved as far, so few pairs are measured in a tick. Meshes stand for their convex hulls.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, final

import coal
import numpy as np
import pinocchio as pin

from wbc import checks
from wbc.errors import InvalidInput, NotSupported, UnknownName
from wbc.models.geometry import Box, Cylinder, Geometry, Shape, Sphere
from wbc.models.model import RobotModel, RobotState
from wbc.models.pinocchio_ import PinocchioModel
from wbc.models.pinocchio_state import PinocchioState
from wbc.models.separation import always_apart
from wbc.types import Index, Mat, Vec

# Curved shapes get their distance by iteration. To a looser tolerance their normals shake; to this one it fails once in
# a million times, says so by an absurd number, and is asked again. The penetration depth (EPA) has no floats for more.
_TIGHT, _LOOSE, _DEPTH_TOLERANCE, _ITERATIONS = 1e-11, 1e-6, 1e-6, 256
_ABSURD = 1e6
#: Rounding of sums of ways [m].
_ROUNDING = 1e-9
#: Time step of second differences [s].
_STEP = 1e-4
# Where the nearest features change, e.g. from one edge to another, a second difference is a jump and no curvature: what
# is beyond that of shapes of a few centimetres [1/m] counts as none.
_MOST_CURVATURE = 30.0
#: Two halves of a second difference that are further apart [m/s²] have a jump in one of them.
_JUMP = 0.5


@final
@dataclass(frozen=True)
class Obstacle:
    """Something in the world to keep away from: a shape at ``pose``, an SE3, or a function of time [s] giving one.

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

    def __post_init__(self) -> None:
        if not isinstance(self.shape, Shape):
            raise InvalidInput(f"obstacle {self.name!r}: {self.shape!r} is no Box, Sphere, Cylinder or Mesh")
        if not isinstance(self.at(0.0), pin.SE3):
            raise InvalidInput(f"obstacle {self.name!r}: a pose is a pinocchio.SE3 or a function of time giving one")

    @property
    def moves(self) -> bool:
        """Whether the pose is a function of time."""
        return callable(self.pose)

    def at(self, t: float) -> Any:
        """The pose at time t [s]."""
        return self.pose(t) if callable(self.pose) else self.pose


@final
class Distances:
    """The ``count`` most critical pairs of shapes within ``reach`` [m], for one model.

    ``read(state)`` fills, row by row in the order of ``pairs``:

    which (count,)         index of the pair, −1 where fewer are within reach
    distance (count,)      d [m], negative inside one another; ``reach`` where there is no pair
    jacobian (count, nv)   ∂d/∂q = nᵀ (J₂ − J₁) at the witness points, n the unit normal from the first to the second
    rate (count,)          ∂d/∂t of obstacles that move
    drift (count,)         d²d/dt² at a = 0: second difference along q ⊕ s v at t + s; NaN in states without drifts

    Where more are within reach, those count that would be nearest after ``ahead`` [s] at the velocity of now. What is
    filled depends on the state alone; what was measured before only spares work. The first reading measures all pairs.

    Left out are shapes that no joint moves against each other, those of neighbouring links, and what two joints or
    fewer cannot bring within ``margin``. With ``pairs=None`` also what is nearer than that in the reference
    configuration: such links overlap by construction, ``excluded`` lists them.

    Args:
        model: a robot from :func:`wbc.models.load`.
        pairs: pairs of names of links and obstacles to look at; None: all.
        obstacles: what stands in the world.
        self_collision: with ``pairs=None``, whether links are kept apart from links.

    Raises:
        NotSupported: the model has no shapes.
        UnknownName: a pair names neither a link with a shape nor an obstacle.
        InvalidInput: two obstacles of one name, a link named like one, no pair left.

    Source: ∂d/∂q by the envelope theorem (Gilbert, Johnson, IEEE J. Robotics Automation 1985).

    Example:
        >>> import wbc
        >>> from wbc.models.collision import Distances
        >>> robot = wbc.load("arm")
        >>> distances = Distances(robot, count=2, reach=1.0)
        >>> distances.read(robot.state())
        >>> distances.pairs[distances.which[0]], bool(distances.distance[0] > 0)
        (('upper_arm', 'forearm'), True)
    """

    def __init__(
        self,
        model: RobotModel,
        *,
        pairs: Iterable[tuple[str, str]] | None = None,
        obstacles: Sequence[Obstacle] = (),
        self_collision: bool = True,
        count: int = 4,
        reach: float = 0.2,
        margin: float = 0.0,
        ahead: float = 0.0,
    ) -> None:
        if not isinstance(model, PinocchioModel) or not model.collisions:
            raise NotSupported(f"{model.name} has no collision shapes, so nothing is known about distances")
        self.model, self.reach = model, checks.number("reach", reach, low=0.0, strict=True)
        self.ahead = checks.number("ahead", ahead, low=0.0)
        self._obstacles = tuple(obstacles)
        self._geometry = pin.GeometryModel()
        self._owners: list[str] = []
        self._add_shapes(model.collisions)
        self._allow(pairs, self_collision)
        self._kinematics = model.pinocchio.createData()
        touching = self._touching(margin) if pairs is None else []
        first = len(self._owners) - len(self._obstacles)
        moving = frozenset(first + i for i, obstacle in enumerate(self._obstacles) if obstacle.moves)
        low, high = model.limits.q_min, model.limits.q_max
        apart = always_apart(model.pinocchio, self._geometry, low, high, margin, moving=moving)
        for pair in [*touching, *apart]:
            self._geometry.removeCollisionPair(pair)
        self.excluded = tuple(dict.fromkeys((self._owners[p.first], self._owners[p.second]) for p in touching))
        self._data, self._beside = self._memory(), self._memory()
        self._prepare(int(checks.number("count", count, low=1)))

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
        body, middle = _coal(shape)
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

    def _memory(self) -> Any:
        data = self._geometry.createData()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # the only way there is to switch the cache off
            for request in data.distanceRequests:
                # A guess from the last call would make distances depend on what was measured before, and fail at times.
                request.enable_cached_gjk_guess = False
        for request in data.distanceRequests:
            request.gjk_tolerance, request.gjk_max_iterations = _TIGHT, _ITERATIONS
            request.epa_tolerance, request.epa_max_iterations = _DEPTH_TOLERANCE, _ITERATIONS
        return data

    def _touching(self, margin: float) -> list[Any]:
        """Pairs of the robot's own shapes that are near in its reference configuration."""
        model, geometry, data = self.model, self._geometry, self._memory()
        pin.updateGeometryPlacements(model.pinocchio, self._kinematics, geometry, data, np.array(model.q0))
        pin.computeDistances(geometry, data)
        return [
            pin.CollisionPair(pair.first, pair.second)
            for pair, result in zip(geometry.collisionPairs, data.distanceResults, strict=True)
            if result.min_distance <= margin and not (self._is_obstacle(pair.first) or self._is_obstacle(pair.second))
        ]

    def _prepare(self, count: int) -> None:
        """Everything of a constant size."""
        model, geometry, data = self.model, self._geometry, self._data
        chosen = [(pair.first, pair.second) for pair in geometry.collisionPairs]
        if not chosen:
            raise InvalidInput(f"{model.name}: no pair of shapes is left to keep apart")
        #: Names of the two links, or link and obstacle, of each pair of shapes.
        self.pairs = tuple((self._owners[i], self._owners[j]) for i, j in chosen)
        n, nv = geometry.ngeoms, model.nv
        self.count = count = min(count, len(chosen))
        self.which: Index = np.full(count, -1, dtype=np.intp)
        self.distance, self.rate, self.drift = np.full(count, self.reach), np.zeros(count), np.zeros(count)
        self.jacobian = np.zeros((count, nv))
        # ∂d/∂q = wᵀ J with w = (n, p × n), one line of force through both witness points, J the columns about the
        # world's origin: those that move the second shape count +, those that move the first −.
        moved = np.array([self._moved_by(shape.parentJoint) for shape in geometry.geometryObjects])
        self._first, self._second = np.array(chosen, dtype=np.intp).T
        self._sign = moved[self._second] - moved[self._first]
        # A shape that has come a way of s since then is s nearer to anything at most: ``until`` is the sum of the ways
        # of both shapes before which a pair cannot be within reach.
        self._centres, self._axes = _placements(data)
        self._radii = np.array([shape.geometry.aabb_radius for shape in geometry.geometryObjects])
        self._way = np.zeros(n)
        pin.updateGeometryPlacements(model.pinocchio, self._kinematics, geometry, data, np.array(model.q0))
        self._last_centres, self._last_axes = self._centres.copy(), self._axes.copy()
        self._until = np.full(len(chosen), -np.inf)
        self._results = [data.distanceResults[k] for k in range(len(chosen))]
        first = n - len(self._obstacles)
        moving = zip(range(first, n), self._obstacles, self._to_shape, strict=True)
        self._moving = {shape: (obstacle, middle) for shape, obstacle, middle in moving if obstacle.moves}
        self._shapes = chosen

    def _moved_by(self, joint: int) -> Vec:
        """1 for each velocity that moves ``joint``."""
        model = self.model.pinocchio
        moved = np.zeros(model.nv)
        while joint:
            moved[model.idx_vs[joint] : model.idx_vs[joint] + model.nvs[joint]] = 1.0
            joint = model.parents[joint]
        return moved

    # ---- the tick
    def read(self, state: RobotState) -> None:
        """Measure the most critical pairs of this state."""
        assert isinstance(state, PinocchioState)
        J = state.joint_columns  # and with them the placements of the joints
        pin.updateGeometryPlacements(self.model.pinocchio, state.data, self._geometry, self._data)
        self._place_obstacles(self._data, state.t)
        self.which[:], self.distance[:], self.jacobian[:] = -1, self.reach, 0.0
        self.rate[:], self.drift[:] = 0.0, 0.0 if state.drifts else np.nan
        near, measured = self._within_reach()
        if not near:
            return
        distances = np.array(measured)
        rows = np.dot([_line(self._results[pair]) for pair in near], J)
        rows *= self._sign[near]
        rates = self._rates(near, state.t) if self._moving else np.zeros(len(near))
        if len(near) > self.count:
            soon = distances + self.ahead * (rows @ state.v + rates)
            worst = np.sort(np.argsort(soon, kind="stable")[: self.count])
            near = [near[i] for i in worst]
            distances, rows, rates = distances[worst], rows[worst], rates[worst]
        k = len(near)
        self.which[:k], self.distance[:k], self.jacobian[:k], self.rate[:k] = near, distances, rows, rates
        if state.drifts:
            self._read_drifts(near, state)

    def _within_reach(self) -> tuple[list[int], list[float]]:
        """All pairs within reach, in the order of ``pairs`` so that rows keep theirs while they can, and distances."""
        way, centres, axes = self._way, self._centres, self._axes
        moved = centres - self._last_centres
        turned = (axes - self._last_axes).reshape(len(way), 9)
        way += np.sqrt(np.einsum("ij,ij->i", moved, moved))
        way += np.sqrt(np.einsum("ij,ij->i", turned, turned)) * self._radii
        self._last_centres[:], self._last_axes[:] = centres, axes
        since = way[self._first]
        since += way[self._second]
        near, measured = [], []
        for pair in np.flatnonzero(self._until <= since).tolist():
            d = self._measured(self._data, pair)
            if d < self.reach:
                near.append(pair)
                measured.append(d)
            self._until[pair] = since[pair] + d - self.reach - _ROUNDING
        return near, measured

    def _measured(self, data: Any, pair: int) -> float:
        """The distance; to a looser tolerance where the tight one was too much.

        Where neither is enough, the shapes count as touching.
        """
        pin.computeDistance(self._geometry, data, pair)
        d = float(data.distanceResults[pair].min_distance)
        if -_ABSURD < d < _ABSURD:
            return d
        request = data.distanceRequests[pair]
        request.gjk_tolerance = _LOOSE
        pin.computeDistance(self._geometry, data, pair)
        request.gjk_tolerance = _TIGHT
        d = float(data.distanceResults[pair].min_distance)
        return d if -_ABSURD < d < _ABSURD else 0.0

    def _place_obstacles(self, data: Any, t: float) -> None:
        for shape, (obstacle, middle) in self._moving.items():
            data.oMg[shape] = obstacle.at(t) * middle

    def _rates(self, near: list[int], t: float) -> Vec:
        """∂d/∂t by the obstacles' own motion."""
        rates = np.zeros(len(near))
        for row, pair in enumerate(near):
            for shape, sign in zip(self._shapes[pair], (-1.0, 1.0), strict=True):
                if shape in self._moving:
                    obstacle, result = self._moving[shape][0], self._results[pair]
                    point = result.getNearestPoint2() if sign > 0 else result.getNearestPoint1()
                    inside = obstacle.at(t).actInv(point)
                    velocity = (obstacle.at(t + _STEP).act(inside) - obstacle.at(t - _STEP).act(inside)) / (2.0 * _STEP)
                    rates[row] += sign * float(result.normal @ velocity)
        return rates

    def _read_drifts(self, near: list[int], state: PinocchioState) -> None:
        """(d(+s) − 2 d + d(−s)) / s²: exact kinematics and the curvature of the shapes in one."""
        model, geometry, beside, k = self.model.pinocchio, self._geometry, self._beside, len(near)
        d = self.distance[:k]
        speed = self.jacobian[:k] @ state.v + self.rate[:k]
        halves = []
        for s in (_STEP, -_STEP):
            q = pin.integrate(model, state.q, s * state.v)
            pin.updateGeometryPlacements(model, self._kinematics, geometry, beside, q)
            self._place_obstacles(beside, state.t + s)
            there = np.array([self._measured(beside, pair) for pair in near])
            halves.append((there - d - s * speed) * (2.0 / _STEP**2))
        ahead, behind = halves
        drift = 0.5 * (ahead + behind)
        # Where other features become the nearest on one side, the other knows the curvature; where on both, nobody.
        jumps = np.abs(ahead - behind) > _JUMP
        drift[jumps] = np.where(np.abs(ahead) < np.abs(behind), ahead, behind)[jumps]
        drift[np.abs(drift) > _MOST_CURVATURE * self._speed_squared(state)] = 0.0
        self.drift[:k] = drift

    def _speed_squared(self, state: PinocchioState) -> float:
        """The largest entry of v, and of a velocity of each moving obstacle, squared."""
        speed = float(np.abs(state.v).max())
        for obstacle, _ in self._moving.values():
            step = obstacle.at(state.t).actInv(obstacle.at(state.t + _STEP))
            speed = max(speed, float(np.abs(pin.log6(step).vector).max()) / _STEP)
        return speed**2


@final
class UnknownShape(UnknownName):
    """Neither a link with a collision shape nor an obstacle."""

    kind = "link or obstacle"


def _coal(shape: Shape) -> tuple[Any, Any]:
    """The shape in coal's terms about the middle of its box, and where that middle is: an SE3.

    Raises:
        InvalidInput: a mesh that spans no volume.
    """
    from scipy.spatial import ConvexHull, QhullError

    still = pin.SE3.Identity()
    if isinstance(shape, Box):
        return coal.Box(*shape.size), still
    if isinstance(shape, Sphere):
        return coal.Sphere(shape.radius), still
    if isinstance(shape, Cylinder):
        return coal.Cylinder(shape.radius, shape.length), still
    points = np.array(coal.MeshLoader().load(str(shape.path), np.array(shape.scale)).vertices())
    still.translation = 0.5 * (points.min(axis=0) + points.max(axis=0))
    try:
        outermost = ConvexHull(points).vertices
    except (QhullError, ValueError):  # before coal, which a flat hull kills with the whole process
        raise InvalidInput(f"{shape.path.name} has no convex hull: its points span no volume") from None
    corners = coal.StdVec_Vec3s()
    for point in points[outermost] - still.translation:
        corners.append(point)
    return coal.ConvexBase.convexHull(corners, False, "Qt"), still


def _line(result: Any) -> tuple[float, ...]:
    """The line of force (6,) along the normal through the witness points, about the world's origin."""
    nx, ny, nz = result.normal.tolist()
    px, py, pz = result.getNearestPoint1().tolist()
    return nx, ny, nz, py * nz - pz * ny, pz * nx - px * nz, px * ny - py * nx


def _placements(data: Any) -> tuple[Mat, Any]:
    """Origins (n, 3) and rotations (n, 3, 3) of all shapes, live views: they lie in memory one behind the other."""
    origins = [_address(placement.translation) for placement in data.oMg]
    first, n = data.oMg[0], len(origins)
    stride = origins[1] - origins[0] if n > 1 else 96
    assert origins == [origins[0] + i * stride for i in range(n)], "placements are not one behind the other"
    return (
        np.asarray(_Memory(origins[0], (n, 3), (stride, 8), data)),
        np.asarray(_Memory(_address(first.rotation), (n, 3, 3), (stride, 8, 24), data)),
    )


def _address(array: Any) -> int:
    return int(array.__array_interface__["data"][0])


class _Memory:
    """A strided view of memory that keeps its owner alive."""

    def __init__(self, start: int, shape: tuple[int, ...], strides: tuple[int, ...], owner: object) -> None:
        self.__array_interface__ = {
            "data": (start, True), "shape": shape, "strides": strides, "typestr": "<f8", "version": 3,
        }  # fmt: skip
        self._owner = owner
