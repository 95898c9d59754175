"""Features: cylinders as sharp as hulls; second derivatives of distances beside differences of distances in time."""

from __future__ import annotations

from itertools import product
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.models.test_near_pairs import KINDS, SEEDS, between, carried, found, hull, outside, placed, shape_of, two
from wbc.models.collision import Distances, Obstacle
from wbc.models.compiled.nearest import LINES
from wbc.models.geometry import Box
from wbc.models.near_pairs import NearPairs
from wbc.testing import moments, robots
from wbc.types import Mat, Vec

_STEP = 1e-4


def moved(pose: Any, motion: Vec, t: float) -> Any:
    """Where a pose is after t [s], to t³: by a twist about the world's origin and its derivative (12,)."""
    return pin.exp6(pin.Motion(t * motion[:6] + 0.5 * t * t * motion[6:])) * pose


def moving(shapes: list[Any], poses: list[Any], motions: Mat, close: float = -np.inf) -> NearPairs:
    """Measured with speeds; the motions (2, 12) are twists about the world's origin, and their derivatives."""
    near = two(*shapes, close=close)
    near.data.oMg[0], near.data.oMg[1] = poses
    near.own[:] = motions
    near.read(np.zeros((6, 0)), np.zeros(0), speeds=True)
    return near


@given(SEEDS, st.sampled_from(list(product(KINDS, KINDS))))
def test_drifts_are_second_differences_of_distances(seed: int, kinds: tuple[str, str]):
    """But where other features become the nearest within a step, and where curvature is over in a tick."""
    rng = np.random.default_rng(seed)
    shapes, poses = [shape_of(kind, rng) for kind in kinds], [placed(rng, 0.3) for _ in kinds]
    motions = rng.normal(size=(2, 12)) * rng.choice([0.0, 1.0], size=(2, 12), p=[0.2, 0.8])
    near = moving(shapes, poses, motions)
    found = near._pairs
    d, speed, drift = near.line[0, 0], float(found.force[0] @ (motions[1] - motions[0])[:6]), float(found.drift[0])
    if d < 5e-3:
        return
    sides = []
    for step in (_STEP, -_STEP):
        there = between(two(*shapes), *(moved(*of, step) for of in zip(poses, motions, strict=True)))[0]
        sides.append(2.0 * (there - d - step * speed) / step**2)
    fastest = max(np.abs(about_middle(*of)).max() for of in zip(poses, motions, strict=True))
    if abs(sides[0] - sides[1]) > 1e-2 * (1.0 + fastest**2) or np.abs(sides).max() > 25.0 * fastest**2:
        return
    assert drift == pytest.approx(np.mean(sides), abs=2e-2 * (1.0 + fastest**2))


def about_middle(pose: Any, motion: Vec) -> Vec:
    """The velocity of the middle of a shape, and its angular velocity (6,)."""
    return np.concatenate([motion[:3] + np.cross(motion[3:6], pose.translation), motion[3:6]])


@given(SEEDS, st.sampled_from(list(product(KINDS, KINDS))))
def test_lines_to_the_side_bend_as_their_points_and_come_nearer_as_the_nearest(seed: int, kinds: tuple[str, str]):
    rng = np.random.default_rng(seed)
    shapes, poses = [shape_of(kind, rng) for kind in kinds], [placed(rng, 0.3) for _ in kinds]
    motions = rng.normal(size=(2, 12))
    near = moving(shapes, poses, motions, close=1.0)
    count = int(near._pairs.sizes[5])
    lines, drift = near.line[:count], near._pairs.drift[:count]

    def along(line: Vec, t: float) -> float:
        return carried(line, poses, [moved(*of, t) for of in zip(poses, motions, strict=True)])

    bends = [(along(line, _STEP) - 2.0 * along(line, 0.0) + along(line, -_STEP)) / _STEP**2 for line in lines]
    slides = drift[0] - bends[0]
    np.testing.assert_allclose(
        drift[1:], np.array(bends[1:]) + min(slides, 0.0), atol=1e-4 * (1.0 + np.abs(bends).max())
    )


