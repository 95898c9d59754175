"""The planar robots: numbers that agree with the derivation, and robots like any other in a stack and a plant."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.models.planar_oracle import FOUR, PR, check_against_derivation, in_pinocchio, robots
from wbc.errors import InvalidInput, UnknownFrame, UnknownJoint
from wbc.models import Limits, Planar4P, PlanarPR
from wbc.models.lagrange import derive

seeds = st.integers(0, 2**32 - 1)


def drawn(kind: str, seed: int) -> Any:
    """A robot of one of the two kinds with random parameters, some masses zero."""
    rng = np.random.default_rng(seed)
    gravity = float(rng.choice([0.0, 9.81, 1.6]))
    if kind == "4p":
        m = rng.uniform(0.05, 5.0, 4)
        m[rng.integers(3)] *= rng.integers(2)
        return Planar4P(m=m, gravity=gravity)
    m1, m2, l2, d2, I2 = rng.uniform(0.05, 5.0, 5)
    return PlanarPR(m1=m1 * rng.integers(2), m2=m2, l2=l2, d2=d2 - 1.0, I2=I2, gravity=gravity)


def vectors(robot: Any, seed: int, count: int) -> np.ndarray:
    """Random rows (count, n)."""
    return np.random.default_rng(seed).normal(size=(count, robot.nv))


# ---- formulas
@given(kind=st.sampled_from(["pr", "4p"]), seed=seeds)
def test_the_numbers_are_those_of_the_derivation(kind: str, seed: int):
    robot = drawn(kind, seed)
    check_against_derivation(robot, *vectors(robot, seed, 4), rtol=1e-12, atol=1e-12)


def test_each_robot_brings_its_derivation():
    assert PR.symbolic() is derive("PR") and FOUR.symbolic() is derive("PPyPPy")
    assert r"\section{Inertia matrix}" in PR.symbolic().latex()


def test_the_pr_robot_at_the_pose_of_the_exercise():
    """M, J at (0, π/2); p and β at q̇ = (1, −1); the torque that gives r̈ = 9 is (104/11, −71/22)."""
    q, v = np.array([0.0, np.pi / 2]), np.array([1.0, -1.0])
    assert np.allclose(PR.M(q), [[2.0, -0.25], [-0.25, 0.1625]], atol=1e-15)
    assert np.allclose(PR.J(q), [[1.0, -0.5], [0.0, 0.0]], atol=1e-15)
    assert np.allclose(PR.momentum(q, v), [2.25, -0.4125], atol=1e-15)
    assert np.allclose(PR.beta(q, v), [0.0, 0.0], atol=1e-12)
    M, J, tau_0, F = PR.M(q), PR.J(q)[:1], np.array([-1.0, 2.0]), np.array([-1.0, 1.0])
    weight = J @ np.linalg.solve(M, J.T)
    for acceleration, expected in ((9.0, (104 / 11, -71 / 22)), (-9.0, (-2.0, 2.5))):
        lack = acceleration - J @ np.linalg.solve(M, tau_0 + PR.J(q).T @ F)
        assert np.allclose(tau_0 + J.T @ np.linalg.solve(weight, lack), expected, rtol=0, atol=1e-12)


@given(seed=seeds)
def test_the_four_masses_and_the_four_coefficients_give_the_same_forces(seed: int):
    """Property 31. Y a = Y_m m = M q̈ + g, Y_m = Y T with a = T m, and Y is linear in (q̈, g0)."""
    robot = drawn("4p", seed)
    (a, b), m = vectors(robot, seed, 2), np.array(list(robot.parameters.values()))
    T = np.triu(np.ones((4, 4)))
    forces = robot.M(np.zeros(4)) @ a + robot.g(np.zeros(4))
    assert np.allclose(robot.Y(a) @ robot.coefficients, forces, rtol=1e-12, atol=1e-11)
    assert np.allclose(robot.Y_masses(a) @ m, forces, rtol=1e-12, atol=1e-11)
    assert np.allclose(robot.coefficients, T @ m, rtol=1e-14)
    assert np.allclose(robot.Y(a) @ T, robot.Y_masses(a), atol=1e-12)
    twice = Planar4P(m=m, gravity=2.0 * robot.g0)
    assert np.allclose(robot.Y(a) + robot.Y(b), twice.Y(a + b), atol=1e-12)


@pytest.mark.parametrize("regressor", ["Y", "Y_masses"])
def test_four_parameters_are_needed(regressor: str):
    """Property 32. Stacked over random motions the rank is 4; without any one column the forces are not reproduced."""
    rng = np.random.default_rng(3)
    stacked = np.vstack([getattr(FOUR, regressor)(a) for a in rng.normal(size=(20, 4))])
    assert np.linalg.matrix_rank(stacked) == 4
    forces = stacked @ (FOUR.coefficients if regressor == "Y" else list(FOUR.parameters.values()))
    for column in range(4):
        _, residual, _, _ = np.linalg.lstsq(np.delete(stacked, column, axis=1), forces, rcond=None)
        assert residual[0] > 1e-3 * (forces @ forces)


@given(seed=seeds)
def test_the_end_effector_carries_the_last_two_links_whatever_the_first_weigh(seed: int):
    """Property 33. M_r = diag(m3 + m4, m4) = (J M⁻¹ Jᵀ)⁻¹, J J_M# = I; M_r does not depend on m1 and m2."""
    robot, q = drawn("4p", seed), np.zeros(4)
    M, J, M_r = robot.M(q), robot.J(q), robot.cartesian_inertia(q)
    _, _, m3, m4 = robot.parameters.values()
    assert np.allclose(M_r, np.diag([m3 + m4, m4]))
    assert np.allclose(np.linalg.inv(M_r), J @ np.linalg.solve(M, J.T), rtol=1e-9)
    inverse = np.linalg.solve(M, J.T) @ M_r
    assert np.allclose(inverse, [[0, 0], [0, 0], [1, 0], [0, 1]], atol=1e-9)
    heavier = Planar4P(m=(m3 + 7.0, m4 + 5.0, m3, m4))
    assert np.allclose(heavier.cartesian_inertia(q), M_r)


