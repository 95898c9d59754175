"""Whatever stands at a path, it is answered or refused by a typed error, and nothing outside is opened."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import wbc
from tests.models.test_hostile_files import with_shape
from tests.reliability.forked import forked
from wbc.errors import PathRefused
from wbc.models import load
from wbc.report import save_report
from wbc.tasks import Posture

ROBOT = wbc.load("arm")


def recorded() -> wbc.Run:
    """Two ticks."""
    controller = wbc.Controller(ROBOT, wbc.Stack([Posture(ROBOT.q0)]), level=wbc.VelocityLevel())
    recorder = wbc.Recorder(2)
    for k in range(2):
        recorder.tick(controller, 1e-3 * k, ROBOT.q0, np.zeros(ROBOT.nv))
    return recorder.run()


def explained(path: str | Path) -> str:
    """After a tick."""
    controller = wbc.Controller(ROBOT, wbc.Stack([Posture(ROBOT.q0)]), level=wbc.VelocityLevel())
    controller.tick(0.0, ROBOT.q0, np.zeros(ROBOT.nv))
    return controller.explain(save=path)


TAKES_A_PATH: dict[str, Callable[[str | Path], object]] = {
    "load": lambda path: wbc.load(Path(path)),
    "load by text": lambda path: wbc.load(str(path) + ".urdf"),
    "load mjcf": lambda path: wbc.load(str(path) + ".xml"),
    "load(srdf=)": lambda path: wbc.load("arm", srdf=path),
    "load(packages=)": lambda path: wbc.load("arm", packages=[path]),
    "Run.load": wbc.Run.load,
    "Run.save": lambda path: recorded().save(path),
    "Run.to_csv": lambda path: recorded().to_csv(path),
    "QP.load": wbc.QP.load,
    "QP.save": lambda path: wbc.QP([[1.0]], [0.0]).save(path),
    "explain(save=)": explained,
    "save_report": lambda path: save_report(recorded(), path, robot=ROBOT),
}
PLACES = ("too long", "a part too long", "zero byte", "empty", "circle of links", "below a file", "a folder", "a pipe",
          "a device", "missing folder", "surrogate")  # fmt: skip


def place(kind: str, folder: Path) -> str:
    """A path as users, programs and file systems make them."""
    (folder / "file").write_text("nothing")
    if kind == "circle of links":
        (folder / "one").symlink_to(folder / "two")
        (folder / "two").symlink_to(folder / "one")
    if kind == "a pipe":
        os.mkfifo(folder / "pipe")
    return {
        "too long": str(folder) + "/a" * 4000, "a part too long": str(folder / ("a" * 300)),
        "zero byte": f"{folder}/a\0b", "empty": "", "circle of links": str(folder / "one"),
        "below a file": str(folder / "file" / "below"), "a folder": str(folder), "a pipe": str(folder / "pipe"),
        "a device": "/dev/full", "missing folder": str(folder / "no" / "such"), "surrogate": f"{folder}/\udcff",
    }[kind]  # fmt: skip


@pytest.mark.parametrize("kind", PLACES)
@pytest.mark.parametrize("function", TAKES_A_PATH)
def test_an_odd_path_is_answered_or_refused_by_a_typed_error(
    function: str, kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    outcome = forked(lambda: TAKES_A_PATH[function](place(kind, tmp_path)))
    assert outcome.kind in ("answered", "refused"), outcome
    assert len(outcome.text) < 1000, "a message is read by a person"


WAYS_OUT = ("../../elsewhere/secret.stl", "file://{outside}/secret.stl", "package://my_robot/../elsewhere/secret.stl",
            "link.stl")  # fmt: skip


@pytest.mark.parametrize("way", WAYS_OUT)
def test_nothing_outside_is_opened(way: str, tmp_path: Path):
    home, outside = tmp_path / "my_robot" / "urdf", tmp_path / "elsewhere"
    home.mkdir(parents=True)
    outside.mkdir()
    (outside / "secret.stl").write_text("solid secret")
    (home / "link.stl").symlink_to(outside / "secret.stl")
    path = home / "robot.urdf"
    path.write_text(with_shape(f'<mesh filename="{way.format(outside=outside)}"/>'))

    def opened() -> list[str]:
        places: list[str] = []
        sys.addaudithook(lambda event, words: places.append(str(words[0])) if event == "open" else None)
        with pytest.raises(PathRefused):
            load(path, packages=[tmp_path / "my_robot"])
        assert any(place.endswith("robot.urdf") for place in places), "the hook sees what is opened"
        return [place for place in places if "elsewhere" in place or place.endswith("link.stl")]

    assert forked(opened) == ("answered", "[]")
