"""The adaptive law of Slotine and Li on four prismatic joints with unknown masses, simulated.

    e = q_d − q,  q̇_r = q̇_d + Λ e,  s = q̇_r − q̇,  Λ = K_D⁻¹ K_P
    τ = Y(q̈_r) â + K_P e + K_D ė,   dâ/dt = Γ Yᵀ(q̈_r) s

What is tested is the mathematics of the law; robot and integration (Runge-Kutta of order four) share no code with any
controller.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import pytest
import sympy as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from wbc.models import Planar4P
from wbc.models.lagrange import derive

T = np.triu(np.ones((4, 4)))
ROBOT = Planar4P(m=(1.5, 0.7, 1.2, 0.9))
TRUE = ROBOT.coefficients
M = ROBOT.M(np.zeros(4))
Desired = Callable[[float], tuple[np.ndarray, np.ndarray, np.ndarray]]
seeds = st.integers(0, 2**32 - 1)
#: A closed loop takes a second.
few = settings(max_examples=max(5, settings.default.max_examples // 20))


def waves(amplitude: Any, frequency: Any, phase: Any = 0.0) -> Desired:
    """q_d = A sin(ω t + φ) and its two derivatives."""
    A, w, p = (np.broadcast_to(np.asarray(x, dtype=float), 4) for x in (amplitude, frequency, phase))
    return lambda t: (A * np.sin(w * t + p), A * w * np.cos(w * t + p), -A * w**2 * np.sin(w * t + p))


REST = waves(0.0, 1.0)


class Sample(NamedTuple):
    """A moment of the closed loop."""

    t: float
    e: np.ndarray
    ed: np.ndarray
    s: np.ndarray
    a_hat: np.ndarray


@dataclass
class Loop:
    """The robot under the law. ``leak`` is σ of the σ-modification, ``dead_zone`` stops adaptation for small |s_i|,
    ``disturbance`` (4,) adds to what the motors do, ``noise`` to the measured velocity."""

    desired: Desired
    gamma: np.ndarray = field(default_factory=lambda: 4.0 * np.eye(4))
    K_P: np.ndarray = field(default_factory=lambda: np.full(4, 40.0))
    K_D: np.ndarray = field(default_factory=lambda: np.full(4, 15.0))
    regressor: Callable[[np.ndarray], np.ndarray] = ROBOT.Y
    leak: float = 0.0
    dead_zone: float = 0.0
    disturbance: Callable[[float], np.ndarray] = lambda t: np.zeros(4)
    noise: Callable[[float], np.ndarray] = lambda t: np.zeros(4)

    def sample(self, t: float, x: np.ndarray) -> Sample:
        q_d, v_d, _ = self.desired(t)
        e, ed = q_d - x[:4], v_d - x[4:8] - self.noise(t)
        return Sample(t, e, ed, ed + self.K_P / self.K_D * e, x[8:])

    def rate(self, t: float, x: np.ndarray) -> np.ndarray:
        now, (_, _, a_d) = self.sample(t, x), self.desired(t)
        Y = self.regressor(a_d + self.K_P / self.K_D * now.ed)
        tau = Y @ now.a_hat + self.K_P * now.e + self.K_D * now.ed
        s = np.where(np.abs(now.s) > self.dead_zone, now.s, 0.0)
        acceleration = np.linalg.solve(M, tau + self.disturbance(t) - ROBOT.g(x[:4]))
        return np.r_[x[4:8], acceleration, self.gamma @ (Y.T @ s - self.leak * now.a_hat)]

    def run(self, x: np.ndarray, duration: float, h: float = 5e-3) -> list[Sample]:
        samples = [self.sample(0.0, x)]
        for k in range(round(duration / h)):
            t = k * h
            k1 = self.rate(t, x)
            k2 = self.rate(t + h / 2, x + h / 2 * k1)
            k3 = self.rate(t + h / 2, x + h / 2 * k2)
            x = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + self.rate(t + h, x + h * k3))
            samples.append(self.sample(t + h, x))
        return samples

    def V(self, now: Sample) -> float:
        """½ sᵀ M s + eᵀ K_P e + ½ (a − â)ᵀ Γ⁻¹ (a − â)."""
        return self.stored(now) + float(now.e @ (self.K_P * now.e))

    def stored(self, now: Sample) -> float:
        """½ sᵀ M s + ½ (a − â)ᵀ Γ⁻¹ (a − â)."""
        off = TRUE - now.a_hat
        return float(0.5 * now.s @ M @ now.s + 0.5 * off @ np.linalg.solve(self.gamma, off))

    def V_rate(self, now: Sample) -> float:
        """−ėᵀ K_D ė − eᵀ K_P K_D⁻¹ K_P e."""
        return float(-now.ed @ (self.K_D * now.ed) - now.e @ (self.K_P**2 / self.K_D * now.e))


def start(desired: Desired, a_hat: Any, *, e: Any = 0.0, ed: Any = 0.0) -> np.ndarray:
    """A state with these errors."""
    q, v, _ = desired(0.0)
    return np.r_[q - e, v - ed, np.broadcast_to(np.asarray(a_hat, dtype=float), 4)]


def random_loop(seed: int) -> tuple[Loop, np.ndarray]:
    """Any gains, any adaptation gain SPD, any smooth reference, any start."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(4, 4))
    loop = Loop(
        waves(rng.uniform(0.1, 0.6, 4), rng.uniform(0.5, 2.0, 4), rng.uniform(0, 6, 4)),
        gamma=root @ root.T + np.eye(4),
        K_P=rng.uniform(20.0, 60.0, 4),
        K_D=rng.uniform(10.0, 25.0, 4),
    )
    return loop, start(loop.desired, rng.normal(scale=3.0, size=4), e=rng.normal(size=4), ed=rng.normal(size=4))


