"""Faults of solvers and changes of contact, few here and many with ``python -m tests.reliability.injected``."""

from __future__ import annotations

import pytest

from tests.reliability.injected import LEVELS, contact_changes, faults


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
