"""Every component of the library bears ticks that have no state: it fails in none, and learns nothing from them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import tasks
import wbc
from tasks import (
    ContactSchedule,
    FaultReaction,
    MeasuredWrench,
    MomentumObserver,
    Posture,
    Sinusoid,
    SlotineLi,
    TorqueLimits,
    feet,
)
from wbc.models import Planar4P
from wbc.models.model import RobotModel
from wbc.stack.component import Component

ARM, QUADRUPED = wbc.load("arm"), wbc.load("quadruped")


def observer() -> MomentumObserver:
    """Of the arm."""
    return MomentumObserver(gain=100.0, threshold=1.0, persistence=2)


def adaptive(robot: RobotModel, **settings: Any) -> SlotineLi:
    """Follows a wave."""
    return SlotineLi(Sinusoid(robot.q0, amplitude=0.1, frequency=0.5), kp=50.0, kd=20.0, gain=2.0, **settings)


def samples() -> dict[str, tuple[RobotModel, list[Component]]]:
    """A robot and the components of a stack for it, new ones."""
    watches = observer()
    names = [foot.name for foot in feet(QUADRUPED)]
    planar = Planar4P()
    return {
        "ContactSchedule": (QUADRUPED, [ContactSchedule([(0.0, names), (0.01, names[:3])])]),
        "FaultReaction": (ARM, [watches, FaultReaction(watches, start=0.0)]),
        "MeasuredWrench": (ARM, [MeasuredWrench("tool", wrench=[0.0, 0.0, -5.0])]),
        "MomentumObserver": (ARM, [observer()]),
        "SlotineLi": (ARM, [adaptive(ARM, composite=0.1, window=0.5, estimate_floor=1e-3)]),
        "SlotineLi of a planar robot": (planar, [adaptive(planar)]),
    }


def controller(name: str) -> tuple[wbc.Controller, list[Component]]:
    """With a stack for those components."""
    robot, components = samples()[name]
    asked = [component.torque for component in components if isinstance(component, SlotineLi)]
    stack = wbc.Stack(
        [Posture(robot.q0), *asked], components=components, contacts=feet(robot) if robot is QUADRUPED else [],
        subject_to=[TorqueLimits()] if robot.nj > 4 else [],
    )  # fmt: skip
    return wbc.Controller(robot, stack, level=wbc.InverseDynamics()), components


def signals(components: list[Component]) -> list[Any]:
    """All that they say, copied."""
    return [{name: np.array(value) for name, value in one.signals().items()} for one in components]


def test_all_components_of_the_library_are_tried() -> None:
    kinds = {name for name, kind in vars(tasks).items() if isinstance(kind, type) and issubclass(kind, Component)}
    assert kinds == {name.split()[0] for name in samples()}


@pytest.mark.parametrize("name", samples())
def test_a_first_tick_without_a_state_is_nobodys_fault_and_is_recorded_like_others(name: str) -> None:
    control, _ = controller(name)
    robot, recorder = control.model, wbc.Recorder(10)
    recorder.tick(control, 0.0, np.full(robot.nq, np.nan), np.zeros(robot.nv))
    assert control.why == "q[0] is nan"
    for k in range(1, 4):
        command = recorder.tick(control, k * control.dt, robot.q0, np.zeros(robot.nv))
        assert command.status.ok, control.explain()
    assert recorder.run().rows == 4


@pytest.mark.parametrize("name", samples())
def test_nothing_is_learnt_from_ticks_without_a_state(name: str) -> None:
    control, components = controller(name)
    robot = control.model
    q = robot.integrate(robot.q0, np.append(np.zeros(robot.nb), np.full(robot.nj, 0.1)))
    for k in range(5):
        control.tick(k * control.dt, q, np.zeros(robot.nv))
    before = signals(components)
    for k in range(5, 30):
        control.tick(k * control.dt, np.full(robot.nq, np.nan), np.zeros(robot.nv))
    for known, now in zip(before, signals(components), strict=True):
        for signal, value in known.items():
            np.testing.assert_array_equal(now[signal], value, err_msg=signal)