@robots
@given(seed=seeds)
def test_locking_a_joint_makes_the_end_effector_no_lighter(robot: Any, seed: int):
    """Property 33. (J M⁻¹ Jᵀ)⁻¹ grows, in Loewner's order, when a joint is locked."""
    q = vectors(robot, seed, 1)[0]
    M, J = robot.M(q), robot.J(q)
    free = J @ np.linalg.solve(M, J.T)
    for joint in range(robot.nv):
        kept = [i for i in range(robot.nv) if i != joint]
        locked = J[:, kept] @ np.linalg.solve(M[np.ix_(kept, kept)], J[:, kept].T)
        assert np.linalg.eigvalsh(free - locked)[0] > -1e-9 * np.abs(free).max()


@robots
@given(seed=seeds)
def test_the_cartesian_inertia_does_not_depend_on_the_coordinates(robot: Any, seed: int):
    """Property 34. q → T q, M → T⁻ᵀ M T⁻¹, J → J T⁻¹ leaves J M⁻¹ Jᵀ."""
    q, *columns = vectors(robot, seed, 1 + robot.nv)
    T = np.array(columns) + 3.0 * np.eye(robot.nv)
    M, J, back = robot.M(q), robot.J(q), np.linalg.inv(T)
    before = J @ np.linalg.solve(M, J.T)
    after = (J @ back) @ np.linalg.solve(back.T @ M @ back, (J @ back).T)
    assert np.allclose(before, after, rtol=1e-7, atol=1e-9 * np.abs(before).max())


def moved(robot: Any, force: Any, q: np.ndarray, v: np.ndarray, duration: float, steps: int) -> np.ndarray:
    """(q, v, ∫ τᵀ v dt) after a motion under τ = force(t, q, v), by Runge-Kutta of order four."""
    n, h = robot.nv, duration / steps

    def rate(t: float, x: np.ndarray) -> np.ndarray:
        q, v = x[:n], x[n : 2 * n]
        tau = force(t, q, v)
        return np.r_[v, np.linalg.solve(robot.M(q), tau - robot.c(q, v) - robot.g(q)), tau @ v]

    x = np.r_[q, v, 0.0]
    for k in range(steps):
        t = k * h
        k1 = rate(t, x)
        k2 = rate(t + h / 2, x + h / 2 * k1)
        k3 = rate(t + h / 2, x + h / 2 * k2)
        x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(t + h, x + h * k3))
    return x


@robots
@pytest.mark.parametrize("seed", range(3))
def test_energy_changes_by_the_work_of_the_joints(robot: Any, seed: int):
    """Property 35. T + U changes by ∫ τᵀ q̇ dt along any motion."""
    q, v, amplitude, phase = vectors(robot, seed, 4)
    end = moved(robot, lambda t, q, v: amplitude * np.sin(3.0 * t + phase) - 0.1 * v, q, v, 1.0, 1000)
    n = robot.nv
    gained = robot.energy(end[:n], end[n : 2 * n]) - robot.energy(q, v)
    assert gained == pytest.approx(end[-1], rel=1e-7, abs=1e-7)


