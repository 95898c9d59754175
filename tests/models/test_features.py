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

from tests.models.test_near_pairs import KINDS, SEEDS, between, carried, hull, placed, shape_of, two
from wbc.models.near_pairs import NearPairs
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
