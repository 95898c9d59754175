"""Which runs a sweep has depends on its settings and its seed, on nothing else."""

from __future__ import annotations

import re
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wbc.errors import InvalidInput, UnknownName, WbcError
from wbc.sim.scenario import find
from wbc.sweep import Choice, Range, Sweep, sweep
from wbc.sweep.draw import RandomDelay, RandomNoise, RandomPayload, RandomPush, at_frame, read_range
from wbc.sweep.plan import read_variations

FLIP = f"{Path(__file__).with_name('flipping.py')}:flip"
REACH = f"{Path(__file__).parents[1] / 'report' / 'solvers' / 'reaching.py'}:reach"


def plan(**settings: object) -> Sweep:
    return Sweep(FLIP, **{"runs": 20, **settings})


@given(st.integers(0, 2**40), st.integers(0, 19))
def test_a_run_is_the_same_whoever_draws_it_and_when(seed: int, run: int):
    def one() -> Sweep:
        return plan(seed=seed, vary={"bias": Range(0.1, 0.2), "coin": Choice(("a", "b"))}, solvers=("pdas", "daqp"))

    trial, other = one().trial(run), one()
    other.trial(3)
    assert trial == other.trial(run)
    assert 0.1 <= trial.parameters["bias"] <= 0.2 and trial.parameters["coin"] in "ab"


def test_more_runs_leave_the_first_ones_as_they_were():
    few, many = plan(vary={"bias": Range(0, 1)}), plan(vary={"bias": Range(0, 1)}, runs=1000)
    assert [few.trial(i) for i in range(20)] == [many.trial(i) for i in range(20)]


def test_every_run_has_numbers_of_its_own():
    trials = [plan(vary={"bias": Range(0, 1)}).trial(i) for i in range(20)]
    assert len({t.parameters["bias"] for t in trials}) == 20
    assert len({t.parameters["seed"] for t in trials}) == 20, "a parameter called seed is drawn unless it is set"
    assert {plan(fixed={"seed": 7}).trial(i).parameters["seed"] for i in range(5)} == {7}


def test_solvers_hierarchies_and_choices_all_occur():
    sweep = plan(solvers=("pdas", "daqp"), hierarchies=("weighted", "strict"), vary={"faces": Range(2, 4, whole=True)})
    trials = [sweep.trial(i) for i in range(20)]
    assert {t.solver for t in trials} == {"pdas", "daqp"}
    assert {t.settings["hierarchy"] for t in trials} == {"weighted", "strict"}
    assert {t.parameters["faces"] for t in trials} == {2, 3, 4}


def test_disturbances_are_drawn_within_what_was_asked():
    kinds = (
        RandomPush("torso", Range(10, 20)), RandomPayload("hand", Range(0.5, 1)), RandomNoise(Range(0, 0.1)),
        RandomDelay(Range(0.001, 0.002)),
    )  # fmt: skip
    seeds = set()
    for i in range(20):
        push, payload, noise, delay = plan(disturbances=kinds, duration=2.0).trial(i).disturbances
        assert 10 <= np.linalg.norm(push.force) <= 20 and push.force[2] == 0 and 0.2 <= push.start <= 1.6
        assert 0.5 <= payload.mass <= 1 and 0 <= noise.velocity <= 0.1 and 0.001 <= delay.seconds <= 0.002
        seeds.add(noise.seed)
    assert len(seeds) == 20


def test_variations_are_read_as_the_scenario_reads_its_parameters():
    found = read_variations(find(FLIP), ["bias=0.2:0.8", "faces=2:6", "coin=euro,dollar", "wait=0,1", "deadly=10:20"])
    assert found == {
        "bias": Range(0.2, 0.8), "faces": Range(2, 6, whole=True), "coin": Choice(("euro", "dollar")),
        "wait": Choice((0.0, 1.0)), "deadly": Range(10, 20),
    }  # fmt: skip


@pytest.mark.parametrize("text", ["bias", "bias=high:low", "bias=2:1", "faces=a,b", "bug=0:1", "height=0:1"])
def test_variations_without_meaning_are_refused(text: str):
    with pytest.raises((InvalidInput, UnknownName)):
        read_variations(find(FLIP), [text])


@pytest.mark.parametrize(
    ("texts", "said"),
    [
        (["bias=2:1"], "--vary bias: the range 2:1 runs backwards; write 1:2"),
        (["faces=2.2:2.8"], "--vary faces: the range 2.2:2.8 holds no whole number"),
        (["bias=0.1,0.2,0.1"], "--vary bias: 0.1 is given 2 times; all values are equally likely"),
        (["bias=0:1", "bias=0.5"], "--vary bias is given twice; give all its values, or one range"),
    ],
)
def test_what_is_wrong_with_a_range_is_said_in_a_sentence(texts: list[str], said: str) -> None:
    with pytest.raises(InvalidInput, match=f"^{re.escape(said)}$"):
        read_variations(find(FLIP), texts)


