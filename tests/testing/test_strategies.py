"""What the strategies promise of what they draw."""

from __future__ import annotations

import numpy as np
from hypothesis import given

from wbc.models.model import RobotState
from wbc.testing import moments, robots
from wbc.testing.strategies import boxes, jacobians, limits, spd, states, vectors

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


@given(limits(6))
def test_limits_contain_zero_and_are_not_crossed(pair: tuple[np.ndarray, np.ndarray]):
    lower, upper = pair
    assert (lower <= 0.0).all() and (upper >= 0.0).all()
    finite = np.abs(np.append(lower, upper))
    finite = finite[np.isfinite(finite) & (finite > 0.0)]
    assert ((finite >= 1e-3) & (finite <= 1e3)).all()


@given(vectors(5))
def test_entries_of_vectors_are_zero_or_of_the_magnitudes_asked_for(vector: np.ndarray):
    size = np.abs(vector[vector != 0.0])
    assert vector.shape == (5,) and ((size >= 1e-3) & (size <= 1e3)).all()


@given(jacobians(3, 5, deficient=False))
def test_full_jacobians_have_the_condition_asked_for(J: np.ndarray):
    values = np.linalg.svd(J)[1]
    assert 1e-3 * 0.99 <= values[0] <= 1e3 * 1.01 and values[-1] >= values[0] / 1.01e6


@given(jacobians(3, 5, deficient=True))
def test_deficient_jacobians_lack_a_direction(J: np.ndarray):
    values = np.linalg.svd(J)[1]
    assert values[-1] <= 1e-12 * (values[0] + 1e-300)


@given(jacobians(0, 4), jacobians(4, 0))
def test_jacobians_may_be_empty(wide: np.ndarray, tall: np.ndarray):
    assert wide.shape == (0, 4) and tall.shape == (4, 0)
