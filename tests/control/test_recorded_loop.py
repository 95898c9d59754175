"""A loop of one's own, written down tick by tick, is the run that a simulation of it would give."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import wbc
from wbc.control.recorder import UnknownColumn
from wbc.errors import InvalidInput
from wbc.sim.plant import IntegratorPlant
from wbc.sim.simulate import simulate
from wbc.tasks import Frame, JointAccelerationLimits, JointLimits, Position, Posture, feet

DT, TICKS = 0.002, 40


def controller(name: str = "humanoid") -> wbc.Controller:
    robot = wbc.load(name)
    frame = "left_hand" if name == "humanoid" else "tool"
    tasks = [Frame(frame, target=np.eye(4), weight=0.1), Posture(robot.q0)]
    stack = wbc.Stack(tasks, contacts=feet(robot) if name == "humanoid" else [], subject_to=[JointLimits()])
    return wbc.Controller(robot, stack, level=wbc.AccelerationLevel(), dt=DT)


def recorded(driver: Any, ticks: int = TICKS) -> wbc.Run:
    robot = driver.controller.model if isinstance(driver, wbc.Setpoint) else driver.model
    recorder, q, v = wbc.Recorder(8), robot.q0, np.zeros(robot.nv)
    for k in range(ticks):
        command = recorder.tick(driver, DT * k, q, v)
        q, v = command.q, command.v
    return recorder.run()


@pytest.mark.parametrize("name", ["humanoid", "arm"])
def test_a_recorded_loop_has_the_columns_of_a_simulation(name: str):
    own = recorded(controller(name))
    plant = IntegratorPlant(controller(name).model, dt=DT)
    other = simulate(controller(name), plant, duration=DT * TICKS)
    assert set(own) == set(other) - {"plant.q", "plant.v", "push"}
    for column in set(own) - {"tick_us"}:
        np.testing.assert_allclose(own[column], other[column], atol=1e-9, err_msg=column)
    assert (own["tick_us"] > 0.0).all()
    same = set(own.meta) & set(other.meta)
    assert {name: own.meta[name] for name in same} == {name: other.meta[name] for name in same}
    assert {"robot", "dt", "duration", "joint_names", "limits", "tasks", "contacts", "stack"} <= same


def test_the_ticks_of_a_setpoint_are_recorded_too():
    run = recorded(wbc.Setpoint(controller("arm"), feedback="measured"))
    assert run.rows == TICKS and run.meta["robot"] == "arm"


def test_columns_and_metadata_of_ones_own_stand_beside_the_others():
    driver = controller("arm")
    recorder, q = wbc.Recorder(2), driver.model.q0
    recorder.tick(driver, 0.0, q, 0 * q, force=[1.0, 2.0, 3.0], battery=48.0)
    with pytest.raises(UnknownColumn, match="batery"):
        recorder.tick(driver, DT, q, 0 * q, batery=47.0)
    run = recorder.run({"robot": "mine", "operator": "me"})
    assert run["force"].tolist() == [[1.0, 2.0, 3.0]] and run["battery"].tolist() == [48.0]
    assert run.meta["robot"] == "mine" and run.meta["operator"] == "me" and run.meta["dt"] == DT


def test_a_recorder_belongs_to_one_controller():
    first, second = controller("arm"), controller("arm")
    recorder = wbc.Recorder(2)
    recorder.tick(first, 0.0, first.model.q0, np.zeros(first.model.nv))
    with pytest.raises(InvalidInput, match="one controller"):
        recorder.tick(second, 0.0, first.model.q0, np.zeros(first.model.nv))
    for nonsense in (None, "arm", first.model):
        with pytest.raises(InvalidInput, match=r"must be a wbc\.Controller"):
            wbc.Recorder(2).tick(nonsense, 0.0, first.model.q0, np.zeros(7))  # type: ignore[arg-type]


def test_why_a_tick_had_no_answer_is_kept_with_its_problem():
    robot = wbc.load("arm")
    high = Position("tool", target=[0.4, 0.2, 4.0], kp=400.0)
    stack = wbc.Stack([Posture(robot.q0)], subject_to=[high.exactly(), JointAccelerationLimits(200.0)])
    driver = wbc.Controller(robot, stack, level=wbc.AccelerationLevel(), dt=DT)
    run = recorded(driver, 3)
    assert run.meta["failure"]["t"] == 0.0 and "Position[tool]" in run.meta["failure"]["why"]
    assert run.failed is not None and recorded(controller("arm")).meta["failure"] is None
