"""Random hierarchies, and oracles that share nothing with the solver: a recursion, and a test of optimality."""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

Level = tuple[np.ndarray, np.ndarray, np.ndarray]


def random_hierarchy(seed: int) -> tuple[list[Level], np.ndarray, np.ndarray]:
    """One to four levels of equations, inequalities and repeated rows, most of them in conflict; bounds contain 0.

    One hierarchy in three is of small integers, so that rows meet in corners; rows of zeros, rows that are nearly
    parallel, and columns that no row of a level reads are among the others.
    """
    rng = np.random.default_rng(seed)
    n = int(rng.integers(3, 12))
    levels = []
    for _ in range(rng.integers(1, 5)):
        m = int(rng.integers(1, 6))
        A, wanted = rng.normal(size=(m, n)), 2.0 * rng.normal(size=m)
        if rng.random() < 0.3:
            A[-1] = A[0]
        equal, below, above = rng.random(m) < 0.4, rng.random(m) < 0.3, rng.random(m) < 0.3
        lo = np.where(below & ~above & ~equal, -np.inf, wanted)
        hi = np.where(equal, wanted, np.where(above, np.inf, wanted + rng.random(m)))
        levels.append((A, lo, hi))
    made = np.random.default_rng([seed, 1])
    if made.random() < 1 / 3:
        levels = [(np.round(A), np.round(lo), np.round(hi)) for A, lo, hi in levels]
    for A, _, _ in levels:
        kind = made.integers(12)
        if kind == 0:
            A[made.integers(len(A))] = 0.0
        if kind == 1:
            A[-1] = A[0] + 1e-3 * A[-1]
        if kind == 2:
            A[:, made.random(n) < 0.3] = 0.0
    lb = np.where(rng.random(n) < 0.3, -np.inf, -rng.random(n))
    ub = np.where(rng.random(n) < 0.3, np.inf, rng.random(n))
    return levels, lb, ub


def violation(level: Level, x: np.ndarray) -> np.ndarray:
    """How far each row is beyond its interval."""
    A, lo, hi = level
    at = A @ x
    return at - np.clip(at, lo, hi)


def residuals(levels: list[Level], x: np.ndarray) -> np.ndarray:
    """‖violation‖ of each level."""
    return np.array([np.linalg.norm(violation(level, x)) for level in levels])


def stationarity(levels: list[Level], lb: np.ndarray, ub: np.ndarray, x: np.ndarray) -> np.ndarray:
    """How far x is from optimal at each level, and then in its norm: the length of what is left of the gradient.

    x is best at a level if no direction improves it that keeps all above as good as they are: minus the gradient lies
    in the cone of the normals of what is at a bound, plus the span of what is violated above. Farkas, by non-negative
    least squares.
    """
    n, near = len(x), 1e-7
    span: list[np.ndarray] = []
    cone = [e for e, v, b in zip(np.eye(n), x, ub, strict=True) if v >= b - near]
    cone += [-e for e, v, b in zip(np.eye(n), x, lb, strict=True) if v <= b + near]
    left = []
    for A, lo, hi in [*levels, (np.eye(n), np.zeros(n), np.zeros(n))]:
        gradient = A.T @ violation((A, lo, hi), x)
        size = float(np.linalg.norm(gradient))
        columns = [*span, *(-a for a in span), *cone]
        share = 1.0 if not columns else nnls(np.array(columns).T, -gradient / (size or 1.0), maxiter=10_000)[1]
        left.append(size * share)
        for a, low, high, value in zip(A, lo, hi, A @ x, strict=True):
            if low == high or not low - near <= value <= high + near:
                span.append(a)
            else:
                cone += ([a] if value >= high - near else []) + ([-a] if value <= low + near else [])
    return np.array(left)


def recursion(levels: list[tuple[np.ndarray, np.ndarray]]) -> np.ndarray:
    """x = Σ (A_k N)# (b_k − A_k x), N the projector on the null space of all above: Siciliano and Slotine, 1991."""
    n = levels[0][0].shape[1]
    x, N = np.zeros(n), np.eye(n)
    for A, b in levels:
        largest = np.linalg.norm(A @ N, 2)
        inverse = np.linalg.pinv(A @ N, rcond=min(1.0, 1e-9 / largest if largest else 1.0))
        x = x + inverse @ (b - A @ x)
        N = N - inverse @ (A @ N)
    return x
