"""``wbc explain``: what a saved QP answers, or which rows cannot hold together."""

from __future__ import annotations

import numpy as np

from wbc.qp import QP
from wbc.report.solvers.problems import sequence

ROWS = [("aim", "x", "m"), ("wall", "x", "m"), ("x", "", "m"), ("y", "", "m")]


def saved(path, wall: float) -> None:
    QP(np.eye(2), [0.0, 0.0], A=[[1.0, 0.0]], b=[3.0], C=[[1.0, 0.0]], cu=[wall], rows=ROWS).save(path)


def test_a_conflict_is_told_by_name_and_amount(wbc, tmp_path):
    saved(tmp_path / "qp.npz", 1.0)
    answer = wbc("explain", "qp.npz")
    assert answer.code == 1
    assert "cannot hold together" in answer.out
    assert "aim\tx\tdown by 2 m\nwall\tx\tupper bound up by 2 m" in answer.out


def test_a_problem_with_an_answer_tells_what_pushes(wbc, tmp_path):
    saved(tmp_path / "qp.npz", 4.0)
    answer = wbc("explain", "qp.npz", "--solver", "daqp")
    assert answer.code == 0
    assert "certified" in answer.out and "aim" in answer.out and "wall" not in answer.out


def test_one_of_a_set_is_named_by_its_index(wbc, tmp_path):
    saved(tmp_path / "qp.npz", 4.0)
    first, second = (
        QP.load(tmp_path / "qp.npz"),
        QP(2.0 * np.eye(2), [0.0, 0.0], cu=[1.0], C=[[1.0, 0.0]], rows=ROWS[1:]),
    )
    sequence("ticks", [first, second]).save(tmp_path / "set.npz")
    assert "aim" in wbc("explain", "set.npz", "--index", "0").out
    answer = wbc("explain", "set.npz", "--index", "1")
    assert answer.code == 0 and "certified" in answer.out and "aim" not in answer.out
    for words, said in ((["set.npz"], "2 QPs; --index 0 to 1"), (["set.npz", "--index", "2"], "no QP 2: it holds 2")):
        answer = wbc("explain", *words)
        assert answer.code == 2 and said in answer.err


def test_a_file_without_names_is_said(wbc, tmp_path):
    np.savez(tmp_path / "plain.npz", P=np.eye(2), q=-np.ones(2), G=np.ones((1, 2)), h=np.ones(1))
    answer = wbc("explain", "plain.npz")
    assert answer.code == 0 and "The file names no rows" in answer.out and "C[0]" in answer.out


def test_a_problem_without_active_rows_says_so(wbc, tmp_path):
    QP(np.eye(2), [-1.0, 0.0], C=[[1.0, 0.0]], cu=[2.0]).save(tmp_path / "qp.npz")
    answer = wbc("explain", "qp.npz")
    assert answer.code == 0 and answer.out.strip().endswith("No row is active.")
