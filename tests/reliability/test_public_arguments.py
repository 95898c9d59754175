"""Whatever stands in the place of an argument: an answer, or an error of the library. No other exception comes out."""

from __future__ import annotations

from typing import Any

import pytest

from tests.reliability import walker
from wbc.errors import InvalidInput

pytest.importorskip("gymnasium", reason="the extra `gym`: every public class is walked over")

PUBLIC = walker.public()


@pytest.mark.slow
@pytest.mark.parametrize("name", PUBLIC)
def test_nonsense_is_refused_by_an_error_of_the_library(name: str):
    assert walker.walk(PUBLIC[name]) == []


def test_the_walk_covers_what_users_build():
    for name in ("control.controller.Controller", "stack.stack.Stack", "tasks.position.Position", "qp.problem.QP"):
        assert f"wbc.{name}" in PUBLIC
    assert len(PUBLIC) > 120
    assert sum(1 for thing in PUBLIC.values() if any(walker.examples(thing))) > 0.7 * len(PUBLIC)


def careless(size: Any, *, gain: Any = 1.0) -> float:
    """Multiplies what it gets.

    Example:
        >>> from tests.reliability.test_public_arguments import careless
        >>> careless(2.0)
        2.0
    """
    if gain is None:
        raise InvalidInput("gain is None")
    if gain == -1:
        raise InvalidInput("give another")
    return 1.0 * float(size) * float(gain)


def test_the_walk_finds_what_it_looks_for(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(walker, "_is_ours", lambda value: value is careless)
    found = dict(walker.walk(careless))
    assert found["careless.size: text"].startswith("ValueError: could not convert")
    assert found["careless.size: None"].startswith("TypeError") and found["careless.gain: beyond floats"]
    assert "careless.gain: None" not in found and found["careless.size: nan"] == "taken"
    assert found["careless.gain: negative"].startswith("not named in: give")
