"""The finite method: its scale is that of a linear program, its least norm has a proof, and ties change nothing."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from hypothesis import settings
from scipy.optimize import linprog, nnls

from tests.methods.problems import integer_task
from tests.seeds import generator
from wbc.methods import NullSpaceSaturation
from wbc.methods.farthest import Farthest, farthest
from wbc.methods.null_space_saturation import Saturation
from wbc.methods.shared import factors

INF = np.inf
#: 500 problems in every run of the tests, 20,000 in `make deep`.
COUNT = 20 * settings().max_examples


def found_on(E: np.ndarray, e: np.ndarray, lower: np.ndarray, upper: np.ndarray, gain: np.ndarray) -> Farthest | None:
    """The farthest z with E z = e: ``values`` are z, and ``u`` is z in the space that E leaves."""
    rows = factors(E)
    F = rows.null.T
    F[np.linalg.norm(F, axis=1) <= 1e-12] = 0.0  # what the equations decide
    return farthest(rows.inverse(e), F, lower, upper, rows.null @ gain)


def units(task: NullSpaceSaturation) -> np.ndarray:
    """The largest number of each row of J."""
    size = np.abs(task.J).max(axis=1)
    return np.where(size > 0.0, size, 1.0)


def largest_scale(task: NullSpaceSaturation) -> float | None:
    """By the simplex method of HiGHS on the numbers given, its tolerances beside integers."""
    unit, n = units(task), task.J.shape[1]
    answer = linprog(
        np.append(np.zeros(n), -1.0), A_eq=np.column_stack([task.J, -task.target]) / unit[:, None],
        b_eq=-task.drift / unit, bounds=[*zip(task.lower, task.upper, strict=True), (0.0, 1.0)], method="highs-ds",
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )  # fmt: skip
    return float(answer.x[-1]) if answer.status == 0 else None


def without_proof(task: NullSpaceSaturation, x: np.ndarray) -> float:
    """What limits and rows of J leave unexplained of x / |x|: x = J'y - up + down with up, down >= 0 says that no other
    x inside the limits with the same J x is shorter. The multipliers are found by scipy."""
    length = float(np.linalg.norm(x))
    if length <= 1e-12:
        return 0.0
    rows, near, eye = (task.J / units(task)[:, None]).T, 1e-9 * (1.0 + length), np.eye(len(x))
    at_upper, at_lower = task.upper - x <= near, x - task.lower <= near
    return float(nnls(np.hstack([rows, -rows, -eye[:, at_upper], eye[:, at_lower]]), x / length, maxiter=10_000)[1])


def assert_same(one: Saturation, other: Saturation, places: np.ndarray) -> None:
    """The same answer, joint i of the one being joint places[i] of the other."""
    assert one.feasible == other.feasible
    if one.feasible:
        assert one.scale == pytest.approx(other.scale, abs=1e-9)
        np.testing.assert_allclose(one.x, other.x[places], rtol=0, atol=1e-7 * (1.0 + np.linalg.norm(one.x)))
        assert {int(places[i]) for i in one.saturated} == set(other.saturated)


@pytest.mark.parametrize("seed", range(4))
def test_the_scale_is_that_of_the_linear_program_and_x_the_shortest_inside_the_limits(seed: int):
    rng, kinds = generator("scales", seed), Counter[str]()
    for _ in range(COUNT // 4):
        task = integer_task(rng)
        found, expected = task.closed_form(), largest_scale(task)
        assert found.feasible == (expected is not None), task
        if expected is None:
            kinds["infeasible"] += 1
            continue
        assert found.scale == pytest.approx(expected, abs=1e-9), task
        assert (task.lower <= found.x).all() and (found.x <= task.upper).all(), task
        missing = (task.J @ found.x + task.drift - found.scale * task.target) / units(task)
        assert np.abs(missing).max() <= 1e-10 * (1.0 + np.linalg.norm(found.x)), task
        assert without_proof(task, found.x) <= 1e-9, task
        kinds["nothing" if expected == 0.0 else "whole" if expected == 1.0 else "in part"] += 1
    assert min(kinds[kind] for kind in ("infeasible", "nothing", "whole", "in part")) >= COUNT // 4 // 40, kinds


def test_last_bits_and_the_order_of_joints_and_rows_change_nothing_but_last_bits():
    """What another processor does: other last bits in every product, other places for ties to be found first."""
    rng = generator("order of joints")
    for _ in range(COUNT // 4):
        task = integer_task(rng)
        m, n = task.J.shape
        found, joints, rows = task.closed_form(), rng.permutation(n), rng.permutation(m)
        other = NullSpaceSaturation(
            task.J[np.ix_(rows, joints)], task.target[rows], lower=task.lower[joints], upper=task.upper[joints],
            drift=task.drift[rows],
        )  # fmt: skip
        assert_same(other.closed_form(), found, joints)
        bits = [1.0 + 4.0 * np.finfo(float).eps * rng.integers(-1, 2, size=shape) for shape in ((m, n), m, m)]
        near = NullSpaceSaturation(
            task.J * bits[0], task.target * bits[1], lower=task.lower, upper=task.upper, drift=task.drift * bits[2]
        )
        assert_same(near.closed_form(), found, np.arange(n))


def test_a_row_that_is_asked_for_two_things_stops_the_task_and_no_more():
    """r x + d = s t = −s t: at s = 0 there is a point, since d = −r x with x inside the limits."""
    rng = generator("rows that disagree")
    for _ in range(COUNT // 4):
        n = int(rng.integers(1, 6))
        row, inside = rng.integers(-2, 3, size=n).astype(float), rng.integers(-4, 5, size=n).astype(float)
        unit, target = 10.0 ** rng.integers(-4, 5), float(rng.choice([0.1, 0.3, 1.0]))
        found = NullSpaceSaturation(
            unit * np.vstack([row, row]), [-target, target], lower=inside - rng.integers(0, 2, size=n),
            upper=inside + rng.integers(0, 2, size=n), drift=np.full(2, -unit * row @ inside),
        ).closed_form()  # fmt: skip
        assert found.feasible and found.scale == pytest.approx(0.0, abs=1e-9)


def test_a_direction_of_many_variables_is_followed_as_far_as_the_linear_program_goes():
    """Many multipliers depend on the push at once; the order in which rows leave decides whether the search ends."""
    rng, moved = generator("directions"), 0
    for _ in range(COUNT // 4):
        n = int(rng.integers(3, 9))
        E, inside = rng.integers(-2, 3, (int(rng.integers(1, n)), n)).astype(float), rng.uniform(-1.0, 1.0, n)
        gain = rng.normal(size=n)
        found = found_on(E, E @ inside, np.full(n, -1.0), np.ones(n), gain)
        best = linprog(-gain, A_eq=E, b_eq=E @ inside, bounds=[(-1.0, 1.0)] * n, method="highs-ds")
        assert found is not None and gain @ found.values == pytest.approx(-best.fun, abs=1e-8)
        np.testing.assert_allclose(E @ found.values, E @ inside, rtol=0, atol=1e-12)
        moved += gain @ found.values > gain @ inside + 1e-3
    assert moved > COUNT // 8, "most directions lead somewhere"


def test_of_points_equally_far_the_shortest_is_taken():
    """max z1 + z2 in the unit square cut by z1 + z2 + z3 = 1.5: a whole edge is farthest."""
    found = found_on(np.ones((1, 3)), np.array([1.5]), np.zeros(3), np.ones(3), np.array([1.0, 1.0, 0.0]))
    assert found is not None
    np.testing.assert_allclose(found.values, [0.75, 0.75, 0.0], rtol=0, atol=1e-14)


def test_its_push_is_the_least_from_which_the_quadratic_program_has_the_same_answer():
    """x + 0.1 y = s with x, y <= 1 and s <= 2: the last 0.1 of s costs y = 1, and pushes below s + 10 y stop short."""
    found = found_on(
        np.array([[1.0, 0.1, -1.0]]), np.zeros(1), np.full(3, -INF), np.array([1.0, 1.0, 2.0]),
        np.array([0.0, 0.0, 1.0]),
    )  # fmt: skip
    assert found is not None
    np.testing.assert_allclose(found.values, [1.0, 1.0, 1.1], rtol=0, atol=1e-14)
    assert found.push == pytest.approx(1.1 + 1.0 / 0.1)


def test_its_multipliers_balance_the_push_along_the_slope_whatever_it_is():
    """Rows at their limits push back: u - mu slope + F' multipliers = 0, signs as they must be from the push on."""
    rng, held = generator("balance"), 0
    for _ in range(COUNT // 4):
        k, m = int(rng.integers(1, 6)), int(rng.integers(6, 12))
        F, slope = rng.normal(size=(m, k)), rng.normal(size=k)
        F /= np.linalg.norm(F, axis=1)[:, None]
        slope /= np.linalg.norm(slope)
        upper, start = np.ones(m), rng.uniform(-0.5, 0.5, m)
        F = np.vstack([F, np.eye(k)])
        lower, upper, start = np.full(m + k, -1.0), np.ones(m + k), np.append(start, np.zeros(k))
        found = farthest(start, F, lower, upper, slope)
        assert found is not None
        for push in (found.push, 2.0 * found.push + 1.0):
            pushes = found.multipliers(push)
            np.testing.assert_allclose(found.u - push * slope + F.T @ pushes, 0.0, rtol=0, atol=1e-9 * (1.0 + push))
            room = np.where(pushes > 0.0, upper - found.values, found.values - lower)
            at = np.abs(room[np.abs(pushes) > 1e-9 * (1.0 + push)])
            assert (at <= 1e-12).all()
            held += len(at)
    assert held > COUNT


@pytest.mark.parametrize("beyond", [1e-6, 1.0])
def test_limits_that_leave_no_point_are_infeasible_and_rounding_in_them_is_not(beyond: float):
    """z1 + z2 + z3 = 3 with z <= 1 is one point."""
    ones, gain = np.ones((1, 3)), np.array([1.0, 0.0, 0.0])
    one = found_on(ones, np.array([3.0 + 1e-12]), np.full(3, -INF), np.ones(3), gain)
    assert one is not None
    np.testing.assert_allclose(one.values, 1.0, rtol=0, atol=1e-11)
    assert found_on(ones, np.array([3.0 + beyond]), np.full(3, -INF), np.ones(3), gain) is None