@robots
@given(seed=seeds)
def test_momentum_changes_by_torque_minus_beta(robot: Any, seed: int):
    """Property 65. dp/dt = τ − β along the motion that τ causes; a skew W with W v = 0 added to S leaves β."""
    q, v, tau = vectors(robot, seed, 3)
    step = 1e-4
    ends = [moved(robot, lambda t, q, v: tau, q, v, side * step, 1) for side in (1.0, -1.0)]
    n = robot.nv
    after, before = (robot.momentum(x[:n], x[n : 2 * n]) for x in ends)
    assert np.allclose((after - before) / (2 * step), tau - robot.beta(q, v), rtol=1e-5, atol=1e-5)
    assert np.allclose(robot.beta(q, v), -robot.S(q, v).T @ v + robot.g(q), atol=1e-9)
    null = np.linalg.svd(v[None])[2][1:]
    W = np.zeros((n, n)) if n < 3 else np.outer(null[0], null[1]) - np.outer(null[1], null[0])
    assert np.allclose(-(robot.S(q, v) + W).T @ v + robot.g(q), robot.beta(q, v), atol=1e-8)


@robots
@given(seed=seeds, k=st.floats(-3.0, 3.0))
def test_coriolis_forces_are_quadratic_and_do_no_work_on_the_energy(robot: Any, seed: int, k: float):
    """Property 56. c(q, k v) = k² c(q, v), c = S v, and Ṁ − 2S is skew-symmetric, Ṁ by differences."""
    q, v, x = vectors(robot, seed, 3)
    assert np.allclose(robot.c(q, k * v), k**2 * robot.c(q, v), rtol=1e-9, atol=1e-9)
    assert np.allclose(robot.S(q, v) @ v, robot.c(q, v), atol=1e-9)
    step = 1e-5
    rate = (robot.M(q + step * v) - robot.M(q - step * v)) / (2 * step)
    assert abs(x @ (rate - 2 * robot.S(q, v)) @ x) < 1e-6 * (1.0 + np.abs(rate).max() * (x @ x))


# ---- arguments
@pytest.mark.parametrize(
    ("changed", "complaint"),
    [
        ({"m2": -1.0}, "m2 is -1; it must be >= 0"),
        ({"l2": np.nan}, "l2 is nan"),
        ({"I2": "heavy"}, "I2 must be a number, not 'heavy'"),
        ({"gravity": np.inf}, "gravity is inf"),
        ({"m1": 0.0, "I2": 0.0}, "inertia matrix of planar_pr is singular"),
        ({"m2": 0.0, "I2": 0.0}, "inertia matrix of planar_pr is singular"),
        ({"tau_max": (1.0, 0.0)}, r"tau_max\[1\] is 0"),
        ({"v_max": -1.0}, r"v_max\[0\] is -1"),
        ({"q_min": 1.0, "q_max": (2.0, 0.5)}, r"q_min\[1\] is 1 and q_max\[1\] is 0.5"),
        ({"q_max": np.ones(3)}, r"q_max must have shape \(2,\), not \(3,\)"),
    ],
)
def test_parameters_without_meaning_are_refused_by_name(changed: dict[str, Any], complaint: str):
    with pytest.raises(InvalidInput, match=complaint):
        PlanarPR(**({"m1": 1.0, "m2": 1.0, "l2": 0.5, "d2": 0.25, "I2": 0.1} | changed))


@pytest.mark.parametrize(
    ("m", "complaint"),
    [
        ((1, 1, 1), r"m must have shape \(4,\), not \(3,\)"),
        ((1, 1, -1, 1), r"m\[2\] is -1; it must be >= 0"),
        ((1, np.nan, 1, 1), r"m\[1\] is nan"),
        ((1, 1, 1, 0), "singular"),
        ((0, 0, 1, 1), "singular"),
        ((1, 0, 0, 1), "singular"),
        ((1, "a", 1, 1), "m must be an array of numbers"),
    ],
)
def test_masses_without_meaning_are_refused(m: Any, complaint: str):
    with pytest.raises(InvalidInput, match=complaint):
        Planar4P(m=m)


def test_links_without_mass_are_allowed_while_all_joints_feel_inertia():
    """M is positive definite if and only if m1 + m2, m2 + m3, m3 + m4 and m4 are positive."""
    for m in ((1, 0, 1, 1), (0, 1, 0, 1)):
        assert np.linalg.eigvalsh(Planar4P(m=m).M(np.zeros(4)))[0] > 0


