"""Small dense systems of the kernels, in plain Python and compiled: what NumPy says, and nothing beyond the block."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.plain import plain
from wbc.qp.rows.compiled import linear

FORMS: dict[str, Any] = {"plain": plain(linear), "compiled": linear}
PLAIN = FORMS["plain"]
sizes = st.integers(0, 9)


@given(
    first=sizes, size=sizes, column=sizes, n=sizes, seed=st.integers(0, 10**6), sign=st.sampled_from([1.0, -1.0])
)  # fmt: skip
def test_sums_of_rows_are_numpys(first: int, size: int, column: int, n: int, seed: int, sign: float) -> None:
    """Whichever of the shares are zero, and from whichever column on."""
    rng, last = np.random.default_rng(seed), first + size
    A, row = rng.normal(size=(last + 2, column + n + 2)), rng.normal(size=column + n + 2)
    for shares in (rng.normal(size=last + 2), np.zeros(last + 2), *np.eye(last + 2)):
        out, wanted = row.copy(), row.copy()
        PLAIN.add_rows(sign, shares, A, first, last, n, out)
        wanted[:n] += sign * shares[first:last] @ A[first:last, :n]
        np.testing.assert_allclose(out, wanted, rtol=0, atol=1e-12)
    out = rng.normal(size=last + 2)
    wanted = out.copy()
    PLAIN.times(A, column, row, first, last, n, out)
    wanted[first:last] = A[first:last, column : column + n] @ row[:n]
    np.testing.assert_allclose(out, wanted, rtol=0, atol=1e-12)


@pytest.mark.parametrize("form", FORMS)
@given(first=sizes, size=st.integers(1, 11), lost=st.integers(0, 4), seed=st.integers(0, 10**6))
def test_a_factor_solves_what_its_independent_rows_say(form: str, first: int, size: int, lost: int, seed: int) -> None:
    """Rows that depend on those above them are left out, and counted; what stands beside the block is not touched."""
    rng, last, call = np.random.default_rng(seed), first + size, FORMS[form]
    rows = rng.integers(-3, 4, (size, size)) + 10.0 * np.eye(size)
    dependent = np.sort(rng.permutation(np.arange(1, size))[:lost])
    for i in dependent:
        rows[i] = rows[rng.integers(i)]
    everything = rng.normal(size=(last + 4, last + 4))
    everything[first:last, first:last] = rows @ rows.T
    L = everything.copy()
    assert call.factor(L, first, last, 1e-10) == len(dependent)
    inside = np.zeros(L.shape, dtype=bool)
    inside[first:last, first:last] = True
    np.testing.assert_array_equal(L[~inside], everything[~inside])
    assert (np.flatnonzero(L.diagonal()[first:last] == 0.0) == dependent).all()

    kept = np.setdiff1d(np.arange(size), dependent)
    wanted = rng.normal(size=last + 4)
    found = wanted.copy()
    call.forward(L, first, last, found)
    call.backward(L, first, last, found)
    block = everything[first:last, first:last][np.ix_(kept, kept)]
    wanted[first + dependent] = 0.0
    wanted[first + kept] = np.linalg.solve(block, wanted[first + kept])
    np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-7 * (1.0 + np.abs(wanted).max()))


@pytest.mark.parametrize("form", FORMS)
@given(first=sizes, size=st.integers(1, 9), at=st.integers(0, 8), seed=st.integers(0, 10**6))
def test_a_factor_without_a_row_is_the_factor_of_what_is_left(
    form: str, first: int, size: int, at: int, seed: int
) -> None:
    rng, last, call = np.random.default_rng(seed), first + size, FORMS[form]
    rows = rng.normal(size=(size, size)) + 5.0 * np.eye(size)
    L = np.zeros((last, last))
    L[first:, first:] = rows @ rows.T
    call.factor(L, first, last, 0.0)
    gone = at % size
    left = np.delete(rows, gone, axis=0)
    call.remove(L, first, last, first + gone)
    b = rng.normal(size=last)
    wanted = np.linalg.solve(left @ left.T, b[first : last - 1]) if size > 1 else np.zeros(0)
    call.forward(L, first, last - 1, b)
    call.backward(L, first, last - 1, b)
    np.testing.assert_allclose(b[first : last - 1], wanted, rtol=0, atol=1e-9 * (1.0 + np.abs(wanted).max(initial=0.0)))
