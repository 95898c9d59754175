"""A recorded run is made into a report from the record alone: one's own, and a scenario's once more."""

from __future__ import annotations

import gzip
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import wbc
from wbc.control.recorder import Run
from wbc.errors import InvalidInput
from wbc.models.collision import Obstacle
from wbc.models.geometry import Box, Cylinder, Sphere
from wbc.report import run_report, save_report
from wbc.report.document import Address, Bar, Bound, Curve, Figure, Link, Map, Marked, Plot, Section, Strip, Table, Text
from wbc.report.kept import OBSTACLES_FILE, SECTIONS_FILE, keep_obstacles, kept_obstacles
from wbc.report.record import beside, judged, judgement, report_again, write_run
from wbc.sim.scenario import ScenarioResult

from .conftest import reaching_run, standing_run


def test_a_run_of_ones_own_becomes_a_folder_with_a_report(tmp_path: Path):
    run = reaching_run()
    del run.meta["scenario"], run.meta["versions"]
    page = save_report(run, tmp_path / "mine", robot=wbc.load("arm"))
    assert page == tmp_path / "mine" / "report.html"
    assert "data-scene" in page.read_text(encoding="utf-8")
    text = (tmp_path / "mine" / "report.md").read_text(encoding="utf-8")
    assert "Arm ran a recorded loop for 0.6 s" in text and "every tick solved and certified." in text
    assert "every demand" not in text and "| numpy |" in text
    np.testing.assert_array_equal(Run.load(tmp_path / "mine")["q"], run["q"])
    assert save_report(run, tmp_path / "mine") == page  # a report is replaced
    assert "data-scene" not in page.read_text(encoding="utf-8").split("<script>")[0]


def test_what_a_scenario_said_of_its_run_is_said_again(standing: ScenarioResult, tmp_path: Path):
    standing.run.meta.update(judgement(standing))
    save_report(standing.run, tmp_path / "r")
    again = judged(Run.load(tmp_path / "r"), standing.robot)
    assert again.ok == standing.ok and list(again.verdict) == list(standing.verdict)
    assert dict(again.violations) == dict(standing.violations) and dict(again.figures) == dict(standing.figures)
    assert again.tracking.keys() == standing.tracking.keys()


