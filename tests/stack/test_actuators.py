"""Motors that are known to deliver otherwise are sent the command that gives the torque decided."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tasks import Posture, TorqueLimits
from wbc.errors import InvalidInput
from wbc.stack.actuators import Actuators

numbers = st.floats(-50.0, 50.0)


@given(st.floats(0.05, 1.0), numbers, numbers)
def test_the_command_gives_the_torque(share: float, offset: float, tau: float) -> None:
    motors = Actuators(3)
    motors.set(1, share=share, offset=offset)
    wanted = np.array([1.0, tau, -2.0])
    sent = motors.command(wanted)
    np.testing.assert_allclose(share * sent[1] - offset, tau, atol=1e-9)
    np.testing.assert_allclose(motors.torque(sent), wanted, atol=1e-9)
    assert sent[[0, 2]].tolist() == [1.0, -2.0]


def test_a_dead_motor_is_sent_nothing_and_gives_nothing() -> None:
    motors = Actuators(2)
    motors.set(0, share=0.0)
    assert motors.command(np.array([7.0, 7.0])).tolist() == [0.0, 7.0]
    assert motors.torque(np.array([7.0, 7.0])).tolist() == [0.0, 7.0]
    motors.reset()
    assert motors.command(np.array([7.0, 7.0])).tolist() == [7.0, 7.0]


def test_torques_that_commands_within_bounds_give() -> None:
    motors = Actuators(2)
    motors.set(1, share=0.5, offset=1.0)
    lower, upper = motors.bounds(np.full(2, -10.0), np.full(2, 10.0))
    assert lower.tolist() == [-10.0, -6.0] and upper.tolist() == [10.0, 4.0]


@pytest.mark.parametrize(
    "joint, settings", [(2, {}), (0, {"share": -0.1}), (0, {"share": 1.1}), (0, {"offset": np.nan})]
)
def test_motors_that_make_no_sense_are_refused(joint: int, settings: dict[str, Any]) -> None:
    with pytest.raises(InvalidInput, match=r"joint|share|offset"):
        Actuators(2).set(joint, **settings)


class HalfStrength(wbc.Component):
    """Says in each tick that joint 1 delivers half of what it is sent."""

    def before(self, state: Any, last: Any, plan: Any) -> None:
        plan.actuators.set(1, share=0.5)


def test_a_controller_sends_what_gives_the_torque_it_decided() -> None:
    arm = wbc.load("arm")

    def tau(*components: wbc.Component) -> Any:
        stack = wbc.Stack([Posture(arm.q0)], subject_to=[TorqueLimits()], components=components)
        return wbc.Controller(arm, stack, level=wbc.InverseDynamics()).tick(0.0, arm.q0, 0 * arm.q0).tau

    sound, known = tau(), tau(HalfStrength())
    assert abs(sound[1]) > 1.0
    np.testing.assert_allclose(known, sound * np.array([1, 2, *[1] * (arm.nj - 2)]))
