"""Motors that are known to deliver otherwise are sent the command that gives the torque decided."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wbc
from tasks import JointVelocityLimits, Posture, TorqueLimits, TorqueSpeedLimits
from tests.stack.conftest import Saying
from wbc.errors import InvalidInput
from wbc.stack.overrides import Actuators

numbers = st.floats(-50.0, 50.0)


@given(st.floats(0.05, 1.0), numbers, numbers)
def test_the_command_gives_the_torque(share: float, offset: float, tau: float) -> None:
    motors = Actuators(np.array([1.0, share, 1.0]), np.array([0.0, offset, 0.0]))
    wanted = np.array([1.0, tau, -2.0])
    sent = motors.command(wanted)
    np.testing.assert_allclose(share * sent[1] - offset, tau, atol=1e-9)
    np.testing.assert_allclose(motors.torque(sent), wanted, atol=1e-9)
    assert sent[[0, 2]].tolist() == [1.0, -2.0]


def test_a_dead_motor_is_sent_nothing_and_gives_nothing() -> None:
    motors = Actuators(np.array([0.0, 1.0]), np.zeros(2))
    assert motors.command(np.array([7.0, 7.0])).tolist() == [0.0, 7.0]
    assert motors.torque(np.array([7.0, 7.0])).tolist() == [0.0, 7.0]


class HalfStrength(wbc.Component):
    """Says in each tick that joint 1 delivers half of what it is sent."""

    def before(self, state: Any, last: Any, plan: Any) -> wbc.Overrides:
        return wbc.Overrides(motors={1: wbc.Motor(share=0.5)})


def test_a_controller_sends_what_gives_the_torque_it_decided() -> None:
    arm = wbc.load("arm")

    def tau(*components: wbc.Component) -> Any:
        stack = wbc.Stack([Posture(arm.q0)], subject_to=[TorqueLimits()], components=components)
        return wbc.Controller(arm, stack, level=wbc.InverseDynamics()).tick(0.0, arm.q0, 0 * arm.q0).tau

    sound, known = tau(), tau(HalfStrength())
    assert abs(sound[1]) > 1.0
    np.testing.assert_allclose(known, sound * np.array([1, 2, *[1] * (arm.nj - 2)]))


@pytest.mark.parametrize("motor", [None, "ab", (), (0.5,), (0.5, 0.0, 0.0), np.array([0.5, 0.0]), {0.5: 0.0}])
def test_what_is_neither_a_motor_nor_a_share_is_refused_by_joint(motor: Any) -> None:
    arm = wbc.load("arm")
    applied = wbc.InverseDynamics().compile(arm, wbc.Stack([Posture(arm.q0)]), dt=1e-3).applied
    with pytest.raises(InvalidInput, match=r"mine\.motors\[1\]\.share"):
        applied.apply([("mine", wbc.Overrides(motors={1: motor}))])
    assert (applied.actuators.share == 1.0).all()
    share: Any = 0.5
    for half in (share, (share, 0.0), wbc.Motor(share)):
        applied.apply([("mine", wbc.Overrides(motors={1: half}))])
        assert applied.actuators.share.tolist() == [1.0, 0.5, *[1.0] * (arm.nj - 2)]


def test_a_command_stays_within_the_torque_limits_whatever_is_known_of_its_motor() -> None:
    """Torques are bounded by what commands within the limits give, so that no command is divided beyond them."""
    arm = wbc.load("arm")

    class Known(wbc.Component):
        def before(self, state: Any, last: Any, plan: Any) -> wbc.Overrides:
            return wbc.Overrides(motors={1: wbc.Motor(share=0.1, offset=0.5), 3: wbc.Motor(offset=-2.0)})

    stack = wbc.Stack([Posture(arm.q0 + 2.0, kp=1e4)], subject_to=[TorqueLimits()], components=[Known()])
    command = wbc.Controller(arm, stack, level=wbc.InverseDynamics()).tick(0.0, arm.q0, 0 * arm.q0)
    assert command.status.ok
    assert (np.abs(command.tau) <= arm.limits.tau_max + 1e-6).all()
    assert np.abs(command.tau[1]) > 0.999 * arm.limits.tau_max[1]


ARM = wbc.load("arm")
FREE = TorqueSpeedLimits(ARM.limits.v_max)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_a_command_stays_within_what_its_motor_has_at_its_speed(seed: int) -> None:
    """What is known to be lost on the way to the joint does not make the motor stronger."""
    rng = np.random.default_rng(seed)
    v, share, offset = rng.uniform(-0.9, 0.9, ARM.nv) * ARM.limits.v_max, rng.uniform(0.1, 1.0, 7), rng.normal(size=7)
    knows = Saying(wbc.Overrides(motors={i: wbc.Motor(share[i], 0.1 * offset[i]) for i in range(ARM.nj)}))
    stack = wbc.Stack([Posture(ARM.q0 + np.sign(v), kp=1e4)], subject_to=[FREE], components=[knows])
    command = wbc.Controller(ARM, stack, level=wbc.InverseDynamics()).tick(0.0, ARM.q0, v)
    assert command.status.ok
    left = np.clip(1.0 - np.array([v, -v]) / ARM.limits.v_max, 0.0, 1.0) * ARM.limits.tau_max
    for torque in (command.tau, Actuators(share, 0.1 * offset).torque(command.tau)):
        assert (torque <= left[0] + 1e-6).all() and (-torque <= left[1] + 1e-6).all()
    assert np.abs(np.array([command.tau, -command.tau]) - left).min() <= 1e-6, "one of them is used up"


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_joint_whose_torque_limits_are_lifted_is_held_at_any_speed(side: float) -> None:
    """As by a brake, which has no torque-speed curve."""
    held = np.where(np.arange(ARM.nj) == 1, 0.0, np.inf)
    braked = wbc.Overrides(lifted={"torque": [1]}, motors={1: wbc.Motor(0.0)}, acceleration=(-held, held))
    q, v = ARM.q0.copy(), np.zeros(ARM.nv)
    q[1], v[1] = -1.5 * side, 0.9 * side * ARM.limits.v_max[1]  # upwards, so fast that a motor could not carry it
    stack = wbc.Stack([Posture(q, kp=10.0)], subject_to=[FREE, JointVelocityLimits()], components=[Saying(braked)])
    control = wbc.Controller(ARM, stack, level=wbc.InverseDynamics())
    command = control.tick(0.0, q, v)
    assert command.status.ok, control.explain()
    assert command.tau[1] == 0.0 and np.abs(command.a).max() <= 1e-4, "no other joint has to carry it"


def test_a_motor_that_leaves_no_torque_is_refused_by_the_component_that_speaks_of_it() -> None:
    weak, sound = Saying(name="weak"), Saying(wbc.Overrides(motors={1: wbc.Motor()}), name="sound")
    stack = wbc.Stack([Posture(ARM.q0)], subject_to=[TorqueLimits()], components=[weak, sound])
    control = wbc.Controller(ARM, stack, level=wbc.InverseDynamics())
    weak.now = wbc.Overrides(motors={0: wbc.Motor(offset=1e6)})
    assert not control.tick(0.0, ARM.q0, 0 * ARM.q0).status.ok
    assert control.why.startswith("weak.motors: joint 'shoulder_yaw' is left no torque")
