"""The fault fraction as a specification: between sound and dead, or not known."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from wbc.methods import FaultFraction
from wbc.qp import solve
from wbc.testing import check_method
from wbc.testing.strategies import magnitudes, spd


@st.composite
def faults(draw: Any, *, coupled: bool | None = None) -> FaultFraction:
    """Actuators that are sound, weak, dead, or show more than was asked of them; some are asked for nothing."""
    n = draw(st.integers(1, 10))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    tau = rng.normal(size=n) * 10.0 ** rng.uniform(-2, 2, n)
    tau[rng.uniform(size=n) < 0.15] = 0.0
    residual = tau * rng.choice([0.0, 0.3, 0.9, 1.0, 1.4, -0.2], n) + 1e-2 * rng.normal(size=n) * np.abs(tau).max()
    kind = draw(st.sampled_from(["none", "number", "diagonal"])) if not coupled else "full"
    if coupled is None and draw(st.booleans()):
        kind = "full"
    weight = {
        "none": lambda: None, "number": lambda: draw(magnitudes()), "diagonal": lambda: 10.0 ** rng.uniform(-3, 3, n),
        "full": lambda: draw(magnitudes()) * draw(spd(n, condition=1e4)),
    }[kind]()  # fmt: skip
    return FaultFraction(tau, residual, weight=weight)


@given(faults())
def test_closed_form_and_qp_agree_on_every_solver(fault: FaultFraction):
    check_method(fault)


@given(faults(coupled=False))
def test_the_qp_as_it_is_written_has_the_closed_form_as_its_optimum(fault: FaultFraction):
    known = fault.identifiable
    if not known.any():
        return
    answer = solve(fault.qp(), "daqp")
    assert answer.status.ok
    curvature = fault.qp().H.diagonal()
    away = answer.x - fault.closed_form().fraction[known]
    assert curvature @ away**2 <= 1e-9 * (curvature.sum() + 1.0)


@given(faults())
def test_the_fractions_are_those_of_bounded_least_squares(fault: FaultFraction):
    """scipy's bounded-variable least squares on |Q^½ (diag(τ) l − r)|, 0 ≤ l ≤ 1."""
    known = fault.identifiable
    answer = fault.solve()
    np.testing.assert_array_equal(np.isnan(answer.fraction), ~known)
    if not known.any():
        return
    half = np.linalg.cholesky(fault.weight).T
    matrix = (half * fault.tau)[:, known]
    unit = np.linalg.norm(matrix, axis=0)
    found = lsq_linear(matrix / unit, half @ fault.residual, (0.0 * unit, unit), method="bvls", tol=1e-15)
    misfit = [
        float(np.linalg.norm(matrix @ x - half @ fault.residual)) for x in (answer.fraction[known], found.x / unit)
    ]
    assert misfit[0] <= misfit[1] * (1 + 1e-9) + 1e-12
    np.testing.assert_allclose(
        answer.fraction[known] * unit, found.x, atol=1e-6 * np.linalg.norm(half @ fault.residual)
    )


@given(st.lists(st.floats(-50, 50).filter(lambda x: abs(x) > 1e-3), min_size=1, max_size=8), st.data())
def test_a_known_loss_is_found(tau: list[float], data: st.DataObject):
    """Property 69: r = l τ gives l, whatever the weight."""
    loss = np.array(data.draw(st.lists(st.floats(0, 1), min_size=len(tau), max_size=len(tau))))
    weight = data.draw(spd(len(tau), condition=1e2))
    for answer in (
        FaultFraction(tau, loss * tau).closed_form(), FaultFraction(tau, loss * tau, weight=weight).solve()
    ):  # fmt: skip
        np.testing.assert_allclose(answer.fraction, loss, atol=1e-9)


def test_a_joint_that_is_asked_for_nothing_is_not_known():
    answer = FaultFraction([5.0, 0.0], [5.0, 3.0]).solve()
    assert answer.fraction[0] == pytest.approx(1.0) and np.isnan(answer.fraction[1])
    assert answer.identifiable.tolist() == [True, False]
    nothing = FaultFraction([0.0, 0.0], [0.0, 0.0])
    assert np.isnan(nothing.solve().fraction).all() and np.isnan(nothing.closed_form().fraction).all()