@given(SEEDS, st.sampled_from(["boxes", "equal boxes", "cylinders", "a cylinder"]), st.sampled_from([0.0, 0.01]))
def test_what_slides_along_a_face_comes_no_nearer(seed: int, kind: str, aside: float):
    """Also if one middle is above the other, where the nearest points lie on diagonals, which are no edges."""
    rng = np.random.default_rng(seed)
    sizes = rng.uniform(0.02, 0.2, (2, 3))
    first, second = coal.Box(*sizes[0]), coal.Box(*sizes[0 if kind == "equal boxes" else 1])
    if "cylinder" in kind:
        second = coal.Cylinder(*sizes[1, ::2])
    if kind == "cylinders":
        first = coal.Cylinder(*sizes[0, ::2])
    heights = sizes[0, 2], sizes[0 if kind == "equal boxes" else 1, 2]
    base = placed(rng, rng.choice([0.0, 0.3]))
    up = pin.SE3(np.eye(3), np.array([aside, rng.choice([0.0, aside]), 0.5 * sum(heights) + 0.03]))
    motions = np.zeros((2, 12))
    motions[1, :3] = base.rotation @ [*rng.normal(size=2), 0.0]
    near = moving([first, second], [base, base * up], motions)
    assert near.line[0, 0] == pytest.approx(0.03, abs=1e-12)
    assert near._pairs.drift[0] == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize("turn", [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (1.0, 0.3, 0.0)])
def test_a_face_that_turns_below_a_ball_is_a_face_also_on_its_diagonal(turn: tuple[float, float, float]):
    """d = cos φ h − 0.2 − 0.1 with the middle of the ball h = 0.8 above that of the box."""
    motions = np.zeros((2, 12))
    motions[0, 3:6] = turn
    poses = [pin.SE3.Identity(), pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.8]))]
    near = moving([coal.Box(1.0, 0.6, 0.4), coal.Sphere(0.1)], poses, motions)
    assert near._pairs.drift[0] == pytest.approx(-0.8 * np.dot(turn, turn), abs=1e-12)


@given(SEEDS)
def test_two_corners_of_a_mesh_that_are_almost_one_bend_the_distance_as_one(seed: int):
    """Files of meshes have such corners; the direction from one to the other says nothing about the shape."""
    rng = np.random.default_rng(seed)
    corners = rng.uniform(0.05, 0.2, (2, 1, 3)) * rng.normal(size=(2, 12, 3))
    poses = [pin.SE3(np.eye(3), np.array([0.0, 0.0, z])) for z in (0.0, 1.5)]
    motions = 0.3 * rng.normal(size=(2, 12))
    once = moving([hull(points) for points in corners], poses, motions)
    if once.line[0, 0] < 0.05:
        return
    aside = np.cross(once.line[0, 1:4], rng.normal(size=3))
    twice = [np.vstack([points, points + 7e-8 / np.linalg.norm(aside) * aside]) for points in corners]
    twins = moving([hull(points) for points in twice], poses, motions)
    assert twins._pairs.drift[0] == pytest.approx(once._pairs.drift[0], abs=1e-3)


@given(SEEDS, st.sampled_from([kinds for kinds in product(KINDS, KINDS) if "cylinder" in kinds]))
def test_cylinders_that_are_apart_need_no_coal(seed: int, kinds: tuple[str, str]):
    """And what is found of them is sharp: across its axis, the normal of a cylinder is that of its nearest point."""
    rng = np.random.default_rng(seed)
    shapes, poses = [shape_of(kind, rng) for kind in kinds], [placed(rng, 0.5) for _ in kinds]
    for pose in poses:
        pose.rotation = pin.exp3(rng.normal(size=3))
    near = two(*shapes)
    near.data.oMg[0], near.data.oMg[1] = poses
    near._here.of = refuse  # type: ignore[method-assign]
    try:
        near.read(np.zeros((6, 0)), np.zeros(0), speeds=False)
    except Refused:
        places = [coal.Transform3s(pose.rotation, pose.translation) for pose in poses]
        asked = shapes[0], places[0], shapes[1], places[1], coal.DistanceRequest(), coal.DistanceResult()
        assert coal.distance(*asked) < 1e-5
        return
    for kind, pose, point in zip(kinds, poses, (near.line[0, 4:7], near.line[0, 7:10]), strict=True):
        if kind == "cylinder":
            n, p = pose.rotation.T @ near.line[0, 1:4], pose.actInv(point)
            assert abs(n[0] * p[1] - n[1] * p[0]) < 1e-11 * np.hypot(p[0], p[1])


class Refused(Exception):
    """Coal was asked."""


def refuse(pair: int) -> float:
    raise Refused


# ---- what would be nearest if shapes were turned: points of the shapes, enough of them to foresee the distance then
ARM, _, HUMANOID = robots()


def lines_of(near: NearPairs, first: Any, second: Any) -> Mat:
    """All lines of the pair (n, 10), the nearest points first."""
    near.data.oMg[0], near.data.oMg[1] = first, second
    numbers = found(near)
    assert numbers == list(range(len(numbers)))
    return near.line[: len(numbers)].copy()


