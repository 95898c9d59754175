"""A sound robot is not blamed for inertia, damping and friction of its motors; mistakes never pass as proven."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from wbc.robots import MotorBoard, UnitreeGo2
from wbc.robots.check import AMPLITUDE
from wbc.robots.motor_board import holding_gains
from wbc.robots.response import Expected, Response, Weights
from wbc.types import Mat

mujoco = pytest.importorskip("mujoco")
pytestmark = pytest.mark.physics

from tests.robots.examples import needs_examples  # noqa: E402 - needs the physics engine
from tests.robots.mistakes import Seeded, checked, period  # noqa: E402

ARM = wbc.load("arm")


def motors(board: MotorBoard, seed: int) -> Mat:
    """Rotor inertia [kg m²], damping [N m s/rad] and dry friction [N m] (3, nj), over the decades that joints have.

    The same for all joints if the seed is even; else each joint its own, inertias in proportion to torque limits.
    Friction is at most half of what a motor gives at the amplitude of a check.
    """
    robot, rng = board.plant.model, np.random.default_rng([7, seed])
    least, most = np.array([[1e-3], [0.01], [0.01]]), np.array([[1.0], [10.0], [2.0]])
    drawn = np.ones((3, robot.nj)) * least * (most / least) ** rng.random((3, robot.nj if seed % 2 else 1))
    if seed % 2:
        drawn[0] *= robot.limits.tau_max / robot.limits.tau_max.max()
    drawn[2] = np.minimum(drawn[2], 0.5 * AMPLITUDE * np.asarray(board.device.gains[0])[: robot.nj])
    return drawn


def fitted(seed: int) -> Callable[[MotorBoard], None]:
    """Give a board such motors; its joints rest where a push from either side, and their friction, have left them."""

    def fit(board: MotorBoard) -> None:
        plant: Any = board.plant
        drawn, index = motors(board, seed), [plant._bridge.velocity_index(i) for i in range(plant.model.nj)]
        physics = plant.physics
        physics.dof_armature[index], physics.dof_damping[index], physics.dof_frictionloss[index] = drawn
        plant._damping = physics.dof_damping.copy()
        mujoco.mj_setConst(physics, mujoco.MjData(physics))
        board.hand[:] = np.random.default_rng(seed).choice([-1.5, 1.5], plant.model.nj) * drawn[2]
        board.sleep(0.5)
        board.hand[:] = 0.0
        board.sleep(0.5)

    return fit


@given(seed=st.integers(0, 2**32 - 1))
def test_inertia_damping_and_friction_of_motors_are_told_apart(seed: int):
    """Friction to a tenth, whatever the others are; the fit leaves no error."""
    rng, expected = np.random.default_rng(seed), Expected(ARM, np.eye(3))
    t, n = 1e-3 * np.arange(1200), ARM.nj
    weights, omega = Weights(len(t), 1e-3, 2.5), 5.0 * np.pi
    grows = np.minimum(1.0, 2.5 * t)
    q = 0.03 * grows * np.sin(omega * t)
    v, a = np.gradient(q, t), np.gradient(np.gradient(q, t), t)
    inertia, damping, friction = 10.0 ** rng.uniform([-3.0, -2.0, -1.0], [0.0, 1.0, 0.3])
    j = int(rng.integers(n))
    gravity, G, M = expected.at(ARM.q0)
    Q, V, A, S, T = np.zeros((5, n, 4 * n))
    columns = slice(j, None, n)
    Q[j, columns], V[j, columns], A[j, columns] = weights.phi @ q, -weights.first @ q, weights.second @ q
    S[j, columns] = weights.signs(q)
    T[:, columns] = (weights.phi @ (np.outer(q, G[:, j]) + np.outer(a, M[:, j]))).T
    T[j, columns] += weights.phi @ (inertia * a + damping * v + friction * np.sign(v))
    seen = Response(ARM.q0, gravity, Q, V, A, S, T)
    assert abs(expected._fitted(seen)[1][j] - friction) < 0.1 * friction
    assert expected.cost(seen) < 0.01


@pytest.mark.parametrize("kind", ["franka", "go2"])
def test_a_sound_robot_is_not_blamed_for_its_motors(kind: str):
    found = checked(kind, 0, fit=fitted(0))
    assert found.ok, found


@pytest.mark.deep
@pytest.mark.parametrize("kind", ["franka", pytest.param("panda", marks=needs_examples), "go2"])
def test_few_sound_robots_are_blamed_for_their_motors(kind: str):
    blamed = [seed for seed in range(1, 40) if not checked(kind, seed, fit=fitted(seed)).ok]
    assert len(blamed) <= 2, blamed


@pytest.mark.parametrize("seed", range(40))
def test_motors_of_the_seeded_robots_hold_still_by_themselves(seed: int):
    """At the period at which the board follows their law; where they swing, a sound robot is blamed."""
    robot, device = wbc.load("quadruped", base="fixed"), UnitreeGo2()
    board: Any = SimpleNamespace(plant=SimpleNamespace(model=robot), device=device)
    rotor, damping, _ = (part * np.ones(robot.nj) for part in motors(board, seed))
    state, dt = robot.state(), period(device)
    state.update(0.0, robot.q0, np.zeros(robot.nv))
    inverse = np.linalg.inv(state.M + np.diag(rotor + dt * damping))
    for kp, kd in (holding_gains(robot), device.gains):
        # v' = v − dt M⁻¹ ((kd + d) v + kp q), q' = q + dt v'
        slows, pulls = np.eye(12) - dt * inverse @ np.diag(kd + damping), -dt * inverse @ np.diag(kp)
        step = np.block([[np.eye(12) + dt * pulls, dt * slows], [pulls, slows]])
        assert np.abs(np.linalg.eigvals(step)).max() < 1.0


WRONG = {
    "franka": [("gear", joint, value) for joint in ("shoulder_yaw", "elbow", "wrist_pitch") for value in (0.5, 2.0)]
    + [("offset", joint, value) for joint in ("shoulder_pitch", "elbow", "wrist_pitch") for value in (-0.4, 0.4)]
    + [("sign", joint, -1) for joint in ("shoulder_yaw", "elbow", "wrist_roll")],
    "go2": [("gear", f"front_left_{joint}", value) for joint in ("hip_roll", "knee") for value in (0.5, 2.0)]
    + [("offset", f"rear_left_{joint}", value) for joint in ("hip_pitch", "knee") for value in (-0.4, 0.4)]
    + [("sign", f"rear_right_{joint}", -1) for joint in ("hip_roll", "hip_pitch", "knee")],
}


@pytest.mark.deep
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("kind", "what", "joint", "value"), [(kind, *wrong) for kind, every in WRONG.items() for wrong in every]
)
def test_a_mistake_is_found_or_said_to_be_unproven(kind: str, what: str, joint: str, value: float, seed: int):
    found = checked(kind, seed, Seeded("", kind, what, "", wrong={what: {joint: value}}), fit=fitted(seed))
    assert not found.ok or any(what in text and joint in text for text in found.unproven), found
