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
from wbc.qp import QP, Solution
from wbc.qp.solvers import by_name, usable
from wbc.report.solvers import compare
from wbc.report.solvers.drawing import slug
from wbc.report.solvers.problems import ProblemSet

OTHERS = Path(os.environ.get("WBC_QPS", "qps"))


def rounding(qp: QP, answer: Solution) -> np.ndarray:
    """How far double precision may be off in each residual: n ε times the sum of magnitudes that are added up.

    Higham: Accuracy and stability of numerical algorithms, 2nd edition, SIAM 2002, section 3.1.
    """
    x, y, z, z_box = (np.abs(np.nan_to_num(v)) for v in (answer.x, answer.y, answer.z, answer.z_box))
    unit = 4.0 * (len(x) + len(qp.lower)) * np.finfo(float).eps
    sides = np.maximum(np.abs(np.where(np.isfinite(qp.lower), qp.lower, 0)),
                       np.abs(np.where(np.isfinite(qp.upper), qp.upper, 0)))  # fmt: skip
    boxes = np.maximum(np.abs(np.where(np.isfinite(qp.lb), qp.lb, 0)), np.abs(np.where(np.isfinite(qp.ub), qp.ub, 0)))
    rows, forces = np.abs(qp.matrix) @ x + sides, np.concatenate([y, z])
    pull = np.abs(qp.H) @ x + np.abs(qp.g) + np.abs(qp.matrix).T @ forces + z_box
    # A multiplier that is zero here can be rounding of the pulls there, and the other way round: data that lie
    # otherwise in memory are added in another order.
    stray = 2.0 * unit * pull.max()
    gap = float((forces + stray) @ rows + (z_box + stray) @ (x + boxes))
    primal = float(np.max(np.concatenate([rows, x + boxes])))
    return unit * np.array([primal, float(pull.max()) / (1.0 + float(np.abs(qp.g).max())), gap])


def residuals(qp: QP, answer: Solution) -> tuple[float, float, float]:
    """Primal; dual and gap over 1 + |g| and 1 + |cost|: row by row, in long doubles."""
    H, g, A, b, C = (np.asarray(part, dtype=np.longdouble) for part in (qp.H, qp.g, qp.A, qp.b, qp.C))
    x, y, z, z_box = (np.asarray(v, dtype=np.longdouble) for v in (answer.x, answer.y, answer.z, answer.z_box))
    if not all(np.isfinite(v).all() for v in (x, y, z, z_box)):
        return (np.inf,) * 3
    primal, stray, gap = [0.0], [0.0], 0.0
    for i in range(len(b)):
        primal.append(abs(float(A[i] @ x - b[i])))
        gap += abs(float(y[i] * (A[i] @ x - b[i])))
    sides = [(C[i] @ x, qp.cl[i], qp.cu[i], z[i]) for i in range(len(qp.cl))]
    sides += [(x[i], qp.lb[i], qp.ub[i], z_box[i]) for i in range(len(x))]
    for value, low, high, force in sides:
        primal.append(max(0.0, float(value - high), float(low - value)))
        side = high if force > 0 else low
        if force != 0 and not np.isfinite(side):
            stray.append(abs(float(force)))
        elif force != 0:
            gap += abs(float(force * (value - side)))
    pull = H @ x + g + A.T @ y + C.T @ z + z_box
    dual = max(float(np.abs(pull).max()), *stray)
    cost = float(x @ (H @ x) / 2 + g @ x)
    return max(primal), dual / (1.0 + float(np.abs(g).max())), gap / (1.0 + abs(cost))


def check(measure: dict[str, Any], qps: list[QP], tolerance: float | None) -> int:
    """Every entry of a cold measure against residuals computed anew; how many were solved."""
    solver = by_name(measure["solver"])
    asked = solver if tolerance is None else solver.at(tolerance)
    limit, solved = tolerance or 1e-6, 0
    for i, qp in enumerate(qps):
        if measure["status"][i] == "LOST":
            continue
        answer = asked.solve(qp)
        again = residuals(qp, answer)
        told = [np.inf if measure[part][i] is None else measure[part][i] for part in ("primal", "dual", "gap")]
        off = rounding(qp, answer)
        for what, one, other, error in zip(("primal", "dual", "gap"), told, again, off, strict=True):
            assert one == other or abs(one - other) <= 1e-4 * other + error, (measure["solver"], i, what, one, other)
        if abs(max(again) - limit) > 1e-4 * limit + off.max():
            assert (measure["status"][i] == "SOLVED") == (max(again) <= limit), f"{measure['solver']} {i}"
        solved += max(again) <= limit
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


@pytest.mark.skipif(not (OTHERS / "mpc").is_dir(), reason="no problems of others; set WBC_QPS to a folder with mpc/")
def test_what_is_told_of_some_of_others_problems_is_so(tmp_path: Path):
    (tmp_path / "some").mkdir()
    for path in [*sorted((OTHERS / "mpc").glob("*.npz"))[::8], *sorted((OTHERS / "free_for_all").glob("*.npz"))]:
        (tmp_path / "some" / path.name).write_bytes(path.read_bytes())
    data = compare(
        tmp_path / "some", solvers=["pdas", "daqp", "clarabel", "osqp"], out=tmp_path / "out", rounds=1,
        torture=False, growth=False,
    )  # fmt: skip
    found = ProblemSet.load(tmp_path / "out" / "problems" / "some.npz")
    for measure in data["measures"]:
        solved = check(measure, list(found.qps), data["classes"][measure["class"]])
        if measure["solver"] == "pdas":
            assert solved == len(found.qps)
