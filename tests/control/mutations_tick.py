"""Slips in the plain tick."""

from __future__ import annotations

DUAL, MOTION = "wbc/qp/rows/dual.py", "wbc/stack/motion.py"
SOLVERS, PLAN = "tests/qp/rows/test_row_solvers.py", "tests/stack/test_plan.py"

MUTATIONS = [
    (DUAL, "soft += self._give", "pass", SOLVERS),
    (DUAL, "residual[: p.n_soft] += self._give", "pass", "tests/workloads/test_scaling.py"),
    (DUAL, "self._root[self._pins] = 0.0", "self._root[self._pins] = 1.0", SOLVERS),
    (DUAL, " and dual <= self._rounding)", ")", SOLVERS),
    (DUAL, "* self._root\n        if self.problem.n_u", "\n        if self.problem.n_u", SOLVERS),
    (MOTION, "self._gains[3] = 0.0, -1.0", "self._gains[3] = 0.0, 1.0", PLAN),
    (MOTION, "self._gains[1:3], self._gains[3] = 0.0", "self._gains[1:3], self._gains[3] = 1.0", PLAN),
    ("wbc/stack/plans.py", "value[self.plan.layout.force_items] * scale", "value[self.plan.layout.force_items]",
     PLAN),
    ("wbc/stack/interval.py", "if not ddot(v, v) <= self._surely_slow:", "if False:", "tests/stack/test_interval.py"),
]  # fmt: skip
