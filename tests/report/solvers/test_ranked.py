"""Hierarchies from files are read, judged level by level, and shown beside the best answer that anybody has."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from wbc.errors import InvalidProblem
from wbc.report.document import Table
from wbc.report.solvers import closing
from wbc.report.solvers.problems import from_folder
from wbc.report.solvers.ranked import is_ranked, missed, ranked, reached, read_ranked


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """x + y = 2 above all; then x >= 3 with x <= 2.5 forced by a bound of the first level."""
    path = tmp_path / "two.npz"
    np.savez(
        path, A0=[[1.0, 1.0], [1.0, 0.0]], l0=[2.0, -9.0], u0=[2.0, 2.5], A1=[[1.0, 0.0]], l1=[3.0], u1=[9.0],
        solution=[2.5, -0.5],
    )  # fmt: skip
    return path


def test_levels_and_the_known_solution_are_read(file: Path):
    problem = read_ranked(file)
    assert is_ranked(file) and [A.shape for A, _, _ in problem.levels] == [(2, 2), (1, 2)]
    assert missed(problem.levels, problem.known) == [0.0, 0.125]
    assert missed(problem.levels, np.array([3.0, 0.0])) == [0.5 + 0.125, 0.0]


def test_levels_that_do_not_fit_are_refused(tmp_path: Path):
    np.savez(tmp_path / "a.npz", A0=np.eye(2), l0=[0.0], u0=[0.0, 1.0])
    np.savez(tmp_path / "b.npz", A0=np.eye(2), l0=[0.0, 0.0], u0=[0.0, 1.0], A1=np.eye(2))
    for name in "ab":
        with pytest.raises(InvalidProblem):
            read_ranked(tmp_path / f"{name}.npz")


def test_levels_count_from_the_first_to_the_first_that_is_missed():
    assert reached([0.0, 1.0, 5.0], [0.0, 1.0, 5.0]) == 3
    assert reached([0.1, 0.0, 0.0], [0.0, 1.0, 5.0]) == 0, "what a level above gives away, the others cannot repay"
    assert reached([1e-12, 1.0 + 1e-9, 5.1], [0.0, 1.0, 5.0]) == 2


def test_the_table_shows_who_comes_how_far():
    entries = [
        {"name": "h", "solver": "good", "status": "SOLVED", "levels": [1e-20, 2.0], "us": 5.0, "known": [0.0, 2.0]},
        {"name": "h", "solver": "bad", "status": "SOLVED", "levels": [0.0, 3.0], "us": 1.0, "known": [0.0, 2.0]},
        {"name": "h", "solver": "lost", "lost": "no answer within 5 s"},
    ]
    section = closing.ranked({"ranked": entries})
    table = next(item for item in section.items if isinstance(item, Table))
    assert [(row[0], row[2]) for row in table.rows] == [("good", 2), ("bad", 1), ("lost", None), ("known solution", 2)]


def test_a_hierarchy_is_solved_and_judged(file: Path):
    assert list(from_folder(file.parent).ranked) == [f"{file.parent.name}/two"]
    found = ranked(file)
    assert found["status"] == "SOLVED" and reached(found["levels"], found["known"]) == 2


OTHERS = Path(os.environ.get("WBC_QPS", "qps")) / "lexls" / "test_01.npz"


@pytest.mark.skipif(not OTHERS.is_file(), reason="no hierarchy of others; set WBC_QPS to a folder with lexls/")
def test_the_core_brings_a_hierarchy_of_others_to_the_solution_they_know():
    found = ranked(OTHERS)
    assert found["status"] == "SOLVED" and reached(found["levels"], found["known"]) == len(found["known"]) == 5
