"""Rows that contradict each other whatever the state: found when a stack is compiled, not in the first tick."""

from __future__ import annotations

import numpy as np

from wbc.errors import Infeasible
from wbc.models.model import RobotState
from wbc.qp.conflict import conflict
from wbc.qp.problem import QP
from wbc.stack.plan import Plan


def refuse_contradictions(plan: Plan, state: RobotState) -> None:
    """Look for a conflict among the rows that are the same in this state and another; both are as before afterwards.

    A force that friction cannot give, a joint speed above its limit: what depends on no state is told while building.

    Raises:
        Infeasible: with the rows, and how much each must give.
    """
    t, q, v = state.t, state.q.copy(), state.v.copy()
    step = 0.1 * np.sin(1.0 + np.arange(len(v)))  # any other state, the same one each time
    # The time of the second tick: a target need not be defined any later.
    state.update(t + plan.dt, plan.model.integrate(q, step), step[::-1])
    plan.fill(state)
    other = plan.qp.copy()
    state.update(t, q, v)
    plan.fill(state)
    qp = _same(plan.qp, other)
    found = None if qp is None else conflict(qp)
    if found is not None:
        raise Infeasible(f"these constraints cannot hold together in any state: {found}", conflict=found, qp=qp)


def _same(qp: QP, other: QP) -> QP | None:
    """The rows and bounds that both have, None where no conflict can be among them or they are no problem."""
    rows = (qp.matrix == other.matrix).all(axis=1) & (qp.lower == other.lower) & (qp.upper == other.upper)
    bounds = (qp.lb == other.lb) & (qp.ub == other.ub)
    if not (rows.any() or (qp.lb > qp.ub)[bounds].any()):
        return None
    sound = np.isfinite(qp.matrix[rows]).all() and not np.isnan(np.concatenate([qp.lower[rows], qp.upper[rows]])).any()
    if not sound:
        return None
    equal, free = rows[: qp.n_eq], rows[qp.n_eq :]
    names = [row for row, kept in zip(qp.rows, [*rows, *np.ones(qp.n, bool)], strict=True) if kept]
    return QP(
        np.eye(qp.n), np.zeros(qp.n), A=qp.A[equal], b=qp.b[equal], C=qp.C[free], cl=qp.cl[free], cu=qp.cu[free],
        lb=np.where(bounds, qp.lb, -np.inf), ub=np.where(bounds, qp.ub, np.inf), rows=names,
    )  # fmt: skip
