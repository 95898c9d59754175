"""Near pairs: each distance is proven from both sides, and what is not measured could not have been near."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import product
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from wbc.models.collision import Distances, Obstacle
from wbc.models.convex import tables
from wbc.models.geometry import Box, Cylinder, Sphere
from wbc.models.near_pairs import NearPairs
from wbc.testing import robots
from wbc.types import Mat, Vec

ARM, QUADRUPED, HUMANOID = robots()
SEEDS = st.integers(0, 2**32 - 1)
KINDS = ["ball", "box", "cylinder", "hull", "stone"]


def hull(points: Mat) -> Any:
    corners = coal.StdVec_Vec3s()
    for point in points[ConvexHull(points).vertices]:
        corners.append(point)
    return coal.ConvexBase.convexHull(corners, False, "Qt")


def shape_of(kind: str, rng: np.random.Generator) -> Any:
    """A shape of some centimetres or decimetres about the origin; a stone has hundreds of corners."""
    size = 10.0 ** rng.uniform(-2.0, -0.5, 3)
    if kind == "ball":
        return coal.Sphere(size[0])
    if kind == "box":
        return coal.Box(*size)
    if kind == "cylinder":
        return coal.Cylinder(size[0], size[1])
    points = rng.normal(size=(200 if kind == "stone" else 5, 3))
    if kind == "stone":
        points /= np.linalg.norm(points, axis=1)[:, None]
    return hull(np.vstack([points, -points]) * size)


def furthest(shape: Any, direction: Vec) -> float:
    """max direction · p over the points p of a shape, in its own axes."""
    if isinstance(shape, coal.Sphere):
        return float(shape.radius * np.linalg.norm(direction))
    if isinstance(shape, coal.Box):
        return float(np.abs(direction) @ shape.halfSide)
    if isinstance(shape, coal.Cylinder):
        return float(shape.radius * np.hypot(*direction[:2]) + shape.halfLength * abs(direction[2]))
    return float((np.array(shape.points()) @ direction).max())


def outside(shape: Any, point: Vec) -> float:
    """By how much a point, in the shape's own axes, is outside the shape; an upper bound of it for hulls."""
    if isinstance(shape, coal.Sphere):
        return float(np.linalg.norm(point) - shape.radius)
    if isinstance(shape, coal.Box):
        return float((np.abs(point) - shape.halfSide).max())
    if isinstance(shape, coal.Cylinder):
        return float(max(np.hypot(*point[:2]) - shape.radius, abs(point[2]) - shape.halfLength))
    faces = ConvexHull(np.array(shape.points())).equations
    return float((faces[:, :3] @ point + faces[:, 3]).max())


def placed(rng: np.random.Generator, far: float) -> Any:
    return pin.SE3(pin.exp3(rng.normal(size=3) * rng.choice([0.0, 1.0])), far * rng.normal(size=3))


def two(first: Any, second: Any, reach: float = 1e3, close: float = -np.inf, ahead: float = 0.0) -> NearPairs:
    """A pair of shapes in the world."""
    geometry = pin.GeometryModel()
    for name, shape in (("first", first), ("second", second)):
        geometry.addGeometryObject(pin.GeometryObject(name, 0, 0, pin.SE3.Identity(), shape))
    geometry.addCollisionPair(pin.CollisionPair(0, 1))
    return NearPairs(pin.Model(), geometry, [0], reach=reach, margin=0.0, ahead=ahead, close=close)


def carried(line: Vec, here: Any, there: Any) -> float:
    """How far the points of a line are apart in its direction, which turns with both shapes by half."""
    points = [new.act(old.actInv(line[i : i + 3])) for old, new, i in zip(here, there, (4, 7), strict=True)]
    n = np.sum([new.rotation @ old.rotation.T @ line[1:4] for old, new in zip(here, there, strict=True)], axis=0)
    return float((points[1] - points[0]) @ n / np.linalg.norm(n))


def between(near: NearPairs, first: Any, second: Any) -> Vec:
    near.data.oMg[0], near.data.oMg[1] = first, second
    assert found(near) == [0]
    return near.line[0]


def found(near: NearPairs) -> list[int]:
    return near.read(np.zeros((6, 0)), np.zeros(0), speeds=False).tolist()


