"""The parameter update as a specification: projections in the metric of the gain, on every solver, for every set."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import nnls

from tests.methods.problems import check_on_every_solver
from wbc.errors import NoClosedForm
from wbc.methods import ParameterUpdate
from wbc.qp import solve
from wbc.testing.strategies import jacobians, magnitudes, spd

SEEDS = st.integers(0, 2**32 - 1)


@st.composite
def updates(draw: Any, kinds: tuple[str, ...] = ("free", "box", "coupled box", "rows", "both")) -> ParameterUpdate:
    """Updates in sets of all kinds, the estimate on a part of their boundary."""
    p, n, kind = draw(st.integers(1, 10)), draw(st.integers(1, 10)), draw(st.sampled_from(kinds))
    rng = np.random.default_rng(draw(SEEDS))
    Y = draw(jacobians(n, p))
    s = draw(magnitudes()) * rng.normal(size=n)
    a_hat = draw(magnitudes()) * rng.normal(size=p)
    diagonal = kind == "box" or (kind == "free" and draw(st.booleans()))
    spread = draw(st.sampled_from([3, 8]))  # half the decades between gains
    gain = draw(magnitudes()) * (10.0 ** rng.uniform(-spread, spread, p) if diagonal else draw(spd(p)))
    options: dict[str, Any] = {}
    a_hat[rng.uniform(size=p) < draw(st.sampled_from([0.0, 0.0, 0.3, 1.0]))] = 0.0
    room = (np.abs(a_hat).max() or 1.0) * np.where(rng.uniform(size=(2, p)) < 0.7, 0.0, rng.uniform(size=(2, p)))
    room[rng.uniform(size=(2, p)) < 0.3] = np.inf
    if kind in ("box", "coupled box", "both"):
        options |= {"lower": a_hat - room[0], "upper": a_hat + room[1]}
    if kind in ("rows", "both"):
        k = draw(st.integers(1, 2 * p))
        C = rng.normal(size=(k, p)) * 10.0 ** rng.uniform(-3, 3, (k, 1))
        slack = np.where(rng.uniform(size=k) < 0.7, 0.0, rng.uniform(size=k)) * np.linalg.norm(C, axis=1)
        options |= {"C": C, "d": C @ a_hat + slack * np.abs(a_hat).max()}
    return ParameterUpdate(Y, s, gain=gain, a_hat=a_hat, **options)


def lengths(update: ParameterUpdate, x: np.ndarray) -> float:
    """In the metric Γ⁻¹."""
    return float(np.linalg.norm(np.linalg.solve(np.linalg.cholesky(update.gain), x)))


def free_rate(update: ParameterUpdate) -> np.ndarray:
    return update.gain @ update.Y.T @ update.s


def sides(update: ParameterUpdate, at: np.ndarray, way: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Rows and bounds of the set as rows (k, p), and which of them a point is on: to the last bits of its ``way``."""
    eye, size = np.eye(len(at)), np.abs(update.a_hat).max()
    rows = np.vstack([update.C, -eye, eye])
    room = np.concatenate([update.d, -update.lower, update.upper]) - rows @ at
    return rows, room <= np.linalg.norm(rows, axis=1) * (1e-9 * max(size, np.abs(at).max()) + 1e-15 * way)


def pushed(update: ParameterUpdate, x: np.ndarray, at: np.ndarray, way: float = 0.0) -> np.ndarray:
    """The point nearest to x, in the metric Γ⁻¹, that sides of the set at a point take away: Γ Aᵀ μ with μ ≥ 0.

    By scipy's non-negative least squares. What is left is the projection of x (Moreau), and as A (a − at) ≤ 0 for
    every a of the set, it never makes the Lyapunov function ½ |at − a|² grow: property 41.
    """
    rows, on = sides(update, at, way)
    R = np.linalg.cholesky(update.gain)
    held = rows[on] @ R
    held /= np.linalg.norm(held, axis=1)[:, None]
    return R @ (held.T @ nnls(held.T, np.linalg.solve(R, x), maxiter=10_000)[0]) if on.any() else 0.0 * x


# ---- every solver
def test_closed_form_and_qp_agree_on_every_solver():
    check_on_every_solver(updates())


@given(updates(kinds=("free", "box")), st.sampled_from(["pdas", "daqp"]))
def test_the_qp_as_it_is_written_has_the_closed_form_as_its_optimum(update: ParameterUpdate, solver: str):
    """Without the units in which methods solve their QPs, where those of the parameters are not far apart."""
    rates = np.sqrt(update.gain.diagonal())
    if np.linalg.cond(update.gain) > 1e4 or not 1e-2 < rates.max() < 1e2:
        return
    answer, expected = solve(update.qp(), solver), update.closed_form().a_hat_dot
    assert answer.status.ok
    assert lengths(update, answer.x - expected) <= 1e-5 * (1.0 + lengths(update, free_rate(update)))


# ---- oracles
@given(updates())
def test_what_is_taken_from_the_rate_is_a_push_of_the_sides_that_the_estimate_is_on(update: ParameterUpdate):
    rate = free_rate(update)
    expected = rate - pushed(update, rate, update.a_hat)
    assert lengths(update, update.solve().a_hat_dot - expected) <= 1e-6 * lengths(update, rate)


@given(updates(), st.floats(1e-3, 1e3))
def test_what_is_taken_from_a_step_is_a_push_of_the_sides_that_it_ends_on(update: ParameterUpdate, dt: float):
    aim, after = update.a_hat + dt * free_rate(update), update.step(dt)
    size = max(lengths(update, after), lengths(update, aim))  # last bits of a way that is far
    push = pushed(update, aim - after, after, way=float(np.abs(aim).max()))
    assert lengths(update, aim - after - push) <= 1e-6 * size


