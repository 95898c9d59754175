"""Frames, directions, headings and distances: what their errors mean, also where they are hard to define."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tasks as T
from tasks.directions import view_axes
from tests.tasks.rows_of import finite, moment, rows
from wbc.models.model import RobotModel, RobotState
from wbc.testing import check_task, moments, robots
from wbc.testing.strategies import states, vectors

ROBOTS = robots()
ARM, QUADRUPED, HUMANOID = ROBOTS
TOOL = ARM.frame_names[-1]
TARGET, POSE = np.array([0.3, 0.1, 0.6]), pinocchio.exp6(np.array([0.3, 0.1, 0.6, 0.5, -1.0, 0.8]))
each_robot = pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)

FEET: dict[str, Any] = {"frame": "rear_left_foot", "reference": "front_left_foot"}
#: A task, those whose rows stand below one another in it or, of one of them, which rows it has.
PARTS: dict[str, tuple[RobotModel, Any, list[Any], Any]] = {
    "frame": (
        ARM, T.Frame(TOOL, target=POSE),
        [T.Position(TOOL, target=POSE.translation), T.Orientation(TOOL, target=POSE.rotation)], slice(None),
    ),
    "relative frame": (
        QUADRUPED, T.RelativeFrame(**FEET, target=POSE),
        [T.RelativePosition(**FEET, target=POSE.translation), T.RelativeOrientation(**FEET, target=POSE.rotation)],
        slice(None),
    ),
    "momentum": (HUMANOID, T.CentroidalMomentum(), [T.LinearMomentum(), T.AngularMomentum()], slice(None)),
    "some axes": (ARM, T.Position(TOOL, target=TARGET[[0, 2]], axes="xz"), [T.Position(TOOL, target=TARGET)], [0, 2]),
    "some axes of its own": (
        ARM, T.LocalPosition(TOOL, target=TARGET, axes="xz"), [T.LocalPosition(TOOL, target=TARGET)], [0, 2],
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", PARTS)
@given(seed=st.integers(0, 2**32 - 1))
def test_rows_of_a_whole_are_those_of_its_parts(case: str, seed: int):
    robot, whole, parts, picked = PARTS[case]
    state = moment(robot, *moments(robot, count=1, seed=seed)[0][1:])
    found, expected = rows(whole, state), [rows(part, state) for part in parts]
    for array in ("e", "J", "drift"):
        wanted = np.concatenate([getattr(part, array) for part in expected])[picked]
        np.testing.assert_allclose(getattr(found, array), wanted, rtol=0, atol=1e-10 if case == "momentum" else 0.0)


@given(states(HUMANOID))
def test_along_its_own_axes_it_is_the_same_error(state: RobotState):
    hand = state.frame("left_hand")
    own, world = (rows(kind("left_hand", target=TARGET), state) for kind in (T.LocalPosition, T.Position))
    np.testing.assert_allclose(hand.rotation @ own.e, world.e, atol=1e-12)
    # Turning with the frame adds the lever to the target, and nothing where the frame is at it.
    lever = pinocchio.skew(TARGET - hand.position) @ hand.jacobian()[3:]
    np.testing.assert_allclose(hand.rotation @ own.J, world.J - lever, atol=1e-12)


@given(states(HUMANOID))
def test_at_its_target_a_frame_is_where_the_other_says(state: RobotState):
    here = state.frame("right_hand").placement.actInv(state.frame("left_hand").placement)
    out = rows(T.RelativeFrame("left_hand", reference="right_hand", target=here), state)
    np.testing.assert_allclose(out.e, 0.0, atol=1e-9)


@given(states(ARM))
def test_seen_from_a_frame_that_stands_still_a_relative_frame_is_a_frame(state: RobotState):
    target, tool = pinocchio.SE3.Random(), ARM.frame_names[-1]
    base = state.frame("base")
    relative = rows(T.RelativeFrame(tool, reference="base", target=base.placement.actInv(target)), state)
    plain = rows(T.Frame(tool, target=target), state)
    turn = np.kron(np.eye(2), base.rotation)
    np.testing.assert_allclose(turn @ relative.J, plain.J, atol=1e-12)
    np.testing.assert_allclose(turn @ relative.drift, plain.drift, atol=1e-10)
    np.testing.assert_allclose(turn @ relative.e, plain.e, atol=1e-9)


def half_turns(robot: RobotModel, off: float) -> list[Any]:
    """Orientation tasks whose error is a turn by π less ``off``, and the moment."""
    first = moments(robot, count=1, seed=2)[0]
    state, (a, b) = moment(robot, first[1]), robot.frame_names[1 :: len(robot.frame_names) - 2]
    turn = pinocchio.exp3((np.pi - off) * np.array([0.6, 0.0, 0.8]))
    relative = state.frame(a).rotation.T @ state.frame(b).rotation
    return [
        first,
        T.Orientation(b, target=turn @ state.frame(b).rotation),
        T.RelativeOrientation(b, reference=a, target=turn @ relative),
    ]


@each_robot
@pytest.mark.parametrize("off", [0.0, 1e-9, 1e-4, 0.01])
def test_half_turns_have_an_error_of_half_a_turn_that_leads_to_the_target(robot: RobotModel, off: float):
    first, *found = half_turns(robot, off)
    state = moment(robot, *first[1:])
    for task in found:
        out = rows(task, state)
        assert finite(out) and np.linalg.norm(out.e) == pytest.approx(np.pi - off, abs=1e-6)
        if off > 1e-3:
            check_task(task, robot, [first, first])
    absolute = rows(found[0], state)
    reached = pinocchio.exp3(absolute.e) @ state.frame(found[0].frame).rotation
    np.testing.assert_allclose(reached, found[0].target, atol=1e-6)


# ---- directions, headings and distances


def angle_between(a: Any, b: Any) -> float:
    """Kahan's formula, exact for small and for large angles."""
    a, b = np.asarray(a) / np.linalg.norm(a), np.asarray(b) / np.linalg.norm(b)
    return float(2.0 * np.arctan2(np.linalg.norm(a - b), np.linalg.norm(a + b)))


