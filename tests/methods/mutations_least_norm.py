"""Slips in how solvers are asked for the shortest point of a polyhedron."""

from __future__ import annotations

FILE, POLISH, TESTS = "wbc/methods/least_norm.py", "wbc/methods/polish.py", "tests/methods/test_least_norm.py"

MUTATIONS = [
    (FILE, "start + T @ found.x / zoom", "start + T @ found.x * zoom", TESTS),
    (FILE, "Words(1.0, \"columns\", 0.5 * ACCURATE),", "", TESTS),
    (FILE, "exact is None or np.linalg.norm(exact[0] - answer.x) > CLOSE", "exact is None or 0.0 > CLOSE", TESTS),
    (POLISH, "for near in NEAR:", "for near in ():", TESTS),
    (POLISH, "np.where(qp.cl < qp.cu, -side * force, 0.0)", "np.where(qp.cl < qp.cu, side * force, 0.0)", TESTS),
]  # fmt: skip
