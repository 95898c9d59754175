"""A component remembers between ticks, and overrides bounds, bias and targets of a tick, never sizes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import wbc
from tasks import Position, Posture, TorqueLimits
from tests.stack.conftest import moving
from wbc.models.model import RobotState
from wbc.stack.component import Component
from wbc.stack.plan import Plan
from wbc.types import Mat


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


# ---- what components add to the inertia holds for one tick, and from all of them together
ARM = wbc.load("arm")


class Heavier(Component):
    """Adds the same to M at the times given."""

    def __init__(self, more: float, ticks: tuple[int, ...]) -> None:
        super().__init__(name=f"heavier by {more}")
        self.more, self.ticks, self.tick = more * np.eye(ARM.nv), ticks, 0

    def reset(self, state: RobotState) -> None:
        self.tick = 0

    def before(self, state: RobotState, last: object, plan: Plan) -> wbc.Overrides | None:
        self.tick += 1
        return wbc.Overrides(inertia=self.more) if self.tick - 1 in self.ticks else None


def inertia_of(plan: Plan) -> Mat:
    rows = plan.problem.G[plan.layout.torque_row : plan.layout.torque_row + ARM.nv, : ARM.nv]
    return np.array(rows)


def test_what_two_components_add_is_added_up_and_gone_in_the_next_tick():
    stack = wbc.Stack([Posture(ARM.q0)], components=[Heavier(1.0, (0, 1)), Heavier(0.5, (0,))])
    controller = wbc.Controller(ARM, stack, level=wbc.InverseDynamics())
    for more in (1.5, 1.0, 0.0):
        controller.tick(0.0, ARM.q0, np.zeros(ARM.nv))
        np.testing.assert_allclose(inertia_of(controller.plan), ARM.state().M + more * np.eye(ARM.nv), atol=1e-12)


class Adds(Component):
    """Adds this to M."""

    def __init__(self, more: Mat) -> None:
        super().__init__(name="guess")
        self._overrides = wbc.Overrides(inertia=more)

    def before(self, state: RobotState, last: object, plan: Plan) -> wbc.Overrides:
        return self._overrides


@pytest.mark.parametrize("seed", range(20))
def test_an_inertia_is_refused_exactly_where_a_motion_would_have_negative_energy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(ARM.nv, ARM.nv))
    q, M = ARM.random_configuration(rng), ARM.state()
    M.update(0.0, q, np.zeros(ARM.nv))
    more = rng.uniform(0.0, 0.6) * (A + A.T) * np.linalg.eigvalsh(M.M)[rng.integers(ARM.nv)]
    stack = wbc.Stack([Posture(ARM.q0)], components=[Adds(more)])
    controller = wbc.Controller(ARM, stack, level=wbc.InverseDynamics())
    command = controller.tick(0.0, q, np.zeros(ARM.nv))
    negative = bool((np.linalg.eigvalsh(M.M + more) < 0.0).any())
    assert command.status.ok != negative
    assert ("guess.inertia: M + inertia has the eigenvalue -" in controller.why) == negative


def test_an_inertia_that_is_not_symmetric_is_refused() -> None:
    stack = wbc.Stack([Posture(ARM.q0)], components=[Adds(np.triu(np.ones((ARM.nv, ARM.nv))))])
    controller = wbc.Controller(ARM, stack, level=wbc.InverseDynamics())
    assert not controller.tick(0.0, ARM.q0, np.zeros(ARM.nv)).status.ok
    assert "guess.inertia is not symmetric" in controller.why
