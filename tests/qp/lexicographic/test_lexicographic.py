"""Each level is at its least among all that keep those above at theirs; of what is left, the least norm."""

from __future__ import annotations

import os
from pathlib import Path

import daqp
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import wbc
from tests.qp.lexicographic.hierarchies import random_hierarchy, recursion, residuals, stationarity
from wbc.qp.solvers.kept import INFINITY
from wbc.types import Status

SEEDS = st.integers(0, 10**6)
STORED = Path(os.environ.get("WBC_QPS", "qps")) / "lexls" / "test_01.npz"


@given(seed=SEEDS)
def test_every_level_of_a_random_hierarchy_is_optimal(seed: int) -> None:
    levels, lb, ub = random_hierarchy(seed)
    answer = wbc.lexicographic(levels, lb=lb, ub=ub)
    assert answer.status is Status.SOLVED and answer.certificate.ok
    assert ((answer.x >= lb - 1e-8) & (answer.x <= ub + 1e-8)).all()
    assert stationarity(levels, lb, ub, answer.x).max() < 1e-6


@settings(max_examples=12)
@given(seed=SEEDS)
def test_the_cascade_of_standard_qps_is_the_same_answer(seed: int) -> None:
    levels, lb, ub = random_hierarchy(seed)
    mine, cascade = (wbc.lexicographic(levels, lb=lb, ub=ub, solver=name) for name in ("pdas", "daqp"))
    assert cascade.status is Status.SOLVED
    excess = residuals(levels, mine.x) - residuals(levels, cascade.x)
    differs = np.flatnonzero(np.abs(excess) > 1e-5)
    assert not len(differs) or excess[differs[0]] < 0.0, excess  # and where it is not the same, it is better


@given(seed=SEEDS, n=st.integers(2, 9), dependent=st.booleans())
def test_equality_levels_are_the_recursive_null_space_formula(seed: int, n: int, dependent: bool) -> None:
    rng = np.random.default_rng(seed)
    levels = []
    for _ in range(rng.integers(1, 5)):
        m = int(rng.integers(1, n))
        A = rng.normal(size=(m, n))
        if dependent:
            A[-1] = A[0] + (levels[-1][0][0] if levels else 0.0)
        levels.append((A, rng.normal(size=m)))
    x = wbc.lexicographic([(A, b, b) for A, b in levels]).x
    np.testing.assert_allclose(x, recursion(levels), atol=1e-6 * (1.0 + np.abs(x).max()))


