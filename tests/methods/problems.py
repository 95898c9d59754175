"""Random problems of the methods, drawn with the strategies that users have."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import settings
from hypothesis import strategies as st

from wbc.methods import ForceDistribution, NullSpaceSaturation, ProjectedGradientStep
from wbc.testing.strategies import jacobians, limits, magnitudes, spd, vectors

#: How far along its own direction a velocity is: zero, inside, at a limit, beyond.
PARTS = st.sampled_from([0.0, 0.1, 0.5, 0.9, 1.0, 1.0, 1.7, 1.7])


def drawn(least: int) -> int:
    """How many problems a share is counted over: as many as the profile asks of every property, and not fewer."""
    return max(least, settings().max_examples)


def reach(v: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> float:
    """The largest multiple of v that is inside; 1 where nothing ends it."""
    ahead = np.where(v > 0.0, upper, -lower)
    moving = np.abs(v) > 1e-9 * np.abs(v).max(initial=0.0)
    multiple = float((ahead[moving] / np.abs(v[moving])).min(initial=np.inf))
    return multiple if np.isfinite(multiple) else 1.0


@st.composite
def steps(draw: Any, *, deficient: bool | None = None, part: st.SearchStrategy[float] = PARTS) -> ProjectedGradientStep:
    """Steps of 1 to 10 joints with a task that uses ``part`` of what the limits leave it."""
    n = draw(st.integers(1, 10))
    m = draw(st.integers(0, n) if deficient is None else st.integers(1, n))
    J = draw(jacobians(m, n, deficient=deficient))
    v_min, v_max = draw(limits(n))
    v = np.linalg.pinv(J, rcond=1e-12) @ (J @ draw(vectors(n)))
    v *= draw(part) * reach(v, v_min, v_max)
    alpha_max = draw(st.one_of(st.just(1e3), magnitudes(), st.just(0.0)))
    return ProjectedGradientStep.from_gradient(
        J, J @ v, draw(vectors(n)), v_min=v_min, v_max=v_max, alpha_max=alpha_max
    )


@st.composite
def bare_steps(draw: Any) -> ProjectedGradientStep:
    """Steps given as two velocities; v_task anywhere in the box, on its sides, or beyond some of them."""
    n = draw(st.integers(1, 10))
    v_min, v_max = draw(limits(n))
    low, high = np.maximum(v_min, -1e3), np.minimum(v_max, 1e3)
    where = np.array(draw(st.lists(st.sampled_from([0.0, 0.3, 0.5, 0.9, 1.0]), min_size=n, max_size=n)))
    v = low + where * (high - low)
    v *= draw(st.sampled_from([1.0, 1.0, 1.0, 1.3]))
    alpha_max = draw(st.one_of(st.just(1e3), magnitudes()))
    return ProjectedGradientStep(v, draw(vectors(n)), v_min=v_min, v_max=v_max, alpha_max=alpha_max)


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
