"""Tasks that ask for opposite things, heavy and without a posture: what they do not decide takes no proof away."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import wbc
from tasks import Position
from tests.qp.rows.test_proof import certified
from wbc.qp.rows.core import CoreSolver
from wbc.types import Vec

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