@few
@given(seed=seeds)
def test_the_lyapunov_function_never_grows_and_falls_as_computed(seed: int):
    """Property 36. V does not increase, and changes by the integral of −ėᵀK_Dė − eᵀK_PK_D⁻¹K_Pe (Simpson's rule)."""
    loop, x = random_loop(seed)
    h = 1e-3
    samples = loop.run(x, 0.5, h)
    V = np.array([loop.V(now) for now in samples])
    assert (np.diff(V) <= 1e-9 * V[0]).all()
    rates = np.array([loop.V_rate(now) for now in samples])
    integrals = h / 3 * (rates[:-2] + 4 * rates[1:-1] + rates[2:])
    assert np.allclose(V[2:] - V[:-2], integrals, rtol=1e-5, atol=1e-5 * np.abs(integrals).max())


@pytest.mark.slow
@few
@given(seed=seeds)
def test_errors_vanish_from_any_start_with_any_adaptation_gain(seed: int):
    """Property 37. e, ė → 0 along any smooth bounded reference: ∫ ėᵀK_Dė + eᵀK_PK_D⁻¹K_Pe <= V(0), which leaves them no
    other way; |a − â|² in Γ⁻¹ stays below 2 V(0)."""
    loop, x = random_loop(seed)
    samples = loop.run(x, 25.0)
    bound = 2.0 * loop.V(samples[0])
    weight = np.linalg.inv(loop.gamma)
    assert max((TRUE - now.a_hat) @ weight @ (TRUE - now.a_hat) for now in samples) <= bound * (1 + 1e-9)
    losses = -np.array([loop.V_rate(now) for now in samples])
    assert np.trapezoid(losses, dx=5e-3) <= loop.V(samples[0]) * (1 + 1e-3)
    # Errors that start near zero grow first: the end is compared with the largest loss of the run.
    assert losses[-400:].mean() < 1e-2 * losses.max()


def test_a_perfect_start_stays_perfect():
    """Property 38. e = ė = 0 and â = a is an equilibrium along any reference."""
    desired = waves([0.3, -0.2, 0.4, 0.1], [1.0, 2.0, 1.5, 0.7])
    for now in Loop(desired).run(start(desired, TRUE), 2.0):
        assert max(np.abs(now.e).max(), np.abs(now.ed).max(), np.abs(now.a_hat - TRUE).max()) < 1e-8


def test_with_the_true_parameters_s_obeys_a_linear_equation():
    """Property 38. With â = a held, M ṡ + K_D s = 0, so s(t) = exp(−M⁻¹ K_D t) s(0)."""
    desired = waves([0.3, -0.2, 0.4, 0.1], 1.3)
    loop = Loop(desired, gamma=np.zeros((4, 4)))
    samples = loop.run(start(desired, TRUE, e=[0.2, -0.1, 0.3, 0.1], ed=0.4), 1.0, 1e-3)
    for now in samples[::100]:
        expected = expm(-np.linalg.solve(M, np.diag(loop.K_D)) * now.t) @ samples[0].s
        assert np.allclose(now.s, expected, atol=1e-9)


