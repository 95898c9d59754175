"""A conflict is irreducible, says how much each row must give, and is the same each time."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.reliability.conflicts import can_be_met, sides
from wbc.errors import InvalidProblem
from wbc.qp import QP
from wbc.qp.conflict import conflict


def test_rows_that_can_be_met_have_no_conflict():
    assert conflict(QP(np.eye(2), [1.0, 1.0], C=[[1.0, 1.0]], cl=[0.0], cu=[1.0], lb=[0.0, 0.0])) is None
    assert conflict(QP(np.eye(2), [1.0, 1.0])) is None


def test_rows_that_just_touch_can_be_met():
    qp = QP(np.eye(2), [0.0, 0.0], A=[[1.0, 1.0]], b=[2.0], ub=[1.0, 1.0], C=[[1.0, 1.0]] * 3, cu=[2.0] * 3)
    assert conflict(qp) is None


def test_a_bound_and_an_equality_are_told_with_what_is_missing():
    qp = QP(np.eye(1), [0.0], A=[[2.0]], b=[6.0], ub=[1.0], rows=[("aim", "x", "m"), ("wall", "x", "m")])
    found = conflict(qp)
    assert found is not None
    assert [(give.row.owner, round(give.amount, 9)) for give in found.gives] == [("aim", -4.0), ("wall", 2.0)]
    assert str(found) == "aim: x against wall: x: enough would be aim: x down by 4 m; or wall: x upper bound up by 2 m"


def test_a_row_that_nothing_can_meet_stands_alone():
    found = conflict(QP(np.eye(2), [0.0, 0.0], C=[[0.0, 0.0], [1.0, 0.0]], cl=[1.0, -1.0], cu=[2.0, 1.0]))
    assert found is not None and found.items == (0,)
    assert "cannot be met at all" in str(found)


@given(seed=st.integers(0, 2**32 - 1))
def test_rows_in_units_that_are_decades_apart_are_all_named(seed):
    """Independent rows and one that depends on all of them, each in a unit of its own; the row misses by ``gap``."""
    rng = np.random.default_rng(seed)
    n, gap = int(rng.integers(2, 5)), 1e4
    rows, most, share = rng.normal(size=(n, n)) + 2.0 * np.eye(n), rng.normal(size=n), rng.uniform(0.5, 2.0, n)
    unit = 10.0 ** rng.uniform(-5.0, 5.0, n + 1)
    C, cu = np.vstack([rows, -share @ rows]), np.append(most, -share @ most - gap)
    found = conflict(QP(np.eye(n), np.zeros(n), C=C * unit[:, None], cu=cu * unit))
    assert found is not None and found.items == tuple(range(n + 1))
    expected = gap * unit / np.append(share, 1.0)
    np.testing.assert_allclose([give.amount for give in found.gives], expected, rtol=1e-6)


def test_what_physics_decides_is_not_named_and_does_not_give():
    rows = [("base dynamics", "fz", "N"), ("limit", "a", "N"), ("limit", "b", "N")]
    qp = QP(np.eye(2), [0.0, 0.0], A=[[1.0, 1.0]], b=[5.0], ub=[1.0, 2.0], rows=rows)
    found = conflict(qp)
    assert found is not None and found.items == (1, 2)
    assert [give.amount for give in found.gives] == pytest.approx([2.0, 2.0])


def test_of_two_conflicts_the_one_without_laws_is_told():
    rows = [("task exactly", "", "m"), ("contact[foot]", "z", "m"), ("limit", "", "m"), ("wall", "", "m")]
    qp = QP(np.eye(1), [0.0], A=[[1.0], [1.0]], b=[9.0, 1.5], C=[[1.0]], cl=[2.0], ub=[1.0], rows=rows)
    found = conflict(qp)
    assert found is not None and [row.owner for row in found.rows] == ["limit", "wall"]


def test_a_long_conflict_is_told_by_its_smallest_amounts():
    n = 9
    qp = QP(np.eye(n), np.zeros(n), A=np.ones((1, n)), b=[10.0], ub=np.ones(n))
    found = conflict(qp)
    assert found is not None and len(found.gives) == n + 1
    assert "4 more: enough would be" in str(found)
    assert str(found).count("; or ") == 5


def test_data_that_are_no_problem_are_refused():
    qp = QP(np.eye(1), [0.0], ub=[1.0])
    qp.ub[0] = np.nan
    with pytest.raises(InvalidProblem):
        conflict(qp)


@st.composite
def systems(draw: st.DrawFn) -> QP:
    """Rows over few decades, some equal, some repeated, some bounds; most cannot be met."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    n, n_eq, n_in = draw(st.integers(1, 6)), draw(st.integers(0, 3)), draw(st.integers(1, 10))
    matrix = rng.normal(size=(n_eq + n_in, n)) * (rng.uniform(size=(n_eq + n_in, n)) < 0.6)
    matrix *= 10.0 ** rng.uniform(-2, 2, (n_eq + n_in, 1))
    if draw(st.booleans()):
        matrix[-1] = matrix[0]
    middle, width = rng.normal(size=n_eq + n_in), rng.exponential(size=n_eq + n_in)
    lower = np.where(rng.uniform(size=n_in) < 0.3, -np.inf, (middle - 0.3 * width)[n_eq:])
    upper = np.where(rng.uniform(size=n_in) < 0.3, np.inf, (middle + 0.3 * width)[n_eq:])
    bound = np.where(rng.uniform(size=n) < 0.5, np.inf, rng.exponential(size=n))
    return QP(np.eye(n), np.zeros(n), A=matrix[:n_eq], b=middle[:n_eq], C=matrix[n_eq:], cl=lower, cu=upper,
              lb=-bound, ub=bound)  # fmt: skip


