"""Our own robots are bodies of one density, left as right, and stand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from tests.models.builders import at
from wbc.models import load
from wbc.models.geometry import Box, Sphere

ROBOTS = {name: load(name) for name in ("arm", "quadruped", "humanoid")}
robots = pytest.mark.parametrize("name", ROBOTS)


@robots
def test_size_mass_and_limits_are_those_of_such_robots_and_the_stance_is_well_inside(name: str):
    robot, limits, q = ROBOTS[name], ROBOTS[name].limits, ROBOTS[name].q0[-ROBOTS[name].nj :]
    low, high, joints = {"arm": (10, 25, 7), "quadruped": (12, 18, 12), "humanoid": (50, 75, 30)}[name]
    assert robot.nj == joints and low < robot.mass < high
    assert robot.nb == (0 if name == "arm" else 6)
    assert np.isfinite([limits.q_min, limits.q_max, limits.v_max, limits.tau_max]).all()
    assert (limits.v_max > 0).all() and (limits.tau_max > 0).all()
    assert (q - limits.q_min).min() > 0.1 and (limits.q_max - q).min() > 0.1


def solid(shape: Any) -> pin.Inertia:
    """Of a shape of density one."""
    if isinstance(shape, Box):
        return pin.Inertia.FromBox(np.prod(shape.size), *shape.size)
    if isinstance(shape, Sphere):
        return pin.Inertia.FromSphere(4 / 3 * np.pi * shape.radius**3, shape.radius)
    return pin.Inertia.FromCylinder(np.pi * shape.radius**2 * shape.length, shape.radius, shape.length)


@robots
def test_every_moving_link_has_the_inertia_of_its_shapes_at_one_density(name: str):
    """Parts that overlap count twice; Pinocchio adds them."""
    for link in (link for link in ROBOTS[name].urdf.links if link.inertial is not None):
        whole = pin.Inertia.Zero()
        for part in (part for part in ROBOTS[name].visuals if part.link == link.name):
            whole += pin.SE3(part.origin.rotation, np.array(part.origin.xyz)).act(solid(part.shape))
        xx, xy, xz, yy, yz, zz = link.inertial.inertia
        wanted = link.inertial.mass / whole.mass * whole.inertia
        np.testing.assert_allclose(link.inertial.origin.xyz, whole.lever, rtol=1e-4, atol=1e-5)
        np.testing.assert_allclose([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]], wanted, rtol=2e-4, atol=1e-7)


@robots
def test_every_link_that_has_a_mass_can_be_seen(name: str):
    robot = ROBOTS[name]
    assert {g.link for g in robot.visuals} == {link.name for link in robot.urdf.links if link.inertial}
    assert all(g.color is not None for g in robot.visuals)


@pytest.mark.parametrize("name", ["quadruped", "humanoid"])
def test_a_robot_stands_with_its_feet_on_the_ground_and_its_weight_between_them(name: str):
    robot = ROBOTS[name]
    state = robot.state()
    corners = []
    for foot in robot.feet.values():
        placement = state.frame(foot.frame).placement
        assert placement.rotation[2, 2] == pytest.approx(1.0) or foot.kind == "point"
        lowest = [placement.act(np.array(p)) - [0, 0, below] for p, below in foot.lowest()]
        assert min(p[2] for p in lowest) == pytest.approx(0.0, abs=1e-9)
        corners += lowest
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    margin = np.minimum(state.com - low, high - state.com)[:2]
    assert (margin > 0.25 * (high - low)[:2]).all()


@pytest.mark.parametrize("name", ["quadruped", "humanoid"])
def test_left_and_right_are_mirror_images(name: str):
    robot = ROBOTS[name]
    state = robot.state()
    assert state.com[1] == pytest.approx(0.0, abs=1e-12)
    sides = [frame for frame in robot.frame_names if "left" in frame]
    assert sides
    for left in sides:
        other = state.frame(left.replace("left", "right")).position
        assert np.allclose(state.frame(left).position * [1, -1, 1], other, atol=1e-12)


def test_the_frames_that_examples_use_are_there():
    assert "tool" in ROBOTS["arm"].frame_names
    on_humanoid = {"left_sole", "right_sole", "left_hand", "right_hand", "torso", "pelvis"}
    assert on_humanoid <= set(ROBOTS["humanoid"].frame_names)
    feet = {f"{end}_{side}_foot" for end in ("front", "rear") for side in ("left", "right")}
    assert set(ROBOTS["quadruped"].feet) == feet


def test_joints_are_positive_as_their_names_say():
    robot = ROBOTS["humanoid"]
    straight = robot.configuration(dict.fromkeys(robot.joint_names, 0.0))

    def moved(frame: str, **joints: float) -> np.ndarray:
        bent = robot.configuration(dict.fromkeys(robot.joint_names, 0.0) | joints)
        return at(robot, bent).frame(frame).position - at(robot, straight).frame(frame).position

    assert moved("left_sole", left_hip_pitch=0.5)[0] > 0.1
    assert moved("left_sole", left_knee=0.5)[0] < -0.1
    assert moved("left_hand", left_shoulder_pitch=0.5)[0] > 0.1
    assert moved("left_hand", left_elbow=0.5)[0] > 0.1
    for side, outwards in (("left", 1), ("right", -1)):
        assert outwards * moved(f"{side}_sole", **{f"{side}_hip_roll": 0.3})[1] > 0.1
        assert outwards * moved(f"{side}_hand", **{f"{side}_shoulder_roll": 0.3})[1] > 0.1
