"""What the motors of an MJCF file give is what MuJoCo gives."""

from __future__ import annotations

import warnings
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import wbc

mujoco = pytest.importorskip("mujoco", reason="the extra `sim`")
pytestmark = pytest.mark.physics


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
