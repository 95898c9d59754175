"""Success and residuals of a comparison against a computation of their own, which shares no code with it.

The solvers are asked once more, and what they answer is judged by formulas written out here, in extended precision.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.report.solvers.conftest import CLASSES, Compared
from wbc.files import slug
from wbc.qp import QP, Solution
from wbc.qp.solvers import by_name, usable
from wbc.report.solvers import compare
from wbc.report.solvers.problems import ProblemSet

OTHERS = Path(os.environ.get("WBC_QPS", "qps"))


def numbers(qp: QP, answer: Solution, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Primal residual, a hundredth of the distance and the larger of stationarity and gap: least and largest values.

    Row by row, in long doubles. A row that is met to within the tolerance, or beyond its bound, counts as held where x
    is, which is a primal residual too; a multiplier on any other row counts as zero in the distance. Between the two
    lies what rounding of the sums can do, n ε times the magnitudes that are added up (Higham: Accuracy and stability of
    numerical algorithms, 2nd edition, SIAM 2002, section 3.1). Another process adds in another order, so a multiplier
    that is zero here can be rounding of the pulls there.
    """
    H, g, A, b, C = (np.asarray(part, dtype=np.longdouble) for part in (qp.H, qp.g, qp.A, qp.b, qp.C))
    x, y, z, z_box = (np.asarray(v, dtype=np.longdouble) for v in (answer.x, answer.y, answer.z, answer.z_box))
    if not all(np.isfinite(v).all() for v in (x, y, z, z_box)):
        return np.full(3, np.inf), np.full(3, np.inf)
    unit = 4.0 * (qp.n + len(qp.lower)) * np.finfo(float).eps
    pull = np.abs(H) @ np.abs(x) + np.abs(g) + np.abs(A.T) @ np.abs(y) + np.abs(C.T) @ np.abs(z) + np.abs(z_box)
    stray = 2.0 * unit * pull.max()
    rows = [(A[i] @ x, A[i], b[i], b[i], y[i]) for i in range(len(b))]
    rows += [(C[i] @ x, C[i], qp.cl[i], qp.cu[i], z[i]) for i in range(len(qp.cl))]
    rows += list(zip(x, np.eye(qp.n), qp.lb, qp.ub, z_box, strict=True))
    primal, magnitude, loose, gap, spare, sizes = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    r = kept = H @ x + g
    bounded = np.zeros(qp.n)
    for i, (value, row, low, high, force) in enumerate(rows):
        primal = max(primal, float(value - high), float(low - value))
        magnitude = max(
            magnitude, float(np.abs(row) @ np.abs(x)) + max(abs(s) for s in (low, high, 0.0) if abs(s) < np.inf)
        )
        r = r + force * row
        side = high if force > 0 else low
        if force != 0 and float(side - value if force > 0 else value - side) <= tolerance:  # met, or beyond
            kept, primal = kept + force * row, max(primal, float(abs(value - side)))
            if i >= len(rows) - qp.n:
                bounded[i - len(rows)] = force
        if force != 0 and not np.isfinite(side):
            loose = max(loose, abs(float(force)))
        elif force != 0:
            gap += abs(float(force * (value - side)))
            sizes += abs(float(force)) * (1.0 + abs(float(value)))
        spare += min(abs(float(value - s)) for s in (low, high)) if np.isfinite(low) or np.isfinite(high) else 0.0
    size = 1.0 + np.abs(x)
    asked = np.abs(g) + np.abs(H) @ size
    scale, scale_gap = float(asked.max()), float(asked @ size) + sizes
    residual = max(
        primal, max(float(np.abs(r).max()), loose) / scale if scale else 0.0, gap / scale_gap if scale_gap else 0.0
    )
    more = unit * max(float(pull.max()) / scale if scale else 0.0, 1.0) + (
        stray * spare / scale_gap if scale_gap else 0.0
    )
    near, far = distance(
        qp, np.asarray(kept, dtype=float), np.asarray(unit * pull, dtype=float), np.asarray(size, dtype=float)
    )
    slack = unit * magnitude
    parts = np.stack([qp.g, (kept - H @ x - g - bounded), bounded]).astype(float)
    steep = slope(qp, np.asarray(kept, dtype=float), parts, np.asarray(unit * pull, dtype=float))
    return np.array([primal - slack, near, residual - more - slack]), np.array(
        [primal + slack, far, max(residual + more + slack, steep)]
    )


def slope(qp: QP, r: np.ndarray, parts: np.ndarray, off: np.ndarray) -> float:
    """The most that can be left of a slope where nothing curves the cost, |r| relative to the largest of ``parts``.

    r is known to ``off``. Where H is singular but for variables that it leaves out, any number at all is allowed.
    """
    flat = ~qp.H.any(axis=1)
    if not np.linalg.matrix_rank(qp.H, hermitian=True) == (~flat).sum():
        return float(np.inf)
    largest = np.abs(parts).max(axis=0)
    sloping = flat & (largest > 0.0)
    return float(((np.abs(r) + off)[sloping] / largest[sloping]).max(initial=0.0))


