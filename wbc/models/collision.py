"""Distances between the shapes of a robot, and between them and obstacles: the nearest pairs, with their derivatives.

Distances and witness points are coal's, placements Pinocchio's. Spheres around all shapes are compared first, in one
product, then boxes along the line between two middles, so that few pairs are measured. Meshes stand for their convex
hulls.
"""

from __future__ import annotations

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

# Curved shapes get their distance by iteration. To a looser tolerance their normals shake; a tighter one of the
# penetration depth (EPA) has no floats left.
_DISTANCE_TOLERANCE, _DEPTH_TOLERANCE, _ITERATIONS = 1e-12, 1e-6, 256
#: Time step of second differences [s].
_STEP = 1e-4
# Where the nearest features change, e.g. from one edge to another, a second difference is a jump and no curvature: what
# is beyond that of shapes of a few centimetres [1/m] counts as none.
_MOST_CURVATURE = 30.0


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
    """The ``count`` nearest pairs of shapes within ``reach`` [m], for one model.

    ``read(state)`` fills, row by row in the order of ``pairs``:

    which (count,)         index of the pair, −1 where fewer are within reach
    distance (count,)      d [m], negative inside one another; ``reach`` where there is no pair
    jacobian (count, nv)   ∂d/∂q = nᵀ (J₂ − J₁) at the witness points, n the unit normal from the first to the second
    rate (count,)          ∂d/∂t of obstacles that move
    drift (count,)         d²d/dt² at a = 0: second difference along q ⊕ s v at t + s; NaN in states without drifts

    A pair of links has one row at most, that of its nearest shapes.

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
    ) -> None:
        if not isinstance(model, PinocchioModel) or not model.collisions:
            raise NotSupported(f"{model.name} has no collision shapes, so nothing is known about distances")
        self.model, self.reach = model, checks.number("reach", reach, low=0.0, strict=True)
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
                near = first == second or (first and parents[second] == first) or (second and parents[first] == second)
                is_self = not (self._is_obstacle(i) or self._is_obstacle(j))
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
        for request in data.distanceRequests:
            request.gjk_tolerance, request.gjk_max_iterations = _DISTANCE_TOLERANCE, _ITERATIONS
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
        groups = {names: i for i, names in enumerate(dict.fromkeys(self.pairs))}
        self._group = [groups[names] for names in self.pairs]
        self.count = count = min(count, len(groups))
        self.which: Index = np.full(count, -1, dtype=np.intp)
        self.distance, self.rate, self.drift = np.full(count, self.reach), np.zeros(count), np.zeros(count)
        self.jacobian = np.zeros((count, nv))
        # ∂d/∂q = wᵀ J with w = (n, p × n), one line of force through both witness points, J the columns about the
        # world's origin: those that move the second shape count +, those that move the first −.
        moved = np.array([self._moved_by(shape.parentJoint) for shape in geometry.geometryObjects])
        self._sign = np.array([moved[j] - moved[i] for i, j in chosen])
        self._lines = np.zeros((count, 6))
        # |cᵢ − cⱼ|² = (−2 cᵢ, |cᵢ|², 1) · (cⱼ, 1, |cⱼ|²), in one product for all; compared with (rᵢ + rⱼ + reach)²
        self._left, self._right = np.ones((n, 5)), np.ones((n, 5))
        shapes = [shape.geometry for shape in geometry.geometryObjects]
        self._radii = np.array([shape.aabb_radius for shape in shapes])
        self._half_edges = np.array([0.5 * (shape.aabb_local.max_ - shape.aabb_local.min_) for shape in shapes])
        self._near = np.full((n, n), -np.inf)
        self._pair_at = np.zeros(n * n, dtype=np.intp)
        for k, (i, j) in enumerate(chosen):
            self._near[i, j] = (self._radii[i] + self._radii[j] + self.reach) ** 2
            self._pair_at[i * n + j] = k
        self._between = np.zeros((n, n))
        self._first, self._second = np.array(chosen, dtype=np.intp).T
        self._centres, self._axes = _placements(data)
        self._results = [data.distanceResults[k] for k in range(len(chosen))]
        self._results_beside = [self._beside.distanceResults[k] for k in range(len(chosen))]
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
        """Measure the nearest pairs of this state."""
        assert isinstance(state, PinocchioState)
        J = state.joint_columns  # and with them the placements of the joints
        geometry, data = self._geometry, self._data
        self._place_obstacles(data, state.t)
        pin.updateGeometryPlacements(self.model.pinocchio, state.data, geometry, data)
        self._place_obstacles(data, state.t)
        near = self._nearest()
        k = len(near)
        self.which[:k], self.which[k:] = near, -1
        self.distance[k:], self.jacobian[k:], self.rate[:], self.drift[:] = self.reach, 0.0, 0.0, 0.0
        if not state.drifts:
            self.drift[:] = np.nan
        if not k:
            return
        lines = self._lines
        for row, pair in enumerate(near):
            result = self._results[pair]
            nx, ny, nz = result.normal.tolist()
            px, py, pz = result.getNearestPoint1().tolist()
            self.distance[row] = result.min_distance
            lines[row] = nx, ny, nz, py * nz - pz * ny, pz * nx - px * nz, px * ny - py * nx
        rows = self.jacobian[:k]
        np.dot(lines[:k], J, rows)
        rows *= self._sign[near]
        if self._moving:
            self._read_rates(near, state.t)
        if state.drifts:
            self._read_drifts(near, state)

    def _nearest(self) -> list[int]:
        """The pairs that are nearest, within reach, in the order of ``pairs``: rows keep their pair while they can."""
        centres, left, right = self._centres, self._left, self._right
        np.multiply(centres, -2.0, left[:, :3])
        square = np.einsum("ij,ij->i", centres, centres)
        left[:, 3] = right[:, 4] = square
        right[:, :3] = centres
        np.dot(left, right.T, self._between)
        maybe = self._pair_at[np.flatnonzero(self._between < self._near)]
        if not len(maybe):
            return []
        bounds = self._at_least(maybe)
        order = np.argsort(bounds)
        geometry, data, results, group = self._geometry, self._data, self._results, self._group
        best: dict[int, tuple[float, int]] = {}
        furthest = self.reach
        for bound, pair in zip(bounds[order].tolist(), maybe[order].tolist(), strict=True):
            if bound >= furthest:
                break
            pin.computeDistance(geometry, data, pair)
            d, links = results[pair].min_distance, group[pair]
            if d < furthest and (links not in best or d < best[links][0]):
                best[links] = (d, pair)
                if len(best) >= self.count:
                    furthest = sorted(best.values())[self.count - 1][0]
        chosen = sorted(best.values())[: self.count]
        return sorted(pair for _, pair in chosen)

    def _at_least(self, pairs: Index) -> Vec:
        """A bound from below on the distance of each pair: boxes around both, seen along the line of their middles."""
        i, j = self._first[pairs], self._second[pairs]
        line = self._centres[j] - self._centres[i]
        apart = np.sqrt(np.einsum("ka,ka->k", line, line))
        line /= np.maximum(apart, 1e-12)[:, None]
        for side in (i, j):
            seen = np.abs(np.einsum("kab,ka->kb", self._axes[side], line))
            apart -= np.minimum(np.einsum("kb,kb->k", seen, self._half_edges[side]), self._radii[side])
        return np.asarray(apart)

    def _place_obstacles(self, data: Any, t: float) -> None:
        for shape, (obstacle, middle) in self._moving.items():
            data.oMg[shape] = obstacle.at(t) * middle

    def _read_rates(self, near: list[int], t: float) -> None:
        for row, pair in enumerate(near):
            for shape, sign in zip(self._shapes[pair], (-1.0, 1.0), strict=True):
                if shape in self._moving:
                    obstacle, result = self._moving[shape][0], self._results[pair]
                    point = result.getNearestPoint2() if sign > 0 else result.getNearestPoint1()
                    inside = obstacle.at(t).actInv(point)
                    velocity = (obstacle.at(t + _STEP).act(inside) - obstacle.at(t - _STEP).act(inside)) / (2.0 * _STEP)
                    self.rate[row] += sign * float(result.normal @ velocity)

    def _read_drifts(self, near: list[int], state: PinocchioState) -> None:
        """(d(+s) − 2 d + d(−s)) / s²: exact kinematics and the curvature of the shapes in one."""
        model, geometry, beside, drift = self.model.pinocchio, self._geometry, self._beside, self.drift
        k = len(near)
        np.multiply(self.distance[:k], -2.0, drift[:k])
        for s in (_STEP, -_STEP):
            q = pin.integrate(model, state.q, s * state.v)
            pin.updateGeometryPlacements(model, self._kinematics, geometry, beside, q)
            self._place_obstacles(beside, state.t + s)
            for row, pair in enumerate(near):
                pin.computeDistance(geometry, beside, pair)
                drift[row] += self._results_beside[pair].min_distance
        drift[:k] /= _STEP**2
        drift[np.abs(drift) > _MOST_CURVATURE * self._speed_squared(state)] = 0.0

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
    """The shape in coal's terms about the middle of its box, and where that middle is: an SE3."""
    still = pin.SE3.Identity()
    if isinstance(shape, Box):
        return coal.Box(*shape.size), still
    if isinstance(shape, Sphere):
        return coal.Sphere(shape.radius), still
    if isinstance(shape, Cylinder):
        return coal.Cylinder(shape.radius, shape.length), still
    points = np.array(coal.MeshLoader().load(str(shape.path), np.array(shape.scale)).vertices())
    still.translation = 0.5 * (points.min(axis=0) + points.max(axis=0))
    corners = coal.StdVec_Vec3s()
    for point in points - still.translation:
        corners.append(point)
    return coal.ConvexBase.convexHull(corners, False, "Qt"), still


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
