"""Faults put into clean motions are found, and named rightly; frames without a fault are not blamed."""

from __future__ import annotations

import pytest

from tests.motion.artefacts import Count, count


def told(counts: dict[str, Count]) -> tuple[float, float, float]:
    """Shares found and named, and frames blamed wrongly in a thousand that are clean."""
    tried = sum(one.tried for one in counts.values())
    found, named = (sum(getattr(one, what) for one in counts.values()) / tried for what in ("found", "named"))
    return found, named, 1e3 * sum(one.false for one in counts.values()) / sum(one.clean for one in counts.values())


@pytest.mark.slow
def test_an_artefact_of_each_kind_is_named():
    found, named, false = told(count(["humanoid"], 1))
    assert (found, named) == (1.0, 1.0)
    assert false <= 1.0


@pytest.mark.deep
def test_two_hundred_artefacts_are_found_and_named():
    pytest.importorskip("example_robot_data")
    counts = count(["humanoid", "g1"], 40)
    found, named, false = told(counts)
    print(counts)
    assert found >= 0.98
    assert named >= 0.95
    assert false <= 1.0
