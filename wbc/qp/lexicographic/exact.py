"""Least squares within inequalities by a primal active set: slow, and exact however flat the cost is."""

from __future__ import annotations

import numpy as np

from wbc.types import Mat, Vec

#: Multipliers and steps below this share of what they are made of are rounding.
_ROUNDING = 1e-12
#: Directions in which the cost is so much flatter than in the steepest count as flat.
_FLAT = 1e-10
#: Changes of the active set for each row.
_MOST = 10


def least_squares_within(W: Mat, a: Vec, A: Mat, low: Vec, high: Vec) -> tuple[Vec, Vec]:
    """minimise ½ ‖W z + a‖² subject to low <= A z <= high, from z = 0, which must be feasible: z and the multipliers.

    W (m, d), A (r, d). In each step the least squares with the active rows held, as far as the others allow; the row
    that stops it is held from then on. Where nothing stops it, the row that pulls most is let go.
    Source: Nocedal, Wright, Numerical Optimization, 16.5.
    """
    d, r = W.shape[1], len(A)
    z, value = np.zeros(d), np.zeros(r)
    length = np.linalg.norm(A, axis=1)
    A = A / np.where(length > 0.0, length, 1.0)[:, None]
    low, high = low / np.where(length > 0.0, length, 1.0), high / np.where(length > 0.0, length, 1.0)
    free = length > 1e-12 * max(1.0, float(length.max(initial=0.0)))
    side, forces = np.zeros(r), np.zeros(r)
    steepest = float(np.linalg.norm(W))
    size = steepest * float(np.linalg.norm(a))
    for _ in range(_MOST * (r + 1)):
        held = np.flatnonzero(side)
        N = _null_space(A[held])
        step = N @ _shortest(W @ N, -(W @ z + a), _FLAT * steepest)
        ahead = A @ step
        if N.shape[1]:
            with np.errstate(divide="ignore", invalid="ignore"):
                room = np.where(ahead > 0.0, (high - value) / ahead, (low - value) / ahead)
            room[(side != 0.0) | ~free | (np.abs(ahead) <= 1e-3 * _ROUNDING * float(np.abs(step).max()))] = np.inf
            first = int(room.argmin()) if r else -1
            far = max(0.0, float(room[first])) if r else np.inf
            z = z + min(1.0, far) * step
            value = A @ z
            if far < 1.0:
                side[first] = np.sign(ahead[first])
                continue
        gradient = W.T @ (W @ z + a)
        force = np.linalg.lstsq(A[held].T, -gradient, rcond=1e-12)[0] if len(held) else np.zeros(0)
        wrong = -force * side[held]
        if not len(held) or wrong.max() <= _ROUNDING * size:
            forces[held] = force / length[held]
            return z, forces
        side[held[int(wrong.argmax())]] = 0.0
    return z, forces


def _shortest(W: Mat, b: Vec, flat: float) -> Vec:
    """The shortest x of least ‖W x − b‖, without the directions that matter less than ``flat``."""
    U, values, V = np.linalg.svd(W, full_matrices=False)
    some = values > flat
    shortest: Vec = V[some].T @ ((b @ U[:, some]) / values[some])
    return shortest


def _null_space(rows: Mat) -> Mat:
    """An orthonormal basis (d, ·) of what is orthogonal to the rows (·, d)."""
    d = rows.shape[1]
    if not len(rows):
        return np.eye(d)
    _, values, turned = np.linalg.svd(rows)
    return np.asarray(turned[int((values > 1e-11).sum()) :].T, dtype=np.float64)
