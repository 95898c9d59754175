"""Unknowns that move a level by less than its rounding: the level has no say in them, and those below have."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from scipy.optimize import lsq_linear

import wbc

#: A number is known to this share of itself.
LAST_BIT = 2.0**-53


class Drawn(NamedTuple):
    """A x = b above x = wanted, lb ≤ x ≤ ub; ``faint`` (n,): columns with gains of 1e-18 to 1e-8 of their rows."""

    A: np.ndarray
    b: np.ndarray
    lb: np.ndarray
    ub: np.ndarray
    wanted: np.ndarray
    faint: np.ndarray


def drawn(seed: int) -> Drawn:
    """One to three rows of sizes from 1e-5 to 10, travels from 1e-3 to 1e3; out of reach, in reach, or met in a corner.

    One in three has rows of small integers, so that columns depend on one another.
    """
    rng = np.random.default_rng([seed, 5])
    n, m, few = int(rng.integers(1, 4)), int(rng.integers(1, 4)), int(rng.integers(1, 3))
    size = 10.0 ** rng.uniform(-5, 1, (m, 1))
    plain = rng.normal(size=(m, n))
    gains = 10.0 ** rng.uniform(-18, -8, (m, few)) * rng.choice([-1.0, 1.0], (m, few))
    A = size * np.hstack([np.round(plain) if rng.random() < 0.3 else plain, gains])
    travel, share = 10.0 ** rng.uniform(-3, 3, n + few), rng.uniform(size=n + few)
    lb, ub = -share * travel, (1.0 - share) * travel
    x = rng.uniform(lb, ub)
    corner = np.where(rng.random(n) < 0.7, np.where(rng.random(n) < 0.5, lb[:n], ub[:n]), x[:n])
    b = (
        A @ x * 10.0 ** rng.uniform(0, 6), rng.normal(size=m) * 10.0 ** rng.uniform(-3, 3), A[:, :n] @ corner, A @ x
    )[rng.integers(4)]  # fmt: skip
    order = rng.permutation(n + few)
    wanted = rng.uniform(lb - 0.2 * travel, ub + 0.2 * travel)
    return Drawn(A[:, order], b, lb[order], ub[order], wanted[order], order >= n)


@pytest.mark.parametrize("block", range(4))
def test_what_moves_a_level_by_less_than_its_rounding_is_left_to_those_below(block: int) -> None:
    """The rows are as near to b as without the faint columns, and these are where the level below wants them."""
    decided = unsolved = 0
    for seed in range(400 * block, 400 * (block + 1)):
        A, b, lb, ub, wanted, faint = drawn(seed)
        identity = np.eye(len(lb))
        answer = wbc.lexicographic([(A, b, b), (identity, wanted, wanted)], lb=lb, ub=ub)
        if not answer.status.ok:
            unsolved += 1
            continue
        x = answer.x
        least = lsq_linear(A[:, ~faint], b, (lb[~faint], ub[~faint]), tol=1e-14, method="bvls")
        assert np.linalg.norm(A @ x - b) <= np.linalg.norm(least.fun) + 1e-5 * (1.0 + np.linalg.norm(b)), seed
        rounding = LAST_BIT * (np.abs(b) + np.abs(A) @ np.abs(x))
        unmoved = faint & (np.abs(A) * (ub - lb) <= rounding[:, None]).all(axis=0)
        off = np.abs(x - np.clip(wanted, lb, ub))[unmoved] / (1.0 + np.abs(wanted[unmoved]))
        assert off.max(initial=0.0) <= 1e-4, seed
        decided += int(unmoved.sum())
    assert decided > 100 and unsolved <= 8
