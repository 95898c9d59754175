"""Nonnegative least squares: the optimum where it is one, and an end in any arithmetic."""

from __future__ import annotations

import numpy as np
import pytest

import wbc.qp.nonnegative as module
from tests.seeds import generator
from wbc.qp.nonnegative import nonnegative
from wbc.types import Mat, Vec


def drawn(rng: np.random.Generator) -> tuple[Mat, Vec]:
    """Columns of unit length, many of them parallel or dependent, and a right side in or out of their cone."""
    n, m = int(rng.integers(1, 8)), int(rng.integers(1, 25))
    k = int(rng.integers(1, n + 1))
    columns = (rng.integers(-2, 3, (n, k)) @ rng.integers(-1, 2, (k, m))).astype(np.float64)
    columns /= np.maximum(np.linalg.norm(columns, axis=0), 1.0)
    right = columns @ rng.exponential(1.0, m) if rng.random() < 0.5 else rng.normal(size=n)
    return columns, right / (np.linalg.norm(right) or 1.0)


def test_no_column_pulls_and_none_that_is_used_is_off() -> None:
    rng = generator("nonnegative")
    for _ in range(300):
        columns, right = drawn(rng)
        z = nonnegative(columns, right)
        pull = columns.T @ (right - columns @ z)
        assert (z >= 0.0).all() and (pull <= 1e-9).all() and (np.abs(pull[z > 0.0]) <= 1e-9).all()


@pytest.mark.parametrize("bits", [1, 4, 16])
def test_it_ends_whatever_rounding_makes_of_its_steps(bits: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Columns that all but depend on each other leave rounding to decide: one that is used may come out as zero."""
    rng = generator("nonnegative by rounding", bits)

    def step(columns: Mat, right: Vec, used: Vec) -> Vec:
        last = 1.0 + 2.0**-52 * rng.integers(0, bits + 1, len(used))
        return np.where(used, last * rng.choice([-1.0, -0.0, 1.0, 1.0, 1.0], len(used)), 0.0)

    monkeypatch.setattr(module, "_least_squares", step)
    with np.errstate(invalid="raise"):
        for _ in range(300):
            z = nonnegative(*drawn(rng))
            assert np.isfinite(z).all() and (z >= 0.0).all()
