"""Constraints that may be broken have the same answer whether slacks are left out where none is needed, or not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tasks import CenterOfMass, HalfSpaceLimit, JointLimits, JointVelocityLimits, Position, Posture
from tests.families.oracle import judge, undamped
from tests.stack.conftest import moving
from wbc.control.answer import active
from wbc.qp.lexicographic.solver import LexicographicSolver
from wbc.tasks import feet

HUMANOID = wbc.load("humanoid")
HAND = HUMANOID.state().frame("left_hand").position
UP = (0.0, 0.0, 1.0)


def controller(
    hierarchy: Any, level: Any, *, floor: float, rate: float, reach: float, levels: int, softly: bool
) -> wbc.Controller:
    """A hand that shall be above a floor, which other limits may not allow, and is wanted somewhere below its reach."""
    ranked: list[list[Any]] = [
        [Position("left_hand", target=HAND + np.array([reach, 0.0, -0.1]), kp=50.0)],
        [CenterOfMass(target=HUMANOID.state().com)],
        [Posture(HUMANOID.q0, kp=10.0)],
    ]  # fmt: skip
    ranked = ranked[-levels:]
    if softly:
        ranked[0].append(JointVelocityLimits(0.5).softly(name="slow"))
    limits = [
        HalfSpaceLimit("left_hand", normal=UP, offset=HAND[2] + floor, rate=rate, slack=1e4),
        HalfSpaceLimit("head", normal=UP, offset=0.5, slack=1e2), JointLimits(a_max=50.0),
    ]  # fmt: skip
    stack = wbc.Stack(ranked, subject_to=limits, contacts=feet(HUMANOID))
    return wbc.Controller(HUMANOID, stack, level=undamped(level, hierarchy), hierarchy=hierarchy)


def with_slacks(control: wbc.Controller) -> LexicographicSolver:
    """Decides the problem of a controller with all its unknowns."""
    plan = control.plan
    stages = [stage for rank in control.hierarchy.ranks(plan.problem.levels) for stage in rank.stages]
    return LexicographicSolver(plan.problem, stages, budget=3 * len(stages) + 1, pulls=plan.damping.pulls)


@pytest.mark.parametrize("level", [wbc.AccelerationLevel(), wbc.InverseDynamics()], ids=repr)
@pytest.mark.parametrize("hierarchy", [wbc.Strict(), wbc.Scaled()], ids=repr)
@given(
    floor=st.sampled_from([-0.2, 0.0, 0.01, 0.1]), rate=st.sampled_from([5.0, 50.0, 300.0]),
    reach=st.sampled_from([0.0, 1.0]), levels=st.integers(1, 3), softly=st.booleans(), seed=st.integers(0, 9),
)  # fmt: skip
def test_slacks_that_are_left_out_change_no_answer(hierarchy: Any, level: Any, seed: int, **drawn: Any) -> None:
    control = controller(hierarchy, level, **drawn)
    q, v = moving(HUMANOID, seed)
    reference, p = with_slacks(control), control.plan.problem
    for k in range(4):
        command = control.tick(1e-3 * k, q, v)
        value, at = p.value.copy(), control.levels
        assert len(control.solution().x) == control.qp.n
        assert "HalfSpaceLimit[left_hand]" in control.explain()
        assert all(np.isfinite(one.bound) for one in active(control))
        status = reference.solve()
        expected, found = p.value.copy(), reference.report()
        p.value[:] = value
        if not status.ok:  # nothing to compare with; the controller may have a fallback
            break
        assert command.status.ok and command.certificate.ok, control.why
        assert [one.tasks for one in at] == [one.tasks for one in found]
        slack = np.abs(value[p.n - 2 : p.n])
        np.testing.assert_allclose(slack, np.abs(expected[p.n - 2 : p.n]), rtol=1e-5, atol=1e-6)
        assert (command.levels[0].how == "met") == (slack.max() <= 1e-6)
        verdict = judge(control, command)
        assert verdict.word != "wrong", verdict.why
        assert {"HalfSpaceLimit[left_hand]", "HalfSpaceLimit[head]"} <= {*command.certificate.bounds}
        q, v = command.q, command.v


def test_slacks_stand_in_the_problem_only_while_a_constraint_has_to_be_broken() -> None:
    """A floor that rises above a hand faster than the hand can, and sinks again."""
    control = controller(
        wbc.Strict(), wbc.AccelerationLevel(), floor=-0.2, rate=50.0, reach=0.0, levels=1, softly=False
    )
    floor, _, _ = control.stack.subject_to
    steps = [(-0.2, False), (0.5, True), (0.5, True), (-0.2, False), (-0.2, False)]
    for k, (height, is_broken) in enumerate(steps):
        floor.offset = HAND[2] + height
        command = control.tick(1e-3 * k, HUMANOID.q0, np.zeros(HUMANOID.nv))
        assert command.status.ok and (command.levels[0].how != "met") == is_broken
        has_slacks = is_broken or (k > 0 and steps[k - 1][1])
        assert control.plan.problem.n - control.qp.n == (0 if has_slacks else 2)
