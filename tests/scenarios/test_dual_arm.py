"""A bar in two hands is where it is to be and is squeezed as hard as is asked; what welds it is part of physics."""

from __future__ import annotations

import numpy as np
import pytest

import wbc
from tasks import LoopClosure
from tests.robots.examples import needs_examples
from tests.scenarios.test_standing import failed, run
from wbc.errors import NotSupported, UnknownFrame


@pytest.mark.physics
def test_our_own_humanoid_squeezes_a_bar() -> None:
    result = run("dual-arm", "robot=humanoid", "squeeze=12", duration=1.8)
    assert not failed(result)
    assert result.figures["grip_error_m"] < 1e-3
    assert np.linalg.norm(result.run["plant.f.bar"][-1]) == pytest.approx(12.0, abs=0.1)
    np.testing.assert_allclose(result.run["plant.f.bar"][-1], result.run["f.bar"][-1, :3], atol=0.1)


@needs_examples
@pytest.mark.physics
@pytest.mark.deep
def test_a_real_humanoid_squeezes_a_bar() -> None:
    result = run("dual-arm", "robot=g1")
    assert not failed(result)


@pytest.mark.physics
def test_what_physics_cannot_join_is_refused() -> None:
    from wbc.sim.mujoco_ import MujocoPlant

    robot = wbc.load("humanoid")
    with pytest.raises(NotSupported, match="holds 3 of 6 directions"):
        MujocoPlant(robot, contacts=[LoopClosure("right_hand", to="left_hand")])
    rows = ("x", "y", "z", "rx", "ry", "rz")
    with pytest.raises(UnknownFrame, match="a weld joins links"):
        MujocoPlant(robot, contacts=[LoopClosure("left_wrist_roll", to="left_hand", rows=rows)])
