"""Large QPs with sparse matrices, such as those over many moments of a motion, solved once by Clarabel."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
from scipy import sparse

from wbc.types import Vec


def solve_sparse(H: Any, g: Vec, A: Any, low: Vec, high: Vec) -> Vec | None:
    """x (n,) of least ½ xᵀ H x + gᵀ x with low <= A x <= high, equalities where low = high; None: there is none.

    H (n, n) and A (m, n) are matrices of ``scipy.sparse``. The answer is Clarabel's, to its accuracy of 1e-8, without a
    certificate: who uses it looks at what it gave.

    Example:
        >>> import numpy as np
        >>> from scipy import sparse
        >>> from wbc.qp.sparse import solve_sparse
        >>> low, high = np.array([1.0, -np.inf]), np.array([1.0, 0.2])
        >>> x = solve_sparse(sparse.eye_array(2), np.zeros(2), sparse.csc_array([[1.0, 1.0], [1.0, 0.0]]), low, high)
        >>> None if x is None else x.round(4)
        array([0.2, 0.8])
    """
    import qpsolvers

    rows, same = sparse.csr_array(A), low == high
    upper, lower = np.isfinite(high) & ~same, np.isfinite(low) & ~same
    G, h = sparse.vstack([rows[upper], -rows[lower]], format="csc"), np.concatenate([high[upper], -low[lower]])
    equal = sparse.csc_array(rows[same])
    with warnings.catch_warnings():  # that there is no answer is said by None
        warnings.simplefilter("ignore", UserWarning)
        answer: Vec | None = qpsolvers.solve_qp(sparse.csc_matrix(H), g, G, h, equal, low[same], solver="clarabel")
    return answer
