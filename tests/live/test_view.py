"""The loop's side of a view: knobs reach the tasks, pushes act, nothing in the browser holds a robot's loop up."""

from __future__ import annotations

import threading
import warnings
from time import monotonic, sleep
from typing import Any

import numpy as np
import pinocchio
import pytest

import wbc
from wbc.errors import InvalidInput
from wbc.live.knobs import Knobs
from wbc.sim.plant import IntegratorPlant
from wbc.sim.simulate import simulate
from wbc.tasks import CenterOfMass, Frame, JointVelocityLimits, Position, Posture, Sinusoid


def made(*tasks: Any, robot: Any = None) -> Any:
    robot = robot or wbc.load("arm")
    stack = wbc.Stack(list(tasks), subject_to=[JointVelocityLimits()])
    return wbc.Controller(robot, stack, level=wbc.VelocityLevel())


def knobs(controller: Any) -> tuple[Knobs, dict[tuple[str, str], int]]:
    found = Knobs(controller.stack.tasks, controller.plans.whole.plan.stack.tasks, controller.model)
    return found, {(knob.task, knob.what): k for k, knob in enumerate(found.all)}


def test_knobs_set_what_a_user_would_set():
    robot = wbc.load("arm")
    reach, posture = Position("tool", target=[0.4, 0.2, 0.5], kp=50.0), Posture(robot.q0, weight=np.full(7, 0.1))
    found, number = knobs(made(reach, posture))
    assert found.set(number["Position[tool]", "kp"], 80.0) == "Position[tool]: kp = 80"
    found.set(number["Position[tool]", "active"], 0.0)
    found.set(number["Posture", "weight ×"], 3.0)
    found.set(number["Posture", "target elbow +"], 0.25)
    assert reach.kp == 80.0 and not reach.active and np.allclose(posture.weight, 0.3)
    elbow = robot.joint_names.index("elbow")
    assert np.allclose(posture.target - robot.q0, 0.25 * np.eye(7)[elbow])
    found.set(number["Position[tool]", "kp"], 1e9)
    assert reach.kp == 200.0  # no further than the slider goes


def test_a_target_is_moved_from_where_it_is_or_goes():
    place = pinocchio.SE3(np.eye(3), np.array([0.4, 0.0, 0.5]))
    frame = Frame("tool", target=place)
    robot = wbc.load("arm")
    moving = Position(robot.frame_names[2], target=Sinusoid([0.1, 0.0, 0.4], amplitude=0.1, frequency=1.0))
    controller = made(frame, moving)
    found, number = knobs(controller)
    before = moving.target(0.3)
    found.set(number["Frame[tool]", "target z +"], 0.1)
    found.set(number[moving.name, "target x +"], -0.2)
    found.set(number[moving.name, "target y +"], 0.1)
    assert np.allclose(frame.target.translation, [0.4, 0.0, 0.6])
    after = moving.target(0.3)
    assert np.allclose(after[0] - before[0], [-0.2, 0.1, 0.0]) and np.allclose(after[1], before[1])
    frame.target = pinocchio.SE3(np.eye(3), np.zeros(3))  # somebody gives another one
    found.set(number["Frame[tool]", "target x +"], 0.05)
    assert np.allclose(frame.target.translation, [0.05, 0.0, 0.1])
    assert controller.tick(0.0, robot.q0, np.zeros(7)).status.ok


def test_tasks_whose_targets_have_other_rows_have_no_sliders_for_them():
    _, number = knobs(made(Posture([0.1], joints=["elbow"])))
    assert not [what for _, what in number if what.startswith("target")]
    robot = wbc.load("humanoid")
    _, number = knobs(made(CenterOfMass(target=[0, 0, 0.8]), Posture(robot.q0, weight={"left_.*": 2.0}), robot=robot))
    assert ("CenterOfMass", "target x +") in number and ("Posture", "weight") not in number


def ticks(view: Any, count: int) -> None:
    q = view.controller.model.q0
    for k in range(count):
        q = view.tick(1e-3 * k, q, np.zeros(7)).q


