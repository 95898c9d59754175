"""Calls of one controller take turns: other threads and interrupts leave every tick whole."""

from __future__ import annotations

import sys
from collections.abc import Callable
from threading import Thread
from types import FrameType
from typing import Any

import numpy as np
import pytest

import wbc
from tests.stack.conftest import moving
from wbc.tasks import CenterOfMass, Damping, JointLimits, Position, Posture, TorqueLimits, feet
from wbc.testing import robots
from wbc.types import Vec

ARM, QUADRUPED = robots()[:2]
GOAL = np.array([0.4, 0.2, 0.5])


class Meanwhile:
    """A target that another thread works beside once it is armed: it has 0.3 s, after which the tick goes on."""

    def __init__(self, value: Any, work: Callable[[], object]) -> None:
        self.value, self.work, self.armed, self.threads = value, work, False, list[Thread]()

    def __call__(self, _t: float) -> Any:
        if self.armed and not self.threads:
            self.threads.append(Thread(target=self.work))
            self.threads[0].start()
            self.threads[0].join(0.3)
        return self.value


def beside(function: str, line: int, work: Callable[[], object], *, during: Callable[[], object]) -> None:
    """Let another thread work while this one is at a line, counted as they run, of a function of that name."""
    others, lines = list[Thread](), iter(range(1000))

    def trace(frame: FrameType, event: str, _given: object) -> Any:
        if frame.f_code.co_name != function:
            return None
        if event == "line" and next(lines) == line:
            others.append(Thread(target=work))
            others[0].start()
            others[0].join(0.3)
        return trace

    was = sys.gettrace()
    sys.settrace(trace)
    try:
        during()
    finally:
        sys.settrace(was)
    for other in others:
        other.join()


def arm(target: Any = GOAL, hierarchy: Any = None) -> wbc.Controller:
    stack = wbc.Stack([Position("tool", target=target), Posture(ARM.q0, weight=1e-2)], subject_to=[JointLimits()])
    return wbc.Controller(ARM, stack, level=wbc.AccelerationLevel(), hierarchy=hierarchy)


@pytest.mark.parametrize("hierarchy", [wbc.Weighted(), wbc.Strict()])
def test_ticks_of_two_threads_are_those_of_one_after_the_other(hierarchy: Any) -> None:
    states = [moving(ARM, seed) for seed in (1, 2)]
    alone = [arm(hierarchy=hierarchy).tick(0.0, *state).a for state in states]
    other = list[wbc.Command]()
    target = Meanwhile(GOAL, lambda: other.append(controller.tick(1e-3, *states[1])))
    controller = arm(target, hierarchy)
    target.armed = True
    first = controller.tick(0.0, *states[0])
    target.threads[0].join()
    for command, a in zip([first, *other], alone, strict=True):
        assert command.status.ok
        np.testing.assert_allclose(command.a, a, atol=1e-6)


def standing(com: Any) -> wbc.Stack:
    limits = [TorqueLimits(), JointLimits()]
    return wbc.Stack(
        [CenterOfMass(target=com), Posture(QUADRUPED.q0, weight=1e-2)], contacts=feet(QUADRUPED), subject_to=limits
    )


@pytest.mark.parametrize("line", range(1, 16))
def test_a_tick_of_another_thread_during_a_replace_keeps_contacts_where_they_are(line: int) -> None:
    com, still = QUADRUPED.state().com.copy(), np.zeros(QUADRUPED.nv)
    q = QUADRUPED.integrate(QUADRUPED.q0, np.full(QUADRUPED.nv, 0.01))
    controller = wbc.Controller(QUADRUPED, standing(com), level=wbc.InverseDynamics())
    controller.tick(0.0, QUADRUPED.q0, still)
    right = controller.tick(1e-3, q, still).a
    beside("replace", line, lambda: controller.tick(1e-3, q, still), during=lambda: controller.replace(standing(com)))
    command = controller.tick(2e-3, q, still)
    assert command.status.ok
    np.testing.assert_allclose(command.a, right, atol=1e-6)


@pytest.mark.parametrize("name", ["tick", "replace", "reset", "compile_waiting"])
def test_a_member_that_calls_its_own_controller_is_named(name: str) -> None:
    given = {"tick": (0.0, *moving(ARM, 1)), "replace": (wbc.Stack([Posture(ARM.q0)]),)}.get(name, ())

    def target(_t: float) -> Any:
        if controllers:
            getattr(controllers[0], name)(*given)
        return GOAL

    controllers = list[wbc.Controller]()
    controllers.append(arm(target))
    command = controllers[0].tick(0.0, *moving(ARM, 1))
    assert not command.status.ok and f"{name} was called within a tick" in controllers[0].why
    (controller,) = controllers
    controllers.clear()
    assert controller.tick(1e-3, *moving(ARM, 1)).status.ok


@pytest.mark.parametrize("line", [*range(0, 60, 3), 70, 90, 120, 200])
@pytest.mark.parametrize("hierarchy", [wbc.Weighted(), wbc.Strict()])
def test_a_tick_that_is_interrupted_leaves_the_next_one_right(hierarchy: Any, line: int) -> None:
    def decided(interrupt: bool) -> list[Vec]:
        controller = arm(lambda t: np.array([0.4 + t, 0.2, 0.5]), hierarchy)
        controller.tick(0.0, *moving(ARM, 1))
        lines = iter(range(10_000))

        def trace(frame: FrameType, event: str, _given: object) -> Any:
            if not frame.f_code.co_filename.startswith(wbc.__file__.removesuffix("__init__.py")):
                return None
            if event == "line" and next(lines) == line:
                raise KeyboardInterrupt
            return trace

        if interrupt:
            was = sys.gettrace()
            sys.settrace(trace)
            try:
                controller.tick(1e-3, *moving(ARM, 2))
            except KeyboardInterrupt:
                pass
            finally:
                sys.settrace(was)
        commands = [controller.tick(2e-3 + 1e-3 * k, *moving(ARM, 3 + k)) for k in range(3)]
        assert all(command.status.ok for command in commands)
        return [command.a for command in commands]

    for found, right in zip(decided(True), decided(False), strict=True):
        np.testing.assert_allclose(found, right, atol=1e-6)


@pytest.mark.parametrize("line", range(40))
def test_what_two_threads_assign_to_one_task_reaches_a_controller(line: int) -> None:
    task = Position("tool", target=GOAL, kp=50.0)
    controller = wbc.Controller(ARM, wbc.Stack([task]), level=wbc.AccelerationLevel())
    controller.tick(0.0, *moving(ARM, 1))

    def work() -> None:
        task.target = GOAL + 0.1
        controller.tick(1e-3, *moving(ARM, 1))

    beside("_assign", line, work, during=lambda: setattr(task, "kp", 70.0))
    controller.tick(2e-3, *moving(ARM, 1))
    own = controller.plan.stack.tasks[0]
    assert own.kp == task.kp == 70.0
    np.testing.assert_array_equal(own.target, task.target)


@pytest.mark.parametrize("line", range(12))
def test_what_is_assigned_while_a_controller_is_made_reaches_it(line: int) -> None:
    task, made = Damping(), list[wbc.Controller]()
    stack = wbc.Stack([task], subject_to=[JointLimits()])
    beside(
        "own", line, lambda: setattr(task, "weight", 3.0),
        during=lambda: made.append(wbc.Controller(ARM, stack, level=wbc.AccelerationLevel())),
    )  # fmt: skip
    made[0].tick(0.0, *moving(ARM, 1))
    assert made[0].plan.stack.tasks[0].weight == task.weight
