"""Slips in saturation in the null space."""

from __future__ import annotations

FILE, SCALING = "wbc/methods/null_space_saturation.py", "wbc/methods/scaling.py"
TESTS = "tests/methods/test_null_space_saturation.py"

MUTATIONS = [
    (FILE, "if not beyond.any():", "if beyond.any():", TESTS),  # the exit condition as printed
    (FILE, "-task.drift - task.V @ held", "-task.drift + task.V @ held", TESTS),
    (FILE, "self.upper[first] if whole[first] > self.upper[first] else self.lower[first]",
     "self.lower[first] if whole[first] > self.upper[first] else self.upper[first]", TESTS),
    (FILE, "if best < high and low <= high:", "if low <= high:", TESTS),
    (FILE, "right = np.append(right, found.size * task.direction - task.drift)",
     "right = np.append(right, found.size * task.direction)", TESTS),
    (FILE, "A=np.column_stack([self.J, -self.target])", "A=np.column_stack([self.J, self.target])", TESTS),
    (SCALING, "towards[-2] += push", "towards[-2] -= push", TESTS),
    (SCALING, "np.append(right, -task.drift) / self.unit", "np.append(right, task.drift) / self.unit", TESTS),
    (SCALING, "steps.onwards(found, push).size <= found.size + GAIN * steps.unit", "True", TESTS),
    (SCALING, "np.linalg.norm(high * missing - off)", "np.linalg.norm(high * missing + off)", TESTS),
]  # fmt: skip
