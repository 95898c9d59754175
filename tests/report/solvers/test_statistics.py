"""Figures are what they say: never negative, never NaN, never mixed with failures."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wbc.qp import QP
from wbc.report.document import Text
from wbc.report.scaling.slope import slope
from wbc.report.solvers import compare
from wbc.report.solvers.advice import advice
from wbc.report.solvers.appendix import failed
from wbc.report.solvers.page import page
from wbc.report.solvers.statistics import (
    Measure,
    best_classes,
    between_rounds,
    geometric_mean,
    measures,
    percentiles,
    profile,
    ratio,
    ratio_of_rounds,
    wins,
)

TIMES = st.lists(st.one_of(st.floats(0.0, 1e7), st.just(np.inf)), min_size=1, max_size=12).map(np.array)


def made(
    total: list[float], achieved: list[float], *, solver: str = "s", asked: str = "default",
    rounds: list[list[float]] | None = None,
) -> Measure:  # fmt: skip
    n, nothing = len(total), np.zeros(len(total))
    return Measure(
        "set", solver, asked, "warm", ["SOLVED"] * n, np.array(total, float), nothing, nothing,
        np.array(rounds or [total], float), np.array(achieved, float), nothing, nothing, nothing, nothing, {}, {}, 0,
    )  # fmt: skip


@given(TIMES)
def test_a_mean_lies_between_the_least_and_the_largest_of_what_was_solved(times: np.ndarray):
    mean, finite = geometric_mean(times), np.maximum(times[np.isfinite(times)], 1e-3)
    assert (mean is None) == (finite.size == 0)
    if mean is not None:
        assert finite.min() * (1 - 1e-9) <= mean <= finite.max() * (1 + 1e-9)


@given(TIMES)
def test_percentiles_are_in_order_and_of_what_was_solved(times: np.ndarray):
    found = percentiles(times)
    if np.isfinite(times).any():
        assert 0.0 <= found[0] <= found[1] <= found[2] == times[np.isfinite(times)].max()
    else:
        assert found == (None, None, None)


@given(st.integers(1, 10).flatmap(lambda n: st.tuples(*[st.lists(st.floats(0, 1e6), min_size=n, max_size=n)] * 2)))
def test_ratio_and_wins_of_a_pair_are_each_others_mirror(pair: tuple[list[float], list[float]]):
    one, other = (np.where(np.array(p) > 9e5, np.inf, p) for p in pair)
    there, common = ratio(one, other)
    back, again = ratio(other, one)
    assert common == again == int((np.isfinite(one) & np.isfinite(other)).sum())
    if common:
        np.testing.assert_allclose(there * back, 1.0, rtol=1e-9)
    won, lost = wins(one, other), wins(other, one)
    assert (won is None) == (lost is None) and (won is None or 0.0 <= won + lost <= 1.0 + 1e-12)


def test_a_failure_is_in_no_time():
    quick_but_wrong, slow = made([1.0, 1.0], [1e-9, 1e-2]), made([5.0, 5.0], [1e-9, 1e-9])
    assert quick_but_wrong.times(1e-6).tolist() == [1.0, np.inf]
    assert percentiles(quick_but_wrong.times(1e-6)) == (1.0, 1.0, 1.0)
    assert ratio(quick_but_wrong.times(1e-6), slow.times(1e-6)) == (0.2, 1)


def test_a_profile_starts_at_the_fastest_and_ends_at_what_was_solved():
    found = dict(
        (m.solver, ratios.tolist())
        for m, ratios in profile([
            made([2.0, 9.0, 4.0, 1.0], [0, 0, 0, 1], solver="a"), made([4.0, 3.0, 4.0, 1.0], [0, 0, 1, 1], solver="b"),
        ])
    )  # fmt: skip
    assert found == {"a": [1.0, 3.0, 1.0, np.inf], "b": [2.0, 1.0, np.inf, np.inf]}


def test_the_class_to_compare_at_solves_most_then_is_fastest_and_the_default_wins_a_draw():
    def best(**times: tuple[float, float]) -> str:
        found = [made([t, t], [0, e], asked=asked.replace("_", "-")) for asked, (t, e) in times.items()]
        return best_classes(found)[0].asked

    assert best(default=(10.0, 0), coarse=(1.0, 1.0)) == "default"
    assert best(default=(10.0, 0), coarse=(1.0, 0)) == "coarse"
    assert best(default=(10.0, 0), coarse=(7.0, 0)) == "default"
    assert best(default=(1.0, 1.0), fine=(10.0, 0)) == "fine"


def test_rounds_are_compared_with_one_another_where_all_of_them_timed_a_problem():
    one = made([1.0, 1.0, 9.0], [0, 0, 0], rounds=[[1.0, 1.0, 9.0], [2.0, 2.0, np.nan]])
    other = made([4.0, 4.0, 9.0], [0, 1, 0], rounds=[[4.0, 4.0, 9.0], [6.0, 6.0, 9.0]])
    assert between_rounds(one) == pytest.approx(2.0)
    assert between_rounds(made([1.0], [0])) is None
    assert ratio_of_rounds(other, one) == pytest.approx([4.0, 3.0]), "on the first problem alone"


def test_a_slope_needs_three_points():
    assert slope(np.array([1.0, 2.0]), np.array([1.0, 2.0])) is None
    assert slope(np.array([0.0, 2.0, 4.0, 8.0]), np.array([5.0, 4.0, np.nan, 64.0])) is None


def test_the_interval_of_a_slope_holds_the_truth_as_often_as_it_says():
    rng, x = np.random.default_rng(0), np.array([7.0, 14.0, 28.0, 56.0, 100.0])
    held = 0
    for _ in range(400):
        found = slope(x, x**1.5 * np.exp(0.2 * rng.standard_normal(5)))
        held += abs(found.exponent - 1.5) <= found.half
    assert 0.92 * 400 <= held <= 0.98 * 400


@pytest.fixture(scope="module")
def with_none() -> dict[str, Any]:
    """Two problems with a solution; one without a feasible point, one without a lower bound, one at the tolerance."""
    cross = QP([[1.0]], [0.0], C=[[1.0]], cl=[2.0], ub=[1.0])
    close = QP([[1.0]], [0.0], C=[[1.0]], cl=[1.0 + 1e-5], ub=[1.0])
    own = [QP([[1.0]], [-1.0], ub=[0.5], C=[[1.0]]), cross, QP([[0.0]], [-1.0], C=[[1.0]]), close]
    return compare(own, solvers=["pdas", "daqp"], rounds=1, classes={"default": None, "1e-3": 1e-3})


def test_a_problem_that_has_no_solution_counts_for_and_against_nobody(with_none: dict[str, Any]):
    """It is named; one that has a solution at the coarsest tolerance counts."""
    for mode, count in (("cold", 2), ("warm", 1)):
        assert {m.count for m in measures(with_none, "problems", mode)} == {count}
    report = page(with_none)
    (said,) = (item.text for item in report.items if isinstance(item, Text) and "Not counted" in item.text)
    assert said.endswith("proven to have no solution: 2 (problem 1, problem 2).")
    assert {index for _, index, _, _ in failed(with_none)} <= {3}
    assert page(copy.deepcopy(with_none)).summary == report.summary


def test_a_set_of_which_no_problem_has_a_solution_has_a_page():
    cross = QP([[1.0]], [0.0], C=[[1.0]], cl=[2.0], ub=[1.0])
    data = compare([cross, cross], solvers=["pdas"], rounds=1)
    assert advice(data, data["sets"][0]).use is None and "1e-6 on any of" in advice(data, data["sets"][0]).sentence
    assert "proven to have no solution: 2" in " ".join(i.text for i in page(data).items if isinstance(i, Text))
