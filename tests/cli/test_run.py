"""``wbc run``: a verdict, a report, one JSON object; bad input is one sentence and leaves nothing behind."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wbc.control.recorder import Run
from wbc.report.record import plain


def test_a_run_ends_with_its_verdict_and_the_path_of_its_report(wbc, waving, tmp_path):
    answer = wbc("run", waving)
    assert answer.code == 0
    assert "it waves\t1\t< 2 Hz\tyes\t" in answer.out
    path = tmp_path / answer.out.strip().splitlines()[-1].removeprefix("report: ")
    assert path.name == "report.html" and path.is_file() and path.parent.parent == tmp_path / "runs"
    assert re.fullmatch(r"wave-\d{8}-\d{6}", path.parent.name)


def test_the_report_folder_holds_page_text_replay_and_record(wbc, waving, tmp_path):
    assert wbc("run", waving, "--out", "here", "--set", "amplitude=0.2").code == 0
    names = {path.name for path in (tmp_path / "here").iterdir()}
    assert names == {"report.html", "report.md", "figures", "run.npz", "meta.json"}
    run = Run.load(tmp_path / "here")
    assert run.rows == 40 and run.meta["parameters"]["amplitude"] == 0.2


def test_json_is_one_object_with_nothing_around_it(wbc, waving, tmp_path):
    answer = wbc(
        "run", waving, "--json", "--set", "good=no", "--duration", "0.1", "--out", "report", "--plant", "paper"
    )
    assert answer.code == 1
    assert answer.out.count("\n") == 1
    data = json.loads(answer.out, parse_constant=lambda word: pytest.fail(f"{word} is not JSON"))
    assert data == {
        "scenario": "wave",
        "ok": False,
        "seconds": 0.1,
        "demands": [
            {
                "demand": "it waves",
                "value": 1.0,
                "relation": ">",
                "bound": 2.0,
                "unit": "Hz",
                "ok": False,
                "at": None,
                "part": "",
                "plot": "",
            }
        ],
        "ticks": 10,
        "late_ticks": 0,
        "tick_us": {"median": 15.0, "p99": 19.9, "max": 20.0},
        "violations": {"joint velocity": 0.0, "joint position": 0.0},
        "tracking": {"Position[tool]": {"rms": pytest.approx(3**0.5 * 1e-3), "max": pytest.approx(3**0.5 * 1e-3)}},
        "statuses": {"SOLVED": 10},
        "report": str(tmp_path / "report" / "report.html"),
        "figures": {"waves": 2, "never": None, "path": [0.0, 1.0]},
    }
    assert "a scenario that chatters" in answer.err


def test_a_malformed_urdf_is_one_sentence_that_names_the_file(wbc, waving, tmp_path):
    (tmp_path / "bad.urdf").write_text("<robot name='x'><link name='a'></robot>")
    answer = wbc("run", waving, "--set", f"robot={tmp_path / 'bad.urdf'}")
    assert answer.code == 2 and "bad.urdf" in answer.err
    assert [path.name for path in tmp_path.iterdir()] == ["bad.urdf"]


def test_a_mesh_outside_the_folder_is_refused(wbc, waving, tmp_path):
    mesh = "<visual><geometry><mesh filename='../../../etc/secret.stl'/></geometry></visual>"
    joint = "<joint name='j' type='revolute'><parent link='a'/><child link='b'/>"
    limit = "<axis xyz='0 0 1'/><limit lower='-1' upper='1' velocity='1' effort='1'/></joint>"
    links = f"<link name='a'>{mesh}</link><link name='b'/>"
    (tmp_path / "arm.urdf").write_text(f"<robot name='x'>{links}{joint}{limit}</robot>")
    answer = wbc("run", waving, "--set", f"robot={tmp_path / 'arm.urdf'}")
    assert answer.code == 2 and "outside the folders" in answer.err
    assert [path.name for path in tmp_path.iterdir()] == ["arm.urdf"]


def test_a_folder_with_something_else_in_it_is_refused_before_any_work(wbc, waving, tmp_path):
    (tmp_path / "thesis").mkdir()
    (tmp_path / "thesis" / "chapter.tex").touch()
    answer = wbc("run", waving, "--out", "thesis")
    assert answer.code == 2 and "holds something else" in answer.err and "chatters" not in answer.err


def test_an_interrupted_run_exits_130_and_leaves_nothing(wbc, waving, tmp_path):
    answer = wbc("run", waving, "--set", "ends=interrupted", "--out", "report")
    assert answer.code == 130 and "interrupted" in answer.err
    assert list(tmp_path.iterdir()) == []


INTERRUPTED = """
import os, signal
from pathlib import Path
from tasks import JointVelocityLimits, Position
import wbc
from wbc.report import measure
from wbc.sim.plant import IntegratorPlant
from wbc.sim.scenario import Check, Scenario, ScenarioResult, Setup