def test_masses_and_coefficients_adapt_alike_when_their_gains_are_alike():
    """Property 39. Γ_a = T Γ_m Tᵀ and â(0) = T m̂(0) give the same e(t), and â = T m̂ for ever."""
    desired = waves([0.3, -0.2, 0.4, 0.1], [1.0, 2.0, 1.5, 0.7])
    gamma_m, m_hat = np.diag([1.0, 2.0, 0.5, 3.0]), np.array([0.5, 2.0, 0.1, 0.0])
    by_mass = Loop(desired, gamma=gamma_m, regressor=ROBOT.Y_masses).run(start(desired, m_hat, e=0.3), 3.0)
    by_coefficient = Loop(desired, gamma=T @ gamma_m @ T.T).run(start(desired, T @ m_hat, e=0.3), 3.0)
    for one, other in zip(by_mass, by_coefficient, strict=True):
        assert np.allclose(one.e, other.e, atol=1e-10)
        assert np.allclose(T @ one.a_hat, other.a_hat, atol=1e-9)


# ---- what can be identified
def gram(accelerations: list[Any], regressor: str) -> sp.Matrix:
    """∫ Yᵀ Y over a period 2π of a reference, exact; accelerations are expressions in t."""
    t = sp.Symbol("t", real=True)
    d = derive("PPyPPy")
    Y = d.Y if regressor == "coefficients" else d.Y * d.coefficients.jacobian(list(d.parameters.values()))
    Y = Y.subs(dict(zip(d.a, accelerations, strict=True)) | {d.g0: sp.Rational(981, 100)})
    return (Y.T * Y).applyfunc(lambda entry: sp.integrate(sp.expand(entry), (t, 0, 2 * sp.pi)))


def test_one_sinusoid_on_the_first_joint_and_gravity_identify_all_four():
    """Property 40. The Gram matrix of Y along the reference has rank 4."""
    wave = sp.sin(sp.Symbol("t", real=True))
    assert gram([wave, 0, 0, 0], "coefficients").rank() == 4


def test_at_rest_gravity_identifies_the_vertical_half():
    """Property 40. Regulation: a2 and a4, nothing of a1 and a3; in masses m4 and m2 + m3 only."""
    null = gram([0, 0, 0, 0], "coefficients").nullspace()
    assert null == [sp.Matrix([1, 0, 0, 0]), sp.Matrix([0, 0, 1, 0])]
    unseen = sp.Matrix.hstack(*gram([0, 0, 0, 0], "masses").nullspace())
    assert unseen.cols == 2
    for seen in ([0, 0, 0, 1], [0, 1, 1, 0]):
        assert sp.Matrix([seen]) * unseen == sp.zeros(1, 2)


def test_opposite_horizontal_motion_identifies_only_the_sum_of_the_first_two_masses():
    """Property 40. q3d = −q1d: of a1 and a3 only a1 − a3 = m1 + m2."""
    wave = sp.sin(sp.Symbol("t", real=True))
    assert gram([wave, 0, -wave, 0], "coefficients").nullspace() == [sp.Matrix([1, 0, 1, 0])]


def test_only_the_third_joint_identifies_no_first_link():
    """Property 40. With joint 1 at rest the first coefficient is never seen."""
    wave = sp.sin(sp.Symbol("t", real=True))
    assert gram([0, 0, wave, 0], "coefficients").nullspace() == [sp.Matrix([1, 0, 0, 0])]


def test_under_excitation_the_parameters_converge():
    """Property 40. Sinusoid on joint 1 and gravity: â → a."""
    desired = waves([0.8, 0, 0, 0], 2.0)
    last = Loop(desired, gamma=40.0 * np.eye(4)).run(start(desired, 0.0), 40.0, 1e-2)[-1]
    assert np.allclose(last.a_hat, TRUE, rtol=1e-3)


def test_what_a_regulation_does_not_excite_never_moves():
    """Property 40. Starting at the goal, gravity corrects a2 and a4; a1 and a3 stay bit for bit where they were."""
    samples = Loop(REST, gamma=20.0 * np.eye(4)).run(start(REST, [0.5, 1.0, -2.0, 0.3]), 20.0, 1e-2)
    assert all(now.a_hat[0] == 0.5 and now.a_hat[2] == -2.0 for now in samples)
    assert np.allclose(samples[-1].a_hat[[1, 3]], TRUE[[1, 3]], rtol=1e-3)


def test_opposite_motion_finds_the_difference_and_not_the_coefficients():
    """Property 40. The identifiable combination converges, the other does not."""
    desired = waves([0.8, 0, -0.8, 0], 2.0)
    last = Loop(desired, gamma=20.0 * np.eye(4)).run(start(desired, 0.0, e=0.2), 40.0, 1e-2)[-1]
    assert last.a_hat[0] - last.a_hat[2] == pytest.approx(TRUE[0] - TRUE[2], rel=1e-2)
    assert abs(last.a_hat[2] - TRUE[2]) > 0.3
    assert np.abs(last.e).max() < 1e-3