def test_a_parameter_too_many_or_too_few_is_named():
    with pytest.raises(InvalidInput, match="parameter 'I1' of chain R is missing"):
        derive("R").robot({"m1": 1.0, "l1": 1.0, "d1": 0.5})
    with pytest.raises(InvalidInput, match="chain Px has no parameter 'l1'; it has m1"):
        derive("P").robot({"m1": 1.0, "l1": 1.0})


@robots
def test_wrong_shapes_are_refused_by_name(robot: Any):
    good, bad = np.zeros(robot.nv), np.zeros(robot.nv + 1)
    for call in (robot.M, robot.g, robot.J, robot.cartesian_inertia):
        with pytest.raises(InvalidInput, match="q must have shape"):
            call(bad)
    for call in (robot.c, robot.S, robot.Jdot_v, robot.momentum, robot.beta, robot.energy):
        with pytest.raises(InvalidInput, match="v must have shape"):
            call(good, bad)
    with pytest.raises(InvalidInput, match="v_reference must have shape"):
        robot.regressor(good, good, bad, good)
    for words in ("here", ["1"] * robot.nv, [None] * robot.nv):
        with pytest.raises(InvalidInput, match="q must be an array of numbers"):
            robot.M(words)
    with pytest.raises(InvalidInput, match=r"a\[0\] is nan"):
        robot.regressor(good, good, good, np.full(robot.nv, np.nan))


# ---- a robot like any other
@robots
@given(seed=seeds)
def test_frames_and_the_centre_of_mass_move_as_in_pinocchio(robot: Any, seed: int):
    q, v = vectors(robot, seed, 2)
    model = in_pinocchio(robot.chain, robot.parameters, robot.g0)
    data = model.createData()
    pin.forwardKinematics(model, data, q, v, np.zeros_like(v))
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    state = robot.state()
    state.update(0.5, q, v)
    for name in robot.frame_names[1:]:
        frame, index = state.frame(name), model.getFrameId(name)
        assert np.allclose(frame.placement.homogeneous, data.oMf[index].homogeneous, atol=1e-12)
        for axes, jacobian in ((pin.LOCAL_WORLD_ALIGNED, frame.jacobian()), (pin.LOCAL, frame.jacobian_local())):
            assert np.allclose(jacobian, pin.getFrameJacobian(model, data, index, axes), atol=1e-12)
        drift = pin.getFrameClassicalAcceleration(model, data, index, pin.LOCAL_WORLD_ALIGNED).vector
        assert np.allclose(frame.drift(), drift, atol=1e-10)
        local = pin.getFrameAcceleration(model, data, index, pin.LOCAL).vector
        assert np.allclose(frame.drift_local(), local, atol=1e-10)
    tip = state.frame("end_effector")
    assert np.allclose(tip.jacobian()[:2], robot.J(q), atol=1e-12)
    assert np.allclose(tip.drift()[:2], robot.Jdot_v(q, v), atol=1e-10)
    assert not tip.jacobian()[2:5].any() and not state.frame("base").jacobian().any()
    pin.jacobianCenterOfMass(model, data, q)
    assert np.allclose(state.com, data.com[0], atol=1e-12) and np.allclose(state.com_jacobian, data.Jcom, atol=1e-12)
    pin.centerOfMass(model, data, q, v, np.zeros_like(v))
    assert np.allclose(state.com_drift, data.acom[0], atol=1e-10)
    pin.ccrba(model, data, q, v)
    assert np.allclose(state.centroidal_map, data.Ag, atol=1e-12)
    pin.computeCentroidalMomentumTimeVariation(model, data, q, v, np.zeros_like(v))
    assert np.allclose(state.centroidal_drift, data.dhg.vector, atol=1e-10)
    assert np.allclose(state.g, -robot.mass * state.com_jacobian.T @ robot.gravity, atol=1e-9)
    assert np.allclose(state.h, robot.c(q, v) + robot.g(q)) and np.array_equal(state.M, robot.M(q))


@robots
def test_what_has_been_read_follows_the_state_and_cannot_be_written(robot: Any):
    state, (q, v) = robot.state(), vectors(robot, 0, 2)
    frame = state.frame("end_effector")
    views = [state.q, state.v, state.M, state.h, state.g, state.com, state.com_jacobian, state.com_drift]
    views += [state.centroidal_map, state.centroidal_drift, frame.position, frame.rotation]
    state.update(1.0, q, v)
    fresh = robot.state()
    fresh.update(1.0, q, v)
    other = fresh.frame("end_effector")
    again = [fresh.q, fresh.v, fresh.M, fresh.h, fresh.g, fresh.com, fresh.com_jacobian, fresh.com_drift]
    again += [fresh.centroidal_map, fresh.centroidal_drift, other.position, other.rotation]
    assert np.array_equal(frame.jacobian(), other.jacobian()) and np.array_equal(frame.drift(), other.drift())
    for view, value in zip(views, again, strict=True):
        assert np.array_equal(view, value)
        with pytest.raises(ValueError, match="read-only"):
            view[...] = 0.0