def test_a_report_made_again_is_the_same_and_leaves_the_record_alone(tmp_path: Path):
    folder = tmp_path / "r"
    save_report(standing_run(), folder, robot=wbc.load("humanoid"))
    before = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    (folder / "report.md").unlink()
    (folder / "figures" / "old.svg").write_text("of a report before")
    page, drawn = report_again(folder)
    assert page == folder / "report.html" and drawn is not None and drawn.name == "humanoid"
    assert before == {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    assert not (folder / "figures" / "old.svg").exists()


@pytest.mark.parametrize("error", [KeyboardInterrupt, OSError("No space left on device")])
def test_a_report_that_is_made_again_and_interrupted_stays_as_it_was(
    error: type[BaseException] | BaseException, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "r"
    save_report(standing_run(), folder, robot=wbc.load("humanoid"))
    for path in (folder / "report.html", folder / "report.md", *(folder / "figures").iterdir()):
        path.write_text("of the report before")
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    writing = Path.write_bytes

    def stopped(path: Path, data: bytes) -> int:
        if path.suffix == ".html":
            raise error
        return writing(path, data)

    monkeypatch.setattr(Path, "write_bytes", stopped)
    monkeypatch.setattr(Path, "write_text", lambda path, text, **_: stopped(path, text.encode()))
    with pytest.raises((KeyboardInterrupt, InvalidInput)):
        report_again(folder)
    assert before == {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_run_saved_without_a_report_gets_one(tmp_path: Path):
    folder = reaching_run().save(tmp_path / "r")
    (folder / "notes.txt").write_text("mine")
    page, drawn = report_again(folder)
    assert page.is_file() and (folder / "notes.txt").read_text() == "mine" and drawn is not None


@pytest.mark.parametrize("name", ["nobody", "humanoid", "/etc/hostname", "../robot.urdf"])
def test_a_robot_that_the_name_does_not_give_is_not_drawn(name: str, tmp_path: Path):
    run = reaching_run()
    run.meta["robot"] = name
    page, drawn = report_again(run.save(tmp_path / "r"))
    assert drawn is None and page.is_file() and "## Motion" not in (tmp_path / "r" / "report.md").read_text()
    again, drawn = report_again(tmp_path / "r", robot=wbc.load("arm"))
    assert drawn is not None and "## Motion" in (again.parent / "report.md").read_text()
    with pytest.raises(InvalidInput, match=r"report.html shows the robot .* give the robot \(--robot NAME or FILE\)"):
        report_again(tmp_path / "r")
    assert "## Motion" in (again.parent / "report.md").read_text()


def test_what_is_no_run_is_refused_by_name(tmp_path: Path):
    with pytest.raises(InvalidInput, match=r"the run has no dt, joint_names, statuses, q, v, status; "):
        save_report(Run({"t": np.zeros(3)}), tmp_path / "r")
    with pytest.raises(InvalidInput, match="has no ticks"):
        save_report(reaching_run(0), tmp_path / "r")
    with pytest.raises(InvalidInput, match="robot is humanoid, with other joints"):
        save_report(reaching_run(), tmp_path / "r", robot=wbc.load("humanoid"))
    with pytest.raises(InvalidInput, match="not the folder of a run"):
        report_again(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_verdict_that_somebody_broke_is_refused(standing: ScenarioResult, tmp_path: Path):
    for broken in ({"ok": True}, {"ok": 1, "verdict": [1], "violations": {}, "tracking": {}, "figures": {}}, {}):
        run = Run(standing.run.columns, {**standing.run.meta, "judged": broken})
        folder = run.save(tmp_path / "r")
        json.loads((folder / "meta.json").read_text())
        with pytest.raises(InvalidInput, match="judged"):
            report_again(folder)


def test_runs_beside_a_run_are_saved_with_it_and_seen_through(standing: ScenarioResult, tmp_path: Path):
    both = replace(standing, run=standing_run(), called="with", beside={"without": standing_run(60)})
    write_run(both, tmp_path)
    saved = Run.load(tmp_path)
    found = beside(tmp_path, saved)
    assert (
        saved.meta["called"] == "with" and list(found) == ["without"] and found["without"].meta["called"] == "without"
    )
    np.testing.assert_array_equal(found["without"]["q"], standing_run(60)["q"])
    scene = run_report(both).scene
    assert scene is not None and [ghost["label"] for ghost in scene.ghosts] == ["without"]
    before = (tmp_path / "report.html").read_bytes()
    page, _ = report_again(tmp_path)
    assert page.read_bytes() == before


def test_obstacles_are_drawn_again_where_they_were(standing: ScenarioResult, tmp_path: Path):
    def swings(t: float) -> pin.SE3:
        return pin.SE3(pin.rpy.rpyToMatrix(0.0, t, 0.1), np.array([1.0, np.sin(t), 0.3]))

    around = [
        Obstacle("post", Cylinder(0.1, 1.0), swings(0.0)), Obstacle("wall", Box((1.0, 0.1, 2.0)), swings(1.0)),
        Obstacle("ball", Sphere(0.2), swings),
    ]  # fmt: skip
    write_run(replace(standing, run=standing_run(60), beside={"longer": standing_run()}, obstacles=around), tmp_path)
    before = (tmp_path / "report.html").read_bytes()
    page, _ = report_again(tmp_path)
    assert page.read_bytes() == before
    for old, new in zip(around, kept_obstacles(tmp_path), strict=True):
        assert (old.name, old.shape) == (new.name, new.shape)
        for t in standing_run()["t"]:
            assert np.array_equal(old.at(float(t)).homogeneous, new.at(float(t)).homogeneous)


def test_a_loop_of_ones_own_has_obstacles_too(tmp_path: Path):
    arm, post = wbc.load("arm"), Obstacle("post", Cylinder(0.1, 1.0), pin.SE3.Identity())
    alone = save_report(reaching_run(), tmp_path / "r", robot=arm).read_bytes()
    assert not kept_obstacles(tmp_path / "r")
    before = save_report(reaching_run(), tmp_path / "r", robot=arm, obstacles=[post]).read_bytes()
    assert before != alone and [one.name for one in kept_obstacles(tmp_path / "r")] == ["post"]
    again, _ = report_again(tmp_path / "r")
    assert again.read_bytes() == before


def test_obstacles_that_somebody_broke_are_refused(tmp_path: Path):
    keep_obstacles([Obstacle("ball", Sphere(0.2), pin.SE3.Identity())], np.zeros(1), tmp_path)
    path = tmp_path / OBSTACLES_FILE
    (one,) = json.loads(gzip.decompress(path.read_bytes()))
    for broken in ({**one, "t": {**one["t"], "of": "", "shape": [0]}}, {**one, "name": {"is": "Ball"}}, 3):
        path.write_bytes(gzip.compress(json.dumps([broken]).encode()))
        with pytest.raises(InvalidInput, match="cannot be read"):
            kept_obstacles(tmp_path)


def test_what_a_scenario_shows_is_made_again_to_the_bit(reaching: ScenarioResult, tmp_path: Path):
    t = 0.01 * np.arange(300.0)
    wave = np.where(t > 2.9, np.nan, np.sin(t))
    curves = [Curve("a", wave, run=0), Curve("b", wave[::2], run=1, dash=1, x=t[::2], shown=False)]
    bounds, strips = [Bound(0.5, "here"), Bound(1.0, "then", "x")], [Strip("on", [(0.0, 0.5), (1.0, 1.5)], 1)]
    cells = [1, 2.5, float("nan"), float("inf"), None, True, np.float64(0.1), "é | <b>",
             Bar(0.0, 0.5, "x", 0.25, False), Link("there", "wave", 0.5), Marked("bad", "bad"),
             Address("page", "a b/report.html")]  # fmt: skip
    section = Section("Own", [
        Text("said"), Table(("what", "is"), [(str(k), cell) for k, cell in enumerate(cells)], "all", folded=True),
        Plot("wave", "Wave", "m", t, curves, bounds, log="y", wide=True), Plot("when", "When", "", t, strips=strips),
        Figure("dot", "a dot", b"<svg xmlns='http://www.w3.org/2000/svg'/>"),
        Map("way", "Way", "m", t, np.cos(t), np.sin(t), [("edge", np.eye(2))]),
    ])  # fmt: skip
    shows = [section, Section("reaching", [])]
    write_run(replace(reaching, run=reaching_run(), sections=shows), tmp_path)
    before = {path.name: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    assert ">Own</h2>" in before["report.html"].decode()
    report_again(tmp_path)
    assert before == {path.name: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}


@pytest.mark.parametrize(
    "text", ["", "[", "{}", "[1]", '[{"is": "Plot"}]', '[{"is": "Run"}]', '[{"is": "Text", "text": "t"}]',
             '[{"is": "array", "of": "AAAA", "shape": [9], "times": 9}]'],
)  # fmt: skip
def test_sections_that_are_none_are_refused(text: str, tmp_path: Path):
    reaching_run().save(tmp_path)
    (tmp_path / SECTIONS_FILE).write_bytes(gzip.compress(text.encode()))
    with pytest.raises(InvalidInput, match=SECTIONS_FILE):
        report_again(tmp_path)
    (tmp_path / SECTIONS_FILE).write_bytes(b"no gzip")
    with pytest.raises(InvalidInput, match=SECTIONS_FILE):
        report_again(tmp_path)
