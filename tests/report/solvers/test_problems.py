"""Problems are read as they were written, recorded where they were met, and made with the active rows they promise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.qp.zoo import random_qp
from wbc.errors import InvalidInput
from wbc.qp import QP, solve
from wbc.qp.problem import Objective
from wbc.report import compare
from wbc.report.solvers.problems import ProblemSet, from_folder, read_qp, sequence
from wbc.report.solvers.recording import growing, record
from wbc.sim.scenario import find

REACH = f"{Path(__file__).with_name('reaching.py')}:reach"
PARTS = ("H", "g", "A", "b", "C", "cl", "cu", "lb", "ub")


def same(one: QP, other: QP) -> bool:
    tasks = [
        (a.name, a.unit) == (b.name, b.unit) and np.array_equal(a.rows, b.rows) and np.array_equal(a.target, b.target)
        for a, b in zip(one.tasks, other.tasks, strict=True)
    ]
    parts = all(np.array_equal(getattr(one, part), getattr(other, part)) for part in PARTS)
    return parts and one.rows == other.rows and all(tasks)


def test_a_set_is_read_back_to_the_same_bits(tmp_path: Path):
    named = random_qp(1, 4, 1, 2).copy()
    named.name_tasks(
        [Objective("reach", np.ones((2, 4)), np.ones(2), "m/s"), Objective("rest", np.eye(4), np.zeros(4))]
    )
    written = ProblemSet("a/b", "sequence", "here", (random_qp(0, 4, 1, 2), named), ["x", "y"], [(0, 1), (1, 2)], 1e-3)
    written.save(tmp_path / "set.npz")
    read = ProblemSet.load(tmp_path / "set.npz")
    assert read.about() == written.about()
    assert all(same(one, other) for one, other in zip(read.qps, written.qps, strict=True))


def test_three_formats_are_one_problem(files: Path):
    ours, onesided = read_qp(files / "ours.npz"), read_qp(files / "onesided.npz")
    np.testing.assert_allclose(solve(ours).x, solve(onesided).x, atol=1e-9)


def test_sides_that_are_equal_become_equations_and_huge_ones_none(files: Path):
    qp = read_qp(files / "between.npz")
    assert qp.shape == (5, 1, 3) and qp.b == [0.5]
    np.testing.assert_array_equal(qp.cl, [-np.inf, -1.0, -2.0])
    np.testing.assert_array_equal(qp.cu, [1.0, np.inf, 2.0])


def test_one_triangle_of_a_cost_is_the_whole_cost(tmp_path: Path):
    P = np.array([[2.0, 1.0], [1.0, 3.0]])
    np.savez(tmp_path / "upper.npz", P=np.triu(P), q=np.zeros(2))
    np.testing.assert_array_equal(read_qp(tmp_path / "upper.npz").H, P)


def test_what_cannot_be_read_is_told_with_its_reason(files: Path):
    found = from_folder(files)
    sets, unread = found.sets, found.unread
    assert [(s.name, list(s.labels)) for s in sets] == [("mixed", ["between", "onesided", "ours"])]
    assert set(unread) == {"notes.npz", "picture.npz", "saddle.npz"}
    assert "convex" in unread["saddle.npz"] and "pixels" in unread["picture.npz"]


def test_every_folder_is_a_set_of_its_own(files: Path, tmp_path: Path):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "qp.npz").write_bytes((files / "ours.npz").read_bytes())
    found = from_folder(tmp_path)
    assert [s.name for s in found.sets] == [f"{tmp_path.name}/one", f"{tmp_path.name}/two"] and not found.unread


def test_a_file_is_a_set_of_its_own(files: Path):
    found = compare(str(files / "ours.npz"), solvers=["pdas"], classes={"default": None}, rounds=1)
    assert {(one["set"], tuple(one["status"])) for one in found["measures"]} == {("ours.npz", ("SOLVED",))}


def test_a_folder_without_problems_is_refused(tmp_path: Path, files: Path):
    for folder in (tmp_path, tmp_path / "nowhere", tmp_path / "nowhere.npz", files / "picture.npz"):
        with pytest.raises(InvalidInput):
            from_folder(folder)
    with pytest.raises(InvalidInput):
        sequence("empty", [])


def test_a_problem_that_grows_is_recorded_at_each_size(tmp_path: Path):
    scenario = find("contacts")
    found = growing(scenario)
    assert list(found.sizes) == list(scenario.sizes) and len(found.stretches) == len(scenario.sizes)
    for size, (start, end) in zip(found.sizes, found.stretches, strict=True):
        assert end - start == 6
        assert {qp.n for qp in found.qps[start:end]} == {30 + 3 * size}, "each point adds a force"
    assert all(same(a, b) for a, b in zip(found.qps, growing(scenario).qps, strict=True))
    found.save(tmp_path / "set.npz")
    assert ProblemSet.load(tmp_path / "set.npz").about() == {**found.about(), "sizes": list(scenario.sizes)}


def test_a_scenario_is_recorded_in_stretches_of_consecutive_ticks():
    scenario = find(REACH)
    chosen = scenario.choose(plant=None, hierarchy=None, duration=0.3)
    found = record(scenario, scenario.parse([]), chosen, count=120)
    assert found.stretches == [(0, 40), (40, 80), (80, 120)] and found.period == 1e-3
    assert found.labels[0] == "t = 0.000 s" and found.labels[-1] == "t = 0.299 s"
    times = np.array([float(label.split()[2]) for label in found.labels])
    for start, end in found.stretches:
        np.testing.assert_allclose(np.diff(times[start:end]), 1e-3, atol=1e-9)
    assert {row.unit for row in found.qps[0].rows} == {"rad/s"}


def test_a_scenario_without_a_loop_of_ours_cannot_be_recorded():
    scenario = find(f"{Path(__file__).parents[2] / 'cli' / 'waving.py'}:wave")
    with pytest.raises(InvalidInput, match="simulate"):
        record(scenario, scenario.parse([]), scenario.choose(plant=None, hierarchy=None, duration=None))
