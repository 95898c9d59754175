"""A component remembers between ticks, and overrides bounds, bias and targets of a tick, never sizes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import wbc
from tasks import Position, Posture, TorqueLimits
from tests.stack.conftest import moving


@pytest.fixture(scope="module")
def arm() -> Any:
    return wbc.load("arm")


class Journal(wbc.Component):
    """Writes down what it is called with."""

    def __init__(self) -> None:
        super().__init__()
        self.calls: list[tuple[str, Any]] = []

    def reset(self, state: Any) -> None:
        self.calls = [("reset", None)]

    def before(self, state: Any, last: Any, plan: Any) -> None:
        self.calls.append(("before", last))

    def after(self, state: Any, command: Any) -> None:
        self.calls.append(("after", command))

    def signals(self) -> dict[str, float]:
        return {"calls": float(len(self.calls))}


def controller(arm: Any, component: wbc.Component) -> wbc.Controller:
    stack = wbc.Stack(
        [Position("tool", target=[0.5, 0.2, 0.4]), Posture(arm.q0, weight=1e-2)],
        subject_to=[TorqueLimits()],
        components=[component],
    )
    return wbc.Controller(arm, stack, level=wbc.InverseDynamics())


def test_it_is_reset_before_the_first_tick_and_sees_each_command_once(arm: Any) -> None:
    journal = Journal()
    control = controller(arm, journal)
    q, v = moving(arm, 1)
    first = control.tick(0.0, q, v)
    second = control.tick(1e-3, q, v)
    assert journal.calls == [
        ("reset", None), ("before", None), ("after", first), ("before", first), ("after", second),
    ]  # fmt: skip
    control.reset()
    control.tick(0.0, q, v)
    assert [name for name, _ in journal.calls] == ["reset", "before", "after"]


def test_it_sees_a_command_that_could_not_be_solved(arm: Any) -> None:
    journal = Journal()
    control = controller(arm, journal)
    q, v = moving(arm, 1)
    control.tick(0.0, q, v)
    control.stack.tasks[0].target = lambda t: np.full(3, 0.4 if t == 0.0 else np.nan)
    held = control.tick(1e-3, q, v)
    assert journal.calls[-1] == ("after", held)
    assert not held.status.ok


BOUND = np.where(np.arange(7) == 2, 0.0, np.inf)
DEAD = wbc.Overrides(torque=(-BOUND, BOUND))


class Dead(wbc.Component):
    """Takes one joint's torque away."""

    def before(self, state: Any, last: Any, plan: Any) -> wbc.Overrides:
        return DEAD


def test_reset_takes_back_what_it_wrote(arm: Any) -> None:
    control = controller(arm, Dead())
    control.tick(0.0, *moving(arm, 2))
    control.components = ()
    control.reset()
    assert abs(control.tick(0.0, *moving(arm, 2)).tau[2]) > 0.1


def test_bounds_it_writes_hold_in_the_same_tick(arm: Any) -> None:
    q, v = moving(arm, 2)
    command = controller(arm, Dead()).tick(0.0, q, v)
    assert command.status.ok
    assert abs(command.tau[2]) <= 1e-8


class Failing(wbc.Component):
    """Takes a joint's torque away in the tick in which the solve fails."""

    def before(self, state: Any, last: Any, plan: Any) -> wbc.Overrides | None:
        return DEAD if state.t > 0.5 else None


def test_bounds_it_writes_hold_for_a_command_that_is_repeated(arm: Any) -> None:
    control = controller(arm, Failing())
    q, v = moving(arm, 2)
    assert abs(control.tick(0.0, q, v).tau[2]) > 0.1
    control.stack.tasks[0].target = lambda t: np.full(3, 0.4 if t == 0.0 else np.nan)
    held = control.tick(1.0, q, v)
    assert held.fallback_level == "hold"
    assert held.tau[2] == 0.0


class Load(wbc.Component):
    """Knows of a generalised force that the model does not."""

    force = np.linspace(1.0, -1.0, 7)

    def before(self, state: Any, last: Any, plan: Any) -> wbc.Overrides:
        return wbc.Overrides(bias=self.force)


def test_a_bias_it_writes_is_carried_by_the_torques(arm: Any) -> None:
    q, v = moving(arm, 3)
    without = controller(arm, Journal()).tick(0.0, q, v)
    loaded = controller(arm, Load()).tick(0.0, q, v)
    np.testing.assert_allclose(loaded.a, without.a, atol=1e-9)
    np.testing.assert_allclose(loaded.tau, without.tau + Load.force, atol=1e-8)


def test_torques_at_a_level_without_them_are_refused_in_a_sentence(arm: Any) -> None:
    control = wbc.Controller(arm, wbc.Stack([Posture(arm.q0)], components=[Dead()]), level=wbc.VelocityLevel())
    control.tick(0.0, arm.q0, np.zeros(7))
    assert control.why == "Dead overrides torques, which the velocity level does not decide"
