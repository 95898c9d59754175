"""Excitation: whether a motion shows all parameters."""

from __future__ import annotations

from typing import final

import numpy as np

from wbc.types import Mat

from .adaptive_law import InertialLaw

#: Eigenvalues are computed once in so many ticks.
EVERY = 20


@final
class Excitation:
    """The mean of YᵀY over about ``window`` seconds, of the independent columns that are adapted, and its smallest
    eigenvalue [N² m² per unit²]: persistent excitation means that it stays above zero."""

    def __init__(self, law: InertialLaw, window: float) -> None:
        self._columns, self._window = law.independent, window
        self.reset()

    def reset(self) -> None:
        """Nothing has been seen."""
        size = len(self._columns)
        self._mean, self._ticks, self.smallest = np.zeros((size, size)), 0, 0.0

    def add(self, Y: Mat, dt: float) -> None:
        """One tick more."""
        seen = Y[:, self._columns]
        self._mean += (dt / self._window) * (seen.T @ seen - self._mean)
        if self._ticks % EVERY == 0:
            self.smallest = max(float(np.linalg.eigvalsh(self._mean)[0]), 0.0)
        self._ticks += 1
