"""Slips in saturation in the null space."""

from __future__ import annotations

FILE, SCALING = "wbc/methods/null_space_saturation.py", "wbc/methods/scaling.py"
TESTS = "tests/methods/test_null_space_saturation.py"
SLOPES = f"{TESTS}::test_a_start_on_a_limit_that_the_task_leaves_outwards_asks_for_scale_zero"

MUTATIONS = [
    (SCALING, "if w <= max(ROUNDING, self.least):", "if True:", TESTS),
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
    # limits give way: by how much, at what price, and when that means that there is no scale
    (SCALING, "np.maximum(slope, ACUTE), slope <= SETTLED", "np.ones_like(slope), slope <= SETTLED", SLOPES),
    (SCALING, "np.maximum(slope, ACUTE), slope <= SETTLED", "np.maximum(slope, ACUTE), slope <= 1e-5", SLOPES),
    (SCALING, "feasible=consistent and self._within(inside)", "feasible=consistent", SLOPES),
    (SCALING, "feasible=consistent and self._within(inside)", "feasible=self._within(inside)", TESTS),
    (SCALING, "least_violation(free, self.low - at, self.high - at)[0]", "np.zeros(free.shape[1])", TESTS),
    (SCALING, "PRICES = (1e1, 1e2, 1e3, 1e4)", "PRICES = (1e-1,)", TESTS),
    (SCALING, "np.maximum(point - self.high, self.low - point)", "np.maximum(point - self.high, point - self.low)",
     TESTS),
]  # fmt: skip