@robots
def test_a_new_state_is_at_the_reference_configuration_and_at_rest(robot: Any):
    there = robot.replace(q0=np.linspace(0.1, 0.4, robot.nq))
    state = there.state()
    assert state.t == 0.0 and np.array_equal(state.q, there.q0) and not state.v.any()
    assert np.array_equal(state.q_joints, state.q) and not robot.q0.any()


@robots
def test_a_copy_of_a_state_is_another_state_at_the_same_moment(robot: Any):
    state, (q, v) = robot.state(), vectors(robot, 1, 2)
    state.update(2.0, q, v)
    for other in (copy.deepcopy(state), pickle.loads(pickle.dumps(state))):
        assert other.t == 2.0 and np.array_equal(other.M, state.M)
        other.update(0.0, 0 * q, 0 * v)
        assert np.array_equal(state.q, q)
    assert np.array_equal(copy.deepcopy(state.frame("link1")).position, state.frame("link1").position)


@robots
@pytest.mark.parametrize("wrong", [np.zeros(9), np.zeros((1, 2)), 0.0, [0.0] * 2, None])
def test_a_wrong_size_is_refused_and_changes_nothing(robot: Any, wrong: Any):
    state, (q, v) = robot.state(), vectors(robot, 2, 2)
    state.update(1.0, q, v)
    for arguments in ((wrong, v), (q, wrong)):
        with pytest.raises(InvalidInput, match=r"must (have shape|be an array)"):
            state.update(3.0, *arguments)
    assert state.t == 1.0 and np.array_equal(state.q, q)


@robots
def test_names_sizes_and_units(robot: Any):
    n = len(robot.chain)
    assert robot.nq == robot.nv == robot.nj == n and robot.nb == 0
    assert robot.joint_names == tuple(f"q{i}" for i in range(1, n + 1)) and robot.joint("q2") == 1
    assert robot.frame_names[0] == "base" and robot.frame_names[-1] == "end_effector"
    assert robot.mass == pytest.approx(sum(v for k, v in robot.parameters.items() if k[0] == "m"))
    assert np.array_equal(robot.gravity, [0.0, -9.81, 0.0])
    with pytest.raises(UnknownJoint, match="no joint 'q9'"):
        robot.joint("q9")
    with pytest.raises(UnknownFrame, match="did you mean 'end_effector'"):
        robot.state().frame("endeffector")


def test_joint_units_are_metres_where_they_slide():
    assert PR.joint_units == ("m", "rad") and FOUR.joint_units == ("m",) * 4


def test_without_limits_there_are_none_and_limits_are_given_by_keyword():
    assert np.array_equal(PR.limits.q_max, [np.inf] * 2) and np.array_equal(PR.limits.tau_max, [np.inf] * 2)
    bounded = Planar4P(q_min=-1.0, q_max=(1.0, 2.0, 3.0, 4.0), v_max=0.5, tau_max=20.0)
    assert np.array_equal(bounded.limits.q_max, [1, 2, 3, 4]) and np.array_equal(bounded.limits.v_max, [0.5] * 4)
    other = bounded.replace(limits=Limits(*([x] * 4 for x in (-2.0, 2.0, 3.0, 4.0))))
    assert np.array_equal(other.limits.tau_max, [4.0] * 4) and np.array_equal(bounded.limits.tau_max, [20.0] * 4)


@given(seed=seeds)
def test_random_configurations_keep_the_limits(seed: int):
    rng = np.random.default_rng(seed)
    bounded = PlanarPR(m1=1, m2=1, l2=1, d2=1, I2=1, q_min=(5.0, -np.inf), q_max=(np.inf, -4.0))
    q = bounded.random_configuration(rng)
    assert 5.0 <= q[0] <= 7.0 and -4.0 - 2 * np.pi - 1e-9 <= q[1] <= -4.0
    assert (np.abs(PR.random_configuration(rng)) <= [1.0, np.pi]).all()
    assert np.array_equal(PR.difference(q, PR.integrate(q, np.ones(2))), (q + 1.0) - q)
