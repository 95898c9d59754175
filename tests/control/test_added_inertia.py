"""What components add to the inertia holds for one tick, and from all of them together."""

from __future__ import annotations

import numpy as np
import pytest

import wbc
from tasks import Posture
from wbc.models.model import RobotState
from wbc.stack.component import Component
from wbc.stack.plan import Plan
from wbc.types import Mat

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