def facing(robot: RobotModel, axis: Any, angle: float) -> tuple[Any, np.ndarray]:
    """A random moment, and the world direction that lies ``angle`` beside the axis of the last frame then."""
    first = moments(robot, count=1, seed=5)[0]
    state = moment(robot, first[1])
    b1, _, a = view_axes(np.asarray(axis, dtype=float) / np.linalg.norm(axis))
    local = np.cos(angle) * a + np.sin(angle) * b1
    return first, state.frame(robot.frame_names[-1]).rotation @ local


@given(states(ARM), vectors(3, low=0.1, high=10.0), vectors(3, low=0.1, high=10.0))
def test_the_length_of_the_error_is_the_angle_to_the_direction(state: RobotState, axis: Any, target: Any):
    if not (axis.any() and target.any()):
        return
    angle = angle_between(state.frame(TOOL).rotation @ axis, target)
    e = rows(T.AxisAlignment(TOOL, axis=axis, target=target), state).e
    assert np.linalg.norm(e) == pytest.approx(min(angle, np.pi - 0.01), abs=1e-7)


@given(states(HUMANOID), vectors(3, low=0.1, high=10.0))
def test_gaze_is_the_alignment_with_the_line_of_sight(state: RobotState, target: Any):
    head = state.frame("head")
    sight = rows(T.AxisAlignment("head", axis=[1, 0, 0], target=target - head.position), state)
    gaze = rows(T.Gaze("head", axis=[1, 0, 0], target=target), state)
    np.testing.assert_allclose(gaze.e, sight.e, atol=1e-12)


