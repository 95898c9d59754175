"""Slips in the projected gradient step."""

from __future__ import annotations

FILE, TESTS = "wbc/methods/projected_gradient.py", "tests/methods/test_projected_gradient.py"

MUTATIONS = [
    (FILE, "high = max(0.0, float(ends[0].max())), min(", "high = float(ends[0].max()), min(", TESTS),
    (FILE, "min(self.alpha_max, float(ends[1].min()))", "float(ends[1].min())", TESTS),
    (FILE, "np.sort(np.array([down[moving], up[moving]]) / direction, axis=0)",
     "np.array([down[moving], up[moving]]) / direction", TESTS),
    (FILE, "self.v_null > 0.0, self.v_max, -self.v_min", "self.v_null > 0.0, -self.v_min, self.v_max", TESTS),
    (FILE, "found.inverse(task_velocity), found.projected(gradient)", "found.inverse(task_velocity), gradient", TESTS),
    (FILE, "ROUNDING * np.abs(self.v_null).max(initial=0.0)", "0.0 * np.abs(self.v_null).max(initial=0.0)", TESTS),
    (FILE, "np.vstack([np.column_stack([limited, -give]), np.column_stack([limited, give])])",
     "np.vstack([np.column_stack([limited, give]), np.column_stack([limited, -give])])", TESTS),
    (FILE, "self.origin.condition * np.linalg.norm", "1.0 * np.linalg.norm", TESTS),
    (FILE, "-alpha * of.gradient", "alpha * of.gradient", TESTS),
    ("wbc/methods/shared.py", "x - self.V.T @ (self.V @ x)", "x + self.V.T @ (self.V @ x)", TESTS),
]  # fmt: skip