signal.signal(signal.SIGINT, signal.default_int_handler)  # it is ignored in what a shell starts in the background

class Reach(Scenario):
    name, summary, duration = "reach", "an arm reaches until Ctrl-C", 2.0

    def build(self, p):
        robot = wbc.load("arm")
        stack = wbc.Stack([Position("tool", target=[0.4, 0.2, 0.5])], subject_to=[JointVelocityLimits()])
        stop = lambda t: os.kill(os.getpid(), signal.SIGINT) if t > 0.0995 else None
        plant = IntegratorPlant(robot, level="velocity")
        return Setup(stack=stack, plant=plant, level=wbc.VelocityLevel(), before_tick=stop)

    def judge(self, trials, p):
        (trial,) = trials
        return ScenarioResult(trial.run, True, {}, {}, [Check("never reached", 1.0, "=", 1.0)], robot=trial.robot)
"""


@pytest.fixture
def elsewhere() -> Iterator[Any]:
    """What SIGTERM does outside of commands, here nothing."""
    before = signal.signal(signal.SIGTERM, signal.SIG_IGN)
    yield signal.SIG_IGN
    signal.signal(signal.SIGTERM, before)


@pytest.mark.parametrize("end", ["SIGINT", "SIGTERM"])
def test_ctrl_c_and_its_like_keep_what_was_recorded_with_its_report(wbc, tmp_path, elsewhere, end: str):
    (tmp_path / "own.py").write_text(INTERRUPTED.replace("signal.SIGINT) if", f"signal.{end}) if"))
    answer = wbc("run", "own.py:Reach", "--out", "report")
    assert signal.getsignal(signal.SIGTERM) is elsewhere
    assert answer.code == 130 and "interrupted at t = 0.100 s; the run so far is in report" in answer.err
    run = Run.load(tmp_path / "report")
    assert run.rows == 100 and run.meta["ended"] == "interrupted at t = 0.100 s"
    assert "interrupted at t = 0.100 s" in (tmp_path / "report" / "report.md").read_text()
    assert (tmp_path / "report" / "report.html").is_file()


JUDGES = """
import wbc
from tasks import JointVelocityLimits, Position
from wbc.sim.plant import IntegratorPlant
from wbc.sim.scenario import Scenario, Setup

class Reach(Scenario):
    name, summary, duration = "reach", "an arm reaches", 0.02

    def cases(self, p):
        return {"near": {"x": 0.4}, "far": {"x": 0.5}}

    def build(self, p):
        robot = wbc.load("arm")
        stack = wbc.Stack([Position("tool", target=[p["x"], 0.2, 0.5])], subject_to=[JointVelocityLimits()])
        return Setup(stack=stack, plant=IntegratorPlant(robot, level="velocity"), level=wbc.VelocityLevel())

    def judge(self, trials, p):
