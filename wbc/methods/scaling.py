"""A task with a scale as independent equations, whatever rank and units its rows have."""

from __future__ import annotations

from typing import final

import numpy as np

from wbc.methods.shared import factors
from wbc.tolerances import ROUNDING, SAME
from wbc.types import Mat, Vec


@final
class ScaledTask:
    """J x + drift = s · target with independent rows: V x + drift = σ · direction, σ in [low, high].

    V (r, n) has orthonormal rows, ``direction`` unit length, and σ = ``full`` means s = 1: it is the length of the
    shortest x that does the whole task. ``drift`` is (r,) here. What J cannot reach allows one scale or none
    (low > high). Rows count alike, whatever their units: each is divided by its length, and a row that is short beside
    the longest by more than rounding is a row of zeros. ``condition`` is that of the rows of unit length.
    """

    def __init__(self, J: Mat, target: Vec, drift: Vec) -> None:
        length = np.linalg.norm(J, axis=1)
        longest = float(length.max(initial=0.0))
        length = np.where(length > ROUNDING * longest, length, longest or 1.0)
        target, drift = target / length, drift / length
        found = factors(J / length[:, None])
        self.V, self.condition = found.V, found.condition
        self.drift = found.solve(drift)
        reachable = np.linalg.norm(found.U.T @ target) > SAME * np.linalg.norm(target)
        way = found.solve(target) if reachable else np.zeros(len(found.values))
        self.full = float(np.linalg.norm(way)) or 1.0
        self.direction: Vec = way / self.full
        missing, off = found.rest.T @ target, found.rest.T @ drift
        missing[np.abs(missing) <= SAME * np.linalg.norm(target)] = 0.0
        off[np.abs(off) <= SAME * np.linalg.norm(drift)] = 0.0
        low, high = 0.0, 1.0
        if missing.any() or off.any():
            low = high = float(missing @ off / (missing @ missing)) if missing.any() else np.nan
            reached = np.linalg.norm(high * missing - off) <= SAME * np.linalg.norm(drift)
            low, high = (low, high) if reached and 0.0 <= low <= 1.0 else (1.0, 0.0)
        self.low, self.high = self.full * low, self.full * high

    @property
    def possible(self) -> bool:
        """Whether some scale is left by what J cannot reach."""
        return self.low <= self.high

    def scale(self, size: float) -> float:
        """s of this σ, in [0, 1] whatever rounding does."""
        return min(1.0, max(0.0, size / self.full))
