"""One solver on one problem: what it says, what is true, and how long it took."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from math import isfinite
from time import perf_counter
from typing import Any

import numpy as np

from wbc.errors import WbcError
from wbc.qp.certificate import Certificate
from wbc.qp.problem import QP
from wbc.qp.solver import Session, Solution, Solver
from wbc.tolerances import DISTANCE
from wbc.types import Vec

#: A cold solve is done twice, the faster counts: the first finds the problem's data in no cache.
COLD_TRIES = 2
#: Unless it took as long as this [s].
LONG = 0.05


def solved(solver: Solver, qps: Sequence[QP], items: Iterable[int], *, warm: bool) -> Iterator[dict[str, Any]]:
    """Solve ``items`` in order, one row each.

    Cold, each problem gets a session of its own, and making it counts. Warm, one session goes through all of them. A
    row has the index, the status, [total, build, solve] in µs, [primal, dual, gap] where dual and gap are relative as
    in a certificate, how far each task can be from its optimum, the violation by unit, the number of active rows,
    how many of them changed, and at what tolerance the back end's own answer is certified, before it is refined.
    """
    session: Session | None = None
    before: Vec | None = None
    for i in items:
        qp = qps[i]
        try:
            if warm:
                session = session if session is not None and session.shape == qp.shape else solver.open(qp.shape)
                answer, total, own = _timed(session, qp)
            else:
                answer, total, own = _cold(solver, qp)
        except WbcError:
            yield {"item": i, "status": "REFUSED"}
            continue
        except Exception as error:  # a back end's own, of any kind: it is the finding
            session = None
            yield {"item": i, "status": f"RAISED {type(error).__name__}"}
            continue
        active = active_set(qp, answer)
        changed = None if before is None or len(before) != len(active) else int((before != active).sum())
        before = active
        yield _row(i, qp, answer, total) | {
            "active": int(active.astype(bool).sum()), "changed": changed, "own": plain(own),
        }  # fmt: skip


def _cold(solver: Solver, qp: QP) -> tuple[Solution, float, float]:
    best: tuple[Solution, float, float] | None = None
    for _ in range(COLD_TRIES):
        start = perf_counter()
        session = solver.open(qp.shape)
        answer = session.solve(qp)
        total = perf_counter() - start
        if best is None or total < best[1]:
            best = answer, total, session.own.level
        if total > LONG:
            break
    assert best is not None
    return best


def _timed(session: Session, qp: QP) -> tuple[Solution, float, float]:
    start = perf_counter()
    answer = session.solve(qp)
    return answer, perf_counter() - start, session.own.level


def _row(i: int, qp: QP, answer: Solution, total: float) -> dict[str, Any]:
    proof = answer.certificate
    times = (total, answer.build_time, answer.solve_time)
    return {
        "item": i,
        "status": answer.status.name,
        "us": [round(1e6 * t, 2) for t in times],
        "kkt": [plain(r) for r in residuals(proof)],
        "bounds": {task: plain(bound) for task, bound in proof.bounds.items()},
        "violation": {unit: plain(worst) for unit, worst in violation(qp, answer.x).items()},
        "iterations": answer.iterations,
    }


def residuals(proof: Certificate) -> tuple[float, float, float]:
    """Primal residual in the row's unit; a hundredth of the distance from the optimum relative to what is asked; the
    larger of stationarity and gap relative to the cost, and the slope that is left where nothing curves the cost. The
    largest of the three is the tolerance at which the certificate holds."""
    return proof.primal, proof.distance / DISTANCE, max(proof.residual, proof.slope)


def active_set(qp: QP, answer: Solution) -> Vec:
    """For each two-sided row and variable: −1, 0 or 1, the side it pushes on, (n_in + n,)."""
    pushing = np.concatenate([answer.z, answer.z_box])
    threshold = 1e-6 * (1.0 + float(np.abs(qp.g).max(initial=0.0)))
    sides: Vec = np.where(np.abs(pushing) > threshold, np.sign(pushing), 0.0)
    return np.nan_to_num(sides)


def violation(qp: QP, x: Vec) -> dict[str, float]:
    """The largest violation of a row or bound, by unit; empty where there is no answer."""
    if not np.isfinite(x).all():
        return {}
    values = np.concatenate([qp.matrix @ x, x])
    lower, upper = qp.sides
    beyond = np.maximum(np.maximum(values - upper, lower - values), 0.0)
    worst: dict[str, float] = {}
    for row, amount in zip(qp.rows, beyond.tolist(), strict=True):
        worst[row.unit] = max(worst.get(row.unit, 0.0), amount)
    return worst


def plain(value: float) -> float | None:
    """Six significant digits; None for what is no number."""
    return float(f"{value:.6g}") if isfinite(value) else None
