"""One small comparison of everything, measured once."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from tests.qp.zoo import sequence as changing
from wbc.qp import QP
from wbc.report.solvers import compare
from wbc.report.solvers.problems import ProblemSet, sequence

CLASSES = {"default": None, "1e-3": 1e-3, "1e-9": 1e-9}


class Compared(NamedTuple):
    """What a comparison gave: its data, and the folder with page, tables and raw data."""

    data: dict[str, Any]
    folder: Path


@pytest.fixture(scope="session")
def ticks() -> ProblemSet:
    """QPs that follow one another."""
    return sequence("ticks", changing(8, n=6, n_eq=1, n_in=4))


@pytest.fixture(scope="session")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of QPs in three formats, and something that is none."""
    folder = tmp_path_factory.mktemp("files") / "mixed"
    folder.mkdir()
    rng = np.random.default_rng(3)
    J, q = rng.standard_normal((5, 5)), rng.standard_normal(5)
    G, h = rng.standard_normal((4, 5)), np.ones(4)
    P = J @ J.T + np.eye(5)
    QP(P, q, C=G, cu=h, lb=np.full(5, -1.0)).save(folder / "ours.npz")
    np.savez(folder / "onesided.npz", P=P, q=q, G=G, h=h, lb=np.full(5, -1.0))
    np.savez(folder / "between.npz", P=P, q=q, A=G, l=[-1e20, -1.0, 0.5, -2.0], u=[1.0, 1e20, 0.5, 2.0])
    np.savez(folder / "picture.npz", pixels=np.zeros((2, 2)))
    np.savez(folder / "saddle.npz", P=-P, q=q)
    (folder / "notes.npz").write_text("not an archive")
    return folder


@pytest.fixture(scope="session")
def compared(ticks: ProblemSet, files: Path, tmp_path_factory: pytest.TempPathFactory) -> Compared:
    """Two solvers on ticks, on files and on a scenario from a file, with everything but the growth of times."""
    folder = tmp_path_factory.mktemp("compared") / "report"
    reach = f"{Path(__file__).with_name('reaching.py')}:reach"
    data = compare(
        [ticks, files, reach], solvers=["pdas", "osqp"], out=folder, rounds=2, ticks=20, classes=CLASSES,
        settings=["way=0.25"], torture=True, growth=False,
    )  # fmt: skip
    return Compared(data, folder)
