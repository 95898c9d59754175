"""``wbc list`` and ``wbc doctor``: what there is, and whether it works."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from wbc import __version__
from wbc.cli import doctor
from wbc.models.catalogue import OWN
from wbc.qp.solvers import SOLVERS, by_name
from wbc.sim import scenario


@pytest.fixture
def wave_is_registered(monkeypatch, waving):
    """One registered scenario."""
    wave = scenario.find(waving)
    monkeypatch.setattr(scenario, "registered", lambda kind: {"wave": wave})


def test_list_names_scenarios_solvers_and_robots(wbc, wave_is_registered):
    answer = wbc("list")
    assert answer.code == 0
    for word in ("wave", "an arm waves", "robot=arm", "pdas", "usable", "humanoid"):
        assert word in answer.out


def test_a_scenario_is_one_whole_line_in_a_pipe(wbc, monkeypatch):
    monkeypatch.setenv("COLUMNS", "60")
    shown = scenario.scenarios()
    lines = {line.split("\t")[1]: line for line in wbc("list").out.splitlines() if line.count("\t") == 4}
    assert set(shown) <= set(lines) and all("  " not in line for line in lines.values())
    for name, one in shown.items():
        group, _, takes, what, _ = lines[name].split("\t")
        assert group == one.group and takes and what == one.summary
    assert lines["W1"].startswith("workloads\t") and "W1" in json.loads(wbc("list", "--json").out)["workloads"]
    groups = [line.split("\t")[0] for line in list(lines.values())[1:]]
    assert groups == sorted(groups) and len(set(groups)) > 3


def test_list_and_doctor_are_json_for_programs(wbc, wave_is_registered, monkeypatch):
    found = json.loads(wbc("list", "--json").out)
    assert found["scenarios"]["wave"]["parameters"]["axis"] == [0.0, 0.0, 1.0]
    assert found["solvers"]["pdas"] == {"usable": True, "package": by_name("pdas").package, "offline": False}
    assert set(OWN) == set(found["robots"]["own"])
    monkeypatch.setattr(doctor, "robots", lambda: iter([doctor.Finding("nobody", "cannot be loaded", good=False)]))
    answer = wbc("doctor", "--json")
    found = json.loads(answer.out)
    assert answer.code == 1 and found["ok"] is False
    assert found["findings"]["Robots"] == [{"what": "nobody", "state": "cannot be loaded", "good": False}]


def test_doctor_finds_what_is_installed_in_order(wbc):
    answer = wbc("doctor")
    assert answer.code == 0, answer.out
    assert all(solver.name in answer.out for solver in SOLVERS)
    assert all(name in answer.out for name in OWN)
    assert f"{doctor.PROBLEMS} of {doctor.PROBLEMS} certified" in answer.out
    assert "everything that is installed works" in answer.out


def test_the_problems_of_the_self_check_have_active_rows():
    answers = [by_name("pdas").solve(doctor.problem(seed)) for seed in range(doctor.PROBLEMS)]
    assert all(answer.status.ok for answer in answers)
    assert sum(np.count_nonzero(answer.z) + np.count_nonzero(answer.z_box) for answer in answers) > doctor.PROBLEMS


def test_a_solver_without_valid_certificates_is_not_as_it_should_be():
    impatient = replace(by_name("daqp"), max_iter=1)
    finding = doctor.checked(impatient, [doctor.problem(seed) for seed in range(3)])
    assert not finding.good and finding.state.startswith("0 of 3 certified")


def test_help_and_version_exit_0(wbc):
    assert wbc("--version").out.strip() == __version__
    for words in ([], ["--help"], ["run", "-h"], ["list", "--help"], ["doctor", "--help"], ["bench", "--help"]):
        answer = wbc(*words)
        assert answer.code == 0 and "Usage" in answer.out