@given(SEEDS, st.sampled_from(list(product(KINDS, KINDS))), st.sampled_from([0.0, 0.1, 1.0]))
def test_they_are_points_of_the_shapes_and_never_nearer(seed: int, kinds: tuple[str, str], far: float):
    rng = np.random.default_rng(seed)
    shapes = [shape_of(kind, rng) for kind in kinds]
    poses = [placed(rng, far) for _ in shapes]
    near = two(*shapes, close=np.inf)
    lines = lines_of(near, *poses)
    assert len(lines) <= LINES and (len(lines) == 1 or "ball" not in kinds)
    d = lines[0, 0]
    # The normal of shapes that are inside one another is known to 0.02 rad (docs/limits.md), the depth to its square.
    for shape in shapes:
        shape.computeLocalAABB()
    accuracy = 1e-6 if d > 0.0 else 0.02**2 * sum(2.0 * shape.aabb_radius for shape in shapes)
    for line in lines[1:]:
        assert line[0] > d - accuracy
        assert np.linalg.norm(line[1:4]) == pytest.approx(1.0, abs=1e-12)
        for shape, pose, point in zip(shapes, poses, (line[4:7], line[7:10]), strict=True):
            assert outside(shape, pose.actInv(point)) < 1e-6
        np.testing.assert_array_equal(line[1:4], lines[0, 1:4])
        assert line[0] == pytest.approx(line[1:4] @ (line[7:10] - line[4:7]), abs=1e-12)
    for pose, now in zip(poses, near.data.oMg, strict=True):
        assert pose == now


@given(SEEDS, st.floats(0.0, np.pi), st.floats(0.002, 0.1))
def test_a_box_above_a_table_has_its_four_corners(seed: int, angle: float, gap: float):
    """Turned about the normal anyhow, and tilted by less than shapes are turned by."""
    rng = np.random.default_rng(seed)
    size, tilt = rng.uniform(0.02, 0.2, 3), rng.uniform(-1e-3, 1e-3, 3)
    turn = pin.exp3(tilt) @ pin.exp3(np.array([0.0, 0.0, angle]))
    box = pin.SE3(turn, np.array([0.1, 0.2, 0.5 * size[2] + gap]))
    table = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.05]))
    corners = [box.act(0.5 * size * np.array([*sides, -1.0])) for sides in product((-1.0, 1.0), repeat=2)]
    for shapes, poses, side in (
        ((coal.Box(*size), coal.Box(1.0, 1.0, 0.1)), (box, table), slice(4, 7)),
        ((coal.Box(1.0, 1.0, 0.1), coal.Box(*size)), (table, box), slice(7, 10)),
    ):
        lines = lines_of(two(*shapes, close=1.0), *poses)
        for corner in corners:
            assert np.linalg.norm(lines[:, side] - corner, axis=1).min() < 1e-6


@given(SEEDS, st.floats(4.0, 20.0))
def test_a_corner_that_comes_fast_has_a_line_before_it_is_too_fast(seed: int, speed: float):
    """A box that turns above a table: if a corner has f + ḟ / γ < 0, a line has no more than that."""
    rng = np.random.default_rng(seed)
    size, about, ahead = rng.uniform(0.05, 0.2, 3), rng.normal(size=3) * [1.0, 1.0, 0.0], 1.0 / 15.0
    poses = [pin.SE3(np.eye(3), np.array([0.0, 0.0, z])) for z in (-0.05, 0.5 * size[2] + rng.uniform(0.01, 0.06))]
    near = two(coal.Box(1.0, 1.0, 0.1), coal.Box(*size), ahead=ahead, close=0.01)
    near.data.oMg[0], near.data.oMg[1] = poses
    turn = speed * about / np.linalg.norm(about)
    near.own[1, :6] = np.concatenate([np.cross(poses[1].translation, turn), turn])  # about its middle
    numbers = near.read(np.zeros((6, 0)), np.zeros(0), speeds=True)
    foreseen = near.line[numbers, 0] + ahead * near._pairs.force[: len(numbers)] @ near.own[1, :6]
    corners = 0.5 * size * np.array(list(product((-1.0, 1.0), repeat=3)))
    worst = (poses[1].translation + corners + ahead * np.cross(turn, corners))[:, 2].min()
    assert worst >= 0.0 or foreseen.min() <= worst + 1e-9


