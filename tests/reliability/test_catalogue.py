"""Every bad input is refused by name or answered within bounds: none kills the process, none hangs it."""

from __future__ import annotations

from collections import Counter

import pytest

import wbc
from tests.reliability.catalogue import cases, fault
from tests.reliability.forked import Case, Outcome, forked
from tests.seeds import generator

CASES = cases()
SOLVED = cases(solved=True)
ONLINE = [name for name in wbc.solvers() if name != "pdas"]


def test_the_catalogue_is_long_and_names_each_case_once():
    assert len(CASES) >= 150
    assert not [name for name, count in Counter(case.name for case in CASES).items() if count > 1]
    assert min(Counter(case.name.partition(":")[0] for case in CASES).values()) >= 40


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("case", CASES, ids=[case.name for case in CASES])
def test_a_bad_input_ends_well(case: Case):
    assert fault(case, forked(lambda: case.call("pdas"))) == ""


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("solver", ONLINE)
def test_bad_inputs_that_the_week_draws_end_well_on_every_solver(solver: str):
    for i in generator("catalogue", solver).choice(len(SOLVED), 6, replace=False):
        case = SOLVED[i]
        assert fault(case, forked(lambda case=case: case.call(solver))) == "", case.name


@pytest.mark.deep
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("solver", ONLINE)
@pytest.mark.parametrize("case", SOLVED, ids=lambda case: case.name)
def test_a_bad_input_ends_well_on_every_solver(case: Case, solver: str):
    assert fault(case, forked(lambda: case.call(solver))) == ""


def test_faults_are_told_from_good_ends():
    refusal, check = Case("", lambda solver: None, ("dt", "-1")), Case("", lambda solver: None, None)
    assert fault(refusal, Outcome("refused", "InvalidInput: dt is -1")) == ""
    assert "does not say ['-1']" in fault(refusal, Outcome("refused", "InvalidInput: dt is wrong"))
    for kind in ("answered", "raised", "died", "hung"):
        assert fault(refusal, Outcome(kind, ""))
    assert fault(check, Outcome("answered", "fine")) == ""
    assert fault(check, Outcome("refused", "why"))


def test_a_fork_tells_how_a_call_ended(monkeypatch: pytest.MonkeyPatch):
    import os
    import signal
    import time

    monkeypatch.setattr("tests.reliability.forked.PATIENCE", 0.5)

    def refuse() -> None:
        raise wbc.errors.InvalidInput("no")

    assert forked(lambda: 3) == ("answered", "3")
    assert forked(refuse) == ("refused", "InvalidInput: no")
    assert forked(lambda: 1 / 0).kind == "raised"
    assert forked(lambda: os.kill(os.getpid(), signal.SIGKILL)) == ("died", "signal 9")
    assert forked(lambda: time.sleep(60.0)).kind == "hung"
