"""Methods of diagnosis and adaptation: residuals, lost shares, forces at contacts and possible bodies."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

from wbc.errors import InvalidInput
from wbc.methods import ContactEstimate, FaultFraction, MomentumResidual, PseudoInertia
from wbc.methods.contact_estimate import UNFELT
from wbc.qp import solve
from wbc.testing import check_method
from wbc.testing.strategies import magnitudes, spd
from wbc.types import Vec


# ---- the fault fraction: between sound and dead, or not known
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


# ---- the momentum residual; robots that move: tests/tasks/test_momentum_observer.py
@given(st.integers(1, 6), st.sampled_from(["exact", "euler", "implicit"]), st.booleans(), st.integers(0, 2**32 - 1))
def test_an_interval_moves_the_residual_by_its_share_of_what_is_missing(n: int, scheme: str, alike: bool, seed: int):
    """r ← r + φ (T (τ − β − Δp/dt) − r): properties 61, 63, 66 and 70, whatever moves."""
    rng = np.random.default_rng(seed)
    gain = rng.uniform(1.0, 50.0, None if alike else n)
    observer = MomentumResidual(gain=gain, dt=1e-2, scheme=scheme)
    p, r = rng.normal(size=n), np.zeros(n)
    observer.reset(p)
    for k in range(8):
        (after, beta, tau), rows = rng.normal(size=(3, n)), rng.normal(size=(n, n)) if k % 2 else np.eye(n)
        dt = rng.uniform(1e-3, 3e-2) if k % 3 else 1e-2
        x = gain * dt
        share = {"exact": 1.0 - np.exp(-x), "euler": x, "implicit": x / (1.0 + x)}[scheme]
        missing = rows @ (tau - beta - (after - p) / dt)
        p, r = after, r + share * (missing - r)
        found = observer.update(p, beta, tau, rows if k % 2 else None, dt=dt if k % 3 else None)
        np.testing.assert_allclose(found, r, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(observer.missing, missing, rtol=1e-12)
        if k == 4:
            observer.restart(n - 1)
            r[n - 1] = 0.0


@given(st.floats(0.1, 100), st.lists(st.floats(1e-4, 0.1), min_size=1, max_size=20), st.floats(-5, 5))
def test_intervals_may_have_lengths_of_their_own(gain: float, lengths: list[float], fault: float):
    """r(t) = (1 − e^(−K t)) τ_f, however the time t is cut into intervals; the momentum changes by −τ_f each second."""
    observer, t = MomentumResidual(gain=gain, dt=1e-3), 0.0
    observer.reset([0.0])
    for dt in lengths:
        t += dt
        observer.update([-fault * t], [0.0], [0.0], dt=dt)
        assert observer.value[0] == pytest.approx(fault * -np.expm1(-gain * t), rel=1e-9, abs=1e-9)
    with pytest.raises(InvalidInput, match="dt is 0"):
        observer.update([0.0], [0.0], [0.0], dt=0.0)
    euler = MomentumResidual(gain=gain, dt=1.0 / gain, scheme="euler")
    euler.reset([0.0])
    with pytest.raises(InvalidInput, match="stable below 2"):
        euler.update([0.0], [0.0], [0.0], dt=2.5 / gain)


def test_after_a_reset_only_what_follows_counts():
    observer = MomentumResidual(gain=10.0, dt=0.01)
    observer.reset([1.0])
    observer.update([1.0], [0.0], [5.0])
    assert observer.value[0] > 0.0
    observer.reset([3.0])
    np.testing.assert_array_equal(observer.update([3.0], [0.0], [0.0]), 0.0)


def test_a_refused_update_leaves_the_residual_as_it_was():
    observer = MomentumResidual(gain=[1.0, 2.0], dt=0.01)
    with pytest.raises(InvalidInput, match=r"p0 must have shape \(2,\)"):
        observer.reset([0.0])
    observer.reset([0.0, 0.0])
    before = observer.update([0.0, 0.0], [0.0, 0.0], [1.0, 1.0])
    with pytest.raises(InvalidInput, match=r"tau\[1\] is nan"):
        observer.update([0.0, 0.0], [0.0, 0.0], [1.0, np.nan])
    with pytest.raises(InvalidInput, match=r"beta must have shape \(2,\), not \(3,\)"):
        observer.update([0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 1.0])
    np.testing.assert_array_equal(observer.value, before)


# ---- the force at a point that explains a residual: least squares, and within a friction cone
@given(st.integers(0, 9999), st.integers(3, 9))
@example(seed=217, joints=3)  # a direction that the joints hardly feel
def test_a_force_that_was_there_is_found(seed: int, joints: int) -> None:
    """But for the share δ / (λ + δ) of what lies along a direction of curvature λ, where δ is what unfelt ones get."""
    rng = np.random.default_rng(seed)
    J, force, weight = rng.standard_normal((3, joints)), 20.0 * rng.standard_normal(3), rng.uniform(0.1, 10.0, joints)
    found = ContactEstimate(J, -J.T @ force, weight=weight).closed_form()
    curvature = np.linalg.eigvalsh((J * weight) @ J.T)
    share, rounding = UNFELT * curvature.sum() / curvature[0], 1e-14 * curvature[-1] / curvature[0]
    assert np.linalg.norm(found.force - force) <= (share + rounding) * np.linalg.norm(force)
    assert found.unexplained < 1e-4


@settings(max_examples=20)
@given(st.integers(0, 9999), st.booleans())
def test_every_solver_gives_the_same(seed: int, surface: bool) -> None:
    rng = np.random.default_rng(seed)
    where = {"normal": rng.standard_normal(3), "friction": 0.5} if surface else {}
    check_method(ContactEstimate(rng.standard_normal((3, 7)), rng.standard_normal(7), **where))


@given(st.integers(0, 9999), st.floats(0.1, 1.0))
def test_the_force_pushes_and_does_not_slip(seed: int, friction: float) -> None:
    rng = np.random.default_rng(seed)
    normal = rng.standard_normal(3)
    normal /= np.linalg.norm(normal)
    J, r = rng.standard_normal((3, 7)), rng.standard_normal(7)
    cone = ContactEstimate(J, r, normal=normal, friction=friction)
    force = cone.solve().force
    inward = -float(force @ normal)
    assert inward >= -1e-7
    assert np.linalg.norm(force + inward * normal) <= 2.0**0.5 * friction * inward + 1e-7
    assert cone.solve().unexplained >= ContactEstimate(J, r).closed_form().unexplained - 1e-7


def test_what_no_joint_feels_is_no_force() -> None:
    J = np.vstack([np.eye(2), np.zeros((1, 2))])
    assert ContactEstimate(J, [1.0, 2.0]).closed_form().force[2] == 0.0


# ---- the nearest body: by eigenvalues and by a QP of four rows
SIZES = np.array([2.0, 0.2, 0.2, 0.2, 0.05, 0.02, 0.05, 0.02, 0.02, 0.05])


def drawn(seed: int) -> Vec:
    return SIZES * np.random.default_rng(seed).standard_normal(10)


@settings(max_examples=max(20, settings.default.max_examples // 2))
@given(st.integers(0, 9999))
def test_both_ways_agree_on_every_solver(seed: int) -> None:
    check_method(PseudoInertia(drawn(seed), length=0.2))


@given(st.integers(0, 9999), st.sampled_from([0.05, 0.1, 0.5]))
def test_the_answer_is_a_body_and_bodies_stay_as_they_are(seed: int, length: float) -> None:
    found = PseudoInertia(drawn(seed), length=length, floor=1e-4).closed_form()
    assert found.smallest >= 1e-4 * (1 - 1e-9)
    again = PseudoInertia(found.parameters, length=length, floor=1e-4)
    assert again.smallest == pytest.approx(found.smallest, abs=1e-9)
    np.testing.assert_allclose(again.closed_form().parameters, found.parameters, atol=1e-9)


@given(st.integers(0, 9999))
def test_no_point_mass_is_nearer(seed: int) -> None:
    """The optimality condition on the cone: against every point mass, which span it."""
    off, rng = drawn(seed), np.random.default_rng(seed)
    x, Q = PseudoInertia(off, floor=1e-9).closed_form().parameters, PseudoInertia.metric()
    for _ in range(20):
        m, c = rng.exponential(2.0), 0.2 * rng.standard_normal(3)
        about = m * (c @ c * np.eye(3) - np.outer(c, c))
        other = np.array([m, *m * c, *about[np.triu_indices(3)][[0, 1, 3, 2, 4, 5]]])
        assert (off - x) @ Q @ (other - x) <= 1e-6 * (1 + np.abs(off).max()) ** 2 * (1 + m)


def test_a_mass_that_is_not_negative_is_not_enough() -> None:
    """Ixx > Iyy + Izz: no distribution of mass is like that."""
    assert PseudoInertia([1.0, 0, 0, 0, 0.1, 0, 0.01, 0, 0, 0.01]).smallest < 0.0
