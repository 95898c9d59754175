"""Strategies for hypothesis: states of a robot, boxes, limits, vectors, Jacobians, positive definite matrices.

Numbers are spread over six decades, matrices have condition numbers up to 1e6 by default, and what breaks
code in practice is drawn often: zeros, equal and missing bounds, dependent rows.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from wbc.models.model import RobotModel, RobotState
from wbc.testing.robots import moments
from wbc.types import Mat, Vec

_SEEDS = st.integers(min_value=0, max_value=2**32 - 1)
_BIG, _SMALL = 1e3, 1e-3


def states(model: RobotModel) -> st.SearchStrategy[RobotState]:
    """States of ``model`` inside its joint limits, moving at about 1 rad/s.

    Example:
        >>> from wbc.testing import robots
        >>> from wbc.testing.strategies import states
        >>> states(robots()[0]).example().q.shape  # doctest: +SKIP
        (7,)
    """

    def state(seed: int) -> RobotState:
        result = model.state()
        result.update(*moments(model, count=1, seed=seed)[0])
        return result

    return _SEEDS.map(state)


@st.composite
def boxes(draw: Any, n: int, *, size: float = 10.0) -> tuple[Vec, Vec]:
    """Bounds lower <= upper (n,): some equal, some infinite."""
    numbers = st.floats(-size, size, allow_nan=False)
    lower = draw(arrays(np.float64, n, elements=numbers))
    width = draw(arrays(np.float64, n, elements=st.one_of(st.just(0.0), st.floats(0.0, size))))
    open_below, open_above = (draw(arrays(np.bool_, n)) for _ in range(2))
    return np.where(open_below, -np.inf, lower), np.where(open_above, np.inf, lower + width)


@st.composite
def spd(draw: Any, n: int, *, condition: float = 1e6) -> Mat:
    """Symmetric positive definite matrices (n, n), eigenvalues between 1 / condition and 1."""
    rng = np.random.default_rng(draw(_SEEDS))
    directions, _ = np.linalg.qr(rng.normal(size=(n, n)))
    values = condition ** -rng.uniform(size=n)
    matrix: Mat = (directions * values) @ directions.T
    return 0.5 * (matrix + matrix.T)


def magnitudes(low: float = _SMALL, high: float = _BIG) -> st.SearchStrategy[float]:
    """Positive numbers, every decade between ``low`` and ``high`` as likely as the next.

    Example:
        >>> from wbc.testing.strategies import magnitudes
        >>> 1e-3 <= magnitudes().example() <= 1e3  # doctest: +SKIP
        True
    """
    return st.floats(np.log10(low), np.log10(high)).map(lambda power: float(np.clip(10.0**power, low, high)))


def numbers(low: float = _SMALL, high: float = _BIG) -> st.SearchStrategy[float]:
    """Zero, or a number of either sign with a magnitude between ``low`` and ``high``."""
    size = magnitudes(low, high)
    return st.one_of(size, size.map(lambda value: -value), st.just(0.0))


def vectors(n: int, *, low: float = _SMALL, high: float = _BIG) -> st.SearchStrategy[Vec]:
    """Vectors (n,) of :func:`numbers`."""
    return st.lists(numbers(low, high), min_size=n, max_size=n).map(lambda entries: np.array(entries, dtype=np.float64))


@st.composite
def limits(draw: Any, n: int, *, low: float = _SMALL, high: float = _BIG) -> tuple[Vec, Vec]:
    """Limits lower <= 0 <= upper (n,), not symmetric: some infinite, some zero, some joints locked (both zero)."""
    rare = st.sampled_from([0.0, np.inf])
    side = st.integers(0, 15).flatmap(lambda kind: rare if kind == 7 else magnitudes(low, high))
    below, above = (np.array(draw(st.lists(side, min_size=n, max_size=n))) for _ in range(2))
    return 0.0 - below, above


@st.composite
def jacobians(
    draw: Any, m: int, n: int, *, deficient: bool | None = None, condition: float = 1e6, low: float = _SMALL
) -> Mat:
    """Matrices (m, n), their largest singular value between ``low`` and 1 / ``low``.

    ``deficient`` says whether the rank is below min(m, n); ``None``: one matrix in four. The condition number of what
    is not zero is at most ``condition``. A deficient matrix with one row or one column is zero.
    """
    rank = min(m, n)
    rng = np.random.default_rng(draw(_SEEDS))
    size, spread = draw(magnitudes(low, 1.0 / low)), draw(magnitudes(1.0, condition))
    short = draw(st.sampled_from([False, False, False, True])) if deficient is None else deficient
    left, right = (np.linalg.qr(rng.normal(size=(k, k)))[0][:, :rank] for k in (m, n))
    values = size * np.sort(spread ** -rng.uniform(size=rank))[::-1]
    values[:1] = size
    if rank and short:
        values[draw(st.integers(0, rank - 1)) :] = 0.0
    matrix: Mat = (left * values) @ right.T
    return matrix
