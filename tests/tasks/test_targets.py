"""What may be given as a target, when it is looked at, and what a task makes of it."""

from __future__ import annotations

import re
from functools import partial
from typing import Any

import numpy as np
import pinocchio
import pytest
from hypothesis import given

import wbc
from tasks import CenterOfMass, ContactForce, Frame, Orientation, Position, Posture, Sinusoid, Torque
from tasks.motions import pose_motion, swing
from tests.tasks.rows_of import linear_rows, rows
from wbc.errors import InvalidInput
from wbc.models.model import RobotState
from wbc.testing import robots
from wbc.testing.strategies import states

ARM, QUADRUPED, HUMANOID = robots()
TOOL = ARM.frame_names[-1]
IDENTITY = np.eye(3)


def pose(rotation: Any) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3] = rotation
    return matrix


@given(states(HUMANOID))
def test_a_task_at_its_target_has_no_error(state: RobotState):
    frame = state.frame("left_hand")
    here = pinocchio.SE3(frame.placement)
    for task in (
        Frame("left_hand", target=here),
        Frame("left_hand", target=here.homogeneous),
        Position("left_hand", target=frame.position),
        Orientation("left_hand", target=frame.rotation),
        CenterOfMass(target=state.com),
        Posture(state.q),
        Posture(state.q_joints),
    ):
        np.testing.assert_allclose(rows(task, state).e, 0.0, atol=1e-7)


@given(states(ARM))
def test_a_frame_is_its_position_above_its_orientation(state: RobotState):
    target = pinocchio.SE3.Random()
    both = rows(Frame(TOOL, target=target), state)
    parts = (
        rows(Position(TOOL, target=target.translation), state),
        rows(Orientation(TOOL, target=target.rotation), state),
    )
    for array in ("e", "J", "drift"):
        np.testing.assert_array_equal(getattr(both, array), np.concatenate([getattr(part, array) for part in parts]))


@given(states(ARM))
def test_turning_by_the_rotation_error_reaches_the_target(state: RobotState):
    target = pinocchio.SE3.Random().rotation
    error = rows(Orientation(TOOL, target=target), state).e
    np.testing.assert_allclose(pinocchio.exp3(error) @ state.frame(TOOL).rotation, target, atol=1e-8)


def test_weights_of_position_and_orientation_may_be_said_apart():
    def weights(**given: Any) -> list[float]:
        return Frame(TOOL, target=np.eye(4), **given).weights().tolist()

    assert weights(weight=[1, 2, 3, 4, 5, 6]) == [1, 2, 3, 4, 5, 6]
    assert weights(orientation_weight=0.1) == [1, 1, 1, 0.1, 0.1, 0.1]
    assert weights(weight=5.0, position_weight=2.0) == [2, 2, 2, 5, 5, 5]


def test_a_target_may_be_assigned_between_ticks_and_is_checked_there():
    state, task = ARM.state(), Position(TOOL, target=np.zeros(3))
    before = rows(task, state).e.copy()
    task.target = [0.0, 0.0, 1.0]
    np.testing.assert_allclose(rows(task, state).e - before, [0.0, 0.0, 1.0])
    with pytest.raises(InvalidInput, match=r"target must have shape \(3,\)"):
        task.target = [0.0, 1.0]
    np.testing.assert_allclose(rows(task, state).e - before, [0.0, 0.0, 1.0])
    assert task.target == [0.0, 0.0, 1.0]


def test_what_a_user_changes_later_does_not_reach_the_task():
    given = np.zeros(3)
    task = Position(TOOL, target=given)
    before = rows(task, ARM.state()).e.copy()
    given[:] = 100.0
    np.testing.assert_array_equal(rows(task, ARM.state()).e, before)


def test_numbers_that_come_in_a_tick_are_left_to_the_certificate_but_not_shapes():
    state, broken = ARM.state(), [False]
    task = Position(TOOL, target=lambda t: np.full(3, np.nan) if broken[0] else np.zeros(3))
    task.prepare(ARM)
    broken[0] = True
    assert np.isnan(rows(task, state).e).all()
    task.target = lambda t: np.zeros(3 if t == 0.0 else 2)
    state.update(1.0, ARM.q0, np.zeros(ARM.nv))
    with pytest.raises(InvalidInput, match=r"\(3,\)"):
        rows(task, state)


