"""Smoothness: what is known in closed form comes out, of signals, of points of a robot, and of targets in steps."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from wbc.report import smoothness
from wbc.report.document import Table
from wbc.report.sections.smoothness import section
from wbc.report.smoothness import Moved, derived, freeze, spectrum
from wbc.sim.scenario import ScenarioResult
from wbc.tasks import CenterOfMass, Damping, Frame, LocalPosition, Position, Posture, Sinusoid, feet

from .conftest import reaching_run, result_of, standing_run

DT = 0.002


def moved(command: Any, order: int = 1) -> Moved:
    command = np.asarray(command, dtype=float).reshape(len(command), -1)
    return Moved("x", "m", order, DT, command, derived(command, order, DT), float("nan"))


@given(
    slow=st.floats(0.5, 2.4), fast=st.floats(4.0, 100.0), a=st.floats(0.1, 10.0), b=st.floats(0.1, 10.0),
    phase=st.floats(0.0, 6.3), offset=st.floats(-50.0, 50.0),
)  # fmt: skip
def test_the_share_above_3_hz_is_that_of_the_squares(
    slow: float, fast: float, a: float, b: float, phase: float, offset: float
):
    t = DT * np.arange(10_000)
    signal = a * np.sin(2 * np.pi * slow * t) + b * np.sin(2 * np.pi * fast * t + phase) + offset
    assert moved(signal).shaking == pytest.approx(b**2 / (a**2 + b**2), rel=0.02, abs=1e-3)
    assert moved(np.column_stack([signal, 0 * t])).shaking == pytest.approx(moved(signal).shaking)


def test_the_power_of_two_axes_is_added():
    t = DT * np.arange(5_000)
    shaking = moved(np.column_stack([3.0 * np.sin(2 * np.pi * t), 4.0 * np.sin(2 * np.pi * 20.0 * t)])).shaking
    assert shaking == pytest.approx(16.0 / 25.0, rel=1e-2)


def test_too_short_or_still_a_motion_has_no_share():
    assert np.isnan(moved(np.random.default_rng(0).normal(size=int(0.9 / DT))).shaking)
    assert np.isnan(moved(np.full(2000, 3.0)).shaking)
    assert not np.isnan(moved(np.random.default_rng(0).normal(size=int(1.1 / DT))).shaking)


@given(c=st.floats(-5.0, 5.0), slope=st.floats(-5.0, 5.0))
def test_the_jerk_of_polynomials_is_exact(c: float, slope: float):
    t = DT * np.arange(200)
    np.testing.assert_allclose(moved(slope * t + c).jerk, slope, atol=1e-8)
    np.testing.assert_allclose(moved(0.5 * slope * t**2 + c * t, order=2).jerk, slope, atol=1e-6)
    assert moved(slope * t + c).jerk_rms == pytest.approx(abs(slope), abs=1e-8)


@given(start=st.floats(1.0, 4.0), length=st.floats(0.05, 4.0), every=st.integers(1, 40), speed=st.floats(0.01, 10.0))
def test_a_freeze_is_as_long_as_the_point_stood(start: float, length: float, every: int, speed: float):
    """Whether the target moves smoothly or comes in samples, at 12.5 Hz or faster."""
    k = np.arange(5_000)
    t = DT * k
    stood = (t >= start) & (t < start + length)
    sampled = speed * DT * (k // every) * every
    own = speed * np.cumsum(np.where(stood, 0.0, DT))
    position, target = (np.column_stack([x, 0 * x]) for x in (own, sampled))
    assert freeze(position, target, DT) == pytest.approx(length, abs=(every + 1) * DT)
    assert freeze(target + 1.0, target, DT) <= 0.1, "a staircase that is followed at once"
    assert freeze(position, target, DT) == pytest.approx(freeze(100 * position, 100 * target, DT))


def test_resting_with_a_target_that_rests_is_no_freeze():
    t = DT * np.arange(5_000)
    goes = np.clip(t, 2.0, 4.0)[:, None]
    assert freeze(goes, goes, DT) <= 2 * DT
    assert np.isnan(freeze(goes, np.full_like(goes, 3.0), DT))
    assert np.isnan(freeze(goes, 1e6 + 1e-3 * np.finfo(float).eps * goes, DT))


def test_the_spectrum_keeps_the_power():
    signal = np.random.default_rng(3).normal(size=(4_001, 3))
    frequency, power = spectrum(signal, DT)
    window = np.hanning(4_003)[1:-1]
    whole = np.sum(((signal - signal.mean(axis=0)) * window[:, None]) ** 2)
    assert 2.0 * power.sum() / 4_001 == pytest.approx(whole, rel=1e-2)
    assert frequency[-1] < 0.5 / DT and (np.diff(frequency) > 0).all()


def loop(level: Any, tasks: Any, name: str = "arm") -> tuple[wbc.Run, Any]:
    robot = wbc.load(name)
    contacts = feet(robot) if name == "humanoid" else []
    controller = wbc.Controller(robot, wbc.Stack([*tasks(robot), Damping(weight=1e-6)], contacts=contacts), level=level)
    controller = wbc.Controller(robot, controller.stack, level=level, dt=DT)
    recorder, q, v = wbc.Recorder(400), robot.q0, np.zeros(robot.nv)
    for k in range(400):
        command = recorder.tick(controller, DT * k, q, v)
        q, v = command.q, command.v
    return recorder.run(), robot


@pytest.mark.parametrize(
    ("level", "name"),
    [(wbc.VelocityLevel(), "arm"), (wbc.AccelerationLevel(), "arm"), (wbc.InverseDynamics(), "humanoid")],
    ids=str,
)
def test_the_command_of_a_point_is_the_motion_that_follows(level: Any, name: str):
    """Read from the task's error alone, whose target stands still."""

    def tasks(robot: Any) -> list[Any]:
        state = robot.state()
        frame = "tool" if name == "arm" else "left_hand"
        pose = np.eye(4)
        pose[:3, 3] = state.frame(frame).position + np.array([0.0, 0.05, -0.05])
        return [
            CenterOfMass(target=state.com + np.array([0.01, 0.0, -0.02]), kp=30.0),
            Frame(frame, target=pose, kp=30.0, weight=[1, 1, 1, 0, 0, 0]),
            Position(frame, target=[0.3], axes="z", weight=1e-9, name="height"),
            LocalPosition(frame, target=pose[:3, 3], weight=1e-9),  # whose error has other axes
            Posture(robot.q0, weight=1e-3),
        ]

    run, robot = loop(level, tasks, name)
    found = {one.name: one for one in smoothness.points(run, robot)}
    assert set(found) == {"CenterOfMass", f"Frame[{'tool' if name == 'arm' else 'left_hand'}]", "height"}
    for task, one in found.items():
        error = run[f"error.{task}"][:, :3]
        assert one.command.shape == error.shape and np.isnan(one.freeze)
        motion = -np.diff(error, axis=0) / DT
        if one.order == 1:
            motion, command = np.diff(motion, axis=0) / DT, one.command[:-2]
        else:
            command = one.command[:-1]
        scale = np.abs(command).max()
        assert scale > 1e-2
        np.testing.assert_allclose(motion, command, atol=0.05 * scale)
        assert one.jerk.shape[0] == run.rows - one.order and (one.unit, one.dt) == ("m", DT)


