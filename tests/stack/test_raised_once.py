"""A target that raises once, where it is read for the first time: the tick fails, and nothing assigned is lost."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tasks import Position, Posture
from tests.stack.conftest import Saying
from wbc.types import Vec

ARM = wbc.load("arm")
HERE, THERE = np.array([0.4, 0.2, 0.5]), np.array([0.5, 0.1, 0.5])
STATE = ARM.q0, np.full(ARM.nv, 0.1)


class Flaky:
    """A stream whose reads of these numbers find nothing."""

    def __init__(self, missing: set[int]) -> None:
        self.missing, self.reads = missing, 0

    def __call__(self, t: float) -> Vec:
        self.reads += 1
        if self.reads in self.missing:
            raise RuntimeError("no sample")
        return THERE


def made(target: Any, weight: float, said: wbc.Overrides | None) -> tuple[wbc.Controller, Position, Posture, Saying]:
    position, posture, saying = Position("tool", target=target), Posture(ARM.q0, weight=weight), Saying(said)
    stack = wbc.Stack([position, posture], components=[saying])
    level = wbc.AccelerationLevel(lm_damping=0.0)
    return wbc.Controller(ARM, stack, level=level), position, posture, saying


@pytest.mark.parametrize("by", ["assignment", "override"])
@given(missing=st.sets(st.integers(1, 10)))
def test_every_tick_fails_or_is_as_with_what_was_assigned(by: str, missing: set[int]) -> None:
    controller, position, posture, saying = made(HERE, 1e-2, None)
    assert controller.tick(0.0, *STATE).status.ok
    flaky = Flaky(missing)
    if by == "override":
        saying.now = wbc.Overrides(tasks={position.name: {"target": flaky}})
    else:
        try:
            position.target = flaky
        except wbc.errors.WbcError:
            return  # it was refused
    posture.weight = 5.0
    said = wbc.Overrides(tasks={position.name: {"target": THERE}}) if by == "override" else None
    expected = made(THERE, 5.0, said)[0].tick(0.0, *STATE)
    for k in range(1, 13):
        command = controller.tick(1e-3 * k, *STATE)
        if command.status.ok:
            np.testing.assert_allclose(command.a, expected.a, rtol=1e-9, atol=1e-9)
        else:
            assert "no sample" in controller.why
    assert command.status.ok