@given(systems())
def test_a_conflict_is_irreducible_and_each_amount_is_enough(qp: QP):
    everything = range(len(qp.rows))
    found = conflict(qp)
    if found is None:
        assert can_be_met(qp, everything)
        return
    assert not can_be_met(qp, found.items)
    for item, amount in zip(found.items, (give.amount for give in found.gives), strict=True):
        assert can_be_met(qp, set(found.items) - {item})
        assert can_be_met(_moved(qp, item, 1.001 * amount), found.items)
        if abs(amount) > 1e-4 * max(1.0, float(np.linalg.norm(sides(qp)[0][item]))):  # what the oracle can tell
            assert not can_be_met(_moved(qp, item, 0.9 * amount), found.items)
    again = conflict(qp)
    assert again == found, "the same bits each time"


def _moved(qp: QP, item: int, amount: float) -> QP:
    """The same problem, one side of one row moved outwards."""
    moved = qp.copy()
    for first, low, high in ((0, moved.lower, moved.upper), (len(qp.lower), moved.lb, moved.ub)):
        if first <= item < first + len(low):
            (high if amount > 0 else low)[item - first] += amount
    return moved


def test_rows_that_contradict_each_other_by_less_than_what_counts_as_met_are_no_conflict() -> None:
    """A bound is met that is missed by 1e-6 of its unit: nobody is to blame for less, and a little more is told."""

    def apart(by: float) -> QP:
        return QP([[1.0]], [0.0], C=[[1.0], [1.0]], cl=[1.0, -9.0], cu=[9.0, 1.0 - by])

    assert conflict(apart(1e-7)) is None
    found = conflict(apart(1e-5))
    assert found is not None and [give.amount for give in found.gives] == pytest.approx([-1e-5, 1e-5], rel=1e-6)


def test_a_row_that_takes_no_part_is_not_named() -> None:
    rows = [("floor", "z", "m"), ("ceiling", "z", "m"), ("wall", "x", "m")]
    qp = QP([[1.0]], [0.0], C=[[1.0], [1.0], [1.0]], cl=[1.0, -9.0, 0.0], cu=[9.0, -1.0, 9.0], rows=rows)
    found = conflict(qp)
    assert found is not None and [row.owner for row in found.rows] == ["floor", "ceiling"]
