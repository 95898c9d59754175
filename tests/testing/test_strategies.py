"""What the strategies promise of what they draw."""

from __future__ import annotations

import numpy as np
from hypothesis import given

from wbc.models.model import RobotState
from wbc.testing import moments, robots
from wbc.testing.strategies import boxes, spd, states

HUMANOID = robots()[2]


@given(states(HUMANOID))
def test_states_are_inside_the_joint_limits_and_move(state: RobotState):
    limits = HUMANOID.limits
    assert (limits.q_min <= state.q_joints).all() and (state.q_joints <= limits.q_max).all()
    assert np.isfinite(state.M).all() and np.abs(state.v).max() > 0.0


@given(boxes(5))
def test_boxes_are_never_crossed(box: tuple[np.ndarray, np.ndarray]):
    lower, upper = box
    assert lower.shape == upper.shape == (5,)
    assert (lower <= upper).all() and (lower < np.inf).all() and (upper > -np.inf).all()


@given(spd(6, condition=100.0))
def test_matrices_are_symmetric_and_well_conditioned(matrix: np.ndarray):
    np.testing.assert_array_equal(matrix, matrix.T)
    values = np.linalg.eigvalsh(matrix)
    assert 0.0099 <= values.min() and values.max() <= 1.0001


def test_moments_are_the_same_each_time():
    for first, second in zip(moments(HUMANOID), moments(HUMANOID), strict=True):
        assert first[0] == second[0]
        np.testing.assert_array_equal(first[1], second[1])
        np.testing.assert_array_equal(first[2], second[2])
