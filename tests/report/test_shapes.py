"""A robot as triangles: whole, within budget, and there even when the model shows nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wbc.models import PlanarPR, load
from wbc.models.pinocchio_ import PinocchioModel
from wbc.report import shapes
from wbc.types import Mat

sizes = st.floats(0.01, 2.0)


def volume(vertices: Mat, faces: np.ndarray) -> float:
    """Volume inside a closed surface whose triangles turn outwards."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def open_edges(faces: np.ndarray) -> int:
    """Edges that two triangles do not share in opposite directions."""
    edges = {(int(t[i]), int(t[(i + 1) % 3])) for t in faces for i in range(3)}
    return sum((b, a) not in edges for a, b in edges)


@given(sizes, sizes, sizes)
def test_a_box_is_closed_and_turns_outwards(x: float, y: float, z: float):
    vertices, faces = shapes.box((x, y, z))
    assert open_edges(faces) == 0
    assert volume(vertices, faces) == pytest.approx(x * y * z)


@given(sizes, sizes)
def test_round_shapes_have_nearly_the_volume_of_the_true_ones(radius: float, length: float):
    ball = 4 / 3 * np.pi * radius**3
    rod = np.pi * radius**2 * length
    made = (shapes.sphere(radius), shapes.cylinder(radius, length), shapes.capsule(radius, length))
    for (vertices, faces), exact in zip(made, (ball, rod, ball + rod), strict=True):
        assert volume(vertices, faces) == pytest.approx(exact, rel=0.05)


@pytest.mark.parametrize("name", ["arm", "quadruped", "humanoid"])
def test_our_robots_show_every_part_in_a_frame_they_have(name: str):
    robot = load(name)
    parts = shapes.parts(robot)
    assert {part.link for part in parts} == {visual.link for visual in robot.visuals}
    assert {part.link for part in parts} <= set(robot.frame_names)
    for part in parts:
        assert np.isfinite(part.vertices).all() and part.faces.min() >= 0 and part.faces.max() < len(part.vertices)


@pytest.mark.parametrize("name", ["arm", "quadruped", "humanoid"])
def test_a_robot_without_shapes_gets_bones_from_joint_to_joint(name: str):
    full = load(name)
    bare = PinocchioModel(replace(full.urdf, visuals=(), collisions=()), base="fixed")
    bones = shapes.parts(bare)
    moving = [joint for joint in full.urdf.joints if np.linalg.norm(joint.origin.xyz) > 0.05]
    assert len(bones) >= len(moving) > 0
    assert {bone.link for bone in bones} <= set(bare.frame_names)
    for bone, joint in zip(
        shapes.parts(bare), (j for j in full.urdf.joints if j.parent == bones[0].link), strict=False
    ):
        reach = np.linalg.norm(bone.vertices - np.array(joint.origin.xyz), axis=1).min()
        assert reach <= np.linalg.norm(joint.origin.xyz)


@given(budget=st.integers(200, 4000))
def test_thinning_ends_within_the_budget_and_keeps_the_outline(budget: int):
    parts = shapes.parts(load("arm"))
    thin = shapes.thinned(parts, budget)
    assert sum(len(part.faces) for part in thin) <= budget
    for before, after in zip(parts, thin, strict=True):
        assert np.all(after.vertices.min(axis=0) >= before.vertices.min(axis=0) - 1e-9)
        assert np.all(after.vertices.max(axis=0) <= before.vertices.max(axis=0) + 1e-9)


def test_a_planar_chain_has_a_rod_for_a_link_that_turns_and_a_block_on_a_rail_for_one_that_slides():
    robot = PlanarPR(m1=1.0, m2=1.0, l2=0.6, d2=0.3, I2=0.1)
    drawn = shapes.parts(robot)
    assert [part.link for part in drawn] == ["base", "link1", "link2"]
    rod = drawn[-1].vertices
    assert np.allclose([rod[:, 0].min(), rod[:, 0].max()], [-0.03, 0.63]) and np.ptp(rod[:, 2]) < 0.1
    assert {part.link for part in drawn} <= set(robot.frame_names)
