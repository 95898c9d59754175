"""Strategies for hypothesis: states of a robot, boxes, symmetric positive definite matrices."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from wbc.models.model import RobotModel, RobotState
from wbc.testing.robots import moments
from wbc.types import Mat, Vec

_SEEDS = st.integers(min_value=0, max_value=2**32 - 1)


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
def spd(draw: Any, n: int, *, condition: float = 1e3) -> Mat:
    """Symmetric positive definite matrices (n, n), eigenvalues between 1 / condition and 1."""
    rng = np.random.default_rng(draw(_SEEDS))
    directions, _ = np.linalg.qr(rng.normal(size=(n, n)))
    values = condition ** -rng.uniform(size=n)
    matrix: Mat = (directions * values) @ directions.T
    return 0.5 * (matrix + matrix.T)