@given(st.floats(-5.0, 5.0), st.floats(0.0, 5.0), st.integers(0, 99))
def test_a_whole_number_is_drawn_within_its_range(low: float, width: float, seed: int) -> None:
    try:
        drawn = Range(low, low + width, whole=True).draw(np.random.default_rng(seed))
    except InvalidInput:
        assert not [k for k in range(-6, 12) if low <= k <= low + width]
    else:
        assert isinstance(drawn, int) and low <= drawn <= low + width


@pytest.mark.parametrize("values", ["0.1-0.4", "0.1:0.2:0.3", "0.1,b", "0.1..0.4"])
def test_a_variation_of_another_form_is_told_the_forms(values: str):
    with pytest.raises(InvalidInput, match=r"must be a number, not .*; --vary takes bias=LOW:HIGH or bias=a,b,c"):
        read_variations(find(FLIP), [f"bias={values}"])


@pytest.mark.parametrize(
    "settings",
    [
        {"runs": 0}, {"runs": 1.5}, {"seed": -1}, {"seed": 0.5}, {"solvers": ("pdas", "pdas")},
        {"vary": {"height": Range(0, 1)}}, {"fixed": {"height": 1}}, {"solvers": ("no",)},
        {"vary": {"bias": Range(0, 1)}, "fixed": {"bias": 0.5}},
        {"hierarchies": ("no",)}, {"plant": "no"}, {"duration": 0.0},
    ],
)  # fmt: skip
def test_what_does_not_exist_is_refused_before_any_run(settings: dict[str, object]):
    with pytest.raises((InvalidInput, UnknownName)):
        plan(**settings)


@pytest.mark.parametrize(
    ("settings", "why"),
    [
        ({"disturbances": (RandomPayload("tool", Range(1, 2)),)}, "IntegratorPlant cannot change its masses"),
        ({"disturbances": (RandomNoise(Range(0, 1)), RandomPush("tool", Range(1, 2)))}, "knows no forces"),
        ({"disturbances": (RandomPayload("tool", Range(1, 2)),), "vary": {"way": Range(0.1, 0.2)}}, "cannot change"),
        ({"fixed": {"robot": "nobody"}}, "nobody"),
        ({"vary": {"robot": Choice(("no-one", "nobody"))}}, "nobody|no-one"),
        ({"solvers": ("highs",)}, "offline"),
        ({"duration": 1e-4}, "shorter than one tick"),
    ],
)
def test_a_sweep_whose_runs_are_all_refused_is_refused_before_any_run(
    settings: dict[str, object], why: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("wbc.sweep.run.do_all", lambda *_, **__: pytest.fail("a run was begun"))
    with pytest.raises(WbcError, match=why):
        sweep(Sweep(REACH, **{"runs": 5, **settings}), out=tmp_path / "out")
    assert not list(tmp_path.iterdir())


class Begun(Exception):
    """Runs are given to workers."""


@pytest.mark.parametrize(
    "settings",
    [
        {"vary": {"robot": Choice(("nobody", "arm"))}}, {"solvers": ("highs", "pdas")},
        {"disturbances": (RandomNoise(Range(0, 1)),)},
    ],
)  # fmt: skip
def test_a_sweep_of_which_a_run_can_begin_is_begun(
    settings: dict[str, object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def begun(*_: object, **__: object) -> None:
        raise Begun

    monkeypatch.setattr("wbc.sweep.run.do_all", begun)
    with pytest.raises(Begun):
        sweep(Sweep(REACH, **{"runs": 20, **settings}), out=tmp_path / "out")


def test_ranges_and_choices_make_sense():
    for bad in (lambda: Range(2, 1), lambda: Range(0, np.inf), lambda: Choice(()), lambda: plan().trial(20)):
        with pytest.raises(InvalidInput):
            bad()
    for kind, name in ((RandomNoise, "velocity"), (RandomDelay, "seconds"), (partial(RandomPayload, "tool"), "mass")):
        assert kind(Range(0.0, 1.0))
        with pytest.raises(InvalidInput, match=f"the least {name} is -1"):
            kind(Range(-1.0, 1.0))
        with pytest.raises(InvalidInput, match=f"{name} is 1.0; it must be a wbc.sweep.Range"):
            kind(1.0)
    assert read_range("x", "3") == Range(3, 3) and at_frame("--push", "torso=1:2") == ("torso", Range(1, 2))
    for text in ("torso", "=1:2", "torso=a"):
        with pytest.raises(InvalidInput):
            at_frame("--push", text)
