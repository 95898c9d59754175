"""Limits come from the model or are given by number, array or joint name; nonsense is refused by joint name."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tasks import JointAccelerationLimits, JointPositionLimits, JointVelocityLimits, TorqueLimits
from wbc.errors import InvalidInput
from wbc.testing import robots

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
        (JointVelocityLimits(), ARM.limits.v_max),
        (TorqueLimits(), ARM.limits.tau_max),
        (JointPositionLimits(), ARM.limits.q_max),
        (JointAccelerationLimits({}), np.full(ARM.nj, np.inf)),
        (JointVelocityLimits(0.5), np.full(ARM.nj, 0.5)),
        (TorqueLimits(np.arange(1.0, 8.0)), np.arange(1.0, 8.0)),
        (JointVelocityLimits({SECOND: 0.1}), np.where(np.arange(7) == 1, 0.1, ARM.limits.v_max)),
        (TorqueLimits({FIRST: np.inf}), np.where(np.arange(7) == 0, np.inf, ARM.limits.tau_max)),
    ],
)
def test_bounds_come_from_the_model_unless_given(constraint: Any, upper: Any):
    constraint.prepare(ARM)
    np.testing.assert_array_equal(constraint.bounds(ARM)[1], upper)
    if constraint.quantity != "position":
        np.testing.assert_array_equal(constraint.bounds(ARM)[0], -upper)


def test_the_limits_of_the_model_are_copied():
    JointPositionLimits().bounds(ARM)[1][:] = 0.0
    assert ARM.limits.q_max.any()


@pytest.mark.parametrize("value", [0.0, -1.0, np.nan])
@pytest.mark.parametrize(
    ("constraint", "field", "argument"),
    [(JointVelocityLimits, "v_max", "v_max"), (TorqueLimits, "tau_max", "tau_max")],
)
def test_a_limit_of_the_model_that_makes_no_sense_is_refused_and_can_be_overruled(constraint, field, argument, value):
    robot = with_limit(field, value)
    with pytest.raises(InvalidInput, match=f"{argument} of joint '{FIRST}' is .*Pass {argument}=.* to overrule"):
        constraint().prepare(robot)
    constraint({FIRST: 3.0}).prepare(robot)
    assert constraint({FIRST: 3.0}).bounds(robot)[1][0] == 3.0


def test_all_joints_whose_limits_make_no_sense_are_named_at_once():
    names = ARM.joint_names[1:4]
    bad = np.isin(ARM.joint_names, names)
    slow = ARM.replace(limits=replace(ARM.limits, v_max=np.where(bad, 0.0, 1.0), q_max=np.where(bad, -9.0, 3.0)))
    for constraint in (JointVelocityLimits(), JointPositionLimits()):
        with pytest.raises(InvalidInput) as refusal:
            constraint.prepare(slow)
        assert all(f"joint {name!r}" in str(refusal.value) for name in names)
    JointVelocityLimits(dict.fromkeys(names, 1.0)).prepare(slow)


def test_crossed_position_limits_are_refused_by_joint_name():
    robot = with_limit("q_max", -100.0)
    with pytest.raises(InvalidInput, match=f"joint '{FIRST}' has limits .*lower must not be above upper"):
        JointPositionLimits().prepare(robot)
    JointPositionLimits(upper={FIRST: 1.0}).prepare(robot)


@pytest.mark.parametrize("wrong", range(1, 8))
def test_a_limit_that_many_joints_get_wrong_names_three_of_them(wrong: int):
    values = np.where(np.arange(7) < wrong, -2.0, 1.0)
    with pytest.raises(InvalidInput, match=r"v_max of joint .* is -2.*; a limit is positive") as refused:
        JointVelocityLimits(values).prepare(ARM)
    said = str(refused.value)
    assert [f"joint {joint!r} is" in said for joint in ARM.joint_names] == [k < min(wrong, 3) for k in range(7)]
    assert (f"and of {wrong - 3} more" in said) == (wrong > 3)


def test_equal_position_limits_are_allowed():
    lower, upper = JointPositionLimits(lower={FIRST: 0.2}, upper={FIRST: 0.2}).bounds(ARM)
    assert lower[0] == upper[0] == 0.2