@pytest.fixture
def view():
    """A view, without a browser, of an arm's controller; ``pushed`` is filled with what was pushed."""
    pytest.importorskip("viser")
    from wbc.live import View

    pushed: list[tuple[str, list[float]]] = []
    reach = Position("tool", target=[0.4, 0.2, 0.5])
    with View(made(reach), port=8140, push=lambda frame, force: pushed.append((frame, force.tolist()))) as shown:
        yield shown, pushed


def test_a_loop_that_is_nobodys_to_stop_is_not_stopped(view):
    shown, pushed = view
    ticks(shown, 2)
    for words in (("pause", True), ("step",), ("speed", 0.01)):
        shown._do(*words)
    shown._do("push", "base", [0.0, 30.0, 0.0], 0.01)
    start = monotonic()
    ticks(shown, 200)
    assert monotonic() - start < 5.0 and not shown.paused
    assert pushed and set(map(str, pushed)) == {"('base', [0.0, 30.0, 0.0])"} and len(pushed) <= 12


def test_steps_are_single_ticks_however_fast_they_come():
    pytest.importorskip("viser")
    from wbc.live import View

    with View(made(Position("tool", target=[0.4, 0.2, 0.5])), port=8160, pausing=True) as shown:
        ticks(shown, 2)
        while not shown._ready:  # the window is another process
            sleep(0.01)
            shown._listen()
        for _ in range(5):
            shown._do("step")
        stopped = threading.Timer(1.5, lambda: setattr(shown, "paused", False))
        seen: list[float] = []
        show = shown._show
        shown._show = lambda row: (seen.append(row["t"]), show(row))  # type: ignore[method-assign]
        stopped.start()
        start = monotonic()
        ticks(shown, 6)
        assert monotonic() - start > 1.0  # the sixth tick waits for somebody to let it go on
        assert seen and max(seen) <= 0.0051


def test_what_a_task_refuses_is_said_and_the_loop_goes_on(view):
    shown, _ = view
    shown._do("set", 0, 0.0)
    assert shown.done == ["Position[tool]: active = 0 from 0.000 s"]
    shown._knobs._turn[1] = lambda value: setattr(shown.controller.stack.tasks[0], "weight", -value)
    shown._do("set", 1, 1.0)
    ticks(shown, 3)
    assert len(shown.done) == 1 and not shown.closed


def test_a_view_whose_process_dies_is_a_warning(view):
    shown, _ = view
    ticks(shown, 2)
    shown._process.kill()
    shown._process.wait()
    shown._ready = True  # as its last word may have been
    end = monotonic() + 10.0
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        while not shown.closed and monotonic() < end:
            ticks(shown, 10)
            sleep(0.02)
    assert shown.closed and ["the loop goes on" in str(one.message) for one in caught] == [True]
    ticks(shown, 2)
    shown.close()


def test_a_simulation_beside_a_view_is_the_same_and_says_what_was_done(monkeypatch: pytest.MonkeyPatch):
    pytest.importorskip("viser")
    from wbc.live import View
    from wbc.live.beside import beside

    def look(shown: View) -> None:
        shown._do("speed", 1000.0)
        shown._do("set", 1, 1.5)

    monkeypatch.setattr(View, "wait", look)
    told: list[str] = []

    def run() -> Any:
        controller = made(Position("tool", target=[0.4, 0.2, 0.5]))
        return simulate(controller, IntegratorPlant(controller.model, level="velocity"), duration=0.3)

    alone = run()
    with beside(8150, told.append) as done:
        watched = run()
    assert len(told) == 1 and told[0].startswith("http://localhost:815")
    assert done == ["Position[tool]: weight = 1.5 from 0.000 s"] and done[0] in watched.meta["disturbances"][0]
    assert np.allclose(alone["q"], watched["q"], atol=1e-6)


def test_a_port_that_is_none_is_refused():
    pytest.importorskip("viser")
    from wbc.live import View
    from wbc.live.view import required

    with pytest.raises(InvalidInput, match="port"):
        required(0)
    with pytest.raises(InvalidInput, match="port"):
        View(made(Position("tool", target=[0.4, 0.2, 0.5])), port=70000)
