"""The robots of the workloads: reduced to what moves, changed where the rules say so, and standing where they start."""

from __future__ import annotations

import json
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin
import pytest

from tasks.workloads.robots import G1, GO2, PANDA, TALOS, RobotRecipe
from wbc.models.catalogue import example_robots

RECIPES = {"W1": PANDA, "W2": G1, "W3": PANDA, "W4": GO2, "W5": TALOS}
SOLES = [
    (G1, ("left_ankle_roll_link", "right_ankle_roll_link")),
    (GO2, ("FL_foot", "RR_foot")),
    (TALOS, ("left_sole_link", "right_sole_link")),
]

each_robot = pytest.mark.parametrize("recipe", [PANDA, GO2, G1, TALOS], ids=lambda recipe: recipe.name)


@each_robot
def test_inertias_and_limits_are_those_of_the_robot_data(recipe: RobotRecipe):
    original = ElementTree.parse(example_robots() / "robots" / recipe.source).getroot()
    made = recipe.made()
    for joint in original.findall("joint"):
        if joint.get("name") in made.robot.joint_names:
            i, limit = made.robot.joint(joint.attrib["name"]), joint.find("limit")
            assert limit is not None
            assert made.robot.limits.tau_max[i] == float(limit.attrib["effort"])
            assert made.robot.limits.v_max[i] == pytest.approx(recipe.speed * float(limit.attrib["velocity"]))
    masses = [float(mass.attrib["value"]) for mass in original.iter("mass")]
    assert sum(inertia.mass for inertia in made.reference.inertias) == pytest.approx(sum(masses))


def test_the_panda_has_no_fingers_to_move():
    made = PANDA.made()
    assert made.robot.joint_names == tuple(f"panda_joint{i}" for i in range(1, 8))


@pytest.mark.parametrize(("recipe", "soles"), SOLES, ids=("g1", "go2", "talos"))
def test_feet_start_on_the_ground(recipe: RobotRecipe, soles: tuple[str, ...]):
    made = recipe.made()
    heights = [made.placement(sole).translation[2] for sole in soles]
    assert heights == pytest.approx([0.0] * len(soles), abs=1e-6)


@pytest.mark.parametrize(("recipe", "soles"), SOLES[::2], ids=("g1", "talos"))
def test_soles_start_level_and_upright_bodies_upright(recipe: RobotRecipe, soles: tuple[str, ...]):
    made = recipe.made()
    for frame in (*soles, made.robot.frame_names[0]):
        np.testing.assert_allclose(made.placement(frame).rotation[:, 2], [0.0, 0.0, 1.0], atol=0.01)


@each_robot
def test_the_robot_starts_inside_its_limits(recipe: RobotRecipe):
    made = recipe.made()
    q, limits = made.q0[-made.robot.nj :], made.robot.limits
    assert (limits.q_min <= q).all() and (q <= limits.q_max).all()


@each_robot
def test_the_robot_and_its_reference_have_the_same_joints(recipe: RobotRecipe):
    made = recipe.made()
    assert made is recipe.made()
    assert tuple(made.reference.names)[-made.robot.nj :] == made.robot.joint_names
    assert made.reference.velocityLimit[-made.robot.nj :] == pytest.approx(made.robot.limits.v_max)


@pytest.mark.parametrize("workload", RECIPES)
def test_starts_are_those_that_other_libraries_were_measured_from(workload: str, peers: Path):
    given = json.loads((peers / "models" / "init.json").read_text(encoding="utf-8"))[workload]
    made = RECIPES[workload].made()
    model = made.reference
    q = pin.neutral(model)
    if given["base"] is not None:
        q[:7] = given["base"]
    for joint, position in given["joints"].items():
        q[model.joints[model.getJointId(joint)].idx_q] = position
    assert np.abs(q - made.q0).max() == 0.0
