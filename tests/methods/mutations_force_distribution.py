"""Slips in the distribution of forces."""

from __future__ import annotations

FILE, TESTS = "wbc/methods/force_distribution.py", "tests/methods/test_force_distribution.py"

MUTATIONS = [
    (FILE, "return inverse_root(self.weight)", "return inverse_root(self.weight).T", TESTS),
    (FILE, "self._result(found.x, -found.y)", "self._result(found.x, found.y)", TESTS),
    (FILE, "[0, -1, mu], [0, 1, mu]]", "[0, -1, mu], [0, 1, -mu]]", TESTS),
    (FILE, "self.G @ f - self.wrench, multipliers", "self.wrench - self.G @ f, multipliers", TESTS),
    (FILE, "if np.linalg.norm(missing) > REACHED * np.linalg.norm(self.wrench):", "if False:", TESTS),
    (FILE, "max(0.0, push - rounding) / scale", "max(0.0, push - 1e7 * rounding) / scale", TESTS),
    (FILE, "found.U @ (found.solve(self.wrench) / found.values)", "found.U @ found.solve(self.wrench)", TESTS),
]  # fmt: skip
