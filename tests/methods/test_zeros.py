"""Numbers that robots have and random draws do not: joints that are locked and motors that are dead, at exactly zero.

Data are small integers, and there is a point by construction: limited entries are zero in it, each at a limit or
between two. Where equations decide these entries, they come out as rounding of the others.
"""

from __future__ import annotations

import numpy as np
import pytest

from tests.methods.test_weighted_torque import EXACT
from tests.seeds import generator
from wbc.methods import NullSpaceSaturation, WeightedTorque

COUNT = 150


def a_point(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """x (n,), and limits that it meets: entries that are not limited are any, the others zero."""
    is_free = rng.random(n) < 0.4
    x = np.where(is_free, rng.integers(-4, 5, size=n), 0.0)
    low, high = rng.integers(0, 3, size=(2, n)) * rng.integers(0, 2, size=(2, n))
    return x, np.where(is_free, -np.inf, -low), np.where(is_free, np.inf, high)


@pytest.mark.parametrize("solver", [None, *EXACT])
def test_a_drift_that_can_be_met_is_met_beside_locked_joints(solver: str | None):
    rng = generator("locked joints", solver)
    for _ in range(COUNT):
        n = int(rng.integers(2, 7))
        J, unit = rng.integers(-2, 3, size=(rng.integers(1, n + 1), n)).astype(float), 10.0 ** rng.integers(-3, 4)
        x, lower, upper = a_point(rng, n)
        target = unit * rng.integers(-3, 4, size=len(J))
        task = NullSpaceSaturation(unit * J, target, lower=lower, upper=upper, drift=-unit * (J @ x))
        found = task.solve(solver) if solver else task.closed_form()
        assert found.feasible, task
        missed = J @ (found.x - x) - found.scale * target / unit
        assert np.abs(missed).max() <= 1e-7 * (1.0 + np.abs(found.x).max()), task


@pytest.mark.parametrize("weight", ["inverse_inertia", "identity"])
@pytest.mark.parametrize("solver", EXACT)
def test_a_task_that_can_be_done_is_done_beside_dead_motors(solver: str, weight: str):
    rng = generator("dead motors", solver, weight)
    for _ in range(COUNT):
        n = int(rng.integers(2, 7))
        J, inertia = rng.integers(-2, 3, size=(rng.integers(1, n + 1), n)).astype(float), 2.0 ** rng.integers(-3, 4, n)
        tau, lower, upper = a_point(rng, n)
        bias, preferred = rng.integers(-3, 4, size=(2, n)).astype(float)
        task = WeightedTorque(
            np.diag(inertia), bias, J, J @ ((tau - bias) / inertia), weight=weight,
            tau_0=preferred * rng.integers(0, 2), tau_min=lower, tau_max=upper,
        )  # fmt: skip
        found = task.solve(solver)
        assert found.feasible, task
        assert np.maximum(lower - found.tau, found.tau - upper).max() <= 1e-6, task
        assert np.abs(J @ ((found.tau - tau) / inertia)).max() <= 1e-6 * (1.0 + np.abs(found.tau).max()), task