@each_robot
@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 0.3, 0.32, 1.5, 3.0, np.pi - 0.02])
def test_rows_are_derivatives_from_straight_ahead_to_nearly_behind(robot: RobotModel, angle: float):
    first, direction = facing(robot, [0, 1, 2], angle)
    check_task(T.AxisAlignment(robot.frame_names[-1], axis=[0, 1, 2], target=direction), robot, [first, first])


@each_robot
def test_straight_behind_is_a_hundredth_beside_it(robot: RobotModel):
    first, behind = facing(robot, [0, 0, 1], np.pi)
    out = rows(T.AxisAlignment(robot.frame_names[-1], axis=[0, 0, 1], target=behind), moment(robot, *first[1:]))
    assert np.linalg.norm(out.e) == pytest.approx(np.pi - 0.01)
    assert finite(out) and np.abs(out.J).max() <= np.pi / np.sin(0.01)


@given(st.floats(0.0, 3.1), st.floats(0.0, 6.3))
def test_a_bearing_is_an_angle_in_its_direction(angle: float, around: float):
    u = np.array([np.sin(angle) * np.cos(around), np.sin(angle) * np.sin(around), np.cos(angle)])
    state, axis = moment(ARM, ARM.q0), np.array([0.0, 0.0, 1.0])
    direction = state.frame(TOOL).rotation @ (view_axes(axis).T @ u)
    error = rows(T.AxisAlignment(TOOL, axis=axis, target=direction), state).e
    np.testing.assert_allclose(error, angle * np.array([np.cos(around), np.sin(around)]), atol=1e-9)


@each_robot
@pytest.mark.parametrize("distance", [0.0, 1e-12, 1e-3])
def test_within_its_nearest_distance_gaze_fades_out(robot: RobotModel, distance: float):
    first = moments(robot, count=1)[0]
    frame = moment(robot, first[1]).frame(robot.frame_names[-1])
    beside = frame.position + distance * frame.rotation[:, 0]
    task = T.Gaze(robot.frame_names[-1], axis=[0, 0, 1], target=beside)
    out = rows(task, moment(robot, *first[1:]))
    assert finite(out) and np.linalg.norm(out.e) <= 100.0 * distance * np.pi / 2 + 1e-12
    check_task(task, robot, [first, first])


@given(states(ARM), st.floats(-20.0, 20.0))
def test_turning_by_the_yaw_error_reaches_the_heading(state: RobotState, target: float):
    e = float(rows(T.Yaw(TOOL, target=target), state).e[0])
    assert -np.pi <= e <= np.pi
    x = pinocchio.exp3(np.array([0.0, 0.0, e])) @ state.frame(TOOL).rotation[:, 0]
    assert np.cos(np.arctan2(x[1], x[0]) - target) == pytest.approx(1.0, abs=1e-9)


@each_robot
def test_an_upright_axis_has_a_finite_heading(robot: RobotModel):
    first = moments(robot, count=1)[0]
    upright = moment(robot, first[1]).frame(robot.frame_names[-1]).rotation.T @ [0.0, 0.0, 1.0]
    out = rows(T.Yaw(robot.frame_names[-1], axis=upright, target=0.3), moment(robot, *first[1:]))
    assert finite(out) and np.abs(out.J).max() <= 1.0 / 1e-2


@each_robot
@pytest.mark.parametrize("apart", [0.0, 1e-9, 0.02, 0.5])
def test_distances_down_to_none_push_apart(robot: RobotModel, apart: float):
    first = moments(robot, count=1)[0]
    name = robot.frame_names[-1]
    there = moment(robot, first[1]).frame(name).position - apart * np.array([0.6, 0.0, 0.8])
    task = T.Distance(name, to=there, target=0.2)
    out = rows(task, moment(robot, *first[1:]))
    assert finite(out) and out.e[0] == pytest.approx(0.2 - apart, abs=1e-12)
    assert np.linalg.norm(out.J) > 0.1  # there is a way to move
    if apart > 1e-3:
        check_task(task, robot, [first, first])
