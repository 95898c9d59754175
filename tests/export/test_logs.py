"""Logs for other programs: read back with the readers of those who keep the formats."""

from __future__ import annotations

import json
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.report.conftest import reaching_run, standing_run
from wbc.control.recorder import Run
from wbc.errors import InvalidInput
from wbc.export import to_mcap, to_rerun
from wbc.export.logs import TICK, log
from wbc.models import load
from wbc.models.catalogue import OWN_ROBOTS


def messages(path: Path) -> dict[str, list[tuple[int, dict]]]:
    """The messages of a log by topic, each with its time [ns]."""
    from mcap.reader import make_reader

    found = defaultdict(list)
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None and channel.message_encoding == "json"
            found[channel.topic].append((message.log_time, json.loads(message.data)))
    return found


@pytest.fixture(scope="module")
def logged(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[tuple[int, dict]]]:
    """The log of a humanoid that is pushed."""
    pytest.importorskip("mcap")
    return messages(to_mcap(standing_run(), tmp_path_factory.mktemp("log") / "run.mcap", robot=load("humanoid")))


def test_a_log_has_every_tick_at_its_time_with_names(logged):
    run = standing_run()
    times = [t for t, _ in logged["/tau"]]
    assert times == [round(1e9 * t) for t in run["t"]]
    knee = run.meta["joint_names"].index("left_knee")
    read = [message["left_knee"] for _, message in logged["/tau"]]
    assert np.allclose(read, run["tau"][:, knee], rtol=1e-8)
    assert logged["/tick"][7][1]["status"] == "infeasible" and logged["/tick"][8][1]["tick_us"] > 0
    assert logged["/q"][0][1]["base_quaternion_w"] == pytest.approx(run["q"][0, 6])


@given(
    names=st.lists(st.text(st.sampled_from("a.[] '/é"), min_size=1, max_size=8), min_size=2, max_size=2, unique=True)
)
def test_names_are_whatever_their_users_chose(names: list[str]):
    task, own = names
    labels = {"tasks": {task: {"labels": ["x", "x", "y [b]"], "units": ["m", "m", "rad"]}}}
    error = np.arange(6.0).reshape(2, 3)
    about = log(Run({"t": [0.0, 0.1], f"error.{task}": error, own: error[:, 0], f"{own}.": error}, labels), None).series
    assert about[TICK].names == [own] and np.array_equal(about[TICK].values, error[:, :1])
    assert about[f"error.{task}"].names == ["x", "x'", "y [b]"] and about[f"error.{task}"].units == ["m", "m", "rad"]
    assert about[f"{own}."].names == ["0", "1", "2"] and np.array_equal(about[f"{own}."].values, error)


