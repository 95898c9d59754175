"""What couples joints in an MJCF file, and what drives them, is what MuJoCo makes of it."""

from __future__ import annotations

import warnings
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import wbc
from tasks import Posture, loop_closures
from tests.models.builders import at

mujoco = pytest.importorskip("mujoco", reason="the extra `sim`")
pytestmark = pytest.mark.physics

#: Two chains of two links with joints about some axis; x, y, z are places of the ends.
CHAINS = """
<mujoco model="loop"><compiler angle="radian"/>
  <worldbody>
    <body name="a1" pos="0.1 0 0.2"><joint name="a1" axis="{axis}"/><geom type="box" size=".1 .02 .02" pos=".1 0 0"/>
      <body name="a2" pos="0.2 0 0" euler="0.3 0 0"><joint name="a2" axis="{second}"/><site name="tip" pos=".1 0.02 0"
        euler="0 0.2 0"/><geom type="box" size=".1 .03 .02" pos=".1 0 0"/></body></body>
    <body name="b1" pos="-0.1 0 0.2"><joint name="b1" axis="{axis}"/><geom type="box" size=".1 .02 .02" pos="-.1 0 0"/>
      <body name="b2" pos="-0.2 0 0"><joint name="b2" axis="{second}"/><site name="end" pos="-.1 0.03 0"/>
        <geom type="box" size=".1 .02 .02" pos="-.1 0 0"/></body></body>
  </worldbody>
  <equality>{equality}</equality>
</mujoco>
"""
CLOSED = {
    "a ball joint": '<connect name="pin" body1="a2" body2="b2" anchor="0.1 0.2 0.3"/>',
    "a ball joint in the world": '<connect name="pin" body1="b2" anchor="0.1 0 0.1"/>',
    "sites in one place": '<connect name="pin" site1="tip" site2="end"/>',
    "a weld": '<weld name="pin" body1="a2" body2="b2"/>',
    "a weld in a pose": '<weld name="pin" body1="a2" body2="b2" relpose=".1 .2 .3 .5 .5 .5 .5" anchor=".1 0 0"/>',
    "a weld of sites": '<weld name="pin" site1="tip" site2="end"/>',
}


def looped(folder: Path, equality: str, second: str = "0 0 1", more: str = "") -> Path:
    """The chains, joined; in one plane where both joints of a chain have the same axis."""
    path, text = folder / "loop.xml", CHAINS.format(axis="0 1 0", second=second, equality=equality)
    text = text.replace("0.3 0 0", "0 0 0") if second == "0 1 0" else text
    path.write_text(text.replace("</worldbody>", f"{more}</worldbody>"))
    return path


@pytest.mark.parametrize("closed", CLOSED)
def test_an_equality_of_bodies_is_the_loop_that_mujoco_closes(tmp_path, closed):
    path = looped(tmp_path, CLOSED[closed])
    robot = wbc.load(path)
    (closure,) = loop_closures(robot)
    assert (closure.name, closure.dim) == ("pin", 6 if "weld" in closed else 3)
    physics = mujoco.MjModel.from_xml_path(str(path))
    data, state = mujoco.MjData(physics), robot.state()
    for seed in range(5):
        q = np.random.default_rng(seed).uniform(-1, 1, 4)
        data.qpos[[int(physics.jnt(joint).qposadr[0]) for joint in robot.joint_names]] = q
        mujoco.mj_forward(physics, data)
        state.update(0.0, q, np.zeros(4))
        ours, theirs = state.frame(closure.frame), state.frame(closure.carrier)
        np.testing.assert_allclose(ours.position - theirs.position, data.efc_pos[:3], atol=1e-9)
        if closure.dim == 6:  # MuJoCo has 2 sin(angle/2) times an axis, scaled
            turned = np.linalg.norm(data.efc_pos[3:6])
            cosine = np.clip((np.trace(ours.rotation.T @ theirs.rotation) - 1.0) / 2.0, -1.0, 1.0)
            assert turned == pytest.approx(np.sin(np.arccos(cosine) / 2.0), abs=1e-9)


def test_rows_that_a_mechanism_keeps_by_itself_are_left_out(tmp_path):
    (closure,) = loop_closures(wbc.load(looped(tmp_path, CLOSED["a ball joint"], "0 1 0")), kp=400.0)
    assert closure.wrench_axes == (0, 2) and closure.kp == 400.0


