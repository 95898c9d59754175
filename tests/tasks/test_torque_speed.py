"""Torque against speed: a motor gives what its curve leaves it, and brakes with all it has."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tasks import JointLimits, JointVelocity, Posture, TorqueLimits, TorqueSpeedLimits
from tests.stack.conftest import Saying
from wbc import Controller, InverseDynamics, Overrides, Stack
from wbc.testing import robots
from wbc.types import Vec

ARM = robots()[0]
FIRST = ARM.joint_names[0]


def narrowed(constraint: TorqueSpeedLimits, v: Any) -> tuple[Vec, Vec]:
    constraint.prepare(ARM)
    lower, upper = constraint.bounds(ARM)
    constraint.narrow(np.full(ARM.nj, v, dtype=np.float64), lower, upper)
    return lower, upper


@pytest.mark.parametrize(
    ("v", "lower", "upper"),
    [(0.0, -10.0, 10.0), (1.0, -10.0, 10.0), (2.0, -10.0, 10.0), (3.0, -10.0, 5.0), (4.0, -10.0, 0.0),
     (9.0, -10.0, 0.0), (-3.0, -5.0, 10.0), (-9.0, 0.0, 10.0)],
)  # fmt: skip
def test_full_up_to_the_corner_then_falling_to_nothing(v: float, lower: float, upper: float):
    found = narrowed(TorqueSpeedLimits(4.0, 10.0, corner_speed=2.0), v)
    np.testing.assert_allclose([bound[0] for bound in found], (lower, upper), atol=1e-12)


@given(st.floats(-1e3, 1e3), st.floats(1e-2, 1e2), st.floats(0.0, 0.99))
def test_zero_is_always_allowed_and_neither_side_jumps(v: float, free: float, corner: float):
    constraint = TorqueSpeedLimits(free, 10.0, corner_speed=corner * free)
    (lower, upper), (low, high) = narrowed(constraint, v), narrowed(constraint, v + 1e-9 * free)
    assert (lower <= 0.0).all() and (upper >= 0.0).all()
    np.testing.assert_allclose((low, high), (lower, upper), atol=1e-5)


def test_joints_left_out_keep_what_the_model_says():
    lower, upper = narrowed(TorqueSpeedLimits({FIRST: 1.0}), 100.0)
    assert (lower[0], upper[0]) == (-ARM.limits.tau_max[0], 0.0)
    np.testing.assert_array_equal(upper[1:], ARM.limits.tau_max[1:])


@pytest.mark.parametrize("limits", [lambda: [TorqueSpeedLimits(2.0)], lambda: [JointLimits(no_load_speed=2.0)]])
def test_a_controller_commands_no_more_than_the_speed_leaves(limits: Any):
    faster = JointVelocity(np.full(ARM.nj, 3.0), kd=200.0)
    controller = Controller(ARM, Stack([faster], subject_to=[*limits(), TorqueLimits()]), level=InverseDynamics())
    constraint = TorqueSpeedLimits(2.0)
    tight = 0
    for v in (0.0, 0.5, 1.5, 1.9):
        command = controller.tick(0.0, ARM.q0, np.full(ARM.nv, v))
        lower, upper = narrowed(constraint, v)
        assert (command.tau <= upper + 1e-8).all() and (command.tau >= lower - 1e-8).all()
        tight += int((command.tau > upper - 1e-6).sum())
    assert tight > 0


def test_what_a_component_takes_away_stays_away():
    saying = Saying()
    stack = Stack([Posture(ARM.q0)], subject_to=[TorqueSpeedLimits(2.0)], components=[saying])
    controller = Controller(ARM, stack, level=InverseDynamics())
    controller.tick(0.0, ARM.q0, np.zeros(ARM.nv))
    saying.now = Overrides(torque=(-1.0, 1.0))
    command = controller.tick(0.0, ARM.q0 + 0.1, np.zeros(ARM.nv))
    assert np.abs(command.tau).max() <= 1.0 + 1e-8
    assert np.abs(controller.plan.torque_range[1]).max() <= 1.0
