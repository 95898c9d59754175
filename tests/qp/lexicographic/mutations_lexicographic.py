"""Slips in strict priorities."""

from __future__ import annotations

FOLDER = "wbc/qp/lexicographic"
DUAL, LEAST, REST, SOLVER, STAGES = (f"{FOLDER}/{name}.py" for name in ("dual", "least", "rest", "solver", "stages"))
ROWS, STACKS = "tests/qp/lexicographic/test_lexicographic.py", "tests/stack/test_hierarchy.py"
SATURATED = "tests/stack/test_strict_saturated.py"

MUTATIONS = [
    (STAGES, "        p.G[rows, p.n] -= residual\n", "        p.G[rows, p.n] += residual\n", ROWS),
    (STAGES, "            np.add(wish.wanted, wish.drift, column)\n",
     "            np.copyto(column, wish.wanted)\n", STACKS),
    (STAGES, "p.lb[source.n :], p.ub[source.n :] = 0.0, 1.0", "p.lb[source.n :], p.ub[source.n :] = 0.0, 0.0", STACKS),
    (LEAST, "idle[rows] = True", "pass", SATURATED),
    (LEAST, "size / (size * size + cost.eps)", "size / (size * size + 1e6 * cost.eps)", SATURATED),
    (REST, "        self._keep(mine, _OWN if missed else _DEPENDENT)\n", "", ROWS),
    (REST, "for share in _COARSE:", "for share in ():", SATURATED),
    (DUAL, "p.lower[kept] = p.upper[kept] = p.value[kept]", "pass", ROWS),
    (SOLVER, "        self._hope = k\n        while", "        self._hope = 0\n        while", STACKS),
    (SOLVER, "        if self.qps >= self.budget:\n            return False\n", "", STACKS),
    ("wbc/stack/hierarchy.py", "return [directions, parts] if directions else [parts]", "return [parts]", STACKS),
]  # fmt: skip
