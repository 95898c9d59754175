"""Numbers of any size are answered with a status, on every solver: nothing warns, nothing overflows into the caller."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import wbc
from tests.seeds import generator
from wbc.errors import InvalidProblem
from wbc.qp.solvers import usable
from wbc.types import Status

SIZES = np.array([1.0, 1.0, 1e8, 1e30, 1e90, 1e150, 1e-30, 1e-150])


def drawn(rng: np.random.Generator) -> wbc.QP:
    """Costs, rows and bounds from 1e-150 to 1e150 in one problem."""
    n, m = int(rng.integers(1, 5)), int(rng.integers(0, 4))

    def numbers(*shape: int) -> np.ndarray:
        return rng.normal(size=shape) * rng.choice(SIZES, size=shape)

    root = rng.normal(size=(n, n)) * (rng.random() < 0.7)
    lower = np.where(rng.random(n) < 0.5, -np.abs(numbers(n)), -np.inf)
    return wbc.QP(
        root @ root.T * float(rng.choice([1.0, 1e-12, 1e12, 1e100, 1e-100, 1e150])), numbers(n), C=numbers(m, n),
        cl=-np.abs(numbers(m)), cu=np.abs(numbers(m)), lb=lower,
    )  # fmt: skip


@pytest.mark.parametrize("solver", usable())
def test_every_solver_has_a_status_for_numbers_of_any_size(solver: str) -> None:
    rng, statuses = generator("numbers of any size"), set[Status]()
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        for _ in range(60):
            try:
                answer = wbc.solve(drawn(rng), solver=solver)
            except InvalidProblem:
                continue
            statuses.add(answer.status)
            assert answer.status is not Status.SOLVED or answer.certificate.ok
    assert Status.SOLVED in statuses and len(statuses) > 1
