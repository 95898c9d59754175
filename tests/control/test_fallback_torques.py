"""What motors are sent in a tick without an answer: torques of the robot as components describe it, within limits."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wbc
from tasks import Posture, TorqueLimits, TorqueSpeedLimits
from wbc.models.model import RobotModel
from wbc.stack.constraint import TorqueBySpeed
from wbc.stack.overrides import Actuators
from wbc.types import Vec

ARM = wbc.load("arm")
T_MAX = ARM.limits.tau_max
NO_STATE = np.full(ARM.nq, np.nan)
SEEDS = st.integers(0, 2**32 - 1)
#: The fallback levels, by how many failed ticks hold the last command.
HELD = pytest.mark.parametrize("ticks, level", [(1, "hold"), (0, "damped")])


class Says(wbc.Component):
    """The same overrides in every tick, until it breaks."""

    def __init__(self, overrides: wbc.Overrides | None = None) -> None:
        super().__init__()
        self.overrides, self.broken = overrides, False

    def before(self, state: Any, last: Any, plan: Any) -> wbc.Overrides | None:
        if self.broken:
            raise RuntimeError("broken")
        return self.overrides


def controller(says: Says, *limits: Any, hold: int, gain: float = 50.0) -> wbc.Controller:
    """A posture that the arm is far from."""
    stack = wbc.Stack([Posture(ARM.q0 + 0.3, kp=gain)], subject_to=limits, components=[says])
    return wbc.Controller(ARM, stack, level=wbc.InverseDynamics(), recovery=wbc.Recovery(hold_ticks=hold))


@given(seed=SEEDS)
@settings(max_examples=20)
def test_joints_brake_as_the_command_says_with_the_motors_and_the_load_that_are_known(seed: int) -> None:
    rng = np.random.default_rng(seed)
    share, offset, bias = rng.uniform(0.2, 1.0, ARM.nj), rng.normal(size=ARM.nj), 5.0 * rng.normal(size=ARM.nv)
    factor = rng.normal(size=(ARM.nv, ARM.nv))
    inertia, motors = factor @ factor.T, {i: wbc.Motor(share[i], offset[i]) for i in range(ARM.nj)}
    control = controller(Says(wbc.Overrides(motors=motors, bias=bias, inertia=inertia)), hold=0)
    last = control.tick(0.0, ARM.q0, rng.uniform(-0.5, 0.5, ARM.nv))
    command = control.tick(control.dt, NO_STATE, np.zeros(ARM.nv))
    assert command.fallback_level == "damped"
    state = ARM.state()
    state.update(0.0, last.q, last.v)  # that which is believed
    torque = Actuators(share, offset).torque(command.tau)
    moved = np.linalg.solve(state.M + inertia, torque - state.h - bias)
    np.testing.assert_allclose(moved, command.a, rtol=1e-6, atol=1e-6)


def test_a_weak_motor_is_held_at_the_command_that_carried_the_robot() -> None:
    """Its torques are bounded by what it can give, its commands by the limits of the stack."""
    control = controller(Says(wbc.Overrides(motors={1: wbc.Motor(share=0.5)})), TorqueLimits(), hold=1, gain=1e4)
    last = control.tick(0.0, ARM.q0, np.zeros(ARM.nv))
    assert abs(last.tau[1]) > 0.9 * T_MAX[1]
    held = control.tick(control.dt, NO_STATE, np.zeros(ARM.nv))
    assert held.fallback_level == "hold"
    np.testing.assert_allclose(held.tau, last.tau)


@HELD
@given(seed=SEEDS)
@settings(max_examples=20)
def test_torques_are_what_motors_have_at_the_speed_of_the_tick(ticks: int, level: str, seed: int) -> None:
    v = np.random.default_rng(seed).uniform(-1.5, 1.5, ARM.nv) * ARM.limits.v_max
    said = Says()
    control = controller(said, TorqueSpeedLimits(ARM.limits.v_max), hold=ticks, gain=1e4)
    control.tick(0.0, ARM.q0, np.zeros(ARM.nv))
    said.broken = True
    command = control.tick(control.dt, ARM.q0, v)
    assert command.fallback_level == level
    left = np.clip(1.0 - np.array([v, -v]) / ARM.limits.v_max, 0.0, 1.0) * T_MAX
    assert (command.tau <= left[0] + 1e-9).all() and (-command.tau <= left[1] + 1e-9).all()


class Curve(TorqueBySpeed):
    """Limits of a user's own."""

    def __init__(self, spoils: Any) -> None:
        super().__init__()
        self._spoils = [spoils, False]

    def bounds(self, model: RobotModel) -> tuple[Vec, Vec]:
        return -model.limits.tau_max, model.limits.tau_max.copy()

    def narrow(self, v: Vec, lower: Vec, upper: Vec) -> None:
        if self._spoils[1]:
            self._spoils[0](lower, upper)

    def spoil(self) -> None:
        """From now on."""
        self._spoils[1] = True


def filled(side: int, joints: Any, value: float) -> Any:
    """What writes ``value`` over one of the bounds."""

    def spoil(*bounds: Vec) -> None:
        bounds[side][joints] = value

    return spoil


@HELD
@pytest.mark.parametrize("side", [0, 1], ids=["lower", "upper"])
@pytest.mark.parametrize("joints", [2, slice(None)], ids=["one", "all"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_spoilt_curve_never_reaches_the_motors(ticks: int, level: str, side: int, joints: Any, value: float) -> None:
    curve = Curve(filled(side, joints, value))
    control = controller(Says(), curve, hold=ticks)
    control.tick(0.0, ARM.q0, np.zeros(ARM.nv))
    curve.spoil()
    for k, q in enumerate((ARM.q0, NO_STATE), start=1):
        tau = control.tick(k * control.dt, q, np.zeros(ARM.nv)).tau
        assert np.isfinite(tau).all() and (np.abs(tau) <= T_MAX + 1e-9).all(), (level, control.why)
