"""Quantities along a motion, and the derivatives of inverse dynamics, beside differences of Pinocchio's own."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import wbc
from wbc.models.along import placed, velocities
from wbc.models.derivatives import inverse_dynamics_derivatives

STEP = 1e-6


@pytest.mark.parametrize("seed", range(3))
def test_derivatives_of_inverse_dynamics_are_those_of_differences(seed: int):
    robot, rng = wbc.load("humanoid", base="floating"), np.random.default_rng(seed)
    model, state = robot.pinocchio, robot.state()
    q, v, a = robot.random_configuration(rng), *rng.normal(size=(2, robot.nv))
    joint = model.frames[robot.frames["left_sole"]].parentJoint
    local = [pin.Force.Zero() for _ in range(model.njoints)]
    local[joint] = pin.Force(100.0 * rng.normal(size=6))  # it moves with the joint

    def torques(q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        return pin.rnea(model, model.createData(), q, v, a, pin.StdVec_Force(local)).copy()

    state.update(0.0, q, v)
    placement = state.frame("left_sole").placement * model.frames[robot.frames["left_sole"]].placement.inverse()
    found = inverse_dynamics_derivatives(state, a, [("left_sole", placement.act(local[joint]))])
    for k, d in enumerate(STEP * np.eye(robot.nv)):
        moved = [(robot.integrate(q, s * d), v + 0.0 * d, a + 0.0 * d) for s in (1.0, -1.0)]
        faster, stronger = ([(q, v + s * d, a) for s in (1.0, -1.0)], [(q, v, a + s * d) for s in (1.0, -1.0)])
        for by, (after, before) in zip(found, (moved, faster, stronger), strict=True):
            slope = (torques(*after) - torques(*before)) / (2.0 * STEP)
            np.testing.assert_allclose(by[:, k], slope, atol=1e-5 * max(1.0, np.abs(slope).max()))


def test_velocities_of_a_motion_at_constant_acceleration_are_exact():
    robot = wbc.load("humanoid", base="floating")
    t, rng = np.arange(9) / 50.0, np.random.default_rng(0)
    v0, a0 = np.zeros(robot.nv), np.zeros(robot.nv)
    v0[6:], a0[6:] = rng.normal(size=(2, robot.nj))
    q = np.array([robot.integrate(robot.q0, s * v0 + 0.5 * s**2 * a0) for s in t])
    v, a, steps = velocities(robot, q, 50.0)
    np.testing.assert_allclose(v[1:-1], v0 + t[1:-1, None] * a0, atol=1e-9)
    np.testing.assert_allclose(a, np.tile(a0, (9, 1)), atol=1e-8)
    assert steps.shape == (8, robot.nv)


def test_frames_and_lowest_points_are_where_pinocchio_has_them():
    robot, rng = wbc.load("humanoid", base="floating"), np.random.default_rng(1)
    q = np.array([robot.random_configuration(rng) for _ in range(4)])
    positions, rotations = placed(robot, q, {"foot": "left_sole"})["foot"]
    foot, data = robot.feet["left_sole"], robot.pinocchio.createData()
    points = foot.lowest_in_world(positions, rotations)
    for k, row in enumerate(q):
        pin.framesForwardKinematics(robot.pinocchio, data, row)
        at = data.oMf[robot.frames["left_sole"]]
        np.testing.assert_allclose(positions[k], at.translation, atol=1e-12)
        expected = [at.act(np.array(point)) - [0.0, 0.0, below] for point, below in foot.lowest()]
        np.testing.assert_allclose(points[k], expected, atol=1e-12)
