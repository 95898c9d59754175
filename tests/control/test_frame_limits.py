"""Limits on frames and on the centre of mass hold in a controller, at every level, and lead back from outside."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tasks as T
from wbc import AccelerationLevel, Controller, InverseDynamics, Stack, VelocityLevel
from wbc.models.model import RobotState
from wbc.stack.constraint import Barrier, BarrierRows
from wbc.testing import robots
from wbc.types import Status, Vec

ARM, QUADRUPED, _ = robots()
START = ARM.state().frame("tool")
P, R = START.position.copy(), START.rotation.copy()
LEVELS = [VelocityLevel(), AccelerationLevel(), InverseDynamics()]
DT = 1e-3
#: A limit, a task that leads out of it, and the same limit with the tool outside at the start.
CASES: dict[str, tuple[Barrier, Any, Barrier]] = {
    "half space": (
        T.HalfSpaceLimit("tool", normal=[0, 0, 1], offset=P[2] - 0.1),
        T.Position("tool", target=P - np.array([0.1, 0.0, 0.3])),
        T.HalfSpaceLimit("tool", normal=[0, 0, 1], offset=P[2] + 0.05),
    ),
    "box": (
        T.BoxLimits("tool", lower=P - 0.08, upper=P + 0.08),
        T.Position("tool", target=P + np.array([-0.2, 0.3, 0.0])),
        T.BoxLimits("tool", upper=P - np.array([0.05, 0.0, 0.03])),
    ),
    "cone": (
        T.ConeLimit("tool", apex=P - np.array([0, 0, 0.2]), axis=[0, 0, 1], angle=0.4),
        T.Position("tool", target=P + np.array([-0.1, 0.2, -0.05])),
        T.ConeLimit("tool", apex=P - np.array([0, 0.1, 0.05]), axis=[0, 0, 1], angle=0.4),
    ),
    "axis cone": (
        T.AxisConeLimit("tool", axis=[0, 0, 1], direction=R[:, 2], angle=0.3),
        T.Orientation("tool", target=R @ np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]], dtype=float)),
        T.AxisConeLimit("tool", axis=[0, 0, 1], direction=R[:, 2] + 0.6 * R[:, 1], angle=0.3),
    ),
}


def stack(task: Any, *constraints: Any) -> Stack:
    return Stack([task, T.Posture(ARM.q0, kp=10.0, weight=1e-2)], subject_to=[T.JointLimits(), *constraints])


def margins(constraint: Barrier, task: Any, level: Any, seconds: float) -> Vec:
    """The smallest h of each tick; the robot does what is decided."""
    controller = Controller(ARM, stack(task, constraint), level=level, dt=DT)
    state, rows, seen = ARM.state(drifts=False), BarrierRows(), []
    rows.h, rows.J = np.zeros(constraint.dim), np.zeros((constraint.dim, ARM.nv))
    rows.drift, rows.rate = np.zeros(constraint.dim), np.zeros(constraint.dim)
    q, v = np.array(ARM.q0), np.zeros(ARM.nv)
    for k in range(round(seconds / DT)):
        state.update(k * DT, q, v)
        constraint.fill(state, rows)
        seen.append(float(rows.h.min()))
        command = controller.tick(k * DT, q, v)
        assert command.status is Status.SOLVED
        q, v = command.q, command.v
    return np.array(seen)


@pytest.mark.parametrize("level", LEVELS, ids=lambda level: level.name)
@pytest.mark.parametrize("case", CASES)
def test_what_starts_inside_stays_inside_whatever_the_tasks_ask_for(case: str, level: Any):
    constraint, task, _ = CASES[case]
    h = margins(constraint, task, level, 1.5)
    assert h.min() > -2e-4  # velocities are kept for a tick, in which curves bend away
    assert h[-1] < 0.02, "the task did not lead to the limit"


@pytest.mark.parametrize("level", LEVELS, ids=lambda level: level.name)
@pytest.mark.parametrize("case", CASES)
def test_from_outside_it_comes_back_at_its_rate(case: str, level: Any):
    _, _, constraint = CASES[case]
    h = margins(constraint, T.Posture(ARM.q0, name="stay"), level, 1.0)
    assert h[0] < -0.01
    assert (np.diff(h[h < -1e-3]) >= -1e-6).all()
    # At velocities h falls as exp(−γ t), at accelerations as (1 + γ t) exp(−γ t), γ = 10; weights cost a little.
    assert h[-1] > (1.2 * h[0] * np.exp(-10.0) if level.order == 1 else 1.2 * h[0] * 11.0 * np.exp(-10.0)) - 2e-4


@pytest.mark.parametrize("level", LEVELS, ids=lambda level: level.name)
def test_a_soft_constraint_stands_above_every_level_of_tasks(level: Any):
    constraint, task, _ = CASES["half space"]
    strict = Stack([[task], [T.Posture(ARM.q0)]], subject_to=[constraint])
    names = [[task.name for task in level] for level in Controller(ARM, strict, level=level).plan.problem.levels]
    assert names == [[constraint.name], [task.name], ["Posture"]]


@settings(max_examples=10)
@given(st.integers(0, 1000))
def test_one_barrier_and_one_task_have_a_closed_form(seed: int):
    """min ½ |a − a₀|² subject to J a >= b: a₀ + Jᵀ max(0, b − J a₀) / (J Jᵀ)."""
    rng = np.random.default_rng(seed)
    constraint = T.HalfSpaceLimit("tool", normal=rng.normal(size=3), offset=float(rng.normal()), slack=None)
    task = T.Posture(ARM.q0 + rng.normal(size=ARM.nj), kp=100.0)
    controller = Controller(ARM, Stack([task], subject_to=[constraint]), level=AccelerationLevel())
    q, v = ARM.random_configuration(rng), rng.normal(size=ARM.nv)
    command = controller.tick(0.0, q, v)
    state = ARM.state()
    state.update(0.0, q, v)
    frame = state.frame("tool")
    J, h = constraint.normal @ frame.jacobian()[:3], constraint.normal @ frame.position - constraint.offset
    b = -2 * constraint.rate * (J @ v) - constraint.rate**2 * h - constraint.normal @ frame.drift()[:3]
    a = 100.0 * (task.target - q) - 20.0 * v
    a = a + J * max(0.0, b - J @ a) / (J @ J)
    np.testing.assert_allclose(command.a, a, rtol=1e-6, atol=1e-6 * np.abs(a).max())


@pytest.mark.parametrize("level", LEVELS, ids=lambda level: level.name)
def test_a_frame_keeps_its_speed_limits(level: Any):
    constraint = T.FrameVelocityLimits("tool", linear=0.15, angular=0.5)
    far = T.Position("tool", target=P + np.array([-0.2, 0.3, 0.1]), kp=400.0, rate=20.0)
    controller = Controller(ARM, stack(far, constraint), level=level, dt=DT)
    q, v, state, fastest = np.array(ARM.q0), np.zeros(ARM.nv), ARM.state(drifts=False), np.zeros(6)
    for k in range(600):
        command = controller.tick(k * DT, q, v)
        assert command.status is Status.SOLVED
        state.update(0.0, command.q if level.order == 1 else q, command.v)
        q, v = command.q, command.v
        fastest = np.maximum(fastest, np.abs(state.frame("tool").jacobian() @ v))
    assert 0.14 < fastest[:3].max() <= 0.15 * (1 + 2e-3)
    assert fastest[3:].max() <= 0.5 * (1 + 2e-3)


def test_the_centre_of_mass_stays_above_the_feet():
    polygon, state = T.SupportPolygon.under(QUADRUPED, margin=0.03), QUADRUPED.state()
    room = inside(polygon, state, QUADRUPED.q0)
    edge = int(np.argmin(polygon._normals @ state.com[:2] - polygon._offsets))
    over = (room + 0.025) * np.append(polygon._normals[edge], 0.0)  # all but over the feet's own edge
    tasks = [
        T.CenterOfMass(target=state.com - over, kp=50.0, weight=1e3),
        T.Posture(QUADRUPED.q0, kp=10.0, weight=1e-2),
    ]
    nearest = []
    for constraints in ([polygon], []):
        q, v = np.array(QUADRUPED.q0), np.zeros(QUADRUPED.nv)
        standing = Stack(tasks, subject_to=[T.JointLimits(), *constraints], contacts=T.feet(QUADRUPED))
        controller = Controller(QUADRUPED, standing, level=InverseDynamics())
        nearest.append(np.inf)
        for k in range(800):
            command = controller.tick(k * DT, q, v)
            assert command.status is Status.SOLVED
            q, v = command.q, command.v
            nearest[-1] = min(nearest[-1], inside(polygon, state, q))
    kept, free = nearest
    assert kept > -1e-4
    assert free < -0.02


def inside(polygon: T.SupportPolygon, state: RobotState, q: Vec) -> float:
    state.update(0.0, q, np.zeros(QUADRUPED.nv))
    return float((polygon._normals @ state.com[:2] - polygon._offsets).min())


def test_a_polygon_is_the_hull_of_its_points_less_the_margin():
    constraint = T.SupportPolygon([[0, 0], [1, 0], [0.5, 0.5], [1, 1], [0, 1]], margin=0.1)
    assert constraint.dim == 4
    middle, corner = (
        (constraint._normals @ np.array(point) - constraint._offsets).min() for point in ([0.5, 0.5], [0.05, 0.5])
    )
    assert (middle, corner) == (pytest.approx(0.4), pytest.approx(-0.05))


@pytest.mark.parametrize(("radius", "offset"), [(0.05, (0.3, 0.3, 0.0)), (0.1, (0.2, 0.1, 0.0))])
@pytest.mark.parametrize("share", [0.8, 1.3])
def test_a_task_rests_on_a_ball_while_its_steps_are_small(radius: float, offset: tuple[float, ...], share: float):
    """docs/limits.md: it does if rate dt < 2 R/D, for a target at D from the centre."""
    dt, q, v, state, off = 1e-2, ARM.q0, np.zeros(ARM.nv), ARM.state(), np.array(offset)
    rate = 2.0 * share * radius / float(np.linalg.norm(off)) / dt
    ball = T.Distance("tool", to=P, target=radius).within(0.0, np.inf)
    stack = Stack([T.Position("tool", target=P + off, rate=rate), T.Posture(q, weight=1e-4)], subject_to=[ball])
    controller = Controller(ARM, stack, level=VelocityLevel(lm_damping=0.0), dt=dt)
    for k in range(600):
        command = controller.tick(k * dt, q, v)
        q, v = command.q, command.v
    state.update(0.0, q, v)
    beyond = np.linalg.norm(state.frame("tool").position - P) - radius
    assert (abs(v).max() < 0.02 and beyond < 1e-6) if share < 1.0 else (abs(v).max() > 0.1 and beyond > 1e-3)
