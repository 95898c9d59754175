"""A run as a table: every number once, under a heading that says what it is and in which unit."""

from __future__ import annotations

import csv
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tests.control.test_recorder import tables
from wbc.control.recorder import Run
from wbc.errors import InvalidInput, NotSupported
from wbc.sim.plant import IntegratorPlant
from wbc.sim.simulate import simulate
from wbc.tasks import CenterOfMass, Frame, JointVelocityLimits, Posture, TorqueLimits, feet


@pytest.fixture(scope="module")
def standing() -> Run:
    """A humanoid that stands: floating base, wrenches, torques, tasks of several units."""
    robot = wbc.load("humanoid")
    stack = wbc.Stack(
        [CenterOfMass(target=robot.state().com), Frame("left_hand", target=np.eye(4)), Posture(robot.q0, weight=0.1)],
        contacts=feet(robot),
        subject_to=[TorqueLimits(), JointVelocityLimits()],
    )
    controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics())
    return simulate(controller, IntegratorPlant(robot), duration=0.02)


def numbers_of(run: Run) -> int:
    return sum(int(np.prod(values.shape[1:])) for values in run.values())


def read(path: Path) -> tuple[list[str], list[list[str]]]:
    with path.open(encoding="utf-8", newline="") as file:
        headings, *rows = csv.reader(file)
    return headings, rows


def test_a_heading_says_component_and_unit(standing: Run, tmp_path: Path):
    headings, rows = read(standing.to_csv(tmp_path / "run.csv"))
    assert len(rows) == standing.rows and len(headings) == len(set(headings)) == numbers_of(standing) + 1
    column = dict(zip(headings, zip(*rows, strict=True), strict=True))

    def same(heading: str, values: Any) -> None:
        np.testing.assert_array_equal(np.array(column[heading], dtype=float), values)

    elbow = standing.meta["joint_names"].index("left_elbow")
    same("t [s]", standing["t"])
    same("q.base_position_z [m]", standing["q"][:, 2])
    same("q.base_quaternion_w", standing["q"][:, 6])
    same("q.left_elbow [rad]", standing["q"][:, 7 + elbow])
    same("v.base_linear_x [m/s]", standing["v"][:, 0])
    same("a.base_angular_z [rad/s²]", standing["a"][:, 5])
    same("plant.v.left_elbow [rad/s]", standing["plant.v"][:, 6 + elbow])
    same("tau.left_elbow [N m]", standing["tau"][:, elbow])
    same("f.Sole[left_sole].force_z [N]", standing["f.Sole[left_sole]"][:, 2])
    same("f.Sole[right_sole].moment_y [N m]", standing["f.Sole[right_sole]"][:, 4])
    same("error.Frame[left_hand].z [m]", standing["error.Frame[left_hand]"][:, 2])
    same("error.Frame[left_hand].yaw [rad]", standing["error.Frame[left_hand]"][:, 5])
    same("error.Posture.left_elbow [rad]", standing["error.Posture"][:, elbow])
    same("distance.CenterOfMass [m/s²]", standing["distance.CenterOfMass"])
    for unit in ("m/s²", "rad/s²"):  # one bound on rows of two units
        same(f"distance.Frame[left_hand] [{unit}]", standing["distance.Frame[left_hand]"])
    assert set(column["status"]) == {"SOLVED"}


def test_only_dimensionless_numbers_have_no_unit(standing: Run, tmp_path: Path):
    headings, _ = read(standing.to_csv(tmp_path / "run.csv"))
    without = {heading for heading in headings if not heading.endswith("]") or heading.startswith("margin")}
    assert {heading.split(".")[0] for heading in without} == {
        "status", "iterations", "fallback", "active", "certificate", "cost", "q", "plant",
    }  # fmt: skip
    assert {h for h in without if h.split(".")[0] in ("q", "plant")} == {
        f"{column}.base_quaternion_{axis}" for column in ("q", "plant.q") for axis in "xyzw"
    }


@given(tables())
def test_any_run_is_read_back_to_the_bit(tmp_path_factory: pytest.TempPathFactory, columns: dict[str, Any]):
    run = Run(columns)
    headings, rows = read(run.to_csv(tmp_path_factory.mktemp("csv") / "run.csv"))
    assert len(headings) == len(set(headings)) == numbers_of(run)
    found = np.array([[float(cell) if cell else np.nan for cell in row] for row in rows])
    wanted = [values.reshape(run.rows, int(np.prod(values.shape[1:]))) for values in run.values()]
    np.testing.assert_array_equal(found.reshape(run.rows, len(headings)), np.hstack([np.empty((run.rows, 0)), *wanted]))


def test_a_column_of_a_users_has_places_where_one_of_ours_has_axes_and_units():
    run = Run({"push": np.zeros((2, 3)), "plant.slip.foot": np.zeros((2, 2)), "own": np.zeros((2, 2))})
    slip = ["plant.slip.foot.x [m]", "plant.slip.foot.y [m]"]
    assert list(frame_of(run)) == ["push.x [N]", "push.y [N]", "push.z [N]", *slip, "own.0", "own.1"]


@given(joints=st.integers(1, 4), base=st.booleans(), rows=st.integers(0, 3))
def test_metadata_that_do_not_fit_give_places_instead_of_names(joints: int, base: bool, rows: int):
    about = {"joint_names": [f"j{i}" for i in range(joints)], "joint_units": ["rad"] * joints}
    run = Run({"q": np.zeros((rows, 7 * base + joints)), "v": np.zeros((rows, joints + 2))}, about)
    headings = list(frame_of(run))
    assert headings[7 * base : 7 * base + joints] == [f"q.j{i} [rad]" for i in range(joints)]
    assert headings[7 * base + joints :] == [f"v.{i}" for i in range(joints + 2)]


def frame_of(run: Run) -> dict[str, Any]:
    """What pandas is given, without pandas."""
    given: list[dict[str, Any]] = []
    pandas = ModuleType("pandas")
    pandas.DataFrame = given.append  # type: ignore[attr-defined]
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "pandas", pandas)
        run.to_pandas()
    return given[0]


def test_pandas_is_given_the_same_table(standing: Run, tmp_path: Path):
    headings, rows = read(standing.to_csv(tmp_path / "run.csv"))
    columns = frame_of(standing)
    assert list(columns) == headings and {len(values) for values in columns.values()} == {len(rows)}


def test_without_pandas_the_error_says_what_to_install(standing: Run, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(NotSupported, match=r"pip install pandas"):
        standing.to_pandas()


def test_a_file_that_cannot_be_written_is_named_and_nothing_is_left(standing: Run, tmp_path: Path):
    (tmp_path / "folder").mkdir()
    for place in (tmp_path / "nowhere" / "run.csv", tmp_path / "folder"):
        with pytest.raises(InvalidInput, match="cannot be written"):
            standing.to_csv(place)
    assert [path.name for path in tmp_path.rglob("*")] == ["folder"]
