"""One stage handed to DAQP, in coordinates where its cost is well conditioned."""

from __future__ import annotations

from typing import NamedTuple

import daqp
import numpy as np

from wbc.qp.solvers.daqp_ import EQUALITY, INFINITY, STATUS
from wbc.types import Mat, Status, Vec


class Rows(NamedTuple):
    """Affine rows low <= A y + a <= high as A (m, n), a (m,), low and high (m,)."""

    A: Mat
    a: Vec
    low: Vec
    high: Vec


class Answer(NamedTuple):
    """y (n,), multipliers of the rows (m,) and of the bounds on y (n,), positive at an upper side, and iterations."""

    status: Status
    y: Vec
    rows: Vec
    bounds: Vec
    iterations: int


def ask_daqp(wish: Rows, give: Vec, rows: Rows, n_laws: int, low: Vec, high: Vec, root: Vec, centre: Vec) -> Answer:
    """minimise ½ ‖(y − centre)/root‖² + ½ Σ rᵢ²/giveᵢ, r the rows of ``wish``, subject to ``rows`` and bounds.

    The last ``n_laws`` of the rows are equations. With ỹ = (y − centre)/root the Hessian is the identity and what the
    wish adds: never singular, and no larger than 1/give.
    """
    n, m = len(root), len(rows.a)
    scaled = wish.A * root
    weighed = scaled / give[:, None]
    sense = np.zeros(n + m, np.intc)
    sense[n + m - n_laws :] = EQUALITY
    at = rows.A @ centre + rows.a
    upper = np.minimum(np.concatenate([(high - centre) / root, rows.high - at]), INFINITY)
    lower = np.maximum(np.concatenate([(low - centre) / root, rows.low - at]), -INFINITY)
    g = weighed.T @ (wish.A @ centre + wish.a)
    x, _, flag, info = daqp.solve(
        np.eye(n) + scaled.T @ weighed, g, rows.A * root, upper, lower, sense, primal_tol=1e-10
    )
    if flag <= 0:
        return Answer(STATUS.get(flag, Status.FAILED), centre, np.zeros(m), np.zeros(n), int(info["iterations"]))
    force = np.array(info["lam"])
    return Answer(Status.SOLVED, centre + root * x, force[n:], force[:n] / root, int(info["iterations"]))
