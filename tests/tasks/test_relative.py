"""One frame seen from another: poses, what does not move them, and large turns."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio
import pytest
from hypothesis import given

from tasks import Frame, Orientation, RelativeFrame, RelativeOrientation, RelativePosition
from tests.tasks.rows_of import finite, moment, rows
from wbc.models.model import RobotModel, RobotState
from wbc.testing import check_task, moments, robots
from wbc.testing.strategies import states

ROBOTS = robots()
ARM, QUADRUPED, HUMANOID = ROBOTS
each_robot = pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)


@given(states(HUMANOID))
def test_at_its_target_a_frame_is_where_the_other_says(state: RobotState):
    here = state.frame("right_hand").placement.actInv(state.frame("left_hand").placement)
    out = rows(RelativeFrame("left_hand", reference="right_hand", target=here), state)
    np.testing.assert_allclose(out.e, 0.0, atol=1e-9)


@given(states(HUMANOID))
def test_moving_the_whole_robot_moves_nothing_against_anything(state: RobotState):
    out = rows(RelativeFrame("left_hand", reference="right_sole", target=np.eye(4)), state)
    np.testing.assert_allclose(out.J[:, :6], 0.0, atol=1e-12)


@given(states(QUADRUPED))
def test_a_relative_frame_is_a_relative_position_above_a_relative_orientation(state: RobotState):
    target, names = pinocchio.SE3.Random(), ("rear_left_foot", "front_left_foot")
    both = rows(RelativeFrame(names[0], reference=names[1], target=target), state)
    parts = [
        rows(RelativePosition(names[0], reference=names[1], target=target.translation), state),
        rows(RelativeOrientation(names[0], reference=names[1], target=target.rotation), state),
    ]
    for array in ("e", "J", "drift"):
        np.testing.assert_array_equal(getattr(both, array), np.concatenate([getattr(part, array) for part in parts]))


@given(states(ARM))
def test_seen_from_a_frame_that_stands_still_a_relative_frame_is_a_frame(state: RobotState):
    target, tool = pinocchio.SE3.Random(), ARM.frame_names[-1]
    base = state.frame("base")
    relative = rows(RelativeFrame(tool, reference="base", target=base.placement.actInv(target)), state)
    plain = rows(Frame(tool, target=target), state)
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
        Orientation(b, target=turn @ state.frame(b).rotation),
        RelativeOrientation(b, reference=a, target=turn @ relative),
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