def test_a_four_bar_from_a_file_stays_closed(tmp_path):
    robot = wbc.load(looped(tmp_path, '<connect name="pin" body1="a2" body2="b2" anchor="0.1 0 0.3"/>', "0 1 0"))
    closures = loop_closures(robot, kp=900.0)
    stack = wbc.Stack([Posture([0.3, -0.6, 0.0, 0.0])], contacts=closures)
    controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), dt=1e-3)

    def gap(q: np.ndarray) -> np.ndarray:
        state = at(robot, q)
        return (state.frame(closures[0].frame).position - state.frame(closures[0].carrier).position)[[0, 2]]

    q, v = robot.q0, np.zeros(4)
    for tick in range(500):
        command = controller.tick(tick * 1e-3, q, v)
        assert command.status.ok
        q, v = command.q, command.v
    assert np.abs(q - robot.q0).max() > 0.05 and np.abs(gap(robot.q0)).max() < 1e-9
    assert np.abs(gap(q)).max() < 1e-4


def test_an_equality_that_joins_nothing_of_the_robot_is_left_out_and_said(tmp_path):
    table = '<body name="table" pos="1 0 0"><geom size=".1"/></body>'
    closed = '<weld name="glue" body1="a2" body2="table"/><joint name="stuck" joint1="a1"/>'
    with pytest.warns(UserWarning, match=r"'stuck' is left out: .*'glue' is left out: it joins no two links"):
        robot = wbc.load(looped(tmp_path, closed, more=table))
    assert loop_closures(robot) == []


# ---- motors
@pytest.mark.parametrize("seed", range(20))
def test_a_torque_limit_is_what_actuators_give_in_both_directions(tmp_path: Path, seed: int):
    """MuJoCo is asked for all they can give; a joint that they drive harder in one direction is warned about.

    Actuators before them may have several controls, or several outputs.
    """
    rng = np.random.default_rng(seed)

    def drawn(name: str) -> str:
        low, high = sorted(rng.choice([-5.0, -2.0, -1.0, 0.0, 0.5, 3.0, 5.0], 2, replace=False))
        return f'{name}="{low} {high}"'

    several = '<pid joint="y" input="pos vel" kp="1" kv="1"/>', '<orientation site="s" refsite="t" kp="1"/>'
    motors = [one for one in several if rng.random() < 0.5]
    for _ in range(int(rng.integers(1, 3))):
        gear = rng.choice([-3.0, -1.0, 0.5, 2.0])
        force = drawn("forcerange") if rng.random() < 0.5 else ""
        motors.append(f'<motor joint="x" gear="{gear}" {drawn("ctrlrange")} {force}/>')
    limit = drawn("actuatorfrcrange") if rng.random() < 0.4 else ""
    path = tmp_path / "driven.xml"
    path.write_text(
        f'<mujoco><compiler angle="radian"/><worldbody><site name="t"/><body name="a"><joint name="x" {limit}/>'
        '<geom size=".1"/><site name="s"/><body name="b"><joint name="y"/><geom size=".1"/></body></body></worldbody>'
        f"<actuator>{''.join(motors)}</actuator></mujoco>"
    )
    model = mujoco.MjModel.from_xml_path(str(path))
    data, given = mujoco.MjData(model), []
    drives = model.actuator_ctrladr[model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT]
    drives = drives[model.actuator_trnid[model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT, 0] == 0]
    for controls in product((-1e6, 1e6), repeat=len(drives)):
        data.ctrl[drives] = controls
        mujoco.mj_forward(model, data)
        given.append(float(data.qfrc_actuator[0]))
    low, high = min(given), max(given)
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        robot = wbc.load(path)
    assert robot.limits.tau_max[0] == pytest.approx(max(min(-low, high), 0.0))
    assert any(f"is driven with {low:g} to {high:g}" in str(one.message) for one in told) == (low != -high)


def test_an_actuator_of_the_free_base_is_left_out_and_said(tmp_path: Path):
    path = tmp_path / "thruster.xml"
    path.write_text(
        '<mujoco><worldbody><body name="a"><freejoint name="base"/><geom size=".1"/><body name="b"><joint name="x"/>'
        '<geom size=".1"/></body></body></worldbody><actuator><motor name="thrust" joint="base" gear="0 0 1 0 0 0" '
        'ctrlrange="0 9"/><motor joint="x" ctrlrange="-2 2"/></actuator></mujoco>'
    )
    with pytest.warns(UserWarning, match="actuator 'thrust' is left out: it moves no joint"):
        robot = wbc.load(path)
    assert robot.limits.tau_max.tolist() == [2.0]
