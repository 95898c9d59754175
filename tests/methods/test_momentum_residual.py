"""The momentum residual as a specification: a robot in a vertical plane is simulated, its actuators fail."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wbc.errors import InvalidInput, NotSupported
from wbc.methods import FaultFraction, MomentumResidual
from wbc.models import PlanarPR

ROBOT = PlanarPR(m1=1, m2=1, l2=0.5, d2=0.25, I2=0.1)
OTHER = PlanarPR(m1=2.5, m2=0.4, l2=0.7, d2=0.3, I2=0.05)
#: The state of the exercise: q = (0, π/2), v = (1, −1).
Q, V = np.array([0.0, np.pi / 2]), np.array([1.0, -1.0])
Signal = Callable[[float], np.ndarray]
#: An example is up to six simulations, a fiftieth of a second each.
few = settings(max_examples=max(5, settings.default.max_examples // 5))


def constant(*values: float) -> Signal:
    return lambda t: np.array(values)


SOUND = constant(0, 0)


def waves(seed: int) -> Signal:
    """Commands that keep the robot moving."""
    rng = np.random.default_rng(seed)
    size, frequency, phase = rng.uniform(0.5, 4, 2), rng.uniform(1, 8, 2), rng.uniform(0, 6, 2)
    return lambda t: size * np.sin(frequency * t + phase)


class Motion(NamedTuple):
    """Momentum at the ends of the intervals, β in their middle and at their end, the command in their middle."""

    dt: float
    p: np.ndarray
    middle: np.ndarray
    end: np.ndarray
    tau: np.ndarray

    def residual(self, gain: object, scheme: str = "exact", beta: np.ndarray | None = None) -> np.ndarray:
        observer = MomentumResidual(gain=gain, dt=self.dt, scheme=scheme)
        observer.reset(self.p[0])
        beta = self.middle if beta is None else beta
        return np.array([observer.update(*rows) for rows in zip(self.p[1:], beta, self.tau, strict=True)])


def simulate(
    command: Signal, missing: Signal = SOUND, *, robot: PlanarPR = ROBOT, q: np.ndarray = Q, v: np.ndarray = V,
    push: np.ndarray | None = None, dt: float = 2e-3, duration: float = 0.3,
) -> Motion:  # fmt: skip
    """Runge-Kutta of order four on M a + c + g = τ − τ_f + Jᵀ F, two steps an interval; the command is held in each."""
    state = robot.state()  # one for all steps: robot.M(q) and its like make a new one each time

    def rate(t: float, x: np.ndarray, tau: np.ndarray) -> np.ndarray:
        state.move(t, x)
        delivered = tau - missing(t)
        if push is not None:
            delivered = delivered + state.frame("end_effector").jacobian()[:2].T @ push
        return np.concatenate([x[2:], np.linalg.solve(state.M, delivered - state.h)])

    def read(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """p and β."""
        state.move(0.0, x)
        return state.M @ state.v, state.g - state.coriolis.T @ state.v

    def step(t: float, x: np.ndarray, tau: np.ndarray, h: float) -> np.ndarray:
        k1 = rate(t, x, tau)
        k2 = rate(t + h / 2, x + h / 2 * k1, tau)
        k3 = rate(t + h / 2, x + h / 2 * k2, tau)
        return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(t + h, x + h * k3, tau))

    x, ticks = np.concatenate([q, v]), round(duration / dt)
    p, middle, end, commands = [read(x)[0]], [], [], []
    for k in range(ticks):
        tau = command((k + 0.5) * dt)
        half = step(k * dt, x, tau, dt / 2)
        x = step((k + 0.5) * dt, half, tau, dt / 2)
        middle.append(read(half)[1])
        momentum, beta = read(x)
        p.append(momentum)
        end.append(beta)
        commands.append(tau)
    return Motion(dt, np.array(p), np.array(middle), np.array(end), np.array(commands))


# ---- the exercise
@pytest.mark.parametrize(("gain", "expected"), [(10.0, 3.1606), (3.0, 1.2959)])
def test_a_total_fault_of_the_first_actuator_shows_as_in_the_exercise(gain: float, expected: float):
    """Property 63: τ = (5, −2) is asked for, nothing arrives on joint 1: r₁(0.1) = 5 (1 − e^(−0.1 K)), r₂ = 0."""
    motion = simulate(constant(5, -2), constant(5, 0), dt=1e-3, duration=0.1)
    r = motion.residual(gain)
    assert r[-1, 0] == pytest.approx(expected, abs=5e-5)
    times = 1e-3 * np.arange(1, 101)
    np.testing.assert_allclose(r[:, 0], 5 * -np.expm1(-gain * times), atol=1e-5)
    np.testing.assert_allclose(r[:, 1], 0.0, atol=1e-5)


@given(st.floats(0.1, 100), st.floats(0.1, 10), st.floats(-5, 5))
def test_a_constant_fault_is_seen_by_two_thirds_after_one_time_constant(gain: float, factor: float, fault: float):
    """Property 63: r(1/K) = (1 − 1/e) τ_f; with K t alike, r is alike. In steps, exactly."""

    def after(gain: float, steps: int, time: float) -> float:
        observer = MomentumResidual(gain=gain, dt=time / steps)
        observer.reset([0.0])
        for _ in range(steps):
            observer.update([0.0], [0.0], [fault])
        return float(observer.value[0])

    expected = fault * -np.expm1(-1.0)
    assert after(gain, 7, 1 / gain) == pytest.approx(expected, rel=1e-12, abs=1e-300)
    assert after(factor * gain, 13, 1 / (factor * gain)) == pytest.approx(expected, rel=1e-12, abs=1e-300)


@given(st.floats(0.1, 100), st.lists(st.floats(1e-4, 0.1), min_size=1, max_size=20), st.floats(-5, 5))
def test_intervals_may_have_lengths_of_their_own(gain: float, lengths: list[float], fault: float):
    """r(t) = (1 − e^(−K t)) τ_f, however the time t is cut into intervals; the momentum changes by −τ_f each second."""
    observer, t = MomentumResidual(gain=gain, dt=1e-3), 0.0
    observer.reset([0.0])
    for dt in lengths:
        t += dt
        observer.update([-fault * t], [0.0], [0.0], dt=dt)
        assert observer.value[0] == pytest.approx(fault * -np.expm1(-gain * t), rel=1e-9, abs=1e-9)
    with pytest.raises(InvalidInput, match="dt is 0"):
        observer.update([0.0], [0.0], [0.0], dt=0.0)
    euler = MomentumResidual(gain=gain, dt=1.0 / gain, scheme="euler")
    euler.reset([0.0])
    with pytest.raises(InvalidInput, match="stable below 2"):
        euler.update([0.0], [0.0], [0.0], dt=2.5 / gain)


# ---- what it sees, and what not
@few
@given(st.integers(0, 2**32 - 1), st.floats(1, 30))
def test_the_residual_depends_on_the_fault_alone(seed: int, gain: float):
    """Property 58: other robots, states and commands, the same fault, the same residual: ṙ = K (τ_f − r)."""

    def fault(t: float) -> np.ndarray:
        return np.array([2 * np.sin(5 * t), 0.5])

    rng = np.random.default_rng(seed)
    one = simulate(waves(seed), fault).residual(gain)
    other = simulate(waves(seed + 1), fault, robot=OTHER, q=rng.normal(size=2), v=rng.normal(size=2)).residual(gain)
    np.testing.assert_allclose(one, other, atol=2e-4)
    t = 2e-3 * np.arange(1, len(one) + 1)
    w = 5.0
    sine = gain * (gain * np.sin(w * t) - w * np.cos(w * t) + w * np.exp(-gain * t)) / (gain**2 + w**2)
    np.testing.assert_allclose(one[:, 0], 2 * sine, atol=2e-3)
    np.testing.assert_allclose(one[:, 1], 0.5 * -np.expm1(-gain * t), atol=2e-4)


@few
@given(st.integers(0, 2**32 - 1), st.sampled_from(["exact", "euler", "implicit"]))
def test_without_a_fault_the_residual_is_zero(seed: int, scheme: str):
    """Property 59: moving, under gravity. β in the middle of the interval leaves O(dt²), at its end O(dt)."""
    errors = {}
    for dt in (4e-3, 2e-3):
        motion = simulate(waves(seed), dt=dt)
        errors[dt] = [np.abs(motion.residual(20.0, scheme, beta)).max() for beta in (motion.middle, motion.end)]
    assert errors[2e-3][0] <= 1e-3 and errors[2e-3][1] <= 0.1
    assert errors[2e-3][0] <= 0.3 * errors[4e-3][0] + 1e-9
    assert 0.4 <= errors[2e-3][1] / errors[4e-3][1] <= 0.6


@few
@given(st.integers(0, 2**32 - 1), st.integers(0, 1), st.floats(-3, 3))
def test_a_fault_of_one_joint_does_not_show_on_the_other(seed: int, joint: int, size: float):
    """Property 60, transients included."""
    fault = np.eye(2)[joint] * size
    r = simulate(waves(seed), lambda t: fault * np.sign(np.sin(20 * t))).residual([8.0, 25.0])
    assert np.abs(r[:, 1 - joint]).max() <= 1e-3


@few
@given(st.integers(0, 2**32 - 1), st.floats(-2, 2))
def test_faults_superpose(seed: int, share: float):
    """Property 61: r(τ_f1 + k τ_f2) = r(τ_f1) + k r(τ_f2)."""
    first, second = constant(1.0, -0.3), waves(seed + 7)
    command = waves(seed)
    one = simulate(command, first).residual(15.0)
    two = simulate(command, second).residual(15.0)
    both = simulate(command, lambda t: first(t) + share * second(t)).residual(15.0)
    np.testing.assert_allclose(both, one + share * two, atol=2e-3)


def test_high_gains_follow_every_fault_and_ramps_lag_by_slope_over_gain():
    """Property 62."""
    slope = np.array([3.0, -1.0])
    motion = simulate(waves(1), lambda t: slope * t, dt=1e-3, duration=0.5)
    truth = slope * (1e-3 * np.arange(1, 501))[:, None]
    worst = []
    for gain in (20.0, 50.0, 100.0):
        r = motion.residual(gain)
        np.testing.assert_allclose(truth[-1] - r[-1], slope / gain, rtol=0.01)
        worst.append(np.abs(truth - r).max())
    assert worst[2] < worst[1] < worst[0]


def test_without_the_momentum_at_the_start_the_residual_starts_at_minus_gain_times_momentum():
    """Property 64: r(0) = −K p(0), which decays with K; with p(0) it is zero. So the source needs its integral to start
    at p(0) = (2.25, −0.4125)."""
    motion, gain, dt = simulate(constant(5, -2), dt=1e-4, duration=0.05), 10.0, 1e-4
    p0 = ROBOT.momentum(Q, V)
    np.testing.assert_allclose(p0, [2.25, -0.4125], atol=1e-12)
    wrong = motion._replace(p=np.vstack([np.zeros(2), motion.p[1:]])).residual(gain)
    np.testing.assert_allclose(wrong[0], -gain * p0, rtol=2e-3)
    np.testing.assert_allclose(wrong[-1], -gain * p0 * np.exp(-gain * 0.05), rtol=2e-3)
    np.testing.assert_allclose(motion.residual(gain), 0.0, atol=1e-6)
    observer = MomentumResidual(gain=gain, dt=dt)
    observer.reset(p0)
    np.testing.assert_array_equal(observer.value, 0.0)


def test_after_a_reset_only_what_follows_counts():
    observer = MomentumResidual(gain=10.0, dt=0.01)
    observer.reset([1.0])
    observer.update([1.0], [0.0], [5.0])
    assert observer.value[0] > 0.0
    observer.reset([3.0])
    np.testing.assert_array_equal(observer.update([3.0], [0.0], [0.0]), 0.0)


# ---- steps
@given(st.floats(0.01, 1.99), st.floats(1e-4, 1.0))
def test_the_explicit_scheme_is_stable_below_two_and_monotone_up_to_one(product: float, dt: float):
    """Property 66: e⁺ = (1 − K dt) e."""
    observer = MomentumResidual(gain=product / dt, dt=dt, scheme="euler")
    observer.reset([0.0])
    r = np.array([observer.update([0.0], [0.0], [1.0])[0] for _ in range(60)])
    np.testing.assert_allclose(1 - r, (1 - product) ** np.arange(1, 61), atol=1e-9)
    assert (np.diff(r) >= -1e-12).all() == (product <= 1.0 + 1e-9 or abs(1 - r[0]) <= 1e-12)


@given(st.floats(1e-3, 1e6), st.sampled_from(["exact", "implicit"]))
def test_the_other_schemes_are_stable_and_monotone_always(product: float, scheme: str):
    """Property 66: e⁺ = e / (1 + K dt), or e^(−K dt) e."""
    observer = MomentumResidual(gain=product, dt=1.0, scheme=scheme)
    observer.reset([0.0])
    r = np.array([observer.update([0.0], [0.0], [1.0])[0] for _ in range(20)])
    pole = np.exp(-product) if scheme == "exact" else 1 / (1 + product)
    np.testing.assert_allclose(1 - r, pole ** np.arange(1, 21), atol=1e-12)
    assert (np.diff(r) >= -1e-15).all() and (r <= 1.0).all()


@pytest.mark.parametrize("scheme", ["euler", "implicit"])
def test_all_schemes_have_the_same_limit(scheme: str):
    """O(dt): half the interval, half the distance to the exact one."""
    apart = []
    for dt in (4e-3, 2e-3):
        motion = simulate(waves(3), constant(1.0, 0.5), dt=dt)
        apart.append(np.abs(motion.residual(20.0, scheme) - motion.residual(20.0)).max())
    assert 0.4 <= apart[1] / apart[0] <= 0.6


# ---- noise
@pytest.mark.parametrize("scheme", ["exact", "euler", "implicit"])
def test_noise_of_the_momentum_has_the_variance_of_the_formula(scheme: str):
    """Property 67: 2 φ² σ² / (dt² (2 − φ)), for Euler 2 K² σ² / (2 − K dt); three sigma: a false alarm in 370; grows
    with K."""
    dt, sigma, joints, ticks = 1e-3, 1e-3, 400, 1500
    rng, variances = np.random.default_rng(0), []
    for gain in (20.0, 100.0, 400.0):
        observer = MomentumResidual(gain=gain, dt=dt, scheme=scheme)
        observer.reset(np.zeros(joints))
        zero, samples = np.zeros(joints), []
        for k in range(ticks):
            r = observer.update(sigma * rng.normal(size=joints), zero, zero)
            if k * dt * gain > 15 or k > ticks - 500:
                samples.append(r)
        share = {"exact": -np.expm1(-gain * dt), "euler": gain * dt, "implicit": gain * dt / (1 + gain * dt)}[scheme]
        expected = 2 * share**2 * sigma**2 / (dt**2 * (2 - share))
        assert np.var(samples) == pytest.approx(expected, rel=0.05)
        assert np.mean(np.abs(samples) > 3 * np.sqrt(expected)) == pytest.approx(0.0027, abs=0.001)
        variances.append(expected)
    assert variances == sorted(variances)


# ---- forces of others
@pytest.mark.slow
@few
@given(st.integers(0, 2**32 - 1))
def test_a_collision_shows_with_the_opposite_sign_and_a_measured_force_is_compensated(seed: int):
    """Property 68: τ_ext = Jᵀ F shows as −τ_ext; τ + Jᵀ F in place of τ takes it away."""
    push = np.array([1.5, -2.0])
    motion = simulate(waves(seed), push=push, dt=1e-3)
    mirrored = simulate(waves(seed), constant(0, 0), push=-push, dt=1e-3)
    first = motion.residual(1e3)[2] + mirrored.residual(1e3)[2]
    np.testing.assert_allclose(first, 0.0, atol=0.05)
    joint = -(ROBOT.J(Q).T @ push)
    np.testing.assert_allclose(motion.residual(1e3)[9], joint, atol=0.15)
    sliding = simulate(waves(seed), q=Q, v=np.array([0.5, 0.0]), push=np.array([2.0, 0.0]), dt=1e-3)
    known = sliding._replace(tau=sliding.tau + np.array([2.0, 0.0]))
    np.testing.assert_allclose(known.residual(20.0)[:, 0], 0.0, atol=1e-4)


# ---- what is missing, as a fraction
def test_the_fraction_tells_a_dead_actuator_from_a_weak_one():
    """Property 69: r₁ / τ₁ → 1 for a total fault, 0.4 for a loss of 40 %."""
    for share in (1.0, 0.4):
        motion = simulate(constant(5, -2), constant(5 * share, 0), dt=1e-3, duration=0.5)
        r = motion.residual(30.0)[-1]
        answer = FaultFraction([5.0, -2.0], r).closed_form()
        np.testing.assert_allclose(answer.fraction, [share, 0.0], atol=1e-4)


# ---- units and names
@given(st.integers(1, 6), st.integers(0, 2**32 - 1))
def test_units_and_the_order_of_joints_do_not_matter(n: int, seed: int):
    """Property 70: grams and millimetres scale the residual with the momentum; joints renamed are rows renamed."""
    rng = np.random.default_rng(seed)
    gain, units, order = rng.uniform(1, 50, n), 10.0 ** rng.integers(-3, 7, n), rng.permutation(n)
    p, beta, tau = rng.normal(size=(3, 11, n))

    def run(gain: np.ndarray, change: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        observer = MomentumResidual(gain=gain, dt=1e-2)
        observer.reset(change(p[0]))
        return np.array([observer.update(*(change(x[k]) for x in (p, beta, tau))) for k in range(1, 11)])

    plain = run(gain, lambda x: x)
    np.testing.assert_allclose(run(gain, lambda x: units * x), units * plain, rtol=1e-9)
    np.testing.assert_allclose(run(gain[order], lambda x: x[order]), plain[:, order], rtol=1e-12)


# ---- what is refused
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"gain": [1.0, 250.0], "dt": 0.01, "scheme": "euler"}, r"gain\[1\] is 250, so gain\[1\] dt is 2.5;.* below 2"),
        ({"gain": 200.0, "dt": 0.01, "scheme": "euler"}, "gain is 200, so gain dt is 2;"),
        ({"gain": [10.0, -1.0], "dt": 0.01}, r"gain\[1\] is -1; it must be positive"),
        ({"gain": 0.0, "dt": 0.01}, "gain is 0; it must be > 0"),
        ({"gain": np.eye(2), "dt": 0.01}, r"gain must have shape \(any,\), not \(2, 2\)"),
        ({"gain": 1.0, "dt": 0.0}, "dt is 0; it must be > 0"),
        ({"gain": 1.0, "dt": 0.01, "scheme": "trapezoidal"}, "scheme is 'trapezoidal'; it must be one of exact, euler"),
    ],
)  # fmt: skip
def test_bad_arguments_are_named(arguments: dict[str, object], message: str):
    """Property 66: the explicit scheme is refused where it is unstable."""
    with pytest.raises(InvalidInput, match=message):
        MomentumResidual(**arguments)  # type: ignore[arg-type]


def test_there_is_no_residual_before_a_reset():
    observer = MomentumResidual(gain=1.0, dt=0.01)
    with pytest.raises(NotSupported, match="before reset"):
        observer.update([0.0], [0.0], [0.0])
    with pytest.raises(NotSupported, match="before reset"):
        _ = observer.value


def test_a_refused_update_leaves_the_residual_as_it_was():
    observer = MomentumResidual(gain=[1.0, 2.0], dt=0.01)
    with pytest.raises(InvalidInput, match=r"p0 must have shape \(2,\)"):
        observer.reset([0.0])
    observer.reset([0.0, 0.0])
    before = observer.update([0.0, 0.0], [0.0, 0.0], [1.0, 1.0])
    with pytest.raises(InvalidInput, match=r"tau\[1\] is nan"):
        observer.update([0.0, 0.0], [0.0, 0.0], [1.0, np.nan])
    with pytest.raises(InvalidInput, match=r"beta must have shape \(2,\), not \(3,\)"):
        observer.update([0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 1.0])
    np.testing.assert_array_equal(observer.value, before)
