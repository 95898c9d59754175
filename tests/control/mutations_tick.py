"""Slips in the plain tick."""

from __future__ import annotations

DUAL, MOTION = "wbc/qp/rows/dual.py", "wbc/stack/motion.py"
SOLVERS, PLAN = "tests/qp/rows/test_row_solvers.py", "tests/stack/test_plan.py"

MUTATIONS = [
    (DUAL, "daxpy(give, now.soft)", "pass", SOLVERS),
    (DUAL, "now.Ed[:] = Er ", "pass ", SOLVERS),
    (DUAL, "residual[: p.n_soft] += self._give", "pass", "tests/workloads/test_scaling.py"),
    (DUAL, "self._root[self._pins] = 0.0", "self._root[self._pins] = 1.0", SOLVERS),
    (DUAL, " and dual <= self._rounding)", ")", SOLVERS),
    (DUAL, "* self._root\n        if self.problem.n_u", "\n        if self.problem.n_u", SOLVERS),
    (MOTION, "minus_ones[:] = 1.0, -1.0", "minus_ones[:] = 1.0, 1.0", PLAN),
    (MOTION, "ones[:], minus_ones[:] = 1.0", "ones[:], minus_ones[:] = 0.0", PLAN),
    (MOTION, "self._right.fill(0.0)", "pass", PLAN),
    (MOTION, "self._minus_kd[rows] = -self.kd[rows]", "pass", PLAN),
    (MOTION, "np.copyto(self.rate_ref, self.own_ed, where=self.writes_ed)", "pass", PLAN),
    (MOTION, "self._Jv[self.writes_ed] = 0.0", "pass", PLAN),
    ("wbc/stack/plans.py", "value[self.plan.layout.force_items] * scale", "value[self.plan.layout.force_items]",
     PLAN),
    ("wbc/stack/interval.py", "daxpy(v, lower, len(v), -self._per_dt)", "pass", "tests/stack/test_interval.py"),
    ("wbc/stack/interval.py", "if not ddot(v, v) <= self._surely_slow:", "if False:", "tests/stack/test_interval.py"),
]  # fmt: skip