def test_a_task_that_is_switched_off_freezes_its_point():
    target = Sinusoid([0.4, 0.0, 0.5], amplitude=[0.0, 0.2, 0.1], frequency=[0.5, 0.5, 0.9])
    task = Position("tool", target=target, rate=20.0)
    robot = wbc.load("arm")
    controller = wbc.Controller(robot, wbc.Stack([task, Damping(weight=1e-6)]), level=wbc.VelocityLevel(), dt=DT)
    recorder, q = wbc.Recorder(1500), robot.q0
    for k in range(1500):
        task.active = not 600 <= k < 1000
        q = recorder.tick(controller, DT * k, q, np.zeros(robot.nv)).q
    (one,) = smoothness.points(recorder.run(), robot)
    assert one.freeze == pytest.approx(0.8, abs=0.05)
    assert smoothness.points(recorder.run(), None) == [] == smoothness.points(recorder.run(), wbc.load("humanoid"))


def test_a_joint_freezes_where_its_own_target_moves():
    robot = wbc.load("arm")
    task = Posture(Sinusoid(robot.q0, amplitude=[0.2] + [0.0] * 6, frequency=0.5), rate=50.0)
    controller = wbc.Controller(robot, wbc.Stack([task]), level=wbc.VelocityLevel(), dt=DT)
    recorder, q = wbc.Recorder(1500), robot.q0
    for k in range(1500):
        command = recorder.tick(controller, DT * k, q, np.zeros(robot.nv))
        q = command.q if not 600 <= k < 1000 else q  # the robot is blocked
    first, *others = smoothness.joints(recorder.run())
    assert first.name == robot.joint_names[0] and first.freeze == pytest.approx(0.8, abs=0.05)
    assert all(np.isnan(joint.freeze) for joint in others)


def test_rows_without_a_number_are_bridged():
    values = np.array([[np.nan, 1.0], [2.0, np.nan], [np.nan, 3.0], [4.0, np.nan], [np.nan, np.nan]])
    assert smoothness.filled(values).tolist() == [[2.0, 1.0], [2.0, 2.0], [3.0, 3.0], [4.0, 3.0], [4.0, 3.0]]
    run = standing_run()
    run.columns["a"][3] = np.nan
    assert all(np.isfinite(joint.jerk_rms) for joint in smoothness.joints(run))


def test_the_section_has_points_where_there_is_a_robot_and_joints_always(standing: ScenarioResult):
    result = result_of(standing_run(), wbc.load("humanoid"))
    result.run.meta["tasks"]["CenterOfMass"] |= {"labels": ["x", "y", "z"], "point": ""}
    for robot, kinds in ((result.robot, ["task point", "joint"]), (None, ["joint"])):
        made = section(result_of(result.run, robot))
        assert made is not None
        tables = [item for item in made.items if isinstance(item, Table)]
        assert [table.columns[0] for table in tables] == kinds
        assert [row[0] for row in tables[-1].rows] == result.run.meta["joint_names"]
    assert section(standing) is not None


@pytest.mark.parametrize("rows", [1, 2, 3, 4])
def test_the_shortest_runs_have_a_section_or_none(rows: int):
    for run in (reaching_run(rows), standing_run(rows)):
        made = section(result_of(run, None))
        assert (made is None) == (rows <= (1 if "a" in run else 2))
