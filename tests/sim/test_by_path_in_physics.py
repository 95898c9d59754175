"""Robots that nobody prepared, by the paths of their files alone: legs lift a foot, hands draw circles, in physics."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import tasks
import wbc
from tests.models.builders import at, quietly
from tests.models.test_standing_by_path import example
from tests.robots.examples import needs_examples
from wbc.models.catalogue import example_robots
from wbc.models.pinocchio_ import Base, PinocchioModel
from wbc.sim.mujoco_ import MujocoPlant
from wbc.sim.simulate import simulate

pytest.importorskip("mujoco", reason="the extra `sim`")
pytestmark = [needs_examples, pytest.mark.physics]
DT = 2e-3
#: Robots with legs that stand on what is left when a foot is up.
LEGGED = [
    "anymal_b_simple_description/robots/anymal.urdf",
    "hyq_description/robots/hyq_no_sensors.urdf",
    "icub_description/robots/icub_reduced.urdf",
    "romeo_description/urdf/romeo_small.urdf",
    "solo_description/robots/solo12.urdf",
]
#: Robots with hands: what draws circles, a pose in which arms are not stretched, and what the base does.
HANDS: dict[str, tuple[list[str], dict[str, float], Base]] = {
    "ur_description/urdf/ur5_robot.urdf": (["tool0"], {"shoulder_lift_joint": -1.2, "elbow_joint": 1.5}, "fixed"),
    "tiago_description/robots/tiago_no_hand.urdf": (
        ["wrist_tool_joint"], {"arm_2_joint": -0.5, "arm_4_joint": 1.2}, "planar",
    ),
    "baxter_description/urdf/baxter.urdf": (
        ["left_gripper_base_link", "right_gripper_base_link"],
        {f"{side}_{joint}": x for side in ("left", "right") for joint, x in (("s1", -0.8), ("e1", 1.9), ("w1", 0.5))},
        "fixed",
    ),
    "allegro_hand_description/urdf/allegro_left_hand.urdf": (
        [f"link_{i}.0_tip" for i in (3, 7, 11, 15)],
        {f"joint_{i}.0": 0.6 for finger in (0, 4, 8, 12) for i in range(finger + 1, finger + 4)},
        "fixed",
    ),
    "tiago_pro_description/robots/tiago_pro.urdf": (["arm_left_tool_link", "arm_right_tool_link"], {}, "planar"),
}  # fmt: skip


def simulated(robot: PinocchioModel, stack: wbc.Stack, plant: Any, duration: float) -> Any:
    controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), dt=DT)
    run = simulate(controller, plant, duration=duration)
    assert run.meta["ended"] == "complete"
    assert (run.columns["status"] == run.columns["status"][0]).all()
    return run


@pytest.mark.parametrize("file", LEGGED)
def test_it_lifts_a_foot(file: str):
    robot = example(file)
    contacts = tasks.feet(robot, kp=0.0, kd=20.0)
    plant = MujocoPlant(robot, contacts=tasks.feet(robot, friction_share=1.0), dt=DT)
    plant.reset(plant.settled(robot.q0))
    state, base = at(robot, plant.q, plant.v), robot.frame_names[0]
    lifted, *others = robot.feet
    foot = state.frame(lifted).position.copy()
    over = np.mean([state.frame(name).position for name in others], axis=0)
    share = 0.6 if len(others) > 1 else 0.8
    com, up = state.com.copy(), foot + np.array([0.0, 0.0, 0.04])
    aside = [*(share * over + (1.0 - share) * com)[:2], com[2]]
    lift = (tasks.MinimumJerk(*ends, duration=0.3, start_time=t) for ends, t in (((foot, up), 1.0), ((up, foot), 1.3)))
    goals = [
        tasks.CenterOfMass(target=tasks.MinimumJerk(com, aside, duration=0.8, start_time=0.1)),
        tasks.Orientation(base, target=state.frame(base).rotation.copy()),
        tasks.Position(lifted, target=tasks.Piecewise(list(zip((1.0, 1.3), lift, strict=True))), weight=10.0),
        tasks.Posture(robot.q0, weight=1e-4),
    ]
    schedule = tasks.ContactSchedule([(0.0, [lifted, *others]), (1.0, others), (1.6, [lifted, *others])])
    limits = [tasks.TorqueLimits(), tasks.JointVelocityLimits()]
    stack = wbc.Stack(goals, contacts=contacts, subject_to=limits, components=[schedule])
    run = simulated(robot, stack, plant, 2.0)
    name = next(contact.name for contact in contacts if contact.frame == lifted)
    load = run.columns[f"f.{name}"][:, 2]
    assert (load[505:795] == 0.0).all() and load[-1] > 1.0
    assert np.linalg.norm(run["error.CenterOfMass"], axis=1).max() < 0.01
    assert np.linalg.norm(run[f"error.Position[{lifted}]"][505:795], axis=1).max() < 0.02, "half of the way up"


def test_nobody_holds_bolt_on_two_points_and_commands_stay_finite():
    robot = example("bolt_description/robots/bolt.urdf")
    stack = wbc.Stack(
        [tasks.CenterOfMass(target=robot.state().com.copy(), kp=100), tasks.Posture(robot.q0, weight=1e-3)],
        contacts=tasks.feet(robot), subject_to=[tasks.TorqueLimits()],
    )  # fmt: skip
    plant = MujocoPlant(robot, contacts=tasks.feet(robot, friction_share=1.0), dt=DT)
    run = simulate(wbc.Controller(robot, stack, level=wbc.InverseDynamics(), dt=DT), plant, duration=2.0)
    assert run.meta["ended"] != "complete" and run.rows * DT > 0.3
    assert np.isfinite(run.columns["tau"]).all()


@pytest.mark.parametrize("file", HANDS)
def test_its_hands_draw_circles(file: str):
    frames, pose, base = HANDS[file]
    robot = quietly(example_robots() / "robots" / file, base=base, q0=pose)
    state = robot.state()
    radius = 0.01 if "allegro" in file else 0.05
    size, phase = np.array([0.0, radius, radius]), [0.0, 0.0, np.pi / 2]

    def circle(frame: str) -> tasks.Position:
        middle = state.frame(frame).position.copy()
        return tasks.Position(
            frame, kp=400.0, target=tasks.Sinusoid(middle, amplitude=size, frequency=0.5, phase=phase)
        )

    circles = [circle(frame) for frame in frames]
    stack = wbc.Stack([*circles, tasks.Posture(robot.q0, weight=1e-5)], subject_to=[tasks.JointLimits()])
    plant = MujocoPlant(robot, dt=DT)
    run = simulated(robot, stack, plant, 3.0)
    for drawn in circles:
        assert np.linalg.norm(run[f"error.{drawn.name}"], axis=1)[1000:].max() < 0.1 * radius
