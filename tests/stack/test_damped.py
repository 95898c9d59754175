"""Levels that rank above others and cannot be met: what they come to is the least with their damping, and no more."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import wbc
from tasks import CenterOfMass, Damping, JointLimits, Position, Posture
from tests.families.oracle import Constraints, least_squares
from tests.stack.conftest import feet
from wbc import AccelerationLevel, Controller, InverseDynamics, Stack, VelocityLevel
from wbc.stack.compiled.damping_kernel import observe, observe_all
from wbc.types import Vec

ARM = wbc.load("arm")
FAR, AWAY = np.array([1.5, 1.2, 0.8]), np.array([-0.4, 0.9, 1.4])
DT = 2e-3


def running(level: Any, hierarchy: Any, levels: list[list[Any]], *, seconds: float, limits: list[Any]) -> Controller:
    """A controller after some time of reaching for what is out of reach."""
    controller = Controller(ARM, Stack(levels, subject_to=limits), level=level, hierarchy=hierarchy, dt=DT)
    q, v = np.array(ARM.q0), np.zeros(ARM.nv)
    for k in range(round(seconds / DT)):
        command = controller.tick(k * DT, q, v)
        assert command.status.ok, controller.why
        q, v = command.q, command.v
    return controller


def reaching(*, posture: float = 1.0) -> list[list[Any]]:
    elbow = ARM.frame_names[len(ARM.frame_names) // 2]
    return [
        [Position("tool", target=FAR, weight=2.0)],
        [Position(elbow, target=AWAY, name="elbow")],
        [Posture(ARM.q0 + 0.1, weight=posture)],
    ]


def by_an_oracle(controller: Controller) -> list[tuple[Vec, Vec]]:
    """J x − t of each level that is damped: as the controller has it, and the least with damping by an interior point
    method, where the levels above are as the controller has them."""
    p, v = controller.plan.problem, controller.state.v
    n, above, found = p.n, list[Any](), []
    for tasks, damping in zip(p.levels, controller.plan.damping.of_levels, strict=False):
        (task,) = tasks
        assert damping.is_on
        rows = p.G[task.rows]
        J, t = rows[:, :n], -rows[:, n]
        D = damping.applied + 1e-8
        rate = damping.rate if controller.level.order > 1 else 0.0 * damping.rate
        F = np.concatenate([np.sqrt(task.weights)[:, None] * J, np.diag(np.sqrt(D))])
        f = np.concatenate([np.sqrt(task.weights) * t, -damping.applied / np.sqrt(D) * rate * v])
        A = np.concatenate([np.zeros((0, n)), *above])
        best = least_squares(F, f, Constraints(A, A @ p.x, np.eye(n), p.lb, p.ub), 1.0 + np.abs(p.x), p.x)
        assert best is not None and best.proved
        found.append((rows @ p.x1, J @ best.x - t))
        above.append(J)
    return found


@pytest.mark.parametrize("level", [VelocityLevel, AccelerationLevel], ids=lambda level: level.name)
@pytest.mark.parametrize("seconds", [0.02, 0.2, 0.6])
def test_every_level_is_the_least_with_its_damping_under_those_above(level: Any, seconds: float):
    controller = running(level(), wbc.Strict(), reaching(), seconds=seconds, limits=[JointLimits()])
    found = by_an_oracle(controller)
    assert len(found) == 2
    for got, least in found:
        np.testing.assert_allclose(got, least, atol=1e-5 * (1.0 + np.abs(least).max()))


def test_the_levels_below_keep_the_freedom_that_rows_leave_and_are_slowed_in_it():
    levels = [reaching()[0], reaching()[2]]
    controller = running(VelocityLevel(), wbc.Strict(), levels, seconds=1.0, limits=[JointLimits()])
    p, damping = controller.plan.problem, controller.plan.damping
    assert damping.is_on and controller.active_count == 0
    J, wanted = p.G[p.levels[0][0].rows, : p.n], p.levels[1][0].wanted
    slow, at = damping.in_metric.applied, J @ p.x
    H = np.diag(damping.in_metric.base + slow)
    system = np.block([[H, J.T], [J, np.zeros((3, 3))]])
    least = np.linalg.solve(system, np.concatenate([damping.in_metric.base * wanted, at]))[: p.n]
    np.testing.assert_allclose(p.x, least, atol=1e-6)
    free = slow < 1e-6  # what has no lever on the hand is as fast as ever
    assert free.any() and slow[~free].max() > 100.0
    assert np.linalg.norm(p.x - np.linalg.pinv(J) @ at) > 1e-3


@pytest.mark.parametrize("level", [VelocityLevel, AccelerationLevel, InverseDynamics], ids=lambda level: level.name)
@pytest.mark.parametrize("factor", [0.02, 0.1, 0.3])
@pytest.mark.parametrize("gain", [5.0, 400.0])
def test_the_damping_is_that_of_the_residual_and_its_lever(level: Any, factor: float, gain: float):
    """d = max(0, Σ s² l / (s + l/100) − b), s = λ √w ‖e_r‖, l = √w ‖Jⱼ‖; λ is at least what a tick's step needs."""
    elbow = ARM.frame_names[len(ARM.frame_names) // 2]
    far = Position("tool", target=FAR, weight=2.0, name="far", rate=gain)
    away = Position(elbow, target=AWAY, weight=0.5, name="away", rate=0.5 * gain)
    levels = [[far, away, Posture(ARM.q0 + 0.1, weight=1e-6)]]
    controller = running(level(lm_damping=factor), wbc.Weighted(), levels, seconds=0.06, limits=[JointLimits()])
    p, damping, errors = controller.plan.problem, controller.plan.damping.in_metric, controller.plan.errors()
    asked = np.zeros(ARM.nj)
    for task, rate, rows in zip((far, away), (gain, 0.5 * gain), p.levels[0], strict=False):
        left = np.abs(p.value[p.item(rows.rows.start) : p.item(rows.rows.stop)])
        per, step = (rate, DT) if level is VelocityLevel else (float(task.gains()[0][0]), 4.0 * DT**2)
        size = np.sqrt(np.sum(rows.weights * np.minimum(left / per, np.abs(errors[task.name])) ** 2))
        s = max(factor, step * per) * size
        lever = np.sqrt(rows.weights @ p.G[rows.rows, : ARM.nv] ** 2)
        asked += s**2 * lever / (s + 0.01 * lever)
    expected = np.maximum(asked - damping.base, 0.0)
    controller.tick(0.06, controller.last.q, controller.last.v)  # type: ignore[union-attr]
    np.testing.assert_allclose(damping.applied, expected, rtol=1e-9, atol=1e-12 * asked.max())
    assert (damping.applied > 0.0).any()


@pytest.mark.parametrize("level", [VelocityLevel, InverseDynamics], ids=lambda level: level.name)
def test_what_is_held_meanwhile_has_its_lever_too(level: Any):
    """lⱼ = √w (‖Jⱼ‖ + Σ ‖Hⱼ‖ max‖J‖ / max‖H‖) over levels above and exact tasks, max over all columns."""
    robot = wbc.load("humanoid")
    state = robot.state()
    hand, head = "right_hand", "head"
    far = Position(hand, target=state.frame(hand).position + np.array([0.0, 0.0, 2.0]), weight=2.0)
    stack = Stack(
        [[CenterOfMass(target=state.com, weight=3.0)], [far], [Posture(robot.q0)]],
        contacts=feet(robot), subject_to=[Position(head, target=state.frame(head).position).exactly()],
    )  # fmt: skip
    controller = Controller(robot, stack, level=level(), hierarchy=wbc.Strict(), dt=DT)
    q, v = np.array(robot.q0), np.zeros(robot.nv)
    for k in range(20):
        q, v = (command := controller.tick(k * DT, q, v)).q, command.v
    p, damping, nb, nv = controller.plan.problem, controller.plan.damping.of_levels[1], robot.nb, robot.nv
    rows = p.levels[1][0].rows
    assert rows is not None

    def columns(rows: slice, weight: float) -> Vec:
        return np.sqrt(weight) * np.linalg.norm(p.G[rows, :nv], axis=0)

    kp, _, rate = (float(gain[0]) for gain in far.gains())
    per, step = (rate, DT) if level is VelocityLevel else (kp, 4.0 * DT**2)
    left = np.abs(p.value[p.item(rows.start) : p.item(rows.stop)])
    e = np.minimum(left / per, np.abs(controller.plan.errors()[far.name]))
    s = max(0.05, step * per) * np.sqrt(2.0) * np.linalg.norm(e)
    own, lever = columns(rows, 2.0), columns(rows, 2.0)[nb:]
    layout = controller.plan.layout
    for block in (*layout.kinematic[:1], *layout.exact):
        held = columns(block.rows, 1.0)
        lever = lever + held[nb:] * own.max() / held.max()
    assert (lever > 0.0).all() and (own[nb:] == 0.0).any()
    expected = np.maximum(s**2 * lever / (s + 0.01 * lever) - damping.base, 0.0)
    controller.tick(20 * DT, q, v)
    np.testing.assert_allclose(damping.applied, expected, rtol=1e-9)


def slowed(controller: Controller) -> list[tuple[Vec, Vec]]:
    """Weight and rate of each damping by the residuals, and with what stands above it stalled: the formula in numpy."""
    p, damping = controller.plan.problem, controller.plan.damping
    v = controller.state.v if controller.level.order > 1 else np.zeros(ARM.nj)
    stalled, rate, found = np.zeros(ARM.nj), np.zeros(ARM.nj), []
    tasks = [[task for task in level if task.kinematic] for level in p.levels]
    for (task,), one in zip(tasks, [*damping.of_levels, damping.in_metric], strict=False):
        observe(one.address)
        J, applied, own_rate = p.G[task.rows, : ARM.nj], one.applied.copy(), one.rate.copy()
        asked = p.G[task.rows, p.n] - J @ (own_rate * v)
        left = p.value[p.item(task.rows.start) : p.item(task.rows.stop)]
        before, after = (float(np.sqrt(task.weights @ r**2)) for r in (asked, left))
        own = np.zeros(ARM.nj)
        if applied.any() and before > 0.0:
            own = applied / applied.max() * min(before, after) / max(before - after, 1e-3 * before)
        more = stalled * (one.base + task.weights @ J**2)
        total = applied + more
        mean = (own_rate * applied + rate * more) / np.where(total > 0.0, total, 1.0)
        found.append((total, np.where(total > 0.0, mean, rate) if stalled.any() else own_rate))
        rate, stalled = np.where(own > stalled, own_rate, rate), np.maximum(own, stalled)
    return found


@pytest.mark.parametrize("level", [VelocityLevel, AccelerationLevel], ids=lambda level: level.name)
@given(st.data())
def test_what_stands_below_a_stalled_level_is_damped_as_many_times_its_own_curvature(level: Any, data: st.DataObject):
    """Whatever the levels ask for and leave, nothing included: one that asks for nothing is not stalled."""
    levels = [*reaching()[:2], [Position("tool", target=AWAY, name="last"), Damping()]]
    controller = running(level(), wbc.Strict(), levels, seconds=0.02, limits=[JointLimits()])
    p, numbers = controller.plan.problem, st.sampled_from([0.0, 0.0, 1e-3, 1.0, 30.0])
    for task in (tasks[0] for tasks in p.levels):
        assert task.rows is not None
        p.G[task.rows, p.n] = data.draw(arrays(float, 3, elements=numbers))
        p.value[p.item(task.rows.start) : p.item(task.rows.stop)] = data.draw(arrays(float, 3, elements=numbers))
    expected = slowed(controller)
    observe_all(controller.plan.damping.address)
    every = [*controller.plan.damping.of_levels, controller.plan.damping.in_metric]
    assert len(every) == len(expected) == 3
    for one, (applied, rate) in zip(every, expected, strict=True):
        np.testing.assert_allclose(one.applied, applied, rtol=1e-9)
        np.testing.assert_allclose(one.rate, rate, rtol=1e-9)
        assert one.is_on == applied.any()


@pytest.mark.parametrize("level", [VelocityLevel, AccelerationLevel, InverseDynamics], ids=lambda level: level.name)
def test_tasks_on_joints_and_damping_are_one_square_about_their_centre(level: Any):
    """Σ w (x − t)² + d (x + rate v)² is (Σ w + d) (x − centre)² but for a constant; a velocity has no rate."""
    postures = [Posture(ARM.q0 + 0.1, weight=3e-3), Posture(ARM.q0 - 0.2, weight=2e-4, name="other")]
    levels = [[Position("tool", target=FAR, weight=2.0), *postures]]
    controller = running(level(), wbc.Weighted(), levels, seconds=0.2, limits=[JointLimits()])
    p, damping, v = controller.plan.problem, controller.plan.damping.in_metric, controller.state.v
    assert damping.is_on and np.abs(v).max() > 0.1
    _, one, two = p.levels[0]
    brakes = damping.rate * v if controller.level.order > 1 else 0.0 * v
    pulls = one.weights * one.wanted + two.weights * two.wanted - damping.applied * brakes
    centre = p.centre[damping.columns]
    np.testing.assert_allclose((damping.base + damping.applied) * centre, pulls, atol=1e-9 * np.abs(pulls).max())


@pytest.mark.parametrize("hierarchy", [wbc.Strict(), wbc.Scaled()], ids=lambda hierarchy: type(hierarchy).__name__)
@pytest.mark.parametrize("level", [VelocityLevel, AccelerationLevel, InverseDynamics], ids=lambda level: level.name)
def test_what_is_left_of_a_damped_level_is_told_of_what_was_asked(level: Any, hierarchy: Any):
    controller = running(level(), hierarchy, [*reaching()[:1], [Damping()]], seconds=0.3, limits=[JointLimits()])
    p, (first, *_), last = controller.plan.problem, controller.levels, controller.last
    assert last is not None and controller.plan.damping.is_on
    (task,) = p.levels[0]
    np.testing.assert_array_equal(p.G[task.rows, p.n], -task.wanted)
    left = p.G[task.rows] @ p.x1
    np.testing.assert_allclose(p.value[p.item(task.rows.start) : p.item(task.rows.stop)], left, atol=1e-12)
    assert np.abs(left).max() > 1e-2
    assert last.certificate.ok and all(outcome.certificate.ok for outcome in controller.levels)
    assert "damping of the joints" in controller.explain()
    if isinstance(hierarchy, wbc.Strict):
        assert first.how == "optimal"
        assert first.residual == pytest.approx(float(np.sqrt(task.weights @ left**2)))


@pytest.mark.parametrize("level", [VelocityLevel, AccelerationLevel, InverseDynamics], ids=lambda level: level.name)
def test_joints_that_a_task_of_their_level_holds_hard_need_no_damping(level: Any):
    """And the weight that it has now is the one that counts."""
    posture = Posture(ARM.q0 + 0.1, weight=1e-4)
    levels = [[Position("tool", target=FAR), posture], [Damping()]]
    controller = running(level(), wbc.Strict(), levels, seconds=0.02, limits=[JointLimits()])
    (damping, *_) = controller.plan.damping.of_levels
    assert damping.is_on
    posture.weight = 1e6
    for k in range(2):
        controller.tick(0.02 + k * DT, np.array(ARM.q0), np.zeros(ARM.nv))
    assert not damping.is_on


def test_a_reset_ends_the_damping_of_every_level():
    controller = running(VelocityLevel(), wbc.Strict(), reaching(), seconds=0.1, limits=[JointLimits()])
    assert all(damping.is_on for damping in controller.plan.damping.of_levels)
    controller.reset()
    first = controller.tick(0.0, np.array(ARM.q0), np.zeros(ARM.nv)).v
    assert not controller.plan.damping.is_on
    np.testing.assert_array_equal(
        first,
        running(VelocityLevel(), wbc.Strict(), reaching(), seconds=DT, limits=[JointLimits()]).last.v,
    )