@given(seed=SEEDS)
def test_each_level_may_be_in_any_unit(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, levels = int(rng.integers(1, 10)), []
    for _ in range(rng.integers(1, 5)):
        m = int(rng.integers(1, n + 3))
        A, centre, width = rng.normal(size=(m, n)), 2.0 * rng.normal(size=m), rng.integers(0, 3, size=m)
        levels.append((A, centre - width, centre + width))
    low, high = -rng.integers(0, 4, size=n), rng.integers(0, 4, size=n)
    plain = wbc.lexicographic(levels, lb=low, ub=high)
    units = 2.0 ** rng.integers(-13, 14, size=len(levels))
    scaled = wbc.lexicographic([(u * A, u * lo, u * hi) for u, (A, lo, hi) in zip(units, levels, strict=True)],
                               lb=low, ub=high)  # fmt: skip
    assert plain.status is scaled.status is Status.SOLVED
    np.testing.assert_array_equal(scaled.x, plain.x)
    rows = np.repeat(units, [len(lo) for _, lo, _ in levels])
    np.testing.assert_array_equal(rows * scaled.z, plain.z)


def test_the_same_problem_twice_gives_the_same_bits() -> None:
    levels, lb, ub = random_hierarchy(5)
    first, second = (wbc.lexicographic(levels, lb=lb, ub=ub) for _ in range(2))
    np.testing.assert_array_equal(first.x, second.x)


def test_the_multipliers_hold_the_least_norm_against_the_levels() -> None:
    levels, lb, ub = random_hierarchy(17)
    answer = wbc.lexicographic(levels, lb=lb, ub=ub)
    A = np.concatenate([level[0] for level in levels])
    np.testing.assert_allclose(answer.x + A.T @ answer.z + answer.z_box, 0.0, atol=1e-7)


@pytest.mark.skipif(not STORED.exists(), reason="no stored hierarchy; set WBC_QPS to a folder with lexls/test_01.npz")
def test_the_stored_hierarchy_of_a_humanoid_is_solved_to_a_hundred_millionth() -> None:
    with np.load(STORED, allow_pickle=False) as file:
        levels = [(file[f"A{k}"], file[f"l{k}"], file[f"u{k}"]) for k in range(5)]
        known = file["solution"]
    answer = wbc.lexicographic(levels)
    assert answer.status is Status.SOLVED and answer.certificate.ok
    excess = residuals(levels, answer.x) ** 2 - residuals(levels, known) ** 2
    assert excess.max() < 1e-8
    assert np.linalg.norm(answer.x) < np.linalg.norm(known)  # among all that are as good, the shortest


@settings(max_examples=15)
@given(seed=SEEDS)
def test_the_hierarchies_of_daqp_leave_no_less_of_the_first_level_that_differs(seed: int) -> None:
    levels, lb, ub = random_hierarchy(seed)
    A, lo, hi = (np.concatenate([level[i] for level in levels]) for i in range(3))
    lower, upper = np.maximum(np.append(lb, lo), -INFINITY), np.minimum(np.append(ub, hi), INFINITY)
    ends = np.cumsum([len(lb), *(len(level[1]) for level in levels)]).astype(np.intc)
    sense, n = np.zeros(len(lower), np.intc), len(lb)
    theirs, _, flag, _ = daqp.solve(np.eye(n), np.zeros(n), A, upper, lower, sense, ends, rho_soft=1e-9)
    assume(flag > 0)  # DAQP's own hierarchies fail where a row is zero or two are nearly parallel
    excess = residuals(levels, wbc.lexicographic(levels, lb=lb, ub=ub).x) - residuals(levels, np.array(theirs))
    for more in excess:
        assert more <= 1e-5, excess
        if abs(more) > 1e-8:
            break  # its levels are soft, not strict: what it lost here, those below gained


@pytest.mark.parametrize("solver", ["pdas", "daqp", "proxqp", "osqp", "clarabel"])
def test_a_hierarchy_with_bounds_alone_is_never_infeasible(solver: str):
    levels = [([[200.0], [-200.0]], [200.0, 200.0], [300.0, 400.0]), ([[1.0]], [3.0], [4.0])]
    answer = wbc.lexicographic(levels, lb=[0.0], solver=solver)
    assert answer.status is not Status.INFEASIBLE
    assert (answer.status is Status.SOLVED) <= answer.certificate.ok
    if answer.status is Status.SOLVED:
        np.testing.assert_allclose(answer.x, [0.0], atol=1e-6)


@given(n=st.integers(2, 6), seed=SEEDS)
def test_rounding_in_a_row_that_others_all_but_take_moves_nothing(n: int, seed: int):
    """A task near a singularity that asks for a hundred: J x + asked σ = asked, then σ least, then x near p.

    J has entries of a ten-millionth of ``asked``, which move their unknowns to their bounds, and others of its last
    bits, which leave theirs to the last level.
    """
    rng = np.random.default_rng(seed)
    felt = rng.permutation(np.arange(n) < rng.integers(1, n))
    small, bits = 10.0 ** rng.uniform(-6.5, -4.0, n), 10.0 ** rng.uniform(-20.0, -16.0, n)
    J = np.where(felt, small, bits) * rng.choice([-1.0, 1.0], n)
    asked, bound, p = float(rng.uniform(50.0, 200.0)), 10.0 ** rng.uniform(0.0, 3.0), rng.uniform(-0.5, 0.5, n)
    x, share = np.eye(n + 1)[:n], np.eye(n + 1)[n:]
    levels = [(np.append(J, asked)[None], [asked], [asked]), (share, [0.0], [0.0]), (x, p, p)]
    answer = wbc.lexicographic(levels, lb=np.append(np.full(n, -bound), 0.0), ub=np.append(np.full(n, bound), 1.0))
    assert answer.status is Status.SOLVED
    np.testing.assert_allclose(answer.x[:n], np.where(felt, np.sign(J) * bound, p), rtol=0, atol=1e-5 * bound)
