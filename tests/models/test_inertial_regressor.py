"""The regressor of an arm gives its dynamics for every arm and motion; base parameters are as few as can be."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wbc
from wbc.models.inertial_regressor import InertialRegressor
from wbc.models.pinocchio_ import PinocchioModel

ARM = wbc.load("arm")
REGRESSOR = InertialRegressor(ARM)


def chain(joints: int, rotors: float) -> PinocchioModel:
    """A fixed chain of revolute and prismatic joints whose motors' rotors have inertias."""
    model, joint = pin.Model(), 0
    model.name = "chain"
    kinds = pin.JointModelRX(), pin.JointModelPY(), pin.JointModelRZ()
    rng = np.random.default_rng(joints)
    for i in range(joints):
        place = pin.SE3(pin.exp3(rng.standard_normal(3)), 0.3 * rng.standard_normal(3))
        joint = model.addJoint(joint, kinds[i % 3], place, f"j{i}")
        ball = pin.Inertia.FromSphere(1.0, 0.2)
        model.appendBodyToJoint(joint, ball, pin.SE3(np.eye(3), 0.3 * rng.standard_normal(3)))
    one = np.ones(joints)
    model.armature = rotors * one
    model.upperPositionLimit, model.lowerPositionLimit = 3.0 * one, -3.0 * one
    model.velocityLimit, model.effortLimit = 10.0 * one, 1e3 * one
    return wbc.load(model)


@pytest.mark.parametrize("rotors", [0.0, 2.0])
@pytest.mark.parametrize("joints", [1, 2, 5])
def test_it_gives_the_dynamics_of_any_number_of_joints_and_rotors(joints: int, rotors: float) -> None:
    arm = chain(joints, rotors)
    regressor, rng = InertialRegressor(arm), np.random.default_rng(joints)
    q, (v, a) = arm.random_configuration(rng), rng.standard_normal((2, joints))
    tau = pin.rnea(arm.pinocchio, arm.pinocchio.createData(), q, v, a)
    Y = regressor(q, v, v, a)
    assert Y.shape == (joints, 10 * joints)
    np.testing.assert_allclose(Y @ regressor.parameters + regressor.rotors * a, tau, atol=1e-10)
    state = arm.state()
    state.update(0.0, q, v)
    links = regressor.inertia(q, regressor.parameters)
    np.testing.assert_allclose(links + np.diag(regressor.rotors), state.M, atol=1e-10)


@settings(max_examples=max(25, settings.default.max_examples // 2))
@given(st.integers(0, 9999))
def test_it_is_recursive_newton_euler_of_arms_with_any_masses(seed: int) -> None:
    rng = np.random.default_rng(seed)
    arm = ARM.with_masses(rng.uniform(0.2, 3.0, 7))
    parameters = np.concatenate([link.toDynamicParameters() for link in list(arm.pinocchio.inertias)[1:]])
    q, (v, a) = ARM.random_configuration(rng), rng.standard_normal((2, 7))
    tau = pin.rnea(arm.pinocchio, arm.pinocchio.createData(), q, v, a)
    np.testing.assert_allclose(REGRESSOR(q, v, v, a) @ parameters, tau, atol=1e-10)


@settings(max_examples=max(25, settings.default.max_examples // 2))
@given(st.integers(0, 9999))
def test_polarised_coriolis_terms_are_those_with_which_M_dot_less_2_C_is_skew(seed: int) -> None:
    rng = np.random.default_rng(seed)
    q, (v, v_r, a_r) = ARM.random_configuration(rng), rng.standard_normal((3, 7))
    state = ARM.state()
    state.update(0.0, q, v)
    M, C, g = np.array(state.M), np.array(state.coriolis), np.array(state.g)
    pi = REGRESSOR.parameters
    np.testing.assert_allclose(REGRESSOR(q, v, v_r, a_r) @ pi, M @ a_r + C @ v_r + g, atol=1e-10)
    np.testing.assert_allclose(REGRESSOR.momentum(q, v) @ pi, M @ v, atol=1e-10)
    np.testing.assert_allclose(REGRESSOR.drive(q, v) @ pi, g - C.T @ v, atol=1e-6)
    np.testing.assert_allclose(REGRESSOR.inertia(q, pi), M, atol=1e-10)
    h = 1e-6
    ahead, behind = (REGRESSOR.inertia(q + s * h * v, pi) for s in (1.0, -1.0))
    skew = (ahead - behind) / (2 * h) - 2 * C
    np.testing.assert_allclose(skew + skew.T, 0.0, atol=1e-6)


def test_no_smaller_set_of_parameters_gives_all_torques() -> None:
    """Property 32: the independent columns are independent, and span the others."""
    rng, columns = np.random.default_rng(7), REGRESSOR.independent
    rows = []
    for _ in range(60):
        q, (v, v_r, a_r) = ARM.random_configuration(rng), rng.standard_normal((3, 7))
        rows.append(REGRESSOR(q, v, v_r, a_r))
    Y = np.vstack(rows)
    sizes = np.linalg.svd(Y[:, columns], compute_uv=False)
    assert sizes[-1] > 1e-6 * sizes[0]
    assert np.linalg.matrix_rank(Y, tol=1e-9 * sizes[0]) == len(columns) < 70
    np.testing.assert_allclose(Y[:, columns] @ REGRESSOR.grouping, Y, atol=1e-8)
