"""How far each task can be from its optimum: a bound per task in its unit, under every hierarchy, and it is true."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import wbc
from tasks import CenterOfMass, ContactForce, Frame, JointVelocityLimits, Position, Posture, Sole, TorqueLimits
from tests.families.legs import draw
from tests.qp.rows.test_proof import certified
from wbc.control.answer import distances, units
from wbc.qp.rows.core import CoreSolver
from wbc.types import Vec

ARM, HUMANOID = wbc.load("arm"), wbc.load("humanoid")
HIERARCHIES = (wbc.Weighted(), wbc.Strict(), wbc.Scaled())


def reaching(hierarchy: object) -> wbc.Controller:
    """A target out of reach in 2 s, so that limits are active, and a posture."""
    stack = wbc.Stack(
        [[Position("tool", target=[3.0, 0.0, 0.5], weight=100.0)], [Posture(ARM.q0)]],
        subject_to=[JointVelocityLimits()],
    )
    return wbc.Controller(ARM, stack, level=wbc.VelocityLevel(), hierarchy=hierarchy)


def test_units_are_those_of_the_rows_whatever_the_task_is_about():
    foot = Sole("left_sole", half_size=(0.08, 0.04), friction=0.6)
    contacts = [foot, Sole("right_sole", half_size=(0.08, 0.04), friction=0.6)]
    torso = HUMANOID.state().frame("torso").placement
    tasks = [
        CenterOfMass(target=HUMANOID.state().com), Frame("torso", target=torso), Posture(HUMANOID.q0),
        ContactForce("left_sole", target=[0.0, 0.0, 200.0]),
    ]  # fmt: skip
    stack = wbc.Stack(tasks, subject_to=[TorqueLimits()], contacts=contacts)
    controller = wbc.Controller(HUMANOID, stack, level=wbc.InverseDynamics())
    assert list(units(controller.plan.problem).values()) == ["m/s²", "m/s², rad/s²", "rad/s²", "N"]


@pytest.mark.parametrize("hierarchy", HIERARCHIES, ids=str)
def test_every_task_of_the_first_level_has_a_bound_and_explain_says_it(hierarchy: object):
    controller = reaching(hierarchy)
    command = controller.tick(0.0, ARM.q0, 0 * ARM.q0)
    found = distances(controller.plan.problem, command.certificate.bounds)
    assert list(found) == ["Position[tool]", "Posture"]
    assert 0.0 <= found["Position[tool]"] < 1e-6
    assert f"at most {found['Position[tool]']:.1g} m/s from its optimum" in controller.explain()


def test_what_is_not_proved_is_nan_and_not_said():
    controller = reaching(wbc.Weighted())
    controller.tick(0.0, ARM.q0, 0 * ARM.q0)
    command = controller.tick(0.001, np.full(7, np.nan), 0 * ARM.q0)
    assert not command.status.ok
    found = distances(controller.plan.problem, command.certificate.bounds)
    assert list(found) == ["Position[tool]", "Posture"] and all(math.isnan(bound) for bound in found.values())
    assert "from its optimum" not in controller.explain()


@pytest.mark.parametrize("weight", [1e-4, 1.0, 1e4])
def test_direction_and_share_of_a_scaled_task_bound_its_rows(weight: float):
    """Of J x + drift = s t both are moved: the rows move by what the direction misses, and by t times the share's.

    The bound on a share is one on s ‖t‖∞, in the unit of the task, whatever the task weighs.
    """
    controller = reaching(wbc.Scaled())
    controller.stack.tasks[0].weight = weight
    controller.tick(0.0, ARM.q0, 0 * ARM.q0)
    problem = controller.plan.problem
    task = problem.levels[0][0]
    missed, less = 1e-4, 1e-3  # [m/s], and of the share
    bounds = {
        "direction of Position[tool]": missed,
        "share of Position[tool]": less * float(np.abs(task.wanted).max()),
    }
    moved = missed + less * np.abs(task.wanted).max()
    assert distances(problem, bounds)["Position[tool]"] == pytest.approx(moved)
    assert math.isnan(distances(problem, {"share of Position[tool]": 1.0})["Position[tool]"])


@pytest.mark.parametrize("case", [1131003473, 1131003546])
def test_the_bound_on_a_share_counts_beside_what_its_task_asks_for(case: int):
    """Weights from 1e-6 to 1e6 on legs: a level of shares is as far as the largest bound over 1 + ‖t‖∞."""
    controller, q, v, _ = draw(case)
    controller.tick(0.0, q, v)
    asked = {
        f"share of {task.name}": float(np.abs(task.wanted + task.drift).max())
        for level in controller.plan.problem.levels for task in level if task.kinematic
    }  # fmt: skip
    found = 0
    for outcome in controller.levels:
        bounds = outcome.certificate.bounds
        if outcome.how == "optimal" and bounds and set(bounds) <= set(asked) and max(bounds.values()) > 0.0:
            relative = max(bound / (1.0 + asked[name]) for name, bound in bounds.items())
            assert outcome.certificate.distance == pytest.approx(relative)
            found += 1
    assert found


def test_explain_gives_each_unit_its_own_number():
    """Of a task with rows in metres and in radians: error, residual and the distance from the optimum."""
    away = pin.SE3(pin.exp3(np.array([0.0, 0.3, 0.0])), np.array([0.1, 0.0, 0.0]))
    frame = Frame("tool", target=ARM.state().frame("tool").placement * away)
    controller = wbc.Controller(ARM, wbc.Stack([frame, Posture(ARM.q0)]), level=wbc.AccelerationLevel())
    controller.tick(0.0, ARM.q0, 0 * ARM.q0)
    (line,) = (line for line in controller.explain().splitlines() if "Frame[tool]" in line)
    number = r"[\d.e+-]+"
    assert re.search(rf"error 0.1 m, 0.3 rad, residual {number} m/s², {number} rad/s², ", line), line
    assert re.search(rf"at most {number} m/s², {number} rad/s² from its optimum$", line), line


# ---- tasks that ask for opposite things, heavy and without a posture: what they do not decide takes no proof away
LEVELS = {"velocity": wbc.VelocityLevel(), "acceleration": wbc.AccelerationLevel(), "dynamics": wbc.InverseDynamics()}


def opposed(name: str, rng: np.random.Generator, weight: float, **settings: Any) -> tuple[wbc.Controller, Vec, Vec]:
    """A controller with two tasks on one frame that ask for opposite steps, and a state."""
    robot = wbc.load(name)
    q, v = robot.integrate(robot.q0, 0.3 * rng.normal(size=robot.nv)), 0.1 * rng.normal(size=robot.nv)
    state = robot.state()
    state.update(0.0, q, v)
    frame = str(rng.choice(robot.frame_names))
    step = rng.normal(size=3)
    tasks = [
        Position(frame, target=state.frame(frame).position + side * step, weight=weight, name=f"to {side}")
        for side in (1.0, -1.0)
    ]
    return wbc.Controller(robot, wbc.Stack(tasks), **settings), q, v


@pytest.mark.parametrize("solver", ["pdas", "daqp"])
@pytest.mark.parametrize(
    "name, level", [("arm", level) for level in LEVELS] + [("humanoid", "velocity"), ("quadruped", "acceleration")]
)
def test_opposed_tasks_without_a_posture_are_answered_with_proof_whatever_they_weigh(
    name: str, level: str, solver: str
) -> None:
    rng = np.random.default_rng(5)
    for decade in range(7):
        for _ in range(2):
            control, q, v = opposed(name, rng, 10.0**decade, level=LEVELS[level], solver=solver)
            command = control.tick(0.0, q, v)
            assert command.status.ok, (decade, str(command.certificate))
            assert max(command.certificate.bounds.values()) <= 1e-4


@pytest.mark.parametrize("decade", [0.0, 3.0, 6.0])
def test_what_no_task_decides_is_still_proven_as_far_as_rounding_tells(decade: float) -> None:
    """Moved along what the tasks leave: not certified where the gradient shows it, in whole at 1 and less at 1e6."""
    rng = np.random.default_rng(6)
    for _ in range(5):
        control, q, v = opposed("arm", rng, 10.0**decade, level=wbc.AccelerationLevel())
        assert control.tick(0.0, q, v).status.ok
        p = control.plan.problem
        left = np.linalg.svd(p.G[p.soft, : p.n])[2][-1]
        p.x[:] += 1e2 * 10.0**decade * left
        value = p.G[: p.n_rows] @ p.x1
        p.value[p.first_row : p.first_row + p.n_rows] = value
        push = np.zeros(p.n_rows)
        push[p.soft] = p.weights / p.unit * value[p.soft]
        assert not certified(CoreSolver(p), push).ok
