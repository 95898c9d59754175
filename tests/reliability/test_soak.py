"""Ticks drawn at random, few here and many with ``wbc soak``: finite, bounded, and solved where there is a solution."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import wbc
from tasks.scenarios.soaks import SOAKS
from wbc.errors import InvalidInput
from wbc.sim.soak import soak

KINEMATIC = ("arm-velocity", "arm-acceleration")


@pytest.mark.parametrize("name", SOAKS)
def test_valid_ticks_are_solved_and_keep_the_limits(name: str):
    found = soak(SOAKS[name], ticks=1000)
    assert found.ok, found
    assert found.solved_share >= 0.999


@pytest.mark.parametrize("name", SOAKS)
def test_nonsense_gives_finite_bounded_commands(name: str):
    found = soak(SOAKS[name], ticks=300, kind="fuzz")
    assert found.ok, found
    assert found.statuses["FAILED"] > 20, "components and targets gave nonsense, or raised"


@pytest.mark.parametrize("name", SOAKS)
def test_any_start_has_a_certified_answer(name: str):
    found = soak(SOAKS[name], ticks=100, kind="starts")
    assert found.ok, found
    if name in KINEMATIC:
        assert found.solved_share == 1.0, (
            "limits on positions, velocities and accelerations never contradict each other"
        )


@pytest.mark.parametrize("name", SOAKS)
def test_a_soak_starts_within_what_it_draws(name: str):
    control = SOAKS[name].first_setup(SOAKS[name].complete_parameters()).controller()
    rng, drawn = np.random.default_rng(0), []

    def now() -> np.ndarray:
        return np.concatenate([np.append(np.ravel(task.target), task.weight) for task in control.stack.tasks])

    start = now()
    for _ in range(300):
        SOAKS[name].stir(control, rng)
        drawn.append(now())
    low, high = np.min(drawn, axis=0), np.max(drawn, axis=0)
    assert (low <= start).all() and (start <= high).all()
    assert ((high - low)[high > low] > 0.01).all(), "what is drawn differs"


@pytest.mark.parametrize(("spoil", "finding"), [("nan", "not_finite"), ("more", "beyond"), ("raises", "exceptions")])
def test_a_soak_finds_what_it_looks_for(spoil: str, finding: str, monkeypatch: pytest.MonkeyPatch):
    decode = wbc.Controller.decode

    def decoded(controller: wbc.Controller, *words: Any) -> wbc.control.command.Command:
        if spoil == "raises":
            raise RuntimeError("a slip")
        command = decode(controller, *words)
        command._v = command.v + (np.nan if spoil == "nan" else 1.0)
        return command

    monkeypatch.setattr(wbc.Controller, "decode", decoded)
    found = soak(SOAKS["arm-velocity"], ticks=200)
    assert not found.ok
    assert getattr(found, finding)


def test_a_soak_of_nothing_is_refused():
    for settings in ({"kind": "salt", "ticks": 1}, {"ticks": 0}):
        with pytest.raises(InvalidInput):
            soak(SOAKS["arm-velocity"], **settings)
