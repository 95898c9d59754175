"""Torque problems of every kind: redundant and not, of any rank, limited, with equalities and damping."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from hypothesis import strategies as st

from wbc.methods.weighted_torque import WEIGHTS, WeightedTorque
from wbc.testing.strategies import jacobians, magnitudes, spd

SEEDS = st.integers(0, 2**32 - 1)
#: Settings of :func:`problems` at moderate condition, with independent rows that can be met.
CALM: dict[str, Any] = {"n": st.integers(2, 6), "condition": 1e2, "deficient": False, "consistent": True}


@st.composite
def problems(
    draw: Any,
    *,
    n: st.SearchStrategy[int] | None = None,
    weights: Sequence[str] = (*WEIGHTS, "array"),
    deficient: bool | None = None,
    consistent: bool | None = None,
    limited: bool = False,
    equalities: bool | None = None,
    damped: bool | None = None,
    condition: float = 1e6,
) -> WeightedTorque:
    """Tasks whose torques, biases and accelerations belong together within three decades, each over six.

    The metric of the cost has a condition of up to ``condition``; ``consistent`` says whether the rows of the task
    can be met together without limits, which only those of a deficient Jacobian may not.
    """
    size = draw(st.integers(1, 10) if n is None else n)
    m = draw(st.integers(1, size))
    rng = np.random.default_rng(draw(SEEDS))
    weight: Any = draw(st.sampled_from(weights))
    spread = condition if weight == "inverse_inertia" else condition**0.5
    M = draw(magnitudes()) * draw(spd(size, condition=spread))
    if weight == "array":
        weight = draw(magnitudes()) * draw(spd(size, condition=condition**0.5))
    J = draw(jacobians(m, size, deficient=deficient, condition=1e3))
    motion = draw(magnitudes())

    def acceleration() -> np.ndarray:
        return rng.normal(size=size) * motion * 10.0 ** rng.uniform(-2, 1)

    drift = J @ acceleration()
    reached = acceleration()
    wanted = J @ reached + drift
    if consistent is False or (consistent is None and draw(st.integers(0, 3)) == 0):
        wanted = draw(st.sampled_from([0.0, 1.0])) * np.abs(J).max() * motion * rng.normal(size=m)
    options: dict[str, Any] = {
        "drift": drift, "tau_0": M @ acceleration(), "tau_external": M @ acceleration(), "weight": weight,
    }  # fmt: skip
    if draw(st.booleans()) if equalities is None else equalities:
        k = draw(st.integers(1, max(1, size - m)))
        E = draw(magnitudes()) * rng.normal(size=(k, size))
        options["equalities"] = (E, E @ (reached if consistent else acceleration()))
    if draw(st.integers(0, 3)) == 0 if damped is None else damped:
        options["damping"] = (
            10.0 ** rng.uniform(-2, 2)
            * np.linalg.norm(J @ np.linalg.inv(M), 2)
            * np.sqrt(1.0 / np.linalg.norm(WeightedTorque(M, np.zeros(size), J, wanted, weight=weight).W, 2))
        )
    n_bias = M @ acceleration()
    task = WeightedTorque(M, n_bias, J, wanted, **options)
    if not limited:
        return task
    tau = task.closed_form().tau
    if np.isnan(tau).any():
        tau = task.tau_0
    room = np.abs(tau) * rng.uniform(0.5, 1.5, size) + 1e-2 * np.abs(tau).max() * rng.uniform(size=size)
    lower, upper = (np.where(rng.uniform(size=size) < 0.6, side * room, side * np.inf) for side in (-1.0, 1.0))
    return WeightedTorque(M, n_bias, J, wanted, **options, tau_min=lower, tau_max=upper)


def again(task: WeightedTorque, **changes: Any) -> WeightedTorque:
    """The same task with something else."""
    values: dict[str, Any] = {
        "M": task.M, "n": task.n, "J": task.J, "task_acceleration": task.task_acceleration, "drift": task.drift,
        "tau_0": task.tau_0, "tau_external": task.tau_external, "weight": task.W, "tau_min": task.tau_min,
        "tau_max": task.tau_max, "equalities": (task.E, task.e), "damping": task.damping,
    } | changes  # fmt: skip
    first = [values.pop(name) for name in ("M", "n", "J", "task_acceleration")]
    return WeightedTorque(*first, **values)
