"""Random problems of the methods, drawn with the strategies that users have."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from wbc.errors import InvalidInput, SolverFailed
from wbc.methods import ForceDistribution, NullSpaceSaturation, ProjectedGradientStep
from wbc.methods.method import Method
from wbc.qp.solvers import usable
from wbc.testing import CheckFailed, check_method
from wbc.testing.strategies import jacobians, limits, magnitudes, spd, vectors

#: How far along its own direction a velocity is: zero, inside, at a limit, beyond.
PARTS = st.sampled_from([0.0, 0.1, 0.5, 0.9, 1.0, 1.0, 1.7, 1.7])


def drawn(least: int) -> int:
    """How many problems a share is counted over: as many as the profile asks of every property, and not fewer."""
    return max(least, settings().max_examples)


def check_on_every_solver(methods: st.SearchStrategy[Method]) -> None:
    """check_method on draws, of which OSQP may give up one in fifty.

    Where multipliers are a hundred times the answer and more, its steps shrink and 20,000 of them do not get near. It
    then says so; it may not be wrong.
    """
    told: Counter[str] = Counter()

    @given(methods)
    def look(method: Method) -> None:
        told["drawn"] += 1
        try:
            check_method(method)
        except CheckFailed as failed:
            if not isinstance(failed.__cause__, SolverFailed) or failed.__cause__.name != "osqp":
                raise
            told["given up"] += 1
            check_method(method, [name for name in usable() if name != "osqp"])

    look()
    assert told["given up"] <= max(1, told["drawn"] // 50), told


def reach(v: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> float:
    """The largest multiple of v that is inside; 1 where nothing ends it."""
    ahead = np.where(v > 0.0, upper, -lower)
    moving = np.abs(v) > 1e-9 * np.abs(v).max(initial=0.0)
    multiple = float((ahead[moving] / np.abs(v[moving])).min(initial=np.inf))
    return multiple if np.isfinite(multiple) else 1.0


def bounded(made: Callable[..., ProjectedGradientStep]) -> ProjectedGradientStep:
    """The step without ``alpha_max``; with one where no limit would end it."""
    try:
        return made()
    except InvalidInput:
        return made(alpha_max=1e3)


@st.composite
def steps(draw: Any, *, deficient: bool | None = None, part: st.SearchStrategy[float] = PARTS) -> ProjectedGradientStep:
    """Steps of 1 to 10 joints with a task that uses ``part`` of what the limits leave it."""
    n = draw(st.integers(1, 10))
    m = draw(st.integers(0, n) if deficient is None else st.integers(1, n))
    J = draw(jacobians(m, n, deficient=deficient))
    v_min, v_max = draw(limits(n))
    v = np.linalg.pinv(J, rcond=1e-12) @ (J @ draw(vectors(n)))
    v *= draw(part) * reach(v, v_min, v_max)
    gradient = J.T @ draw(vectors(m)) if draw(st.integers(0, 7)) == 3 else draw(vectors(n))
    made = partial(ProjectedGradientStep.from_gradient, J, J @ v, gradient, v_min=v_min, v_max=v_max)
    largest = st.one_of(st.just(1e3), magnitudes(), st.just(0.0))
    return made(alpha_max=draw(largest)) if draw(st.booleans()) else bounded(made)


@st.composite
def bare_steps(draw: Any) -> ProjectedGradientStep:
    """Steps given as two velocities; v_task anywhere in the box, on its sides, or beyond some of them."""
    n = draw(st.integers(1, 10))
    v_min, v_max = draw(limits(n))
    low, high = np.maximum(v_min, -1e3), np.minimum(v_max, 1e3)
    where = np.array(draw(st.lists(st.sampled_from([0.0, 0.3, 0.5, 0.9, 1.0]), min_size=n, max_size=n)))
    v = low + where * (high - low)
    v *= draw(st.sampled_from([1.0, 1.3, 1.0, 1.3]))
    v_null = np.zeros(n) if draw(st.integers(0, 7)) == 3 else draw(vectors(n))
    made = partial(ProjectedGradientStep, v, v_null, v_min=v_min, v_max=v_max)
    return made(alpha_max=draw(st.one_of(st.just(1e3), magnitudes()))) if draw(st.booleans()) else bounded(made)


@st.composite
def scaled_tasks(
    draw: Any, *, drift: bool | None = None, deficient: bool | None = None, n: int | None = None
) -> NullSpaceSaturation:
    """Tasks of 1 to 10 joints that go from well inside the limits to far beyond; with a drift every other time."""
    n = draw(st.integers(1, 10)) if n is None else n
    J = draw(jacobians(draw(st.integers(1, n)), n, deficient=deficient))
    lower, upper = draw(limits(n))
    x = np.linalg.pinv(J, rcond=1e-12) @ (J @ draw(vectors(n)))
    x *= reach(x, lower, upper) * draw(st.sampled_from([0.5, 1.0, 1.5, 3.0, 10.0, 100.0]))
    offset = np.zeros(len(J))
    if drift if drift is not None else draw(st.booleans()):
        start = np.clip(draw(vectors(n)), np.maximum(lower, -1e3), np.minimum(upper, 1e3))
        offset = -J @ start * draw(st.sampled_from([0.1, 1.0, 10.0, 100.0]))
    return NullSpaceSaturation(J, J @ x, lower=lower, upper=upper, drift=offset)


@st.composite
def distributions(draw: Any, *, limited: bool | None = None) -> ForceDistribution:
    """One to four point contacts, with or without friction and limits."""
    contacts = draw(st.integers(1, 4))
    nf = 3 * contacts
    m = draw(st.integers(1, 6))
    G = draw(jacobians(m, nf))
    weight = draw(spd(nf)) if draw(st.booleans()) else draw(magnitudes())
    if not (draw(st.sampled_from([True, True, True, False])) if limited is None else limited):
        wrench = G @ draw(vectors(nf)) if draw(st.integers(0, 4)) else draw(vectors(m))
        return ForceDistribution(G, wrench, weight=weight)
    mu = draw(st.floats(0.2, 1.0))
    normal = np.array(draw(st.lists(st.floats(1.0, 100.0), min_size=contacts, max_size=contacts)))
    slopes = np.array(draw(st.lists(st.floats(-1.0, 1.0), min_size=2 * contacts, max_size=2 * contacts)))
    tangential = mu * normal[:, None] * slopes.reshape(contacts, 2)
    f = np.column_stack([tangential, normal]).ravel() * draw(st.sampled_from([1.0, 1.0, -1.0, -1.0, 3.0]))
    return ForceDistribution(G, G @ f, weight=weight, friction=mu, f_min=-150.0, f_max=150.0)


def integer_task(rng: np.random.Generator) -> NullSpaceSaturation:
    """What rounding and users draw: integers, ties, joints that are locked, without limits or on a limit at the start,
    columns of zeros, columns and rows that repeat or depend on each other, targets out of reach, rows of other units.
    """
    n = int(rng.integers(1, 9))
    m = int(rng.integers(1, min(n, 6) + 1))
    kind, most = int(rng.integers(6)), int(rng.integers(1, 3))
    J = rng.integers(-most, most + 1, size=(m, n)).astype(float)
    if kind == 0:
        J[:, rng.integers(n)] = J[:, rng.integers(n)]
    if kind == 1:
        J[:, rng.integers(n)] = 0.0
    if kind == 2 and m > 1:
        J[rng.integers(m)] = J[rng.integers(m)] * rng.integers(-1, 3)
    if kind == 3 and m > 2:
        J[0] = J[1] - J[2]
    sides = [np.where(rng.random(n) < 0.15, np.inf, rng.integers(0, 4, size=n).astype(float)) for _ in range(2)]
    lower, upper = (np.zeros(n) if rng.random() < 0.7 else rng.integers(-2, 3, size=n).astype(float)) + [
        -sides[0], sides[1]]  # fmt: skip
    if rng.random() < 0.2:
        i = rng.integers(n)
        upper[i] = lower[i] if np.isfinite(lower[i]) else upper[i]
    target = J @ rng.integers(-3, 4, size=n) * rng.choice([1, 1, 2, 5])
    if rng.random() < 0.08:
        target = rng.integers(-3, 4, size=m).astype(float)
    low = np.where(np.isfinite(lower), lower, np.minimum(-2.0, upper))
    high = np.where(np.isfinite(upper), upper, np.maximum(2.0, lower))
    start = np.choose(rng.integers(0, 3, size=n), [low, high, np.floor((low + high) / 2)])
    drift = -(J @ start) * rng.choice([0, 0, 0, 1, 1, 1, 2])
    unit = 10.0 ** rng.integers(-4, 5, size=m) if rng.random() < 0.3 else np.ones(m)
    return NullSpaceSaturation(unit[:, None] * J, unit * target, lower=lower, upper=upper, drift=unit * drift)


def integer_step(rng: np.random.Generator) -> ProjectedGradientStep:
    """The same for steps along a projected gradient, at stationary points and with the default ``alpha_max`` too."""
    task = integer_task(rng)
    J = task.J
    gradient = rng.integers(-2, 3, size=J.shape[1]).astype(float)
    if rng.random() < 0.2:
        gradient = J.T @ rng.integers(-2, 3, size=len(J))
    made = partial(
        ProjectedGradientStep.from_gradient, J, task.target * rng.choice([0.0, 0.2, 1.0]), gradient,
        v_min=np.minimum(task.lower, 0.0), v_max=np.maximum(task.upper, 0.0),
    )  # fmt: skip
    return made(alpha_max=float(rng.integers(0, 4))) if rng.random() < 0.3 else bounded(made)
