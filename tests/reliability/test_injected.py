"""Whatever happens in whatever order: each tick gives a finite, bounded command, and a sound one solves again."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

import wbc
from tests.reliability.faults import FAULTS, excess, sabotaged
from tests.reliability.injected import LEVELS, contact_changes, faults
from wbc.errors import InvalidInput
from wbc.types import Status


# ---- few here, and many with ``python -m tests.reliability.injected``
@pytest.mark.parametrize("other", [True, False])
@pytest.mark.parametrize("name", LEVELS)
def test_a_fault_is_answered_within_bounds_in_the_same_tick(name: str, other: bool):
    found = faults(name, 60, other=other)
    assert found.bad == 0 and sum(found.fallback_levels.values()) == found.count
    if other:  # an answer that is late, or all but right, is certified; for all others another solver
        assert {"other solver"} <= set(found.fallback_levels) <= {"solved", "other solver"}
    else:
        assert found.fallback_levels["closed form"] > 0


@pytest.mark.parametrize("name", ["quadruped", "humanoid"])
def test_whichever_feet_hold_there_is_an_answer(name: str):
    found = contact_changes(name, 100)
    assert found.bad == 0 and set(found.fallback_levels) == {"solved"}


# ---- a controller from its first tick on
ROBOTS = {name: wbc.load(name) for name in LEVELS}
RUBBISH = st.sampled_from([np.nan, np.inf, -np.inf, 1e300, 1e20, -1e9])
SEEDS = st.integers(0, 2**32 - 1)


class Life(RuleBasedStateMachine):
    """One controller from its first tick on."""

    @initialize(name=st.sampled_from(sorted(LEVELS)), other=st.booleans(), hold=st.integers(0, 3))
    def begin(self, name: str, other: bool, hold: int) -> None:
        self.robot, level = ROBOTS[name], LEVELS[name]
        self.control, self.script = sabotaged(
            self.robot, level, other=other, recovery=wbc.Recovery(hold_ticks=hold, resume_after=hold + 1)
        )
        self.weights = [task.weight for task in self.control.stack.tasks]
        self.command: Any = None
        self.t, self.q, self.v = 0.0, np.array(self.robot.q0), np.zeros(self.robot.nv)

    def tick(self, q: Any, v: Any) -> None:
        self.command = self.control.tick(self.t, q, v)
        self.t += self.control.dt
        if np.abs(self.command.v).max() < 5.0 and np.abs(self.command.q - self.robot.q0).max() < 1.0:
            self.q, self.v = np.array(self.command.q), np.array(self.command.v)

    @rule()
    def go_on(self) -> None:
        self.tick(self.q, self.v)

    @rule(fault=st.sampled_from(["", *FAULTS[:-1]]))
    def break_or_mend_the_solver(self, fault: str) -> None:
        self.script.fault = fault

    @rule(value=RUBBISH, place=st.integers(0, 40), which=st.booleans())
    def see_nonsense(self, value: float, place: int, which: bool) -> None:
        q, v = self.q.copy(), self.v.copy()
        spoilt = q if which else v
        spoilt[place % len(spoilt)] = value
        self.tick(q, v)
        assert self.command.status is Status.INVALID_STATE

    @rule(seed=SEEDS)
    def be_pushed(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.q = self.robot.integrate(self.robot.q0, 0.05 * rng.normal(size=self.robot.nv))
        self.v = 0.2 * rng.normal(size=self.robot.nv)

    @rule(value=st.one_of(RUBBISH, st.floats(0.0, 1e3)), task=st.integers(0, 1))
    def weigh(self, value: float, task: int) -> None:
        try:
            self.control.stack.tasks[task].weight = value
        except InvalidInput:
            assert not 0.0 <= value <= 1e15

    @rule(value=st.one_of(RUBBISH, st.floats(-2.0, 2.0)))
    def aim(self, value: float) -> None:
        task: Any = self.control.stack.tasks[0]
        target = np.array(task.target)
        target[2] = value
        try:
            task.target = target
        except InvalidInput:
            assert not abs(value) <= 1e15

    @rule()
    def start_anew(self) -> None:
        self.control.reset()
        self.q, self.v = np.array(self.robot.q0), np.zeros(self.robot.nv)

    @precondition(lambda self: self.command is not None)
    @rule()
    def heal(self) -> None:
        """A sound solver, a sound state and sound targets for as many ticks as it takes to resume."""
        self.script.fault = ""
        for task, weight in zip(self.control.stack.tasks, self.weights, strict=True):
            task.weight = weight
        aim: Any = self.control.stack.tasks[0]
        aim.target = self.robot.state().com if self.robot.nb else [0.4, 0.2, 0.5]
        self.start_anew()
        for _ in range(5):
            self.tick(self.q, self.v)
        assert self.command.fallback_level == "solved", self.control.explain()

    @invariant()
    def commands_are_finite_and_bounded(self) -> None:
        command = getattr(self, "command", None)
        if command is None or command.fallback_level == "relaxed":  # then it is declared what is relaxed
            return
        assert excess(self.control, command) <= 1e-6, (command, self.control.explain())


Life.TestCase.settings = settings(max_examples=25, stateful_step_count=25)
TestLife = Life.TestCase
