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
