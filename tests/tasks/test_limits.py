"""Limits come from the model or are given by number, array or joint name; torque limits may fall with speed."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tasks as T
from tests.stack.conftest import Saying
from wbc import Controller, InverseDynamics, Overrides, Stack
from wbc.errors import InvalidInput
from wbc.testing import robots
from wbc.types import Vec

ARM = robots()[0]
FIRST, SECOND = ARM.joint_names[:2]


def with_limit(field: str, value: float) -> Any:
    """The arm with one limit of its first joint replaced."""
    changed = getattr(ARM.limits, field).copy()
    changed[0] = value
    robot = copy(ARM)
    robot.limits = replace(ARM.limits, **{field: changed})
    return robot


@pytest.mark.parametrize(
    ("constraint", "upper"),
    [
        (T.JointVelocityLimits(), ARM.limits.v_max),
        (T.TorqueLimits(), ARM.limits.tau_max),
        (T.JointPositionLimits(), ARM.limits.q_max),
        (T.JointAccelerationLimits({}), np.full(ARM.nj, np.inf)),
        (T.JointVelocityLimits(0.5), np.full(ARM.nj, 0.5)),
        (T.TorqueLimits(np.arange(1.0, 8.0)), np.arange(1.0, 8.0)),
        (T.JointVelocityLimits({SECOND: 0.1}), np.where(np.arange(7) == 1, 0.1, ARM.limits.v_max)),
        (T.TorqueLimits({FIRST: np.inf}), np.where(np.arange(7) == 0, np.inf, ARM.limits.tau_max)),
    ],
)
def test_bounds_come_from_the_model_unless_given(constraint: Any, upper: Any):
    constraint.prepare(ARM)
    np.testing.assert_array_equal(constraint.bounds(ARM)[1], upper)
    if constraint.quantity != "position":
        np.testing.assert_array_equal(constraint.bounds(ARM)[0], -upper)


def test_the_limits_of_the_model_are_copied():
    T.JointPositionLimits().bounds(ARM)[1][:] = 0.0
    assert ARM.limits.q_max.any()


@pytest.mark.parametrize(
    ("constraint", "field", "value", "says", "own"),
    [
        *((kind, field, value, f"{field} of joint '{FIRST}' is .*Pass {field}=.* to overrule", {field: {FIRST: 3.0}})
          for kind, field in ((T.JointVelocityLimits, "v_max"), (T.TorqueLimits, "tau_max"))
          for value in (0.0, -1.0, np.nan)),
        (T.JointPositionLimits, "q_max", -100.0, f"joint '{FIRST}' has limits .*lower must not be above upper",
         {"upper": {FIRST: 3.0}}),
    ],
)  # fmt: skip
def test_a_limit_of_the_model_that_makes_no_sense_is_refused_and_can_be_overruled(
    constraint: Any, field: str, value: float, says: str, own: dict[str, Any]
):
    robot = with_limit(field, value)
    with pytest.raises(InvalidInput, match=says):
        constraint().prepare(robot)
    constraint(**own).prepare(robot)
    assert constraint(**own).bounds(robot)[1][0] == 3.0


@pytest.mark.parametrize("wrong", range(1, 8))
def test_a_limit_that_many_joints_get_wrong_names_three_of_them(wrong: int):
    values = np.where(np.arange(7) < wrong, -2.0, 1.0)
    with pytest.raises(InvalidInput, match=r"v_max of joint .* is -2.*; a limit is positive") as refused:
        T.JointVelocityLimits(values).prepare(ARM)
    said = str(refused.value)
    assert [f"joint {joint!r} is" in said for joint in ARM.joint_names] == [k < min(wrong, 3) for k in range(7)]
    assert (f"and of {wrong - 3} more" in said) == (wrong > 3)


def test_equal_position_limits_are_allowed():
    lower, upper = T.JointPositionLimits(lower={FIRST: 0.2}, upper={FIRST: 0.2}).bounds(ARM)
    assert lower[0] == upper[0] == 0.2


# ---- torque against speed: a motor gives what its curve leaves it, and brakes with all it has
def narrowed(constraint: T.TorqueSpeedLimits, v: Any) -> tuple[Vec, Vec]:
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
    found = narrowed(T.TorqueSpeedLimits(4.0, 10.0, corner_speed=2.0), v)
    np.testing.assert_allclose([bound[0] for bound in found], (lower, upper), atol=1e-12)


@given(st.floats(-1e3, 1e3), st.floats(1e-2, 1e2), st.floats(0.0, 0.99))
def test_zero_is_always_allowed_and_neither_side_jumps(v: float, free: float, corner: float):
    constraint = T.TorqueSpeedLimits(free, 10.0, corner_speed=corner * free)
    (lower, upper), (low, high) = narrowed(constraint, v), narrowed(constraint, v + 1e-9 * free)
    assert (lower <= 0.0).all() and (upper >= 0.0).all()
    np.testing.assert_allclose((low, high), (lower, upper), atol=1e-5)


def test_joints_left_out_keep_what_the_model_says():
    lower, upper = narrowed(T.TorqueSpeedLimits({FIRST: 1.0}), 100.0)
    assert (lower[0], upper[0]) == (-ARM.limits.tau_max[0], 0.0)
    np.testing.assert_array_equal(upper[1:], ARM.limits.tau_max[1:])


@pytest.mark.parametrize("limits", [lambda: [T.TorqueSpeedLimits(2.0)], lambda: [T.JointLimits(no_load_speed=2.0)]])
def test_a_controller_commands_no_more_than_the_speed_leaves(limits: Any):
    faster = T.JointVelocity(np.full(ARM.nj, 3.0), kd=200.0)
    controller = Controller(ARM, Stack([faster], subject_to=[*limits(), T.TorqueLimits()]), level=InverseDynamics())
    constraint = T.TorqueSpeedLimits(2.0)
    tight = 0
    for v in (0.0, 0.5, 1.5, 1.9):
        command = controller.tick(0.0, ARM.q0, np.full(ARM.nv, v))
        lower, upper = narrowed(constraint, v)
        assert (command.tau <= upper + 1e-8).all() and (command.tau >= lower - 1e-8).all()
        tight += int((command.tau > upper - 1e-6).sum())
    assert tight > 0


def test_what_a_component_takes_away_stays_away():
    saying = Saying()
    stack = Stack([T.Posture(ARM.q0)], subject_to=[T.TorqueSpeedLimits(2.0)], components=[saying])
    controller = Controller(ARM, stack, level=InverseDynamics())
    controller.tick(0.0, ARM.q0, np.zeros(ARM.nv))
    saying.now = Overrides(torque=(-1.0, 1.0))
    command = controller.tick(0.0, ARM.q0 + 0.1, np.zeros(ARM.nv))
    assert np.abs(command.tau).max() <= 1.0 + 1e-8
    assert np.abs(controller.plan.torque_range[1]).max() <= 1.0
