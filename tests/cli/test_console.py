"""What all verbs share: one bar with the time that is left, lines in a pipe, addresses to click."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from wbc.cli import app, console
from wbc.sim.scenario import trials


def test_a_pipe_gets_a_line_every_ten_seconds_with_what_is_left(monkeypatch, capsys):
    now = 0.0
    monkeypatch.setattr(console, "monotonic", lambda: now)
    with console.progress("running it") as report:
        for (_, one), k in zip(trials(report, range(4)), range(4), strict=True):
            now = 11.0 * k + 5.5
            one(0.5, "half way")
    lines = capsys.readouterr().err.splitlines()
    assert lines == [
        "wbc: running it: 2 of 4, half way, 28 s left, 38 %",
        "wbc: running it: 3 of 4, half way, 17 s left, 62 %",
        "wbc: running it: 4 of 4, half way, 6 s left, 88 %",
    ]


def test_what_an_earlier_life_did_does_not_make_the_rest_look_short(monkeypatch, capsys):
    now = 0.0
    monkeypatch.setattr(console, "monotonic", lambda: now)
    with console.progress("sweeping") as report:
        report(0.5)
        now = 20.0
        report(0.6)
    assert "80 s left" in capsys.readouterr().err.replace("1 min", "80 s")


def test_what_came_before_the_first_report_does_not_make_the_rest_look_long(monkeypatch, capsys):
    now = 0.0
    monkeypatch.setattr(console, "monotonic", lambda: now)
    with console.progress("running") as report:
        now = 60.0
        report(0.0)
        now = 71.0
        report(0.1)
    assert capsys.readouterr().err.splitlines() == ["wbc: running, 0 %", "wbc: running, 2 min left, 10 %"]


def test_of_less_than_a_hundredth_the_rest_is_not_guessed(monkeypatch, capsys):
    times = iter([0.0, 0.0, 11.0, 22.0])
    monkeypatch.setattr(console, "monotonic", lambda: next(times))
    with console.progress("comparing") as report:
        for done in (0.0, 0.001, 0.02):
            report(done)
    assert capsys.readouterr().err.splitlines() == ["wbc: comparing, 0 %", "wbc: comparing, 18 min left, 2 %"]


def test_trials_are_parts_of_the_whole():
    seen = []
    for _, one in trials(lambda done, text="": seen.append((done, text)), "ab"):
        one(1.0)
    assert seen == [(0.0, "1 of 2"), (0.5, "1 of 2"), (0.5, "2 of 2"), (1.0, "2 of 2")]


def test_notes_tell_a_warning_once_and_no_deprecation(capsys):
    with console.notes():
        for _ in range(2):
            warnings.warn("the motors are\n weak", UserWarning, stacklevel=2)
        for kind in (DeprecationWarning, PendingDeprecationWarning):
            warnings.warn("use np.reshape", kind, stacklevel=2)
    assert capsys.readouterr().err == "note: the motors are weak\n"


def test_a_report_is_an_absolute_address_and_opened_when_asked(monkeypatch, capsys, tmp_path: Path):
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    monkeypatch.chdir(tmp_path)
    console.reported(Path("r/report.html"))
    assert capsys.readouterr().out == f"report: {tmp_path / 'r' / 'report.html'}\n" and not opened
    console.reported(Path("r/report.html"), show=True)
    assert opened == [(tmp_path / "r" / "report.html").as_uri()]


@pytest.mark.parametrize(("seconds", "said"), [(0.2, "1 s"), (59.5, "60 s"), (300.0, "5 min"), (7200.0, "2.0 h")])
def test_a_rough_time(seconds: float, said: str):
    assert console.remaining(seconds) == said


def _answered(redirected: str, *words: str, **environment: str) -> int:
    """The exit code of ``wbc WORDS`` in a shell that ends with ``redirected``."""
    line = " ".join(map(shlex.quote, (sys.executable, "-m", "wbc", *words)))
    how = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2]), **environment}
    return subprocess.run(["bash", "-o", "pipefail", "-c", f"{line} {redirected}"], env=how).returncode


@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_reader_that_goes_away_is_no_verdict(unbuffered):
    assert _answered("2>/dev/null | true", "list", PYTHONUNBUFFERED=unbuffered) == console.UNREAD


def test_an_exit_of_a_users_code_keeps_its_number(monkeypatch):
    monkeypatch.setattr(app, "app", lambda **_: sys.exit(3))
    monkeypatch.setattr(warnings, "formatwarning", warnings.formatwarning)
    with pytest.raises(SystemExit) as left:
        app.run_app()
    assert left.value.code == 3


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a full disk to write to")
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_full_disk_is_one_sentence(unbuffered, tmp_path):
    said = tmp_path / "said"
    assert _answered(f">/dev/full 2>{said}", "list", PYTHONUNBUFFERED=unbuffered) == console.BAD_INPUT
    assert said.read_text() == "wbc: the output is not whole: No space left on device\n"


@pytest.mark.parametrize("module", ["wbc.cli.app", "wbc.cli.bench"])
def test_an_interrupt_while_modules_are_imported_is_one_sentence(module):
    """Which takes a second or more: the first time that Ctrl-C is pressed."""
    script = f"""
import sys
class Interrupts:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupts())
from wbc.cli import main
sys.argv = ["wbc", "list"]
main()
"""
    how = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    ended = subprocess.run([sys.executable, "-c", script], env=how, capture_output=True, text=True)
    assert ended.returncode == console.INTERRUPTED
    assert ended.stderr == "wbc: interrupted; nothing was written\n"


@pytest.mark.parametrize("closed", ["2>&-", ">&- 2>&-", ">&- 2>&- <&-"])
def test_closed_streams_change_no_exit_code(closed):
    assert _answered(closed, "run", "nosuch") == console.BAD_INPUT
    assert _answered(closed, "derive", "PR") == 0


def test_a_stdout_that_cannot_encode_a_sign_gets_it_escaped(tmp_path):
    said = tmp_path / "said"
    assert _answered(f"> {said}", "derive", "PR", PYTHONIOENCODING="ascii") == 0
    assert "\\u" in said.read_text("ascii")
