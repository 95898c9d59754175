"""The robots of example-robot-data load, stand, and are the same robots that Pinocchio reads."""

from __future__ import annotations

import re
import warnings
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from tests.models.builders import at, quietly
from wbc.errors import ModelError
from wbc.models import load
from wbc.models.catalogue import EXAMPLES, example_robots
from wbc.models.geometry import Box, Sphere

try:
    ROOT = example_robots()
except ModelError as missing:
    pytest.skip(str(missing), allow_module_level=True)


@pytest.mark.parametrize("name", EXAMPLES)
def test_every_robot_of_the_table_loads(name: str):
    robot = quietly(name)
    assert robot.name == name and robot.nv == robot.nb + robot.nj
    assert (robot.nb == 6) == (EXAMPLES[name].base == "floating")
    joints = robot.q0[robot.nq - robot.nj :]
    sane = robot.limits.q_min < robot.limits.q_max
    assert (joints >= robot.limits.q_min)[sane].all() and (joints <= robot.limits.q_max)[sane].all()
    state = robot.state()
    assert np.isfinite(state.M).all() and np.isfinite(state.com).all()
    assert all(visual.link in robot.frame_names for visual in robot.visuals)


@pytest.mark.parametrize("name", ["panda", "go2", "g1", "talos"])
def test_the_robots_that_benchmarks_use_load_without_a_word(name: str):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        robot = load(name)
    assert robot.urdf.missing_meshes == () and len(robot.visuals) > 10
    assert all(visual.shape.path.is_relative_to(ROOT) for visual in robot.visuals if hasattr(visual.shape, "path"))


@pytest.mark.parametrize("name", ["go2", "g1", "talos", "anymal_c", "tiago"])
def test_the_model_is_the_one_that_pinocchio_reads_from_the_file(name: str):
    robot = quietly(name, feet=[])  # feet that are found bring frames along
    root = (pin.JointModelFreeFlyer(),) if robot.nb else ()
    text = re.sub(r'type="continuous"', 'type="revolute"', robot.urdf.path.read_text())
    text = re.sub(r"<limit (?![^>]*lower)", '<limit lower="-1e30" upper="1e30" ', text)
    theirs = pin.buildModelFromXML(text, *root)
    ours = robot.pinocchio
    assert list(ours.names) == list(theirs.names)
    assert all(a == b for a, b in zip(ours.inertias, theirs.inertias, strict=True))
    assert all(a == b for a, b in zip(ours.jointPlacements, theirs.jointPlacements, strict=True))
    assert [(f.name, f.placement) for f in ours.frames] == [(f.name, f.placement) for f in theirs.frames]
    bounded = np.isfinite(robot.limits.q_min)
    assert np.array_equal(robot.limits.q_min[bounded], theirs.lowerPositionLimit[-robot.nj :][bounded])
    assert np.array_equal(robot.limits.tau_max, theirs.effortLimit[-robot.nj :])
    assert np.array_equal(robot.limits.v_max, theirs.velocityLimit[-robot.nj :])


@pytest.mark.parametrize(("name", "kind"), [("talos", "sole"), ("g1", "sole"), ("go2", "point")])
def test_legged_robots_stand_on_their_feet(name: str, kind: str):
    robot = load(name)
    state = robot.state()
    heights = []
    for foot in robot.feet.values():
        assert foot.kind == kind
        placement = state.frame(foot.frame).placement
        heights += [placement.act(np.array(p))[2] - below for p, below in foot.lowest()]
        if kind == "sole":
            assert np.allclose(placement.rotation[2], [0, 0, 1], atol=2e-3)
    assert min(heights) == pytest.approx(0.0, abs=1e-9) and max(heights) < 2e-3
    assert np.abs(state.com[:2] - np.mean([state.frame(f).position[:2] for f in robot.feet], axis=0)).max() < 0.06


def test_stances_are_the_known_ones():
    panda, g1, talos = load("panda"), load("g1"), load("talos")
    assert panda.nj == 7 and panda.q0.tolist() == [0, -0.3, 0, -2.2, 0, 2.0, 0.785]
    assert g1.nj == 29 and g1.q0[7 + g1.joint("left_shoulder_roll_joint")] == 0.25
    assert talos.nj == 32 and talos.mass == pytest.approx(90.272192)
    assert talos.q0[7 + talos.joint("leg_left_4_joint")] == pytest.approx(0.8, abs=0.2)


# ---- our own robots are bodies of one density, left as right, and stand
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
