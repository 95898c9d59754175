"""A measured force is a known term: tasks are met in spite of it, and the torque it spares is spared."""

from __future__ import annotations

from typing import Any

import numpy as np

import wbc
from tasks import MeasuredWrench, Position, Posture
from tests.stack.conftest import moving
from wbc.types import Vec

ARM = wbc.load("arm")
WRENCH = np.array([3.0, -2.0, 5.0, 0.4, 0.1, -0.3])


def ticked(*components: wbc.Component) -> tuple[Any, Any]:
    """The command of a stack with these components, and the state it was decided in."""
    stack = wbc.Stack([Position("tool", target=[0.5, 0.2, 0.4]), Posture(ARM.q0, weight=1e-2)], components=components)
    controller = wbc.Controller(ARM, stack, level=wbc.InverseDynamics())
    q, v = moving(ARM, 3)
    command = controller.tick(0.0, q, v)
    assert command.status.ok
    return command, controller.state


def test_the_motion_stays_and_the_torque_is_less_by_what_the_wrench_does():
    """Property 51."""
    without, state = ticked()
    with_wrench, _ = ticked(MeasuredWrench("tool", wrench=WRENCH))
    spared: Vec = state.frame("tool").jacobian().T @ WRENCH
    np.testing.assert_allclose(with_wrench.a, without.a, atol=1e-8)
    np.testing.assert_allclose(with_wrench.tau, without.tau - spared, atol=1e-7)


def test_a_force_is_a_wrench_without_moment_and_wrenches_add_up():
    force, _ = ticked(MeasuredWrench("tool", wrench=WRENCH[:3]))
    same, _ = ticked(MeasuredWrench("tool", wrench=lambda t: np.r_[WRENCH[:3], 0, 0, 0]))
    halves, _ = ticked(*(MeasuredWrench("tool", wrench=0.5 * WRENCH[:3], name=name) for name in ("one", "other")))
    np.testing.assert_allclose(force.tau, same.tau, atol=1e-12)
    np.testing.assert_allclose(force.tau, halves.tau, atol=1e-9)


def test_it_acts_in_each_tick_once_and_follows_what_is_assigned():
    sensor = MeasuredWrench("tool")
    stack = wbc.Stack([Posture(ARM.q0)], components=[sensor])
    controller = wbc.Controller(ARM, stack, level=wbc.InverseDynamics())
    q, v = moving(ARM, 3)
    free = controller.tick(0.0, q, v).tau
    sensor.wrench = WRENCH
    pushed = [controller.tick(0.0, q, v).tau for _ in range(3)]
    np.testing.assert_allclose(pushed[0], pushed[2], atol=1e-9)
    np.testing.assert_allclose(free - pushed[0], controller.state.frame("tool").jacobian().T @ WRENCH, atol=1e-7)
    np.testing.assert_array_equal(sensor.signals()["wrench"], WRENCH)
    sensor.wrench = lambda t: WRENCH if t == 0.0 else np.full(6, np.nan)
    controller.tick(0.0, q, v)
    assert controller.tick(1.0, q, v).status.ok
    np.testing.assert_array_equal(sensor.signals()["wrench"], WRENCH)