"""


@pytest.mark.parametrize(
    ("judge", "said", "kept"),
    [
        ("near, far = trials; near.error('Position').max(axis=1)", "AxisError: axis 1 is out", ["near", "far"]),
        ("for trial in trials: trial.run['velocity']", "UnknownColumn: there is no column 'velocity'", ["near"]),
        ("next(trials).error('Postion')", "UnknownColumn: there is no column 'error.Postion'; did", ["near"]),
    ],
)  # fmt: skip
def test_an_error_in_the_judge_is_named_and_keeps_the_runs(wbc, tmp_path, judge: str, said: str, kept: list[str]):
    (tmp_path / "own.py").write_text(f"{JUDGES}        {judge}\n")
    answer = wbc("run", "own.py:Reach", "--out", "report")
    assert answer.code == 2 and not answer.out
    line = JUDGES.count("\n") + 1
    assert f"wbc: the scenario reach raised {said}" in answer.err
    assert f"(own.py:{line}); the run is in report" in answer.err and "Traceback" not in answer.err
    run = Run.load(tmp_path / "report")
    assert run.rows == 20 and run.meta["judged"]["ok"] is False
    beside = [Run.load(path) for path in sorted((tmp_path / "report" / "beside").glob("*"))]
    assert [one.meta.get("called", "") for one in (run, *beside)] == (kept if len(kept) > 1 else [""])
    assert said.partition(":")[0] in (tmp_path / "report" / "report.md").read_text()
    again = wbc("run", "own.py:Reach", "--out", "report")
    assert again.code == 2, "the folder of a run without a verdict can be replaced"


def test_an_error_before_any_run_leaves_nothing(wbc, tmp_path):
    (tmp_path / "own.py").write_text(f"{JUDGES}        1 / 0\n")
    answer = wbc("run", "own.py:Reach", "--out", "report")
    assert answer.code == 2 and "ZeroDivisionError" in answer.err
    assert not (tmp_path / "report").exists()


BREAKS = """
class Breaks(wbc.Component):
    def before(self, state, last, plan):
        raise ValueError("no signal")
