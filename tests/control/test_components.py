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
    """Takes one joint's torque away from half a second on."""

    def before(self, state: Any, last: Any, plan: Any) -> wbc.Overrides | None:
        return DEAD if state.t > 0.5 else None


def test_bounds_it_writes_hold_in_their_tick_also_for_a_command_that_is_repeated(arm: Any) -> None:
    control = controller(arm, Dead())
    q, v = moving(arm, 2)
    for t, dead in ((1.0, True), (0.0, False)):
        command = control.tick(t, q, v)
        assert command.status.ok and (abs(command.tau[2]) <= 1e-8) == dead
    control.stack.tasks[0].target = lambda t: np.full(3, 0.4 if t == 0.0 else np.nan)
    held = control.tick(1.0, q, v)
    assert held.fallback_level == "hold"
    assert held.tau[2] == 0.0


def test_torques_at_a_level_without_them_are_refused_in_a_sentence(arm: Any) -> None:
    control = wbc.Controller(arm, wbc.Stack([Posture(arm.q0)], components=[Dead()]), level=wbc.VelocityLevel())
    control.tick(1.0, arm.q0, np.zeros(7))
    assert control.why == "Dead overrides torques, which the velocity level does not decide"
