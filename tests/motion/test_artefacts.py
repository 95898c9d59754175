"""Faults put into clean motions are found, and named rightly; frames without a fault are not blamed."""

from __future__ import annotations

import pytest

from tests.motion.artefacts import KINDS, Count, count
from tests.robots.examples import needs_examples


def told(counts: dict[str, Count], each: int) -> tuple[float, float, float]:
    """Shares found and named, and frames blamed wrongly in a thousand that are clean; all counts are printed."""
    for kind, one in counts.items():
        print(f"{kind}: {one}")
    assert [one.tried for one in counts.values()] == [each] * len(KINDS)
    tried = each * len(KINDS)
    found, named = (sum(getattr(one, what) for one in counts.values()) / tried for what in ("found", "named"))
    return found, named, 1e3 * sum(one.false for one in counts.values()) / sum(one.clean for one in counts.values())


@pytest.mark.slow
def test_artefacts_of_each_kind_are_named():
    found, named, false = told(count(["humanoid"], 1, motions=["dance"]), 1)
    assert (found, named) == (1.0, 1.0)
    assert false <= 1.0


@pytest.mark.deep
@needs_examples
def test_two_hundred_artefacts_are_found_and_named():
    found, named, false = told(count(["humanoid", "g1"], 40), 40)
    assert found >= 0.98
    assert named >= 0.95
    assert false <= 1.0
