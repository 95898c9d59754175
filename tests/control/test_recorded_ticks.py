"""What controllers answered before is what they answer now, where the answer is unique: the sum of all costs is."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from tests.control.recorded_stacks import CASES, DT, EVERY, FILE, HIERARCHIES, active, answer, controller


@cache
def recorded() -> Any:
    return np.load(FILE)


@pytest.mark.parametrize("hierarchy", HIERARCHIES)
@pytest.mark.parametrize("case", CASES)
def test_ticks_along_a_recorded_motion_are_answered_as_before(case: str, hierarchy: str) -> None:
    names = ("q", "v", "answer", "ok", "active")
    rows = [recorded()[f"{case}/{hierarchy}/{name}"] for name in names]
    control = controller(case, hierarchy)
    for i, (q, v, before, ok, held) in enumerate(zip(*rows, strict=True)):
        command = control.tick(i * EVERY * DT, q.copy(), v.copy())
        assert command.status.ok == ok, i
        now = answer(control, command)
        assert np.abs(now - before).max() <= 1e-8 * (1.0 + np.abs(before).max()), i
        assert (active(control) == held).all(), i


def test_what_is_recorded_meets_limits() -> None:
    """Else it would say little of working sets."""
    most = {
        case: max(np.abs(recorded()[f"{case}/{h}/active"]).sum(axis=1).max() for h in HIERARCHIES) for case in CASES
    }
    assert sum(count > 0 for count in most.values()) >= 3, most