def test_a_log_of_a_run_that_begins_before_zero_counts_from_its_beginning(tmp_path):
    pytest.importorskip("mcap")
    run, robot = reaching_run(), load("arm")
    early = Run({**run.columns, "t": run["t"] - 0.25}, run.meta)
    told, wanted = (messages(to_mcap(one, tmp_path / "run.mcap", robot=robot)) for one in (early, run))
    assert {k: [t for t, _ in some] for k, some in told.items()} == {
        k: [t for t, _ in some] for k, some in wanted.items()
    }


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("rows", [[0], [5, 6], [59], range(60)])
def test_a_time_that_is_not_finite_is_taken_from_those_beside_it(rows: list[int], bad: float, tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    run = reaching_run()
    t = run["t"].copy()
    t[rows] = bad
    wanted = dict(enumerate(round(1e9 * time) for time in run["t"]))
    path = to_mcap(Run({**run.columns, "t": t}, run.meta), tmp_path / "run.mcap", robot=load("arm"))
    told = [time for time, _ in messages(path)["/tick"]]
    assert told == sorted(told) and len(told) == 60
    assert all(told[k] == wanted[k] for k in set(wanted) - set(rows))


def test_a_time_that_the_format_cannot_tell_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    run = reaching_run()
    with pytest.raises(InvalidInput, match="an MCAP log counts at most"):
        to_mcap(Run({**run.columns, "t": run["t"] * 1e12}, run.meta), tmp_path / "run.mcap")


def test_gaps_are_null_and_active_rows_have_names(logged):
    assert logged["/tick"][7][1]["distance.CenterOfMass"] is None
    name = "TorqueLimits: left_knee, upper"
    assert logged["/active"][40][1][name] == 7.5 and logged["/active"][10][1][name] is None


def test_the_scene_of_a_log_moves_with_the_robot(logged):
    run, robot = standing_run(), load("humanoid")
    times = np.array([t for t, _ in logged["/tf"]])
    assert np.diff(times).max() <= 20_000_000 and times[-1] == round(1e9 * run["t"][-1])
    state = robot.state()
    state.update(0.0, run["q"][-1], np.zeros(robot.nv))
    last = {one["child_frame_id"]: one for one in logged["/tf"][-1][1]["transforms"]}
    for link, pose in last.items():
        assert np.allclose([pose["translation"][k] for k in "xyz"], state.frame(link).position, atol=1e-9)
    ((_, body),) = logged["/robot"]
    assert {entity["frame_id"] for entity in body["entities"]} == set(last)
    assert all(len(e["triangles"][0]["indices"]) % 3 == 0 and e["triangles"][0]["points"] for e in body["entities"])


def test_an_arrow_of_a_log_lies_along_the_push(logged):
    (entity,) = (e for e in logged["/marks"][20][1]["entities"] if e["id"] == "push")
    (arrow,) = entity["arrows"]
    turn = [arrow["pose"]["orientation"][k] for k in "wxyz"]
    w, x, y, z = turn
    along = [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)]
    assert np.allclose(along, [0, 1, 0], atol=1e-9) and np.isclose(np.linalg.norm(turn), 1.0)
    assert arrow["shaft_length"] + arrow["head_length"] == pytest.approx(0.5)


def test_no_frame_of_a_log_carries_itself(tmp_path: Path):
    pytest.importorskip("mcap")
    urdf = tmp_path / "arm.urdf"
    urdf.write_text((OWN_ROBOTS / "arm.urdf").read_text().replace('"base"', '"world"'))
    log = messages(to_mcap(reaching_run(), tmp_path / "run.mcap", robot=load(urdf)))
    frames = [one for _, message in log["/tf"] for one in message["transforms"]]
    children = {one["child_frame_id"] for one in frames}
    assert "world" in children and not children & {one["parent_frame_id"] for one in frames}


def test_a_log_without_a_robot_has_the_numbers_alone(tmp_path: Path):
    pytest.importorskip("mcap")
    assert not {"/tf", "/robot", "/marks"} & set(messages(to_mcap(reaching_run(), tmp_path / "run.mcap")))


def test_a_recording_is_whole_for_reruns_own_reader(tmp_path: Path):
    pytest.importorskip("rerun")
    run = standing_run()
    path = to_rerun(run, tmp_path / "run.rrd", robot=load("humanoid"))
    tool = [sys.executable, "-m", "rerun", "rrd"]
    subprocess.run([*tool, "verify", path], check=True, capture_output=True)
    printed = subprocess.run([*tool, "print", path], check=True, capture_output=True, text=True).stdout
    for entity in ("/run/tau", "/run/error", "/world/robot/torso", "/world/push", "/status"):
        assert entity in printed, entity
    assert not list(tmp_path.glob(".*"))


def test_a_run_without_ticks_is_refused(tmp_path: Path):
    for write, name in ((to_mcap, "mcap"), (to_rerun, "rerun")):
        pytest.importorskip(name)
        with pytest.raises(InvalidInput, match="no ticks"):
            write(Run({"t": []}, {"dt": 0.01}), tmp_path / "no")


def test_a_run_without_a_period_cannot_be_drawn(tmp_path: Path):
    pytest.importorskip("mcap")
    run = reaching_run()
    del run.meta["dt"]
    with pytest.raises(InvalidInput, match=r"meta\['dt'\] of the run must be a number, not None"):
        to_mcap(run, tmp_path / "no.mcap", robot=load("arm"))
