"""The 3-D replay: one page, silent, offline, and nothing left running."""

from __future__ import annotations

import threading
from pathlib import Path

import pytest

from wbc.models import load
from wbc.report.replay import replay
from wbc.report.shapes import parts
from wbc.report.stills import stills

from .conftest import reaching_run


def test_recording_says_nothing_and_leaves_no_thread(capfd: pytest.CaptureFixture[str]):
    before = set(threading.enumerate())
    robot = load("arm")
    page = replay(reaching_run(), robot, parts(robot), title="made-up")
    assert page.startswith("<!doctype html>") or page.lower().lstrip().startswith("<!doctype html")
    assert "__VISER_EMBED_DATA__" in page
    assert capfd.readouterr() == ("", "")
    assert not {thread for thread in threading.enumerate() if thread.is_alive()} - before


def test_the_replay_of_a_report_lies_beside_it(folder: Path):
    page = (folder / "replay.html").read_text(encoding="utf-8")
    assert 'src="http' not in page and 'href="http' not in page
    assert 0.5e6 < len(page) < 8e6


def test_stills_are_one_picture_of_some_moments():
    robot = load("arm")
    figure = stills(reaching_run(), robot, parts(robot), moments=3)
    assert figure.kind == "png" and figure.data.startswith(b"\x89PNG") and len(figure.data) > 5000
