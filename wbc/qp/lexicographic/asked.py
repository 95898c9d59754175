"""One stage handed to a solver, in coordinates where its cost is well conditioned, for the rows that are active."""

from __future__ import annotations

from typing import NamedTuple, final

import daqp
import numpy as np

from wbc.errors import InvalidProblem
from wbc.qp.problem import QP, Shape
from wbc.qp.solver import Session, Solver
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
    """y (n,), multipliers of the rows (m,) and of the bounds on y (n,), positive at an upper side, and iterations.

    A multiplier that is smaller than the distance to the bound that it pushes on is zero here.
    """

    status: Status
    y: Vec
    rows: Vec
    bounds: Vec
    iterations: int


class Posed(NamedTuple):
    """½ ỹᵀ H ỹ + gᵀ ỹ within low <= matrix ỹ <= high, the last ``equal`` of them equations, and lb <= ỹ <= ub."""

    H: Mat
    g: Vec
    matrix: Mat
    low: Vec
    high: Vec
    lb: Vec
    ub: Vec
    equal: int


@final
class Finder:
    """Asks a solver for the minimum of a stage. ``solver`` None: DAQP, without a session."""

    def __init__(self, solver: Solver | None) -> None:
        self._solver = solver
        self._sessions: dict[Shape, Session] = {}

    def reset(self) -> None:
        """Forget all warm starts."""
        self._sessions.clear()

    def ask(self, wish: Wished, rows: Rows, box: Box) -> Answer:
        """Minimise the wish and the distance within rows and bounds.

        With ỹ = (y − centre)/root the Hessian is the identity and what the wish adds: never singular, and no larger
        than 1/give.
        """
        n, m = len(box.root), len(rows.a)
        scaled = wish.A * box.root
        weighed = scaled / wish.give[:, None]
        at = rows.A @ box.centre + rows.a
        low, high = rows.low - at, rows.high - at
        lb, ub = (box.low - box.centre) / box.root, (box.high - box.centre) / box.root
        g = weighed.T @ (wish.A @ box.centre + wish.a)
        posed = Posed(np.eye(n) + scaled.T @ weighed, g, rows.A * box.root, low, high, lb, ub, rows.equal)
        if not n:
            return Answer(Status.SOLVED, box.centre, np.zeros(m), np.zeros(n), 0)
        status, x, force, iterations = _daqp(posed) if self._solver is None else self._other(posed, self._solver)
        if not status.ok:
            return Answer(status, box.centre, np.zeros(m), np.zeros(n), iterations)
        value = np.concatenate([x, posed.matrix @ x])
        room = np.where(force > 0.0, np.append(ub, high) - value, value - np.append(lb, low))
        force = np.where(np.abs(force) > np.maximum(room, 0.0), force, 0.0)
        return Answer(Status.SOLVED, box.centre + box.root * x, force[n:], force[:n] / box.root, iterations)

    def _other(self, posed: Posed, solver: Solver) -> tuple[Status, Vec, Vec, int]:
        n, m, equal = len(posed.g), len(posed.matrix), posed.equal
        shape = Shape(n, equal, m - equal)
        if shape not in self._sessions:
            self._sessions[shape] = solver.open(shape)
        qp = QP.empty(shape)
        order = np.concatenate([np.arange(m - equal, m), np.arange(m - equal)])
        qp.H[:], qp.g[:], qp.matrix[:] = 0.5 * (posed.H + posed.H.T), posed.g, posed.matrix[order]
        qp.lower[:], qp.upper[:] = posed.low[order], posed.high[order]
        qp.lower[:equal] = qp.upper[:equal]
        qp.lb[:], qp.ub[:] = posed.lb, posed.ub
        try:
            found = self._sessions[shape].solve(qp)
        except InvalidProblem:
            return Status.FAILED, posed.g, posed.g, 0
        if not np.isfinite(found.x).all():
            return found.status, found.x, found.x, found.iterations
        # An answer that is not certified may still name the right rows: whoever asked verifies them.
        return Status.SOLVED, found.x, np.concatenate([found.z_box, found.z, found.y]), found.iterations


def _daqp(posed: Posed) -> tuple[Status, Vec, Vec, int]:
    n, size, equal = len(posed.g), len(posed.g) + len(posed.matrix), posed.equal
    sense = np.zeros(size, np.intc)
    sense[size - equal :] = EQUALITY
    upper = np.minimum(np.append(posed.ub, posed.high), INFINITY)
    lower = np.maximum(np.append(posed.lb, posed.low), -INFINITY)
    x, _, flag, info = daqp.solve(posed.H, posed.g, posed.matrix, upper, lower, sense, primal_tol=1e-10)
    status = Status.SOLVED if flag > 0 else STATUS.get(flag, Status.FAILED)
    return status, np.array(x)[:n], np.array(info["lam"]), int(info["iterations"])
