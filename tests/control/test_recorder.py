"""A record keeps every number it was given, says which it was not given, and survives the disk unchanged."""

from __future__ import annotations

import copy
import json
import os
import pickle
import sys
import tempfile
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

import wbc
from wbc.control.recorder import Recorder, Run, UnknownColumn
from wbc.errors import InvalidInput, WbcError
from wbc.tasks import Posture

names = st.text(st.characters(codec="utf-8", exclude_characters="/\\\0:", exclude_categories=["C"]), min_size=1)
numbers = st.floats(width=64, allow_nan=True)
meta_values = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**53), 2**53) | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)


@st.composite
def tables(draw: st.DrawFn) -> dict[str, np.ndarray]:
    rows = draw(st.integers(0, 5))
    columns = draw(st.lists(names, max_size=4, unique=True))
    shapes = st.sampled_from([(rows,), (rows, 1), (rows, 3)])
    return {name: draw(hnp.arrays(np.float64, draw(shapes), elements=numbers)) for name in columns}


@settings(max_examples=50, deadline=None)
@given(tables(), st.dictionaries(st.text(), meta_values, max_size=4))
def test_a_saved_run_comes_back_bit_for_bit(columns, meta):
    with tempfile.TemporaryDirectory() as folder:
        Run(columns, meta).save(folder)
        loaded = Run.load(folder)
    assert list(loaded) == list(columns)
    for name, values in columns.items():
        assert loaded[name].dtype == values.dtype
        np.testing.assert_array_equal(loaded[name], values)
    assert loaded.meta == meta


def test_columns_named_like_arguments_of_numpy_are_columns_too(tmp_path):
    Run({"file": np.ones(2), "allow_pickle": np.zeros(2)}).save(tmp_path)
    assert set(Run.load(tmp_path)) == {"file", "allow_pickle"}


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 7), st.integers(1, 20))
def test_every_row_is_kept_whatever_the_capacity_and_growth_is_counted(capacity, rows):
    recorder = Recorder(capacity)
    for k in range(rows):
        recorder.append({"t": 0.1 * k, "q": np.array([k, -k], dtype=float), "status": k})
    run = recorder.run()
    np.testing.assert_array_equal(run["t"], 0.1 * np.arange(rows))
    np.testing.assert_array_equal(run["q"], np.outer(np.arange(rows), [1.0, -1.0]))
    np.testing.assert_array_equal(run["status"], np.arange(rows))
    assert recorder.grown == (rows - 1) // capacity


def resident() -> int:
    """Bytes of memory in use."""
    return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1]) * os.sysconf("SC_PAGE_SIZE")


def test_memory_that_is_set_aside_is_not_written():
    """A loop in real time that records ten minutes at 1 kHz would spend a second on it in its first tick."""
    before = resident()
    recorder = Recorder(600_000)
    recorder.append({"t": 0.0, "q": np.zeros(100)})  # 485 MB
    assert recorder.run()["q"].shape == (1, 100)
    assert resident() - before < 50e6


def test_what_a_row_leaves_out_is_nan_and_minus_one_for_integers():
    recorder = Recorder(4)
    recorder.append({"t": 0.0, "f": np.ones(3), "status": 2})
    recorder.append({"t": 1.0})
    recorder.append({"t": 2.0, "f": np.zeros(3), "status": 0})
    run = recorder.run()
    assert np.isnan(run["f"][1]).all() and np.isfinite(run["f"][[0, 2]]).all()
    assert run["status"].tolist() == [2, -1, 0] and run["status"].dtype == np.int64


def test_integers_that_are_rounded_are_no_integers():
    """Such as times in nanoseconds: a column of integers has what was given, to the last digit."""
    for stamp in (2**53 - 1, 2**53, 1_764_400_000_123_456_789, 10**400):
        recorder = Recorder(2)
        if stamp > 1e300:
            with pytest.raises(InvalidInput, match="column 'stamp' must hold numbers"):
                recorder.append({"stamp": stamp})
            continue
        recorder.append({"stamp": stamp})
        column = recorder.run()["stamp"]
        assert column.dtype == (np.int64 if stamp < 2**53 else np.float64) and column[0] == float(stamp)


