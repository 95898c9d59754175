"""Problems that others wrote down: model predictive control of walking and of a wheeled robot."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from wbc.qp import QP
from wbc.qp.solvers import by_name, usable
from wbc.types import Status

FOLDER = Path(os.environ.get("WBC_QPS", "qps")) / "mpc"
FILES = sorted(FOLDER.glob("*.npz"))
SOLVERS = {"pdas": 1e-8, "daqp": 1e-8, "clarabel": 1e-6, "piqp": 1e-6}


def read(path: Path) -> QP:
    """½ xᵀPx + qᵀx, G x ≤ h, A x = b, lb ≤ x ≤ ub; what is not in the file is not there."""
    with np.load(path, allow_pickle=False) as file:
        part = {name: file[name] for name in file.files}
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