def distance(qp: QP, r: np.ndarray, off: np.ndarray, size: np.ndarray) -> tuple[float, float]:
    """A hundredth of |Sᵢ|_{H⁻¹} |r|_{H⁻¹} / size, the largest over all rows of tasks, for r and for r known to ``off``.

    A QP that names no tasks is judged by its variables. Where H is singular the directions without curvature have no
    distance, and any number at all is allowed.
    """
    values, axes = np.linalg.eigh(qp.H)
    if values[0] <= 1e-9 * values[-1]:
        return 0.0, np.inf
    half = (axes / np.sqrt(values)).T
    tasks = [(task.rows, 1.0 + np.abs(task.target)) for task in qp.tasks] or [(np.eye(qp.n), size)]
    unit = max(float((np.linalg.norm(half @ rows.T, axis=0) / sizes).max()) for rows, sizes in tasks)
    least, most = np.linalg.norm(half @ r) - np.linalg.norm(np.abs(half) @ off), np.linalg.norm(half @ r)
    return 0.01 * unit * float(least), 0.01 * unit * (float(most) + 2.0 * float(np.linalg.norm(np.abs(half) @ off)))


def check(measure: dict[str, Any], qps: list[QP], tolerance: float | None) -> int:
    """Every entry of a cold measure against residuals computed anew; how many were solved."""
    solver = by_name(measure["solver"])
    asked = solver if tolerance is None else solver.at(tolerance)
    limit, solved = tolerance or 1e-6, 0
    for i, qp in enumerate(qps):
        if measure["status"][i] == "LOST":
            continue
        answer = asked.solve(qp)
        low, high = numbers(qp, answer, limit)
        for what, least, most in zip(("primal", "dual", "gap"), low, high, strict=True):
            told = np.inf if measure[what][i] is None else measure[what][i]
            assert (1 - 1e-4) * least <= told <= (1 + 1e-4) * most, (measure["solver"], i, what, told, least, most)
        is_solved = measure["status"][i] == "SOLVED"
        assert is_solved or not high.max() <= limit, f"{measure['solver']} {i}"
        assert not is_solved or low.max() <= limit, f"{measure['solver']} {i}"
        solved += is_solved
    return solved


def test_what_is_told_of_our_problems_is_so(compared: Compared):
    """pdas gives the same bits for the same problems, so a second answer is the first one."""
    sets = [ProblemSet.load(path) for path in sorted((compared.folder / "problems").glob("*.npz"))]
    checked = 0
    for found in sets:
        for measure in compared.data["measures"]:
            if measure["set"] == found.name and measure["mode"] == "cold" and measure["solver"] == "pdas":
                checked += check(measure, list(found.qps), CLASSES[measure["class"]])
    assert checked > 50


@pytest.mark.deep
@pytest.mark.skipif(not OTHERS.is_dir(), reason="no problems of others; set WBC_QPS to their folder")
def test_what_is_told_of_others_problems_is_so_for_every_solver(tmp_path: Path):
    """Every installed solver that gives the same bits twice, in every class, on every problem."""
    repeatable = [name for name in usable() if by_name(name).repeatable]
    data = compare(
        OTHERS, solvers=repeatable, out=tmp_path / "out", rounds=1, limit=60.0, torture=False, growth=False
    )  # fmt: skip
    for about in data["sets"]:
        found = ProblemSet.load(tmp_path / "out" / "problems" / f"{slug(about['name'])}.npz")
        for measure in data["measures"]:
            if measure["set"] == found.name:
                check(measure, list(found.qps), data["classes"][measure["class"]])


@pytest.mark.slow
@pytest.mark.skipif(not (OTHERS / "mpc").is_dir(), reason="no problems of others; set WBC_QPS to a folder with mpc/")
def test_what_is_told_of_some_of_others_problems_is_so(tmp_path: Path):
    (tmp_path / "some").mkdir()
    for path in [*sorted((OTHERS / "mpc").glob("*.npz"))[::8], *sorted((OTHERS / "free_for_all").glob("*.npz"))]:
        (tmp_path / "some" / path.name).write_bytes(path.read_bytes())
    data = compare(
        tmp_path / "some", solvers=["pdas", "clarabel", "osqp"], out=tmp_path / "out", rounds=1,
        torture=False, growth=False,
    )  # fmt: skip
    found = ProblemSet.load(tmp_path / "out" / "problems" / "some.npz")
    for measure in data["measures"]:
        solved = check(measure, list(found.qps), data["classes"][measure["class"]])
        if measure["solver"] == "pdas":
            assert solved == len(found.qps)
