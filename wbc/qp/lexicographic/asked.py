"""One stage handed to DAQP, in coordinates where its cost is well conditioned."""

from __future__ import annotations

from typing import NamedTuple

import daqp
import numpy as np

from wbc.qp.solvers.daqp_ import EQUALITY, INFINITY, STATUS
from wbc.types import Mat, Status, Vec


class Wished(NamedTuple):
    """½ Σ rᵢ²/giveᵢ with r = A y + a, A (m, n)."""

    A: Mat
    a: Vec
    give: Vec


class Rows(NamedTuple):
    """Affine rows low <= A y + a <= high, A (m, n), the last ``equal`` of them equations."""

    A: Mat
    a: Vec
    low: Vec
    high: Vec
    equal: int


class Box(NamedTuple):
    """Bounds on y (n,), and ½ ‖(y − centre)/root‖²."""

    low: Vec
    high: Vec
    root: Vec
    centre: Vec


class Answer(NamedTuple):
    """y (n,), multipliers of the rows (m,) and of the bounds on y (n,), positive at an upper side, and iterations."""

    status: Status
    y: Vec
    rows: Vec
    bounds: Vec
    iterations: int


def ask_daqp(wish: Wished, rows: Rows, box: Box) -> Answer:
    """Minimise the wish and the distance within rows and bounds.

    With ỹ = (y − centre)/root the Hessian is the identity and what the wish adds: never singular, and no larger than
    1/give.
    """
    n, m = len(box.root), len(rows.a)
    scaled = wish.A * box.root
    weighed = scaled / wish.give[:, None]
    sense = np.zeros(n + m, np.intc)
    sense[n + m - rows.equal :] = EQUALITY
    at = rows.A @ box.centre + rows.a
    upper = np.minimum(np.concatenate([(box.high - box.centre) / box.root, rows.high - at]), INFINITY)
    lower = np.maximum(np.concatenate([(box.low - box.centre) / box.root, rows.low - at]), -INFINITY)
    g = weighed.T @ (wish.A @ box.centre + wish.a)
    H = np.eye(n) + scaled.T @ weighed
    x, _, flag, info = daqp.solve(H, g, rows.A * box.root, upper, lower, sense, primal_tol=1e-10)
    if flag <= 0:
        return Answer(STATUS.get(flag, Status.FAILED), box.centre, np.zeros(m), np.zeros(n), int(info["iterations"]))
    force = np.array(info["lam"])
    y = box.centre + box.root * x
    return Answer(Status.SOLVED, y, force[n:], force[:n] / box.root, int(info["iterations"]))
