"""Rows along the axes of the frame itself: the way to the target turns with it."""

from __future__ import annotations

import numpy as np
import pinocchio
import pytest
from hypothesis import given

import wbc
from tasks import JointLimits, LocalPosition, Orientation, Position, Posture
from tests.tasks.rows_of import rows
from wbc.errors import InvalidInput
from wbc.models.model import RobotState
from wbc.testing import robots
from wbc.testing.strategies import states

ARM, _, HUMANOID = robots()
TARGET = np.array([0.3, 0.1, 0.6])


@given(states(HUMANOID))
def test_it_is_the_same_error_in_other_axes(state: RobotState):
    hand = state.frame("left_hand")
    own, world = (rows(kind("left_hand", target=TARGET), state) for kind in (LocalPosition, Position))
    np.testing.assert_allclose(hand.rotation @ own.e, world.e, atol=1e-12)
    # Turning with the frame adds the lever to the target, and nothing where the frame is at it.
    lever = pinocchio.skew(TARGET - hand.position) @ hand.jacobian()[3:]
    np.testing.assert_allclose(hand.rotation @ own.J, world.J - lever, atol=1e-12)
    np.testing.assert_array_equal(rows(LocalPosition("left_hand", target=TARGET, axes="xz"), state).J, own.J[[0, 2]])


@pytest.mark.parametrize("level", [wbc.VelocityLevel(), wbc.AccelerationLevel(), wbc.InverseDynamics()])
def test_a_drill_is_free_along_its_own_axis(level: wbc.Formulation):
    """A tilted tool comes onto the line through the target, where the posture has it along that line."""
    state, dt = ARM.state(), 5e-3
    tool = state.frame("tool")
    tilted = tool.rotation @ pinocchio.rpy.rpyToMatrix(0.3, -0.4, 0.0)
    far = tool.position + tilted @ [0.02, -0.03, 0.3]  # 0.3 m along the tool: not to be gone
    drill = LocalPosition("tool", target=far, axes="xy", kp=100.0)
    stack = wbc.Stack(
        [drill, Orientation("tool", target=tilted), Posture(ARM.q0, weight=1e-4)], subject_to=[JointLimits()]
    )
    controller, q, v = wbc.Controller(ARM, stack, level=level, dt=dt), ARM.q0, np.zeros(ARM.nv)
    for k in range(600):
        command = controller.tick(k * dt, q, v)
        assert command.status.ok
        q, v = command.q, command.v
    state.update(0.0, q, v)
    off = state.frame("tool").rotation.T @ (far - state.frame("tool").position)
    assert np.abs(off[:2]).max() < 1e-3 and off[2] > 0.2


def test_axes_are_some_of_xyz():
    with pytest.raises(InvalidInput, match=r"LocalPosition\[tool\].axes"):
        LocalPosition("tool", target=TARGET, axes="zx")