def test_a_recorded_array_is_a_copy():
    recorder, q = Recorder(2), np.zeros(2)
    recorder.append({"q": q})
    q[:] = 7.0
    assert recorder.run()["q"].tolist() == [[0.0, 0.0]]


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ({"q": np.zeros(3), "t": 1.0}, r"column 'q' has shape \(2,\)"),
        ({"q": 1.0, "t": 1.0}, r"column 'q' has shape \(2,\)"),
        ({"q": np.zeros(2), "t": np.zeros(1)}, r"column 't' has shape \(\)"),
        ({"q": np.zeros(2), "t": "soon"}, r"column 't' must hold numbers"),
        ({"q": np.zeros(2), "tt": 1.0}, r"no column 'tt'; did you mean 't'"),
    ],
)
def test_a_row_unlike_the_first_is_refused_by_name_and_leaves_no_trace(row, message):
    recorder = Recorder(4)
    recorder.append({"q": np.ones(2), "t": 0.0})
    with pytest.raises(WbcError, match=message):
        recorder.append(row)
    recorder.append({"t": 2.0})
    run = recorder.run()
    assert run.rows == 2 and np.isnan(run["q"][1]).all() and run["t"][1] == 2.0


def test_a_mistyped_column_names_the_near_ones():
    run = Run({"plant.slip.left": np.zeros((2, 2)), "t": np.zeros(2)})
    with pytest.raises(UnknownColumn) as caught:
        run["plant.slip.lft"]
    assert str(caught.value) == "there is no column 'plant.slip.lft'; did you mean 'plant.slip.left'?"
    assert run.get("nothing") is None and "nothing" not in run
    assert list(run.matching("plant.slip.")) == ["left"]


def test_columns_of_different_lengths_are_refused():
    with pytest.raises(InvalidInput, match="column 'q' has 3 rows; 't' has 2"):
        Run({"t": np.zeros(2), "q": np.zeros((3, 2))})


