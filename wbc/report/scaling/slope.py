"""How fast a time grows with a size: the exponent of a power law, and how sure it is."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from wbc.types import Vec


class Slope(NamedTuple):
    """The exponent p of y ≈ c xᵖ, and half of its 95 % interval."""

    exponent: float
    half: float

    def __str__(self) -> str:
        places = 1 if self.half >= 0.1 else 2
        return f"{round(self.exponent, places) + 0.0:.{places}f} ± {max(self.half, 0.1**places):.{places}f}"


def slope(x: Vec, y: Vec) -> Slope | None:
    """The exponent p of y ≈ c xᵖ by least squares on logarithms, with Student's interval; None below three points.

    Example:
        >>> import numpy as np
        >>> from wbc.report.scaling.slope import slope
        >>> print(slope(np.array([1.0, 2.0, 4.0, 8.0]), np.array([3.0, 13.0, 46.0, 192.0])))
        2.0 ± 0.2
    """
    from scipy.stats import t

    good = np.isfinite(x) & np.isfinite(y) & (x > 0) & (y > 0)
    if good.sum() < 3:
        return None
    u, w = np.log(x[good]), np.log(y[good])
    u, w = u - u.mean(), w - w.mean()
    p = u.dot(w) / u.dot(u)  # scipy's linregress has no interval where all times are the same
    error = np.sqrt(np.sum((w - p * u) ** 2) / (len(u) - 2) / u.dot(u))
    return Slope(float(p), float(error * t.ppf(0.975, len(u) - 2)))
