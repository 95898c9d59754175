"""Relaxation: the QP in which some rows have slacks, as small as can be."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from wbc.qp.problem import QP, Row


def relaxed(qp: QP, items: Iterable[int], *, share: float) -> QP:
    """minimise ½ ‖s‖² + share (½ xᵀHx + gᵀx)  subject to  lower ≤ r x − s ≤ upper for the rows and bounds ``items``.

    All others hold. ``items`` are indices into ``qp.rows``; the unknowns are [x; s], s in the rows' own units. Feasible
    whenever the others are. A small ``share`` lets the cost choose only among the least slacks.

    Example:
        >>> import wbc
        >>> from wbc.qp.relax import relaxed
        >>> qp = wbc.QP([[1.0]], [0.0], A=[[1.0]], b=[3.0], ub=[1.0])
        >>> wbc.solve(relaxed(qp, [0], share=1e-4)).x.round(3)
        array([ 1., -2.])
    """
    chosen = np.array(sorted(set(items)), dtype=np.intp)
    n, n_eq, m, k = qp.n, qp.n_eq, len(qp.lower), len(chosen)
    rows = chosen[chosen < m]
    bounds = chosen[chosen >= m] - m
    gives = np.zeros((m, k))
    gives[rows, np.arange(len(rows))] = -1.0
    matrix = np.hstack([qp.matrix, gives])
    as_rows = np.zeros((len(bounds), n + k))
    as_rows[np.arange(len(bounds)), bounds] = 1.0
    as_rows[np.arange(len(bounds)), n + len(rows) + np.arange(len(bounds))] = -1.0
    H = np.zeros((n + k, n + k))
    H[:n, :n] = share * qp.H
    H[range(n, n + k), range(n, n + k)] = 1.0
    lb, ub = qp.lb.copy(), qp.ub.copy()
    lb[bounds], ub[bounds] = -np.inf, np.inf
    free = np.full(k, np.inf)
    names = [*qp.rows[:m], *(qp.rows[m + i] for i in bounds), *qp.rows[m:]]
    names += [Row(qp.rows[i].owner, f"{qp.rows[i].label} gives", qp.rows[i].unit) for i in chosen]
    return QP(
        H, np.concatenate([share * qp.g, np.zeros(k)]), A=matrix[:n_eq], b=qp.b, C=np.vstack([matrix[n_eq:], as_rows]),
        cl=np.concatenate([qp.cl, qp.lb[bounds]]), cu=np.concatenate([qp.cu, qp.ub[bounds]]),
        lb=np.concatenate([lb, -free]), ub=np.concatenate([ub, free]), rows=names,
    )  # fmt: skip