"""


@pytest.mark.parametrize(("members", "kept"), [
    ("components=[Breaks()]", False),
    ("subject_to=[JointVelocityLimits(0.1), Position('tool', target=[9.0, 0.0, 0.0], name='far').exactly()]", True),
])  # fmt: skip
def test_the_qp_of_a_failure_is_named_where_it_was_written(wbc, tmp_path, members: str, kept: bool):
    """A tick in which a component failed has no QP."""
    own = JUDGES.replace("\nclass", f"{BREAKS}\nclass").replace("subject_to=[JointVelocityLimits()]", members)
    verdict = "from wbc.tasks.scenarios import judge; return judge.verdict(list(trials), [])"
    (tmp_path / "own.py").write_text(f"{own}        {verdict}\n")
    answer = wbc("run", "own.py:Reach", "--out", "report")
    assert (tmp_path / "report" / "failed.npz").is_file() is kept, answer.err
    assert ("its QP: wbc explain report/failed.npz" in answer.out) is ("wbc explain" in answer.out) is kept


def test_ctrl_c_while_the_report_is_drawn_keeps_the_run(wbc, waving, tmp_path, monkeypatch: pytest.MonkeyPatch):
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as drawing:
        drawing.setattr("wbc.report.folder.html", interrupted)
        answer = wbc("run", waving, "--out", "my report")
    folder = tmp_path / "my report"
    assert answer.code == 130 and "`wbc report run 'my report'` draws its report" in answer.err
    assert not (folder / "report.html").exists() and Run.load(folder).rows == 40
    again = wbc("report", "run", "my report")
    assert again.code == 0 and "wave" in (folder / "report.html").read_text()
    assert "it waves" in (folder / "report.md").read_text()


def test_a_folder_that_cannot_be_written_is_refused_before_the_run(wbc, waving):
    answer = wbc("run", waving, "--out", "/proc/nowhere/report")
    assert answer.code == 2 and "/proc/nowhere/report cannot be written" in answer.err
    assert "chatters" not in answer.err


def test_the_scenarios_of_a_file_are_listed_as_all_are_and_nothing_runs(wbc, waving, tmp_path):
    (tmp_path / "own.py").write_text(INTERRUPTED + "\nclass Bow(Reach):\n    name, summary = 'bow', 'an arm bows'\n")
    answer = wbc("run", "own.py")
    assert answer.code == 0 and not answer.err
    lines = [line.split() for line in answer.out.splitlines()]
    assert ["own.py:Reach", *"an arm reaches until Ctrl-C".split()] in lines
    assert ["own.py:Bow", *"an arm bows".split()] in lines
    assert lines[0] == "Scenarios (wbc run NAME)".split() and lines[1][1] == "name"
    assert sorted(path.name for path in tmp_path.iterdir() if path.suffix) == ["own.py"]
    answer = wbc("run", "own.py", "--json")
    assert answer.code == 2 and "name the scenario to run; wbc run own.py" in answer.err and not answer.out
    (tmp_path / "none.py").write_text("x = 1\n")
    answer = wbc("run", "none.py")
    assert answer.code == 2 and "'none.py' has no scenario" in answer.err


def test_the_package_of_the_command_line_runs_as_the_command_does(tmp_path):
    words = [sys.executable, "-m", "wbc.cli", "--version"]
    done = subprocess.run(
        words,
        cwd=tmp_path,
        env={"PYTHONPATH": str(Path(__file__).parents[2])},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0 and done.stdout.strip()


def test_a_bug_keeps_its_traceback_leaves_nothing_and_is_no_verdict(wbc, waving, tmp_path):
    """Exit code 1 says that a demand was not met."""
    answer = wbc("run", waving, "--set", "ends=with a bug")
    assert answer.code == 2 and "Traceback" in answer.err and "RuntimeError: a bug" in answer.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("package", ["jinja2", "matplotlib", "trimesh"])
def test_a_missing_extra_is_said_before_any_work(wbc, waving, monkeypatch, package):
    monkeypatch.setattr("wbc.checks.find_spec", lambda name: None if name == package else object())
    answer = wbc("run", waving)
    assert answer.code == 2 and f"a report needs {package}; from a clone of wbc: pip install '.[report]'" in answer.err
    assert "chatters" not in answer.err


def test_the_module_runs_as_the_command_does(waving, tmp_path):
    words = [sys.executable, "-m", "wbc", "run", waving, "--set", "robot=nobody"]
    root = Path(__file__).parents[2]
    done = subprocess.run(
        words, cwd=tmp_path, env={"PYTHONPATH": str(root)}, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout) == (2, "")
    assert "there is no robot 'nobody'" in done.stderr


def test_plain_values_are_what_json_has():
    value = {"a": np.float64("inf"), "b": (np.int64(2), np.bool_(True)), 3: np.array([[1.0, np.nan]]), "c": Path("x")}
    assert plain(value) == {"a": None, "b": [2, True], "3": [[1.0, None]], "c": "x"}
    json.dumps(plain(value), allow_nan=False)


def test_without_a_scenario_what_there_is_is_listed_and_nothing_runs(wbc, waving, tmp_path, monkeypatch):
    from wbc.sim import scenario

    monkeypatch.setattr(scenario, "scenarios", lambda: {"wave": scenario.find(waving)})
    answer = wbc("run")
    assert answer.code == 0 and "wbc run NAME" in answer.out and "an arm waves" in answer.out
    assert list(tmp_path.iterdir()) == []
    for words in (("--json",), ("--duration", "1"), ("--set", "a=1")):
        answer = wbc("run", *words)
        assert answer.code == 2 and "name the scenario" in answer.err and not answer.out


def test_what_libraries_print_meanwhile_is_not_in_the_answer(tmp_path: Path):
    program = """
import ctypes, os
from wbc.cli.console import on_stderr
print("before")
with on_stderr():
    print("python")
    os.write(1, b"descriptor ")
    ctypes.CDLL(None).puts(b"buffered by C")
print("after")
"""
    root = str(Path(__file__).parents[2])
    words = [sys.executable, "-c", program]
    done = subprocess.run(words, cwd=tmp_path, env={"PYTHONPATH": root}, capture_output=True, text=True, check=True)
    assert done.stdout == "before\nafter\n"
    assert all(word in done.stderr for word in ("python", "descriptor", "buffered by C"))