@given(SEEDS, st.sampled_from(list(product(KINDS, KINDS))))
def test_a_distance_is_proven_from_both_sides(seed: int, kinds: tuple[str, str]):
    """The points are in the shapes, d apart along the normal, and the shapes are d apart in that direction."""
    rng = np.random.default_rng(seed)
    shapes = [shape_of(kind, rng) for kind in kinds]
    near = two(*shapes)
    for far in (1.0, 0.3, 1.0):
        poses = [placed(rng, far) for _ in shapes]
        line = between(near, *poses)
        d, n, points = line[0], line[1:4], (line[4:7], line[7:10])
        if d < 1e-5:
            continue
        assert np.linalg.norm(n) == pytest.approx(1.0, abs=1e-12)
        np.testing.assert_allclose(points[1] - points[0], d * n, atol=1e-9)
        for shape, pose, point in zip(shapes, poses, points, strict=True):
            assert outside(shape, pose.actInv(point)) < 1e-9
        tops = [
            furthest(shape, pose.rotation.T @ (sign * n)) + sign * n @ pose.translation
            for shape, pose, sign in zip(shapes, poses, (1.0, -1.0), strict=True)
        ]
        assert -sum(tops) > d - 1e-9


@given(SEEDS, st.sampled_from(list(product(KINDS, KINDS))))
def test_inside_one_another_coal_is_asked(seed: int, kinds: tuple[str, str]):
    rng = np.random.default_rng(seed)
    near = two(*(shape_of(kind, rng) for kind in kinds))
    line = between(near, *(placed(rng, 0.0) for _ in kinds))
    result = near.data.distanceResults[0]
    assert line[0] < 0.0
    assert line[0] == result.min_distance


@settings(max_examples=5)
@given(SEEDS, st.booleans())
def test_faces_that_are_parallel_but_for_rounding_have_a_proof_too(seed: int, round_ones: bool):
    """But for one in a hundred, which coal is asked for."""
    rng, asked = np.random.default_rng(seed), list[int]()
    for _ in range(60):
        sizes = rng.uniform(0.02, 0.2, (2, 3))
        if rng.random() < 0.4:
            sizes[1] = sizes[0]
        shapes, axis = [coal.Box(*size) for size in sizes], rng.integers(3)
        for i in range(2):
            if round_ones and (i or rng.random() < 0.5):
                sizes[i, 1] = sizes[i, 0]
                shapes[i] = coal.Cylinder(0.5 * sizes[i, 0], sizes[i, 2])
        near = two(*shapes)
        near._here.of = partial(noted, asked, near._here.of)  # type: ignore[method-assign]
        base = pin.exp3(rng.normal(size=3))
        for _ in range(10):  # the first begins the searches of the others
            up = np.where(np.arange(3) == axis, 0.5 * sizes.sum(axis=0) + 0.03, rng.choice([0.0, 1e-9, 1e-3], size=3))
            tilt = pin.SE3(pin.exp3(10.0 ** rng.uniform(-17.0, -3.0) * rng.normal(size=3)), up)
            first = pin.SE3(base, 0.3 * rng.normal(size=3))
            near.data.oMg[0], near.data.oMg[1] = first, first * tilt
            found(near)
    assert len(asked) <= 6


def noted(asked: list[int], ask: Callable[[int], float], pair: int) -> float:
    asked.append(pair)
    return ask(pair)


@given(SEEDS, st.sampled_from(["box", "hull", "stone"]))
def test_climbing_along_edges_ends_at_the_furthest_corner(seed: int, kind: str):
    """A ball far away sees the corner that is furthest in its direction, or what is beside it on a face."""
    rng = np.random.default_rng(seed)
    shape, ball = shape_of(kind, rng), coal.Sphere(1e-3)
    near = two(shape, ball)
    for _ in range(10):
        direction = rng.normal(size=3)
        direction *= 1e3 / np.linalg.norm(direction)
        d = between(near, pin.SE3.Identity(), pin.SE3(np.eye(3), direction))[0]
        corners = tables([shape])[0][3]
        assert d <= np.linalg.norm(corners - direction, axis=1).min() - 1e-3 + 1e-9
        assert d >= 1e3 - (corners @ direction).max() / 1e3 - 1e-3 - 1e-9


