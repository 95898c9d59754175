"""The adaptive law in a stack: the command is the law, errors vanish without knowing a mass, V falls."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wbc
from tasks import SlotineLi, TorqueLimits
from tasks.scenarios.exact_plant import ExactPlant
from wbc.models import Planar4P, PlanarPR
from wbc.models.planar import PlanarRobot
from wbc.sim.simulate import simulate
from wbc.types import Vec

TRUE = Planar4P(m=(2.0, 1.0, 1.5, 0.5))
MODEL = Planar4P()  # what the controller believes; its masses are wrong and count for nothing
DT = 2e-3


class Wave:
    """q_d = amplitude sin(ω t), and its derivatives."""

    def __init__(self, amplitude: Any, frequency: Any) -> None:
        self.amplitude, self.frequency = np.asarray(amplitude), np.asarray(frequency)

    def __call__(self, t: float) -> tuple[Vec, Vec, Vec]:
        a, w = self.amplitude, self.frequency
        return a * np.sin(w * t), a * w * np.cos(w * t), -a * w**2 * np.sin(w * t)


ALL = Wave([0.5, 0.4, 0.3, 0.3], [1.1, 0.9, 2.1, 1.7])


def adapted(
    target: Any, *, model: PlanarRobot = MODEL, true: PlanarRobot = TRUE, duration: float = 6.0, dt: float = DT,
    q: Any = None, v: Any = None, limits: Any = (), **settings: Any,
) -> wbc.Run:  # fmt: skip
    arguments = {"kp": 100.0, "kd": 40.0, "gain": 10.0, "truth": true.coefficients} | settings
    adaptive = SlotineLi(target, **arguments)
    controller = wbc.Controller(
        model,
        wbc.Stack([adaptive.torque], components=[adaptive], subject_to=limits),
        level=wbc.InverseDynamics(),
        dt=dt,
    )
    plant = ExactPlant(true, dt=dt)
    plant.reset(true.q0 if q is None else q, v)
    return simulate(controller, plant, duration=duration)


def signal(run: wbc.Run, name: str) -> Vec:
    return run[f"signal.SlotineLi.{name}"]


@given(seed=st.integers(0, 9999), exact=st.booleans())
def test_with_no_limit_active_the_command_is_the_law(seed: int, exact: bool):
    rng = np.random.default_rng(seed)
    kp, kd, a_hat = rng.uniform(1, 200, 4), rng.uniform(1, 60, 4), rng.uniform(0, 5, 4)
    adaptive = SlotineLi(ALL, kp=kp, kd=kd, gain=rng.uniform(0.1, 10.0), a_hat=a_hat)
    limits = [TorqueLimits(1e4)] if exact else []
    stack = wbc.Stack([adaptive.torque], components=[adaptive], subject_to=limits)
    controller = wbc.Controller(MODEL, stack, level=wbc.InverseDynamics())
    t, q, v = rng.uniform(0, 5), rng.normal(size=4), rng.normal(size=4)
    command = controller.tick(t, q, v)
    q_d, v_d, a_d = ALL(t)
    e, e_rate = q_d - q, v_d - v
    law = MODEL.Y(a_d + kp / kd * e_rate) @ a_hat + kp * e + kd * e_rate
    assert command.status.ok
    np.testing.assert_allclose(command.tau, law, atol=1e-9 * (1 + np.abs(law).max()))
    np.testing.assert_allclose(adaptive.signals()["s"], e_rate + kp / kd * e, atol=1e-12)


def test_within_limits_the_command_is_the_law_cut_off():
    run = adapted([0.5, 0.5, 0.0, 0.0], limits=[TorqueLimits([20.0, 40.0, 20.0, 5.0])], duration=0.5)
    wanted = np.clip(signal(run, "tau"), [-20, -40, -20, -5], [20, 40, 20, 5])
    assert (np.abs(signal(run, "tau")) > np.abs(wanted) + 1.0).any(), "no limit was active"
    assert (run["status"] == 0).all()
    np.testing.assert_allclose(run["tau"], wanted, atol=1e-6)


@pytest.mark.slow
@settings(max_examples=6, deadline=None)
@given(seed=st.integers(0, 999), physical=st.booleans())
def test_V_never_rises_and_bounds_what_it_is_made_of(seed: int, physical: bool):
    """Properties 36, 37 and 41: whatever the gain, the start and the masses."""
    rng = np.random.default_rng(seed)
    true, gain = Planar4P(m=rng.uniform(0.2, 3.0, 4)), rng.uniform(0.5, 20.0, 4)
    run = adapted(
        ALL, true=true, gain=gain, a_hat=np.sort(rng.uniform(0, 8, 4))[::-1], physical=physical, duration=2.0,
        q=0.3 * rng.normal(size=4), v=0.3 * rng.normal(size=4),
    )  # fmt: skip
    V, a_hat = signal(run, "V"), signal(run, "a_hat")
    assert np.diff(V).max() <= 2e-3 * V[0]
    assert V[-1] < V[0]
    off = true.coefficients - a_hat
    assert ((off**2 / gain).sum(axis=1) <= 2.0 * V[0] * 1.01).all()
    if physical:
        assert (np.diff(a_hat, axis=1) <= 1e-9).all() and (a_hat[:, 3] >= -1e-9).all()


def test_V_falls_as_its_formula_says():
    """Property 36."""
    run = adapted(ALL, dt=2e-4, duration=0.5, q=[0.1, -0.1, 0.2, 0.1])
    t, e_rate = run["t"], np.array([ALL(t)[1] for t in run["t"]]) - run["v"]
    e = np.array([ALL(t)[0] for t in t]) - run["q"]
    expected = -(40.0 * e_rate**2).sum(axis=1) - (100.0**2 / 40.0 * e**2).sum(axis=1)
    found = np.gradient(signal(run, "V"), t)
    np.testing.assert_allclose(found[2:-2], expected[2:-2], atol=2e-2 * np.abs(expected).max())


@pytest.mark.slow
def test_errors_vanish_and_an_exciting_motion_identifies_every_coefficient():
    """Property 40."""
    run = adapted(ALL, duration=20.0, gain=60.0, dt=4e-3)
    e = np.array([ALL(t)[0] for t in run["t"]]) - run["q"]
    assert np.abs(e[-500:]).max() < 2e-3
    np.testing.assert_allclose(signal(run, "a_hat")[-1], TRUE.coefficients, atol=2e-2)


def test_standing_still_identifies_what_gravity_loads_and_nothing_else():
    """Property 40."""
    run = adapted([0.3, 0.2, -0.1, 0.1], duration=10.0, dt=4e-3)
    a_hat = signal(run, "a_hat")
    np.testing.assert_allclose(a_hat[-1, [1, 3]], TRUE.coefficients[[1, 3]], atol=1e-6)
    assert np.abs(a_hat[-1, [0, 2]] - TRUE.coefficients[[0, 2]]).max() > 0.5
    np.testing.assert_allclose(a_hat[-1], a_hat[-500], atol=1e-6)
    np.testing.assert_allclose(run["q"][-1], [0.3, 0.2, -0.1, 0.1], atol=1e-6)


def test_motions_that_cancel_identify_a_difference_alone():
    """Property 40: q3 = −q1 excites a1 − a3 = m1 + m2 and no more."""
    run = adapted(Wave([0.5, 0.0, -0.5, 0.0], [2.0, 1.0, 2.0, 1.0]), duration=20.0, gain=60.0, dt=4e-3)
    a_hat = signal(run, "a_hat")[-1]
    assert a_hat[0] - a_hat[2] == pytest.approx(3.0, abs=2e-2)
    assert abs(a_hat[2] - 2.0) > 0.2


def test_who_knows_everything_learns_nothing():
    """Property 38."""
    q, v, _ = ALL(0.0)
    run = adapted(ALL, a_hat=TRUE.coefficients, q=q, v=v, duration=1.0, dt=1e-3)
    np.testing.assert_allclose(signal(run, "a_hat"), np.tile(TRUE.coefficients, (run.rows, 1)), atol=1e-2)
    assert np.abs(signal(run, "s")).max() < 1e-2


def test_without_adaptation_it_is_feedforward_and_PD():
    """Property 41."""
    run = adapted([0.3, 0.2, -0.1, 0.1], gain=1e-12, a_hat=[5.0, 3.0, 2.0, 0.5], duration=1.0)
    np.testing.assert_allclose(signal(run, "a_hat")[-1], [5.0, 3.0, 2.0, 0.5], atol=1e-9)


def test_a_robot_with_coriolis_forces_is_tracked_too():
    true = PlanarPR(m1=1, m2=1, l2=0.5, d2=0.25, I2=0.1)
    model = PlanarPR(m1=2, m2=3, l2=0.5, d2=0.1, I2=0.4)
    wave = Wave([0.3, 1.0], [2.0, 1.5])
    run = adapted(wave, model=model, true=true, duration=10.0, kp=[60.0, 20.0], kd=[30.0, 6.0], gain=10.0)
    e = np.array([wave(t)[0] for t in run["t"]]) - run["q"]
    assert np.abs(e[-500:]).max() < 1e-2
    V = signal(run, "V")
    assert np.diff(V).max() <= 2e-3 * V[0]


def test_the_gain_may_be_a_matrix_and_a_reset_forgets():
    adaptive = SlotineLi(ALL, kp=50.0, kd=20.0, gain=np.eye(4) + 0.5, truth=TRUE.coefficients)
    controller = wbc.Controller(
        MODEL, wbc.Stack([adaptive.torque], components=[adaptive]), level=wbc.InverseDynamics(), dt=DT
    )
    first = controller.tick(0.0, np.zeros(4), np.zeros(4)).tau
    assert np.isfinite(adaptive.signals()["V"])
    assert adaptive.a_hat.any()
    controller.reset()
    np.testing.assert_array_equal(controller.tick(0.0, np.zeros(4), np.zeros(4)).tau, first)
    unknown = SlotineLi(ALL, kp=50.0, kd=20.0, gain=1.0)
    wbc.Controller(MODEL, wbc.Stack([unknown.torque], components=[unknown]), level=wbc.InverseDynamics()).tick(
        0.0, np.zeros(4), np.zeros(4)
    )
    assert np.isnan(unknown.signals()["V"])
