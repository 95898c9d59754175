"""The filter against numerical derivatives of its error, and against least squares over a whole run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.optimize import approx_fprime, least_squares
from scipy.spatial.transform import Rotation

from tests.robots.motions import GRAVITY, NAMES, ROBOT, Motion, errors, estimates, estimator, standing, sums
from tests.seeds import generator
from wbc.robots import ImuNoise
from wbc.robots.compiled.filter_kernel import Filter, correct, exponentials, innovation, level, predict
from wbc.robots.invariant_filter import made
from wbc.types import Mat, Vec

NO_NOISE = ImuNoise(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


class State(NamedTuple):
    """R, v, p, d, and both biases."""

    R: Mat
    v: Vec
    p: Vec
    d: Mat
    bias: Vec


def of(one: Filter) -> State:
    return State(one.R.copy(), one.v.copy(), one.p.copy(), one.d.copy(), one.bias.copy())


def true_of(estimate: State, xi: Vec) -> State:
    """The truth from which an estimate is off by ξ = [R, v, p, biases, d]."""
    turn, first, _ = sums(xi[:3])
    back = turn.T
    v, p = back @ (estimate.v - first @ xi[3:6]), back @ (estimate.p - first @ xi[6:9])
    d = (estimate.d - xi[15:].reshape(-1, 3) @ first.T) @ turn
    return State(back @ estimate.R, v, p, d, estimate.bias - xi[9:15])


def error_of(estimate: State, true: State) -> Vec:
    """ξ of an estimate."""
    xi = Rotation.from_matrix(estimate.R @ true.R.T).as_rotvec()
    turn, first, _ = sums(xi)
    off = [np.linalg.solve(first, a - turn @ b) for a, b in ((estimate.v, true.v), (estimate.p, true.p))]
    points = np.linalg.solve(first, (estimate.d - true.d @ turn.T).T).T
    return np.concatenate([xi, *off, estimate.bias - true.bias, points.reshape(-1)])


def moved(state: State, dt: float, gyro: Vec, force: Vec) -> State:
    """``dt`` seconds on."""
    turn, first, second = sums(dt * (gyro - state.bias[:3]))
    a = force - state.bias[3:]
    p = state.p + dt * state.v + dt**2 * (state.R @ second @ a + 0.5 * GRAVITY)
    return State(state.R @ turn, state.v + dt * (state.R @ first @ a + GRAVITY), p, state.d, state.bias)


def somewhere(rng: np.random.Generator) -> Filter:
    """A filter of two points in any state."""
    one = made(2, NO_NOISE, GRAVITY, np.zeros((3, 3)))
    one.R[:] = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix()
    one.v[:], one.p[:], one.d[:] = rng.normal(size=3), rng.normal(size=3), rng.normal(size=(2, 3))
    one.bias[:] = [*0.1 * rng.normal(size=3), *rng.normal(size=3)]
    return one


def jacobian(of_error: Callable[[Vec], Any]) -> Mat:
    """Of a function of ξ (21,), by central differences."""
    return np.array([(of_error(h) - of_error(-h)) / 2e-5 for h in 1e-5 * np.eye(21)]).T


def see(one: Filter, point: int, y: Vec, N: Mat) -> None:
    """The encoders see one point at y, with covariance N."""
    one.sizes[1], one.chosen[0], one.y[0], one.N[:3, :3] = 1, point, y, N
    innovation(one)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 9.9e-3, 1.01e-2, 0.7, 3.0])
def test_the_sums_are_those_of_a_matrix_exponential(angle: float) -> None:
    axis = generator("axis", angle).normal(size=3)
    phi = angle * axis / np.linalg.norm(axis)
    got = np.empty((9, 3))
    exponentials(phi, got)
    assert np.abs(got - np.vstack(sums(phi))).max() < 1e-14


@pytest.mark.parametrize("case", range(5))
def test_errors_move_as_their_numerical_derivative(case: int) -> None:
    rng, dt = generator("derivative", case), 1e-3
    one = somewhere(rng)
    gyro, force, before = rng.normal(size=3), 9.81 * rng.normal(size=3), of(one)

    def after(xi: Vec) -> Vec:
        return error_of(moved(before, dt, gyro, force), moved(true_of(before, xi), dt, gyro, force))

    numerical = jacobian(after)
    for i in range(21):
        one = somewhere(generator("derivative", case))
        one.P[:] = np.outer(np.eye(21)[i], np.eye(21)[i])
        one.gyro[:], one.force[:] = gyro, force
        predict(one, dt)
        assert np.abs(one.P - np.outer(numerical[:, i], numerical[:, i])).max() < 2e-5
    assert np.abs(error_of(of(one), moved(before, dt, gyro, force))).max() < 1e-12


def test_an_innovation_is_the_error_of_the_point_less_that_of_the_imu() -> None:
    one = somewhere(generator("innovation"))
    estimate = of(one)
    one.P[:] = np.eye(21)

    def r(xi: Vec) -> Vec:
        true = true_of(estimate, xi)
        see(one, 1, estimate.R @ true.R.T @ (true.d[1] - true.p), np.zeros((3, 3)))  # turned by the estimate
        return one.r[:3].copy()

    numerical = jacobian(r)
    assert np.abs(numerical - one.seen[:3]).max() < 1e-8
    assert np.abs(one.S[:3, :3] - numerical @ numerical.T).max() < 1e-8


def uncertain(rng: np.random.Generator, size: float) -> tuple[Filter, State, Mat]:
    """A filter with some covariance, its state and that."""
    one, root = somewhere(rng), size * rng.normal(size=(21, 21))
    one.P[:] = root @ root.T
    return one, of(one), one.P.copy()


def is_conditional_mean(one: Filter, before: State, P: Mat, H: Mat, r: Vec, N: Mat) -> None:
    """The estimate and its covariance are those of a linear measurement r = H ξ + noise."""
    gain = P @ H.T @ np.linalg.inv(H @ P @ H.T + N)
    assert np.abs(error_of(of(one), before) + gain @ r).max() < 1e-9
    left = np.eye(21) - gain @ H
    assert np.abs(one.P - (left @ P @ left.T + gain @ N @ gain.T)).max() < 1e-12


def test_a_correction_is_the_conditional_mean_of_the_error() -> None:
    rng = generator("correction")
    one, before, P = uncertain(rng, 1e-3)
    N, r = 1e-6 * np.eye(3), 1e-3 * rng.normal(size=3)
    see(one, 1, one.d[1] - one.p - r, N)
    assert correct(one, 0.0) == 0, "a gate that nothing passes"
    assert np.array_equal(one.P, P)
    see(one, 1, one.d[1] - one.p - r, N)
    assert correct(one, np.inf) == 1
    is_conditional_mean(one, before, P, np.hstack([np.zeros((3, 6)), -np.eye(3), np.zeros((3, 9)), np.eye(3)]), r, N)


def test_a_height_is_the_conditional_mean_of_the_error() -> None:
    one, before, P = uncertain(generator("height"), 1e-4)
    variance, up = 1e-8, np.array([0.0, 0.6, 0.8])
    height = float(up @ one.d[1]) - 1e-4

    def off(xi: Vec) -> float:
        return float(up @ (before.d[1] - true_of(before, xi).d[1]))

    H = jacobian(off)[None]
    assert not level(one, 1, up, height, variance, 0.0), "a gate that nothing passes"
    assert np.array_equal(one.P, P)
    assert level(one, 1, up, height, variance, np.inf)
    is_conditional_mean(one, before, P, H, np.array([1e-4]), np.array([[variance]]))


# ---- against a whole run at once
NOISE = ImuNoise(
    gyro=2e-3, accelerometer=2e-2, gyro_bias=0.02, accelerometer_bias=0.1, gyro_walk=0, accelerometer_walk=0
)
JOINT, FLEX, TILT, SPEED = 1e-3, 5e-4, 0.03, 0.1


def seen(motion: Motion, k: int) -> tuple[Mat, Mat]:
    """Where the encoders see the feet from the base (4, 3), its axes, and inverse roots (4, 3, 3) of the covariance."""
    state, q = ROBOT.state(), np.concatenate([np.zeros(6), [1.0], motion.q[k, 7:]])
    state.update(0.0, q, np.zeros(18))
    J = [state.frame(name).jacobian()[:3, 6:] for name in NAMES]
    roots = [np.linalg.inv(np.linalg.cholesky(JOINT**2 * j @ j.T + FLEX**2 * np.eye(3))) for j in J]
    return np.array([np.array(state.frame(name).position) for name in NAMES]), np.array(roots)


def whole_run(motion: Motion, start: State) -> tuple[Callable[[Vec], State], Callable[[Vec], Vec]]:
    """The last state and the whitened residuals, as functions of the unknowns: errors of the start (9), of biases (6),
    places of the feet (12), and the noise of each sample (6 each). At the start it leans about the middle of its feet.
    """
    n, dt = len(motion.t) - 1, float(motion.t[1])
    sizes = np.repeat([NOISE.gyro, NOISE.accelerometer], 3) / np.sqrt(dt)
    scale = np.array(
        [TILT, TILT, 1e-6, *[SPEED] * 3, *[1e-6] * 3, *[NOISE.gyro_bias] * 3, *[NOISE.accelerometer_bias] * 3]
    )
    legs = [seen(motion, k) for k in range(n + 1)]
    hips = -start.R @ legs[0][0].mean(axis=0)

    def states(x: Vec) -> list[State]:
        off = scale * x[:15]
        turn = Rotation.from_rotvec(off[:3]).as_matrix()
        p = start.p - hips + turn @ hips + off[6:9]
        found = [State(turn @ start.R, start.v + off[3:6], p, x[15:27].reshape(4, 3), off[9:15])]
        for k in range(n):
            noise = sizes * x[27 + 6 * k : 33 + 6 * k]
            found.append(moved(found[-1], dt, motion.gyro[k + 1] - noise[:3], motion.force[k + 1] - noise[3:]))
        return found

    def residuals(x: Vec) -> Vec:
        parts = [x[:15], x[27:]]
        for state, (places, roots) in zip(states(x), legs, strict=True):
            off = (state.d - state.p) @ state.R - places
            parts.append(np.einsum("kij,kj->ki", roots, off).reshape(-1))
        return np.concatenate(parts)

    return lambda x: states(x)[-1], residuals


@pytest.mark.slow
@pytest.mark.parametrize("case", range(2))
def test_it_agrees_with_least_squares_over_the_whole_run(case: int) -> None:
    """Every sample at once, solved by Gauss and Newton: the same estimate of the end and the same covariance."""
    rng = generator("batch", case)
    motion = standing(1e-2, 0.2)
    bias = np.repeat([NOISE.gyro_bias, NOISE.accelerometer_bias], 3) * rng.standard_normal(6)
    noisy = motion.with_noise(rng, NOISE.gyro, NOISE.accelerometer, JOINT, bias)
    lean = Rotation.from_rotvec([*rng.normal(0.0, TILT, 2), 0.0])
    R = (lean * Rotation.from_quat(motion.q[0, 3:7])).as_matrix()
    speed = Rotation.from_quat(motion.q[0, 3:7]).apply(motion.v[0, :3]) + rng.normal(0.0, SPEED, 3)
    start_q = np.concatenate([motion.q[0, :3], Rotation.from_matrix(R).as_quat(), motion.q[0, 7:]])

    last, residuals = whole_run(noisy, State(R, speed, motion.q[0, :3], np.zeros((4, 3)), np.zeros(6)))
    guess = np.zeros(27 + 6 * (len(motion.t) - 1))
    guess[15:27] = (seen(noisy, 0)[0] @ R.T + motion.q[0, :3]).reshape(-1)
    solved = least_squares(residuals, guess, method="trf", x_scale="jac", xtol=1e-10, ftol=1e-12, gtol=1e-10)
    end = last(solved.x)

    trusts = {"tilt": TILT, "speed": SPEED, "flex": FLEX, "creep": 0.0, "sink": 0.0, "gate": 0.0}
    one = estimator(noise=NOISE, joint=JOINT, **trusts)
    begins = replace(motion, q=start_q[None], v=np.concatenate([R.T @ speed, motion.v[0, 3:]])[None])
    *_, (_, q, v) = estimates(one, noisy, begins)

    base = Rotation.from_matrix(end.R)
    apart = errors(q, v, np.concatenate([end.p, base.as_quat()]), end.R.T @ end.v)

    def about(x: Vec) -> Vec:
        state = last(x)
        turn = (Rotation.from_matrix(state.R) * base.inv()).as_rotvec()
        return np.concatenate([state.p - end.p, turn, state.v - end.v])

    J = approx_fprime(solved.x, about, 1e-6)
    covariance = J @ np.linalg.solve(solved.jac.T @ solved.jac, J.T)
    sizes = np.sqrt(np.diag(covariance))
    assert (np.abs(apart) < 0.1 * sizes + 1e-6).all(), apart / sizes
    assert np.allclose(np.sqrt(np.diag(one.covariance)), sizes, rtol=0.05, atol=1e-6)
