"""Ranked least squares of any rows: the same machinery without a robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from time import perf_counter
from typing import Any

import numpy as np

from wbc import checks
from wbc.arguments import tells_arguments
from wbc.errors import InvalidProblem
from wbc.qp.certificate import Certificate, certificate
from wbc.qp.lexicographic.parts import Part, Stage
from wbc.qp.problem import QP, Row, Shape
from wbc.qp.rows import RowProblem, RowTask
from wbc.qp.solver import Answer, Solution, Solver
from wbc.qp.solvers import by_name
from wbc.types import Index, Mat, Status, Vec

#: Who answers, in a :class:`Solution`.
_CORE = "pdas"


@tells_arguments
def lexicographic(
    levels: Sequence[tuple[Any, Any, Any]], *, lb: Any = None, ub: Any = None, solver: str | Solver = "pdas"
) -> Solution:
    """Minimise the violation of each level in least squares, in order of priority, and last the norm of x.

    With vᵢ(x) the distance of Aᵢ x from [loᵢ, hiᵢ], row by row: ½ ‖v₁‖² first, then ½ ‖v₂‖² among all that keep ‖v₁‖ at
    its minimum, and so on; last ½ ‖x‖². The bounds hold above all levels. x is unique.

    Args:
        levels: (A (m, n), lo (m,), hi (m,)) each, the first wins; lo = hi is an equation, ±inf is no side.
        lb: lower bounds (n,) of x, or −inf.
        ub: upper bounds (n,) of x, or inf.
        solver: a name or a :class:`Solver` that exists. The library's own code solves the levels, whichever is named.

    Returns:
        x, and the multipliers z (rows of all levels,) and z_box (n,) of the last problem, ½ ‖x‖² with every level held:
        x + Aᵀz + z_box = 0. The certificate is of that problem; SOLVED needs that and a certificate of every level.

    Raises:
        InvalidProblem: wrong shapes, NaN, crossed bounds, no level, a level without rows.
        UnknownSolver, SolverMissing: as :func:`wbc.qp.solve`.

    Source: Kanoun, Lamiraux, Wieber, IEEE T-RO 27(4), 2011; Escande, Mansard, Wieber, IJRR 33(7), 2014.

    Example:
        >>> import wbc
        >>> first = ([[1.0, 1.0]], [2.0], [2.0])
        >>> second = ([[1.0, 0.0]], [3.0], [9.0])
        >>> wbc.lexicographic([first, second], lb=[-9, -9], ub=[2.5, 9]).x.round(6)
        array([ 2.5, -0.5])
    """
    named = [_level(i, *parts) for i, parts in enumerate(_parts(levels))]
    if not named:
        raise InvalidProblem("levels is empty; give at least one (A, lo, hi)")
    n = named[0][0].shape[1]
    for i, (A, _, _) in enumerate(named):
        if A.shape[1] != n:
            raise InvalidProblem(f"levels[{i}]: A has {A.shape[1]} columns, that of levels[0] has {n}")
    box = QP(np.eye(n), np.zeros(n), lb=lb, ub=ub)  # refuses bounds that leave nothing
    by_name(solver)  # refuses what does not exist
    return _judged(_solve(named, box.lb, box.ub))


def _judged(answer: Solution) -> Solution:
    """SOLVED exactly with a certificate. Where only bounds are hard there is an answer, and it is never infeasible."""
    if answer.status.ok and not answer.certificate.ok:
        return replace(answer, status=Status.INACCURATE, reason=answer.certificate.fault())
    status = Status.FAILED if answer.status is Status.INFEASIBLE else answer.status
    return answer if status.ok else replace(answer, status=status, reason="a level has no certificate")


def _parts(levels: Any) -> list[tuple[Any, Any, Any]]:
    """The levels as triples, or InvalidProblem."""
    try:
        given = [(level, len(level)) for level in levels]
    except TypeError as cause:
        raise InvalidProblem(f"levels must be a list of (A, lo, hi), not {levels!r}") from cause
    for i, (level, size) in enumerate(given):
        if size != 3 or isinstance(level, str):
            raise InvalidProblem(f"levels[{i}] must be (A, lo, hi), not {level!r}")
    return [tuple(level) for level, _ in given]


def _level(i: int, A: Any, lo: Any, hi: Any) -> tuple[Mat, Vec, Vec]:
    A = checks.array(f"levels[{i}].A", A, (None, None), error=InvalidProblem)
    if not A.size:
        raise InvalidProblem(f"levels[{i}].A has shape {A.shape}; a level has at least one row and one column")
    sides = [
        checks.array(f"levels[{i}].{name}", side, (len(A),), finite=False, error=InvalidProblem)
        for name, side in (("lo", lo), ("hi", hi))
    ]
    QP(np.eye(A.shape[1]), np.zeros(A.shape[1]), C=A, cl=sides[0], cu=sides[1])  # the same rules as for any rows
    return A, sides[0], sides[1]


def _solve(levels: list[tuple[Mat, Vec, Vec]], low: Vec, high: Vec) -> Solution:
    from wbc.qp.lexicographic.solver import LexicographicSolver  # compiled code: loaded where levels are decided

    A, lo, hi = (np.concatenate([level[i] for level in levels]) for i in range(3))
    ends, n = np.cumsum([0] + [len(level[1]) for level in levels]), len(low)
    equal = lo == hi
    # A level may be in any unit: its solutions are the same. Powers of two change no digit.
    _, exponents = np.frexp([np.abs(A).max() for A, _, _ in levels])
    unit = np.repeat(np.ldexp(1.0, exponents), np.diff(ends))
    rows, stages = _row_problem(A / unit[:, None], lo / unit, hi / unit, ends)
    rows.lb[:n], rows.ub[:n] = low, high
    ranked = LexicographicSolver(rows, [*stages, []], budget=4 * len(stages) + 4)
    start = perf_counter()
    status = ranked.solve()
    elapsed = perf_counter() - start
    if not status.ok and status is not Status.INACCURATE:
        none, proof = Answer.none(Shape(n, 0, len(lo)), status), Certificate.none()
        return Solution(status, none.x, none.y, none.z, none.z_box, proof, ranked.iterations, 0.0, elapsed, _CORE)
    x, z = rows.x[:n].copy(), np.zeros(len(lo))
    y, z[~equal], box = ranked.multipliers()
    stop = len(y)
    for first, end in pairwise(ends.tolist()):  # in falling order of rank, equations of a level first
        own = first + np.flatnonzero(equal[first:end])
        stop -= end - first
        z[own] = y[stop : stop + len(own)]
    z /= unit
    at = A @ x
    # What a level above needed stays as it is: it may push either way in the last problem.
    last = ranked.answered
    below, above = last.range_bounds()
    kept = equal | (at < lo) | (at > hi)
    kept[~equal] |= below == above
    near = np.clip(x, low, high)
    fixed = last.lb[:n] == last.ub[:n]
    held = QP(np.eye(n), np.zeros(n), C=A, cl=np.where(kept, at, lo), cu=np.where(kept, at, hi),
              lb=np.where(fixed, near, low), ub=np.where(fixed, near, high))  # fmt: skip
    proof = certificate(held, x, np.zeros(0), z, box[:n]) if status.ok else ranked.certificate
    return Solution(status, x, np.zeros(0), z, box[:n], proof, ranked.iterations, 0.0, elapsed, _CORE)


def _row_problem(A: Mat, lo: Vec, hi: Vec, ends: Index) -> tuple[RowProblem, list[Stage]]:
    """Equations as soft rows, the others as ranges with a slack each: unknowns [x | slacks]."""
    equal, n = lo == hi, A.shape[1]
    n_range = int((~equal).sum())
    names = [Row(f"row {i}") for i in (*np.flatnonzero(~equal), *np.flatnonzero(equal))]
    names += [Row(f"x[{i}]") for i in range(n)] + [Row(f"slack {i}") for i in np.flatnonzero(~equal)]
    p = RowProblem(0, n + n_range, n_range=n_range, n_soft=len(lo) - n_range, n_equal=0, rows=names, regularisation=1.0)
    p.G[p.range, :n], p.G[p.soft, :n], p.G[p.soft, p.n] = A[~equal], A[equal], -lo[equal]
    p.G[p.range, n : p.n] = np.eye(n_range)
    lower, upper = p.range_bounds()
    lower[:], upper[:] = lo[~equal], hi[~equal]
    stages: list[Stage] = []
    row, slack = p.soft.start, n
    for first, last in pairwise(ends.tolist()):
        own = int(equal[first:last].sum())
        give = last - first - own
        name, none = f"level {len(stages) + 1}", np.zeros(last - first)
        rows = RowTask(name, slice(row, row + own), None, np.ones(own), none[:own], none[:own])
        gives = RowTask(name, None, slice(slack, slack + give), np.ones(give), none[:give], none[:give])
        stages.append([Part(task) for task in (rows, gives) if task.dim])
        row, slack = row + own, slack + give
    return p, stages