def test_objects_never_reach_the_disk(tmp_path):
    with pytest.raises(InvalidInput, match="column 'x' holds Python objects"):
        Run({"x": np.array([object()])}).save(tmp_path)
    with pytest.raises(InvalidInput, match=r"meta\['robot'\] is a object"):
        Run({}, {"robot": object()}).save(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_failing_disk_leaves_the_old_run_whole(tmp_path, monkeypatch):
    Run({"t": np.zeros(2)}, {"try": 1}).save(tmp_path)

    def full(*_args, **_kwargs):
        raise OSError("no space left on device")

    monkeypatch.setattr(np.lib.format, "write_array", full)
    with pytest.raises(InvalidInput, match="no space"):
        Run({"t": np.zeros(5)}, {"try": 2}).save(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["meta.json", "run.npz"]
    assert Run.load(tmp_path).meta == {"try": 1}


def test_a_folder_that_is_not_a_run_is_refused_with_what_is_wrong(tmp_path):
    with pytest.raises(InvalidInput, match=r"is not the folder of a run: it has no run\.npz"):
        Run.load(tmp_path)
    Run({"t": np.zeros(2)}).save(tmp_path)
    (tmp_path / "meta.json").write_text("{")
    with pytest.raises(InvalidInput, match=r"meta\.json is not json"):
        Run.load(tmp_path)
    (tmp_path / "meta.json").write_text("[]")
    with pytest.raises(InvalidInput, match="must hold an object, not a list"):
        Run.load(tmp_path)
    archive = (tmp_path / "run.npz").read_bytes()
    (tmp_path / "run.npz").write_bytes(archive[: len(archive) // 2])
    with pytest.raises(InvalidInput, match=r"run\.npz cannot be read"):
        Run.load(tmp_path)
    with pytest.raises(InvalidInput, match="is a file; it must be a folder"):
        Run({}).save(tmp_path / "meta.json")


def test_a_pickle_is_never_opened(tmp_path):
    np.savez(tmp_path / "run.npz", x=np.array([{"a": 1}], dtype=object))
    (tmp_path / "meta.json").write_text(json.dumps({}))
    with pytest.raises(InvalidInput, match=r"run\.npz cannot be read"):
        Run.load(Path(tmp_path))


def test_a_column_of_gaps_takes_no_room_on_disk(tmp_path: Path):
    gaps = np.full((20_000, 16), np.nan)
    gaps[::100, 0] = np.arange(200)
    noise = np.random.default_rng(0).normal(size=20_000)
    folder = Run({"gaps": gaps, "noise": noise}, {}).save(tmp_path / "r")
    assert (folder / "run.npz").stat().st_size < 1.2 * noise.nbytes < gaps.nbytes / 10
    again = Run.load(folder)
    np.testing.assert_array_equal(again["gaps"], gaps)
    np.testing.assert_array_equal(again["noise"], noise)


@pytest.mark.parametrize("rows", [3, 64, 1000])
def test_columns_are_read_back_to_the_bit(rows: int, tmp_path: Path):
    rng, t = np.random.default_rng(0), 1e-3 * np.arange(rows)
    q = np.sin(np.outer(t, [1.0, 3.0]))
    odd = rng.integers(0, 2**64, (rows, 3), dtype=np.uint64).view(np.float64)  # NaN of every kind, subnormal, huge
    columns = {
        "t": t, "q": q, "noise": rng.normal(size=(rows, 2)), "odd": odd,
        "edges": np.resize([0.0, -0.0, np.inf, -np.inf, np.nan, 5e-324, -1.0], rows), "plant.q": q.copy(),
        "count": np.arange(rows), "on": t > 0.5, "none": np.zeros((rows, 0)), "single": t.astype(np.float32),
        "fortran": np.asfortranarray(rng.normal(size=(rows, 2))), "cube": rng.normal(size=(rows, 2, 2)),
    }  # fmt: skip
    again = Run.load(Run(columns).save(tmp_path))
    assert list(again) == list(columns)
    for name, values in columns.items():
        assert (again[name].dtype, again[name].shape) == (values.dtype, values.shape), name
        assert again[name].tobytes() == values.tobytes(), name
    again["plant.q"][0] = 7.0
    assert again["q"][0, 0] == 0.0  # one array on disk, two in memory


def test_a_smooth_motion_takes_a_third_of_its_room_and_the_same_column_twice_no_more(tmp_path: Path):
    t = 1e-3 * np.arange(10_000)
    q = np.sin(np.outer(t, np.linspace(0.5, 2.0, 10)) + 0.3)
    one = (Run({"q": q}).save(tmp_path / "one") / "run.npz").stat().st_size
    two = (Run({"q": q, "plant.q": q.copy()}).save(tmp_path / "two") / "run.npz").stat().st_size
    assert one < q.nbytes / 3 and two < one + 100


def test_the_name_of_what_says_how_columns_are_stored_is_no_column(tmp_path: Path):
    with pytest.raises(InvalidInput, match=r"no column may be called '\.stored'"):
        Run({".stored": np.zeros(2)}).save(tmp_path)


def test_a_controller_in_the_place_of_the_number_of_rows_is_told_where_it_belongs():
    robot = wbc.load("arm")
    controller = wbc.Controller(robot, wbc.Stack([Posture(robot.q0)]), level=wbc.VelocityLevel())
    with pytest.raises(InvalidInput, match=r"takes a number of rows, and its tick\(controller"):
        Recorder(controller)


@pytest.mark.parametrize(
    ("name", "value"),
    [("dt", "x"), ("dt", -1.0), ("joint_names", 3), ("joint_names", [1]), ("statuses", "SOLVED"), ("tasks", [1]),
     ("tasks", {"hand": 1}), ("contacts", {"foot": []}), ("limits", 1.0), ("active_rows", [1]), ("silent", "all")],
)  # fmt: skip
def test_metadata_of_another_kind_are_refused_where_they_are_read(tmp_path: Path, name: str, value: Any):
    Run({"t": [0.0]}, {"dt": 0.1, "joint_names": None, name: value}).save(tmp_path)
    with pytest.raises(InvalidInput, match=rf"meta\.json: {name}"):
        Run.load(tmp_path)


def test_a_recorder_without_rows_gives_a_run_without_columns():
    assert dict(Recorder(3).run()) == {}


def test_a_copy_has_rows_of_its_own():
    recorder = Recorder(3)
    recorder.append({"t": 0.0})
    for same, value in ((copy.copy(recorder), 1.0), (pickle.loads(pickle.dumps(recorder)), 2.0)):
        same.append({"t": value})
        assert same.run()["t"].tolist() == [0.0, value]
    recorder.append({"t": 3.0})
    assert recorder.run()["t"].tolist() == [0.0, 3.0]


@pytest.mark.parametrize("before", range(4))
@pytest.mark.parametrize("more", [1, 2, 3, 7])
@pytest.mark.parametrize("line", range(12))
def test_rows_may_come_in_at_every_line_of_run(line: int, more: int, before: int):
    recorder = Recorder(3)

    def append(count: int) -> None:
        for k in range(recorder.rows, recorder.rows + count):
            recorder.append({"k": k, "x": [1.0 * k, 2.0 * k]})

    append(before)
    lines = iter(range(100))

    def trace(frame: FrameType, event: str, _given: object) -> Any:
        if frame.f_code.co_filename != Recorder.run.__code__.co_filename:
            return None
        if event == "line" and next(lines) == line:
            append(more)
        return trace

    was = sys.gettrace()
    sys.settrace(trace)
    try:
        run = recorder.run()
    finally:
        sys.settrace(was)
    assert before <= run.rows <= before + more
    if run.rows:
        assert run["k"].tolist() == list(range(run.rows))
        np.testing.assert_array_equal(run["x"], np.outer(np.arange(run.rows), [1.0, 2.0]))
