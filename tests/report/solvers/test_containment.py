"""A solver that hangs, crashes or lies harms nobody else, and is shown as what it is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.qp.zoo import random_qp
from tests.report.solvers.strange import Crashing, Hanging, Lying
from wbc.errors import InvalidInput
from wbc.qp import QP, Session, Shape, Solver
from wbc.qp.solvers import by_name
from wbc.report.document import Marked
from wbc.report.solvers import compare
from wbc.report.solvers.advice import advice
from wbc.report.solvers.page import page
from wbc.report.solvers.torture import CASES, tortured

SMALL = QP([[2.0]], [0.0])


@pytest.fixture(scope="module")
def found() -> dict[str, Any]:
    """The three among a sound one; the first and the last problem are small."""
    qps = [SMALL, random_qp(0, 6, 1, 3), SMALL]
    return compare(
        qps, solvers=[Hanging(), Crashing(), Lying(), "daqp"], rounds=1, limit=3.0, classes={"default": None},
        torture=False, growth=False,
    )  # fmt: skip


@pytest.mark.parametrize(("run", "options", "said"), [
    ([], {}, "nothing to compare"), ((), {}, "nothing to compare"),
    *(([SMALL], {what: wrong}, what) for what in ("rounds", "ticks") for wrong in (0, -1, 1.5, True, "3", None)),
    *(([SMALL], {what: wrong}, what) for what in ("limit", "patience") for wrong in (0.0, -1.0, np.nan, "3", None)),
    *(([SMALL], {"classes": wrong}, "classes") for wrong in ({"x": "y"}, {"x": 0.0}, {"x": -1e-6}, ["default"], None)),
])  # fmt: skip
def test_a_comparison_that_makes_no_sense_is_refused_before_anything_is_measured(
    run: Any, options: dict[str, Any], said: str, tmp_path: Path
):
    with pytest.raises(InvalidInput, match=said):
        compare(run, solvers=["pdas"], out=tmp_path / "report", **options)
    assert not list(tmp_path.iterdir())


def column(found: dict[str, Any], solver: str, mode: str = "cold") -> dict[str, Any]:
    return next(m for m in found["measures"] if m["solver"] == solver and m["mode"] == mode)


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["cold", "warm"])
def test_what_hangs_or_crashes_loses_only_the_problem_it_hung_or_crashed_on(found: dict[str, Any], mode: str):
    for solver, reason in (("hanging", "no answer within 3 s"), ("crashing", "crashed: SIGSEGV")):
        measure = column(found, solver, mode)
        assert measure["status"] == ["SOLVED", "LOST", "SOLVED"]
        assert measure["lost"] == {"1": reason}
        assert measure["total_us"][1] is None and measure["total_us"][2] > 0.0


def test_what_lies_is_not_believed(found: dict[str, Any]):
    """Zero is the optimum of the first and the last alone."""
    assert column(found, "lying")["status"] == ["SOLVED", "INACCURATE", "SOLVED"]


def test_the_others_are_not_disturbed(found: dict[str, Any]):
    assert column(found, "daqp")["status"] == ["SOLVED"] * 3
    assert advice(found, found["sets"][0]).use.solver == "daqp"


def test_the_page_shows_each_as_what_it_is(found: dict[str, Any]):
    report = page(found)
    section = next(s for s in report.sections if s.title == "problems")
    table = next(i for i in section.items if getattr(i, "caption", "").startswith("Solved (warm)"))
    rows = {row[0]: row for row in table.rows}
    solved, lost = table.columns.index("default"), table.columns.index("lost")
    assert (rows["lying"][solved], rows["lying"][lost]) == (Marked("50 %, 1 wrong", "bad"), 0)
    assert (rows["hanging"][solved], rows["hanging"][lost]) == ("50 %", 1)
    assert (rows["crashing"][solved], rows["crashing"][lost]) == ("50 %", 1)


def test_a_solver_that_cannot_be_sent_to_a_process_is_refused():
    class Local(Solver):
        name = "local"

        def open(self, shape: Shape) -> Session:
            raise AssertionError

    with pytest.raises(InvalidInput, match="local"):
        compare([SMALL], solvers=[Local()], torture=False, growth=False)


@pytest.mark.parametrize("case", CASES)
def test_behind_the_checks_the_default_solver_ends_every_torture_as_it_should(case: str):
    finding = tortured(by_name("pdas"), case, guarded=True)
    assert finding == {"word": CASES[case].wanted, "right": True}