@given(st.integers(1, 8), SEEDS)
def test_a_parameter_is_held_by_a_bound_that_it_is_on_whatever_the_other_gains_are(p: int, seed: int):
    """Gains 16 decades apart: one of little gain is long in the metric Γ⁻¹, and what is near beside it is not on it."""
    rng = np.random.default_rng(seed)
    gain, a_hat, rate = 10.0 ** rng.uniform(-8, 8, p), rng.normal(size=p), rng.normal(size=p)
    on = rng.uniform(size=p) < 0.5
    room = np.where(on, 0.0, 10.0 ** rng.uniform(-6, 0, p) * np.abs(a_hat))
    lower = np.where(rate < 0.0, a_hat - room, -np.inf)
    upper = np.where(rate > 0.0, a_hat + room, np.inf)
    expected = np.where(on, 0.0, gain * rate)
    C = np.vstack([np.diag(np.sign(rate)), np.zeros((1, p))])
    d = np.append(np.sign(rate) * (a_hat + np.sign(rate) * room), 0.0)
    box = ParameterUpdate(np.eye(p), rate, gain=gain, a_hat=a_hat, lower=lower, upper=upper)
    rows = ParameterUpdate(np.eye(p), rate, gain=gain, a_hat=a_hat, C=C, d=d)
    known = 1e-7 * lengths(box, expected) + 1e-15 * lengths(box, gain * rate)  # last bits of what is held
    for answer in (box.closed_form(), box.solve(), rows.solve()):
        assert lengths(box, answer.a_hat_dot - expected) <= known


@given(st.integers(1, 10), st.integers(-330, -300), SEEDS)
def test_steps_of_numbers_next_to_zero_are_steps(p: int, exponent: int, seed: int):
    """A chain without mass, driven by what is all but nothing."""
    rng = np.random.default_rng(seed)
    C, d = np.eye(p, k=1) - np.eye(p), np.zeros(p)
    a_hat = np.zeros(p)
    for _ in range(3):
        push = rng.normal(size=p) * 10.0**exponent
        a_hat = ParameterUpdate(np.eye(p), push, gain=10.0 ** rng.uniform(-3, 3, p), a_hat=a_hat, C=C, d=d).step(1.0)
        assert (np.abs(a_hat) <= 1e-290).all()


@given(updates(), st.floats(1e-3, 1e3))
def test_steps_never_leave_the_set(update: ParameterUpdate, dt: float):
    """Property 41: the next estimate is accepted as an estimate, ten times over; a_hat outside the set is an error."""
    for _ in range(10):
        a_hat = update.step(dt)
        assert (a_hat >= update.lower).all() and (a_hat <= update.upper).all()
        if np.abs(a_hat).max() > 1e15:  # further than any estimate is accepted
            return
        update = ParameterUpdate(
            update.Y, update.s, gain=update.gain, a_hat=a_hat, lower=update.lower, upper=update.upper,
            C=update.C, d=update.d,
        )  # fmt: skip


@given(updates())
def test_short_steps_follow_the_rate(update: ParameterUpdate):
    """Short: so that no row and no bound is met that the estimate is not on. A parameter of much gain goes far."""
    answer = update.solve()
    size = lengths(update, answer.a_hat_dot) + lengths(update, free_rate(update))
    if size == 0.0:
        return
    rows = np.vstack([update.C, -np.eye(len(update.a_hat)), np.eye(len(update.a_hat))])
    room = np.concatenate([update.d, -update.lower, update.upper]) - rows @ update.a_hat
    met = (rows @ answer.a_hat_dot > 0.0) & ~np.concatenate(update._on_boundary())
    ends = room[met] / (rows @ answer.a_hat_dot)[met]
    dt = min(1e-6 * (lengths(update, update.a_hat) or 1.0) / size, 0.5 * ends.min(initial=np.inf))
    known = 1e-3 * size + 1e-15 * lengths(update, update.a_hat) / dt  # last bits of the estimate
    assert lengths(update, (update.step(dt) - update.a_hat) / dt - answer.a_hat_dot) <= known


def test_cutting_each_parameter_is_not_the_projection_when_the_gain_couples_them():
    """By hand: Γ = [[2, 1], [1, 2]], rate (−1, −0.5) at a bound of the first: the second keeps −0.5 + 0.5 · 1 = 0."""
    update = ParameterUpdate(np.eye(2), np.linalg.solve([[2.0, 1.0], [1.0, 2.0]], [-1.0, -0.5]),
                             gain=[[2.0, 1.0], [1.0, 2.0]], a_hat=[0.0, 1.0], lower=[0.0, -np.inf])  # fmt: skip
    answer = update.solve()
    np.testing.assert_allclose(answer.a_hat_dot, [0.0, 0.0], atol=1e-12)
    assert answer.active == (0,) and answer.feasible
    with pytest.raises(NoClosedForm, match="not diagonal"):
        update.closed_form()


# ---- what is refused


@pytest.mark.parametrize("out", [0.0, 0.5, 2.0])
def test_a_rate_that_leaves_the_set_is_a_difference_by_how_fast_it_does(out: float):
    """The first estimate is at its upper limit; without limits both would grow at 1."""
    update = ParameterUpdate(np.eye(2), [1.0, 1.0], gain=1.0, a_hat=[0.0, 0.0], upper=[0.0, np.inf])
    right = update.closed_form()
    wrong = replace(right, a_hat_dot=right.a_hat_dot + np.array([out, 0.0]))
    np.testing.assert_allclose(right.a_hat_dot, [0.0, 1.0], atol=1e-12)
    assert update.difference(wrong, right)["set"] == pytest.approx(out / np.sqrt(2.0), abs=1e-12)
