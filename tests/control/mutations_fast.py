"""Slips in compiled ticks."""

from __future__ import annotations

ROWS, FILL = "wbc/stack/compiled/rows_kernel.py", "wbc/stack/compiled/fill_kernel.py"
BOUNDS, DUAL, BOX = (
    "wbc/stack/compiled/interval_kernel.py", "wbc/qp/rows/compiled/dual_kernel.py",
    "wbc/qp/rows/compiled/box_kernel.py",
)  # fmt: skip
FAST, SOLVERS = "tests/control/test_fast.py", "tests/qp/rows/test_compiled.py"
GEOMETRY = "wbc/stack/compiled/geometry.py"

MUTATIONS = [
    (GEOMETRY, "if angle < 0.03:", "if angle < 1e-4:", FAST),
    (GEOMETRY, "1.0 / 12.0 + square / 720.0", "1.0 / 12.0", FAST),
    (GEOMETRY, "factor = -factor", "pass", FAST),
    (ROWS, "a0 = A[0] + V[4] * V[2] - V[5] * V[1]", "a0 = A[0]", FAST),
    (ROWS, "x0 += w1 * offset[2] - w2 * offset[1]", "x0 += 0.0", FAST),
    (FILL, "row[columns - 1] = h[i] + extra[i]", "row[columns - 1] = h[i] - extra[i]", FAST),
    (FILL, "centre[nb - n_u + j] = pull", "centre[nb - n_u + j] = 0.0", FAST),
    (BOUNDS, "bound[i] = min(free[i], strongest[i])", "bound[i] = free[i]", FAST),
    (DUAL, "change[row] = value[item] - (upper", "change[row] = value[item] + (upper", SOLVERS),
    (DUAL, "wrong[q] = 0.0 if lower[item] == upper[item] else pull * side[q]", "wrong[q] = -pull * side[q]", SOLVERS),
    (BOX, "held[c] = -1.0", "held[c] = 1.0", SOLVERS),
    ("wbc/stack/tracking.py", "Tracking.assignments += 1", "pass", FAST),
    ("wbc/qp/rows/pivoting.py", "under[new] >= over[new], -1.0, 1.0", "under[new] >= over[new], 1.0, -1.0",
     "tests/qp/rows/test_row_solvers.py"),
]  # fmt: skip
