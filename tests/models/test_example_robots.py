"""The robots of example-robot-data load, stand, and are the same robots that Pinocchio reads."""

from __future__ import annotations

import re
import warnings

import numpy as np
import pinocchio as pin
import pytest

from tests.models.builders import quietly
from wbc.errors import ModelError
from wbc.models import load
from wbc.models.catalogue import EXAMPLES, example_robots

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