# ---- limits of the law
def test_without_adaptation_it_is_feedback_with_a_fixed_feedforward():
    """Property 41. Γ → 0: the loop tends to PD with the first â."""
    desired = waves([0.3, -0.2, 0.4, 0.1], 1.3)
    x = start(desired, [5.0, 2.0, 1.0, 0.2], e=0.2)
    fixed = Loop(desired, gamma=np.zeros((4, 4))).run(x, 2.0)
    offs = []
    for gain in (1e-2, 1e-3, 1e-4):
        slow = Loop(desired, gamma=gain * np.eye(4)).run(x, 2.0)
        offs.append(max(np.abs(a.e - b.e).max() for a, b in zip(slow, fixed, strict=True)))
    assert offs[1] == pytest.approx(offs[0] / 10, rel=0.1) and offs[2] == pytest.approx(offs[1] / 10, rel=0.1)


@few
@given(seed=seeds)
def test_the_adaptive_loop_is_passive_from_the_disturbance_to_s(seed: int):
    """Property 35. ½ sᵀMs + ½ãᵀΓ⁻¹ã changes by −∫ sᵀK_D s − ∫ sᵀ w: what w takes out was stored or is dissipated."""
    loop, x = random_loop(seed)
    amplitude = np.random.default_rng(seed).normal(scale=5.0, size=4)
    loop.disturbance = lambda t: amplitude * np.sin(3.0 * t)
    h = 1e-3
    samples = loop.run(x, 1.0, h)
    power = np.array([now.s @ (loop.K_D * now.s) + now.s @ loop.disturbance(now.t) for now in samples])
    work = h * (power[1:-1].sum() + 0.5 * (power[0] + power[-1]))
    assert loop.stored(samples[-1]) - loop.stored(samples[0]) == pytest.approx(-work, rel=1e-3, abs=1e-3)


@few
@given(seed=seeds)
def test_a_leak_keeps_everything_bounded_under_any_bounded_disturbance(seed: int):
    """Property 42. W = ½ sᵀMs + ½ ãᵀΓ⁻¹ã obeys Ẇ <= −λ W + C, so W <= max(W(0), C/λ), with the leak σ and
    λ = min(λ_min(K_D)/λ_max(M), σ λ_min(Γ)), C = ½ max wᵀK_D⁻¹w + ½ σ |a|²."""
    loop, x = random_loop(seed)
    rng = np.random.default_rng(seed)
    amplitude, frequency = rng.normal(scale=10.0, size=4), rng.uniform(0.0, 5.0, 4)
    loop.leak, loop.disturbance = 0.2, lambda t: amplitude * np.cos(frequency * t)
    decay = min(loop.K_D.min() / np.linalg.eigvalsh(M)[-1], loop.leak * np.linalg.eigvalsh(loop.gamma)[0])
    supply = 0.5 * amplitude @ (amplitude / loop.K_D) + 0.5 * loop.leak * TRUE @ TRUE
    samples = loop.run(x, 6.0)
    bound = max(loop.stored(samples[0]), supply / decay)
    assert max(map(loop.stored, samples)) <= bound * (1 + 1e-6)


def test_a_leak_biases_what_is_not_excited():
    """Property 42. Regulation without disturbance: the leak pulls â from what identification finds, and e stays."""
    plain, leaking = (Loop(REST, leak=leak).run(start(REST, 0.0), 60.0, 1e-2)[-1] for leak in (0.0, 0.05))
    assert np.abs(plain.e).max() < 1e-6 < 1e-4 < np.abs(leaking.e).max()
    assert np.allclose(plain.a_hat[[1, 3]], TRUE[[1, 3]], rtol=1e-5)
    assert np.abs(leaking.a_hat - TRUE)[[1, 3]].min() > 1e-4


def test_in_the_dead_zone_nothing_is_learnt_from_noise():
    """Property 42. |s_i| within the zone moves no parameter; without the zone noise does."""
    desired = waves([0.3, -0.2, 0.4, 0.1], 1.3)

    def noise(t: float) -> np.ndarray:
        return 0.02 * np.sin(np.array([90.0, 70.0, 80.0, 60.0]) * t)

    # Noise of the velocity also enters what the motors do; a zone that covers both.
    quiet = Loop(desired, noise=noise, dead_zone=0.06).run(start(desired, TRUE), 2.0)
    assert all(np.array_equal(now.a_hat, TRUE) for now in quiet)
    awake = Loop(desired, noise=noise).run(start(desired, TRUE), 2.0)
    assert np.abs(awake[-1].a_hat - TRUE).max() > 1e-6
