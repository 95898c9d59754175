"""The state of a MuJoCo model of one's own is read and written by name, whatever else is in the scene."""

from __future__ import annotations

import numpy as np
import pytest

import wbc
from wbc.errors import SimulationError
from wbc.sim.bridge import Bridge

mujoco = pytest.importorskip("mujoco", reason="the extra `sim`")

LEG = '<body name="{0}" pos="{1} 0 0"><joint name="{0}_hip" axis="1 2 0"/><geom size="0.05" pos="0 0 -0.2"/></body>'
#: Limbs in an order that is not alphabetical, behind a thing that lies about.
SCENE = """<mujoco><worldbody>
  <body name="cube" pos="1 0 1"><freejoint/><geom size="0.1"/></body>
  <body name="base" pos="0 0 1">{}<geom size="0.1"/>{}{}</body>
</worldbody></mujoco>"""
LEGS = LEG.format("right", 0.1), LEG.format("left", -0.1)
FREE = '<freejoint name="root"/>'


@pytest.mark.parametrize("root", [FREE, ""])
@pytest.mark.filterwarnings("ignore")
def test_frames_and_their_velocities_are_those_of_mujoco(root: str):
    physics = mujoco.MjModel.from_xml_string(SCENE.format(root, *LEGS))
    robot, data, rng = wbc.load(physics, feet=[]), mujoco.MjData(physics), np.random.default_rng(0)
    assert robot.joint_names == ("left_hip", "right_hip")  # not MuJoCo's order
    data.qvel[:] = rng.normal(size=physics.nv)
    mujoco.mj_integratePos(physics, data.qpos, rng.normal(size=physics.nv), 1.0)
    mujoco.mj_forward(physics, data)
    bridge, state = Bridge(robot, physics), robot.state()
    q, v = bridge.read(data)
    state.update(0.0, q, v)
    for name in ("base", "left", "right") if root else ("left", "right"):
        frame, body, J = state.frame(name), data.body(name), np.zeros((6, physics.nv))
        mujoco.mj_jacBody(physics, data, J[:3], J[3:], body.id)
        np.testing.assert_allclose(frame.position, body.xpos, atol=1e-12)
        np.testing.assert_allclose(frame.rotation, body.xmat.reshape(3, 3), atol=1e-12)
        np.testing.assert_allclose(frame.jacobian() @ v, J @ data.qvel, atol=1e-12)
        np.testing.assert_allclose(frame.jacobian(), J @ bridge.velocity_map(data), atol=1e-12)

    moved = robot.random_configuration(rng), rng.normal(size=robot.nv)
    cube = data.body("cube").xpos.copy()
    bridge.write(data, *moved)
    for ours, read in zip(moved, bridge.read(data), strict=True):
        np.testing.assert_allclose(read, ours, atol=1e-12)
    mujoco.mj_forward(physics, data)
    assert np.array_equal(data.body("cube").xpos, cube)


@pytest.mark.parametrize(
    ("legs", "base", "sentence"),
    [
        ((LEGS[0], ""), "floating", r"physics has no joint 'left_hip' of .*does not name its joints"),
        (LEGS, "planar", "physics has no joint 'base_x', 'base_y', 'base_yaw'"),
        (LEGS, "fixed", "the base of .* is not free, and in physics it is free; load the robot with another base"),
    ],
)
@pytest.mark.filterwarnings("ignore")
def test_what_is_not_the_same_robot_is_refused(legs: tuple[str, str], base: str, sentence: str):
    robot = wbc.load(mujoco.MjModel.from_xml_string(SCENE.format(FREE, *LEGS)), base=base, feet=[])
    with pytest.raises(SimulationError, match=sentence):
        Bridge(robot, mujoco.MjModel.from_xml_string(SCENE.format(FREE, *legs)))


@pytest.mark.filterwarnings("ignore")
def test_joints_without_names_are_not_taken_for_others():
    physics = mujoco.MjModel.from_xml_string(SCENE.format("", *LEGS).replace('name="left_hip"', ""))
    robot = wbc.load(physics, feet=[])
    with pytest.raises(SimulationError, match="no joint 'joint_2'"):
        Bridge(robot, physics)


@pytest.mark.filterwarnings("ignore")
def test_torques_go_to_no_actuator_of_another_name():
    motors = (
        '<actuator><motor name="left_motor" joint="left_hip"/><motor name="right_hip" joint="right_hip"/></actuator>'
    )
    physics = mujoco.MjModel.from_xml_string(SCENE.format("", *LEGS).replace("</mujoco>", f"{motors}</mujoco>"))
    data, bridge = mujoco.MjData(physics), Bridge(wbc.load(physics, feet=[]), physics)
    with pytest.raises(SimulationError, match="not every joint has an actuator of its name"):
        bridge.write_torques(data, np.ones(2))
    assert not data.ctrl.any()
