"""Slips in strict priorities."""

from __future__ import annotations

FOLDER = "wbc/qp/lexicographic"
DUAL, REST, SOLVER, STAGES = (f"{FOLDER}/{name}.py" for name in ("dual", "rest", "solver", "stages"))
ROWS, STACKS = "tests/qp/lexicographic/test_lexicographic.py", "tests/stack/test_hierarchy.py"

MUTATIONS = [
    (STAGES, "        p.G[rows, p.n] -= residual\n", "        p.G[rows, p.n] += residual\n", ROWS),
    (STAGES, "            np.add(wish.wanted, wish.drift, column)\n",
     "            np.copyto(column, wish.wanted)\n", STACKS),
    (STAGES, "p.lb[source.n :], p.ub[source.n :] = 0.0, 1.0", "p.lb[source.n :], p.ub[source.n :] = 0.0, 0.0", STACKS),
    (DUAL, "_NONE if met else pushing", "_NONE", ROWS),
    (DUAL, "holds *= 1.0 + _TRACE", "holds *= 1.001", ROWS),
    (REST, "self.basis = _complement(self.basis, mine, _OWN)", "pass", ROWS),
    (SOLVER, "        self._hope = k\n        while", "        self._hope = 0\n        while", STACKS),
    (SOLVER, "        if self.qps >= self.budget:\n            return False\n", "", STACKS),
    ("wbc/stack/hierarchy.py", "return [directions, parts] if directions else [parts]", "return [parts]", STACKS),
]  # fmt: skip