FOLLOWING: dict[str, Any] = {  # tasks by what their targets are
    "position": (np.zeros(3), partial(Position, TOOL)),
    "rotation": (IDENTITY, partial(Orientation, TOOL)),
    "pose": (np.eye(4), partial(Frame, TOOL)),
    "joints": (ARM.q0, Posture),
}


@pytest.mark.parametrize("given", [None, "there", [0.0, None, 0.0], 1j], ids=repr)
@pytest.mark.parametrize("kind", FOLLOWING)
def test_a_target_that_is_no_numbers_any_more_is_named_in_its_tick(kind: str, given: Any):
    sound, task = FOLLOWING[kind]
    said = [sound]
    stack = wbc.Stack([task(target=lambda t: said[0])])
    controller = wbc.Controller(ARM, stack, level=wbc.AccelerationLevel())
    at_rest = ARM.q0, np.zeros(ARM.nv)
    assert controller.tick(0.0, *at_rest).status.ok
    said[0] = given
    assert not controller.tick(1e-3, *at_rest).status.ok
    assert re.search(r"\btarget must be a", controller.why) and repr(given) in controller.why, controller.why


@given(states(ARM))
def test_the_inverse_inertia_weight_is_the_kinetic_norm_of_the_torque(state: RobotState):
    tau_0, tau = np.arange(7.0), np.linspace(-3.0, 5.0, 7)
    out = linear_rows(Torque(tau_0, weight="inverse_inertia"), state, 7)
    residual, off = out.A @ tau - out.b, tau - tau_0
    np.testing.assert_allclose(residual @ residual, off @ np.linalg.solve(state.M, off), rtol=1e-9)


@given(state=states(HUMANOID))
def test_on_a_floating_base_the_weight_is_that_of_the_joints(state: RobotState):
    tau_0 = np.linspace(-3.0, 5.0, HUMANOID.nj)
    out = linear_rows(Torque(tau_0, weight="inverse_inertia"), state, HUMANOID.nj)
    weight = np.linalg.inv(state.M)[6:, 6:]
    np.testing.assert_allclose(out.A.T @ out.A, weight, atol=1e-8 * np.abs(weight).max())
    np.testing.assert_allclose(out.b, out.A @ tau_0, atol=1e-9)


@given(states(ARM))
def test_a_position_along_some_axes_is_some_rows_of_the_whole(state: RobotState):
    whole = rows(Position(TOOL, target=[0.3, 0.1, 0.5]), state)
    part = rows(Position(TOOL, target=[0.3, 0.5], axes="xz"), state)
    for array in ("e", "J", "drift"):
        np.testing.assert_array_equal(getattr(part, array), getattr(whole, array)[[0, 2]])


def test_a_torque_and_a_force_are_wished_for_row_by_row():
    state = ARM.state()
    torque = linear_rows(Torque(2.0), state, 7)
    np.testing.assert_array_equal(torque.A, np.eye(7))
    np.testing.assert_array_equal(torque.b, np.full(7, 2.0))
    force = linear_rows(ContactForce("left_sole", target=[0.0, 0.0, 400.0]), state, 6)
    np.testing.assert_array_equal(force.A, np.eye(6)[:3])
    np.testing.assert_array_equal(force.b, [0.0, 0.0, 400.0])


def test_poses_may_move_along_two_motions():
    motion = pose_motion(
        Sinusoid([0.0] * 3, amplitude=0.1, frequency=0.5), swing(IDENTITY, [0, 0, 2], angle=0.3, frequency=1)
    )
    value, rate, second = motion(0.4)
    assert isinstance(value, pinocchio.SE3) and rate.shape == second.shape == (6,)
    ahead, behind = motion(0.4 + 1e-5)[0], motion(0.4 - 1e-5)[0]
    turned = pinocchio.log3(ahead.rotation @ behind.rotation.T) / 2e-5
    np.testing.assert_allclose(
        np.concatenate([(ahead.translation - behind.translation) / 2e-5, turned]), rate, atol=1e-7
    )


def test_what_the_refusal_of_a_quaternion_says_is_taken():
    turn = pinocchio.Quaternion(np.cos(0.5), 0.0, 0.0, np.sin(0.5))  # one radian about z
    np.testing.assert_allclose(Orientation(TOOL, target=turn.matrix()).reference(0.0).value[0, 0], np.cos(1.0))
    Frame(TOOL, target=pinocchio.SE3(turn, np.zeros(3)))
