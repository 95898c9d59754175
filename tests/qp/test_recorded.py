"""Problems that others wrote down: model predictive control of walking and of a wheeled robot."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from wbc.qp import QP, solve
from wbc.qp.solvers import by_name, usable
from wbc.types import Status

FOLDER = Path(os.environ.get("WBC_QPS", "qps"))
FILES = sorted((FOLDER / "mpc").glob("*.npz"))
MAROS_MESZAROS = sorted((FOLDER / "maros_meszaros").glob("*.npz"))
SOLVERS = {"pdas": 1e-8, "daqp": 1e-8, "clarabel": 1e-6, "piqp": 1e-6}


def read(path: Path) -> QP:
    """½ xᵀPx + qᵀx, G x ≤ h, A x = b, lb ≤ x ≤ ub, or l ≤ A x ≤ u; what is not in the file is not there."""
    with np.load(path, allow_pickle=False) as file:
        part = {name: file[name] for name in file.files}
    if "l" in part:
        low, high = np.where(part["l"] > -1e19, part["l"], -np.inf), np.where(part["u"] < 1e19, part["u"], np.inf)
        return QP(part["P"], part["q"], C=part["A"], cl=low, cu=high)
    return QP(
        part["P"], part["q"], A=part.get("A"), b=part.get("b"), C=part.get("G"), cu=part.get("h"),
        lb=part.get("lb"), ub=part.get("ub"),
    )  # fmt: skip


@pytest.mark.skipif(not FILES, reason="no recorded problems; set WBC_QPS to a folder that has mpc/*.npz")
@pytest.mark.parametrize("name", SOLVERS)
def test_recorded_problems_are_certified(name: str):
    if name not in usable():
        pytest.skip(f"{name} is not installed")
    for path in FILES:
        answer = by_name(name).solve(read(path))
        assert answer.status is Status.SOLVED, f"{path.name}: {answer.status}"
        assert answer.certificate.within(SOLVERS[name]), f"{path.name}: {answer.certificate}"


@pytest.mark.skipif(not MAROS_MESZAROS, reason="no recorded problems; set WBC_QPS to a folder with maros_meszaros")
def test_the_problems_of_maros_and_meszaros_are_certified():
    for path in MAROS_MESZAROS:
        if path.stem != "VALUES":  # it is not convex
            assert solve(read(path)).certificate.within(1e-8), path.name