def test_no_line_depends_on_a_velocity_where_velocities_are_decided():
    """Rows that follow from the last decision would make the next one flicker."""
    poses = [pin.SE3(np.eye(3), np.array([0.0, 0.0, z])) for z in (-0.05, 0.09)]
    near, seen = two(coal.Box(1.0, 1.0, 0.1), coal.Cylinder(0.05, 0.1), ahead=0.1, close=0.05), []
    for turn in (0.0, 0.3, 10.0):
        near.own[1, :6] = 0.0, 0.0, 0.0, turn, 0.5 * turn, 0.0
        seen.append(lines_of(near, *poses))
    assert len(seen[0]) > 3
    np.testing.assert_array_equal(seen[1], seen[0])
    np.testing.assert_array_equal(seen[2], seen[0])


@given(SEEDS, st.sampled_from(["box", "hull"]))
def test_they_foresee_the_distance_after_a_turn(seed: int, kind: str):
    """Faces that meet, turned by less than shapes are turned by: the nearest points alone are wrong by the whole turn,
    all lines together by no more than a fraction of it in the mean."""
    rng = np.random.default_rng(seed)
    wrong = []
    for _ in range(10):
        size = rng.uniform(0.05, 0.2, 3)
        other = shape_of(kind, rng) if kind == "hull" else coal.Box(*rng.uniform(0.05, 0.2, 3))
        shapes = coal.Box(*size), other
        first = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.5 * size[2]]))
        second = pin.SE3(pin.exp3(np.array([0.0, 0.0, rng.uniform(0.0, 3.0)])), np.array([0.0, 0.0, 1.0]))
        near = two(*shapes, close=10.0)
        second.translation[2] -= lines_of(near, first, second)[0, 0] - 0.03
        lines = lines_of(near, first, second)
        about = rng.normal(size=2)
        turn = pin.SE3(pin.exp3(0.004 * np.array([*about / np.linalg.norm(about), 0.0])), np.zeros(3))
        turned = turn * second
        d = lines_of(two(*shapes), first, turned)[0, 0]
        gaps = [float(np.linalg.norm(turned.act(second.actInv(line[7:10])) - line[4:7])) for line in lines]
        assert min(gaps) > d - 1e-9
        wrong.append((gaps[0] - d, min(gaps) - d))
    alone, together = np.mean(wrong, axis=0)
    assert together < 0.1 * alone + 1e-6


@pytest.mark.parametrize("robot", [ARM, HUMANOID], ids=lambda robot: robot.name)
def test_rows_are_derivatives_along_the_motion(robot: Any):
    """Of lines to the side; their second ones too, to which is added what the nearest points come nearer by sliding."""
    wall = Obstacle("wall", Box((2.0, 0.1, 2.0)), pin.SE3(np.eye(3), np.array([0.0, 0.5, 0.5])))
    distances, step, checked = Distances(robot, obstacles=[wall], count=10_000, reach=0.3, close=0.3), 1e-4, 0
    near, state, model = distances._near, robot.state(), robot.pinocchio
    for _, q, v in moments(robot, count=4, seed=5):
        state.update(0.0, q, v)
        distances.read(state)
        used = distances.which >= 0
        numbers, here = distances._held[used].tolist(), [pose.copy() for pose in near.data.oMg]
        d, speed, drift = distances.distance[used], distances.jacobian[used] @ v, distances.drift[used]

        def of_pair(number: int, poses: Any) -> Any:
            return [poses[int(shape)] for shape in near.pairs[number // LINES]]

        def along(s: float, q: Vec = q, v: Vec = v, numbers: Any = numbers, here: Any = here) -> Vec:
            data, there = model.createData(), distances._geometry.createData()
            pin.updateGeometryPlacements(model, data, distances._geometry, there, pin.integrate(model, q, s * v))
            return np.array([carried(near.line[i], of_pair(i, here), of_pair(i, there.oMg)) for i in numbers])

        sides = along(step), along(0.0), along(-step)
        bends = (sides[0] - 2.0 * sides[1] + sides[2]) / step**2
        slides = {numbers[i] // LINES: drift[i] - bends[i] for i in range(len(numbers)) if numbers[i] % LINES == 0}
        for i, number in enumerate(numbers):
            if number % LINES:
                assert sides[1][i] == pytest.approx(d[i], abs=1e-12)
                assert (sides[0] - sides[2])[i] / (2.0 * step) == pytest.approx(speed[i], abs=1e-6)
                assert bends[i] + min(slides[number // LINES], 0.0) == pytest.approx(drift[i], abs=1e-5)
                checked += 1
    assert checked > 20