@pytest.mark.parametrize("turns", [False, True])
def test_what_comes_straight_at_another_is_found_in_the_tick_that_it_is_near(turns: bool):
    """The end of a thin bar comes at a ball, along a line or an arc: the bound has nothing to spare, and is enough."""
    near = two(coal.Box(2.0, 1e-3, 1e-3), coal.Sphere(1e-3), reach=0.1)
    way, asked = np.linspace(0.0, 0.5, 501), 0
    ball = pin.SE3(np.eye(3), np.array([np.cos(0.5), np.sin(0.5), 0.0] if turns else [1.5, 0.0, 0.0]))
    for s in way:
        bar = pin.SE3(pin.exp3(np.array([0.0, 0.0, s])), np.zeros(3)) if turns else pin.SE3(np.eye(3), s * np.eye(3)[0])
        near.data.oMg[0], near.data.oMg[1] = bar, ball
        before = near.measured.copy()
        at_once = found(near)
        asked += int((near.measured != before).sum())
        fresh = two(coal.Box(2.0, 1e-3, 1e-3), coal.Sphere(1e-3), reach=0.1)
        fresh.data.oMg[0], fresh.data.oMg[1] = bar, ball
        assert at_once == found(fresh)
    assert at_once and asked < 130


@pytest.mark.parametrize(
    ("rotation", "place"),
    [(np.eye(3), [np.nan, 0, 0]), (np.full((3, 3), np.nan), [3, 0, 0]), (np.eye(3), [1e200, 0, 0]),
     (np.eye(3), [1e15, 0, 0]), (np.eye(3), [3e10, 0, 0])],
)  # fmt: skip
def test_what_had_no_place_is_measured_again(rotation: Mat, place: Any):
    """It comes back just within reach, where a way with few digits, or none, would hide it."""
    near, fresh = (two(coal.Sphere(0.1), coal.Box(0.2, 0.2, 0.2), reach=0.1) for _ in range(2))
    far, here = (pin.SE3(np.eye(3), np.array([x, 0.0, 0.0])) for x in (0.4, 0.3 - 1e-8))
    lost = pin.SE3(rotation, np.array(place, dtype=np.float64))
    for first in 2 * [far, lost, here]:
        near.data.oMg[0], near.data.oMg[1] = first, pin.SE3.Identity()
        seen = found(near)
    assert seen == [0]
    assert (near.line[0] == between(fresh, here, pin.SE3.Identity())).all()


def things(rng: np.random.Generator) -> list[Obstacle]:
    """Shapes that fly and turn, straight on, at the robot."""
    flying = []
    for i, shape in enumerate((Sphere(0.05), Box((0.3, 0.05, 0.02)), Cylinder(0.03, 0.4))):
        start, turning = rng.normal(size=3), rng.normal(size=3)

        def pose(t: float, start: Vec = start, turning: Vec = turning) -> Any:
            return pin.SE3(pin.exp3(turning * t), start * (1.0 - t))

        flying.append(Obstacle(f"thing {i}", shape, pose))
    return flying


@pytest.mark.slow
@settings(max_examples=10)
@given(SEEDS, st.sampled_from([ARM, QUADRUPED, HUMANOID]))
def test_asking_few_pairs_says_what_asking_all_says(seed: int, robot: Any):
    """Along walks and jumps, with things that fly at the robot: the same pairs, and the same bits of each."""
    rng = np.random.default_rng(seed)
    drifts = bool(rng.integers(2))
    settings = {"count": 10_000, "reach": 0.1, "margin": 0.02, "ahead": 0.1, "close": 0.05}
    few, everything = (Distances(robot, obstacles=things(np.random.default_rng(seed)), **settings) for _ in range(2))
    state, q, t, asked = robot.state(drifts=drifts), np.array(robot.q0), 0.0, 0
    v = 0.3 * rng.normal(size=robot.nv)
    for _ in range(40):
        q = robot.integrate(q, v * 0.01 if rng.random() < 0.95 else rng.normal(size=robot.nv))
        t += 0.02 if rng.random() < 0.95 else rng.normal()
        state.update(t, q, v)
        before = few._near.measured.copy()
        few.read(state)
        asked += int((few._near.measured != before).sum())
        everything._near.measured.fill(-np.inf)
        everything.read(state)
        said = [[x.tobytes() for x in (d.which, d.distance, d.jacobian, d.rate, d.drift)] for d in (few, everything)]
        assert said[0] == said[1]
    assert asked < 40 * len(few.pairs)
