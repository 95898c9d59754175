"""Nonnegative least squares, in plain numpy: the implementation in compiled libraries may free memory twice.

Lawson, Hanson: Solving Least Squares Problems, 1974, chapter 23.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import lstsq

from wbc.types import Mat, Vec

#: A gradient below this, of columns of unit length beside a right side of length one, is rounding.
_ROUNDING = 1e-13

_LEAST = float(np.finfo(np.float64).tiny)


def nonnegative(columns: Mat, right: Vec) -> Vec:
    """z ≥ 0 of least |columns z − right|; columns (n, m) of about unit length, right (n,), z (m,).

    Example:
        >>> import numpy as np
        >>> from wbc.qp.nonnegative import nonnegative
        >>> nonnegative(np.array([[1.0, -1.0], [0.0, 1.0]]), np.array([2.0, -1.0]))
        array([2., 0.])
    """
    m = columns.shape[1]
    z, used, barred = np.zeros(m), np.zeros(m, dtype=bool), np.zeros(m, dtype=bool)
    size = float(np.abs(right).max(initial=0.0))
    for _ in range(3 * m + 30):
        pull = columns.T @ (right - columns @ z)
        pull[used | barred] = -np.inf
        enters = int(pull.argmax()) if m else 0
        if not m or not pull[enters] > _ROUNDING * size:
            break
        used[enters] = True
        trial = _least_squares(columns, right, used)
        if trial[enters] <= 0.0:  # it depends on those in use, to rounding
            used[enters], barred[enters] = False, True
            continue
        while (trial[used] <= 0.0).any():
            out = used & (trial <= 0.0)
            ratio = np.full(m, np.inf)
            ratio[out] = z[out] / np.maximum(z[out] - trial[out], _LEAST)  # 0 for one that is zero before and after
            step = float(ratio.min())
            z = np.where(used, z + step * (trial - z), 0.0)
            used &= ~(out & (ratio <= step))
            z[~used] = 0.0
            trial = _least_squares(columns, right, used)
        z, barred = trial, np.zeros(m, dtype=bool)
    return z


def _least_squares(columns: Mat, right: Vec, used: Vec) -> Vec:
    z = np.zeros(columns.shape[1])
    if used.any():
        z[used] = lstsq(columns[:, used], right, cond=1e-13, lapack_driver="gelsy", check_finite=False)[0]
    return z
