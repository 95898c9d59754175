"""Adaptive control of arms from URDFs: ten numbers a link, always those of bodies; nothing but the motion is known."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wbc
from tasks import Position, Posture, Sinusoid, SlotineLi, TorqueLimits
from tasks.components.adaptive_law import InertialLaw
from tasks.components.prediction import Prediction
from tests.models.test_inertial_regressor import chain
from wbc.methods import PseudoInertia
from wbc.models.inertial_regressor import InertialRegressor
from wbc.sim.plant import ForwardDynamicsPlant
from wbc.sim.simulate import simulate
from wbc.types import Vec

ARM = wbc.load("arm")
LAST = ARM.joint_names[-1]
WAVE = Sinusoid(ARM.q0, amplitude=0.3, frequency=np.linspace(0.6, 1.2, 7))
KD = np.minimum(20.0, 200.0 * np.diag(ARM.state().M))
HEAVY = np.array([1.0] * 6 + [4.0])  # the last link weighs four times as much as the controller thinks


def adapted(
    *, dt: float = 1e-3, duration: float = 1.5, true: Any = None, tasks: Any = (), **given_settings: Any
) -> tuple[wbc.Run, SlotineLi]:
    true = ARM.with_masses(HEAVY) if true is None else true
    truth = np.concatenate([link.toDynamicParameters() for link in list(true.pinocchio.inertias)[1:]])
    frozen = given_settings.pop("frozen", False)
    arguments: dict[str, Any] = {"kp": 10.0 * KD, "kd": KD, "gain": 50.0, "links": [LAST], "truth": truth}
    adaptive = SlotineLi(given_settings.pop("target", WAVE), **arguments | given_settings)
    adaptive.frozen = frozen
    stack = wbc.Stack([adaptive.torque, *tasks], components=[adaptive], subject_to=[TorqueLimits(1e4)])
    controller = wbc.Controller(ARM, stack, level=wbc.InverseDynamics(), dt=dt)
    plant = ForwardDynamicsPlant(true, dt=dt)
    plant.reset(ARM.q0)
    return simulate(controller, plant, duration=duration), adaptive


def signal(run: wbc.Run, name: str) -> Vec:
    return run[f"signal.SlotineLi.{name}"]


def worst(run: wbc.Run) -> float:
    """Largest error of the joints in the last third [rad]."""
    wanted = np.array([WAVE(t)[0] for t in run["t"]])
    return float(np.abs(run["plant.q"] - wanted)[-len(wanted) // 3 :].max())


def test_it_learns_a_load_and_follows_while_the_same_gains_alone_do_not() -> None:
    learning, adaptive = adapted(duration=3.0)
    stubborn, _ = adapted(duration=3.0, frozen=True)
    assert worst(learning) < worst(stubborn) / 10
    true_mass = 4.0 * ARM.pinocchio.inertias[7].mass
    assert adaptive.a_hat[60] == pytest.approx(true_mass, rel=0.1)
    assert (signal(learning, "smallest") > 0.0).all()
    assert (signal(stubborn, "a_hat") == signal(stubborn, "a_hat")[0]).all()
    assert (signal(learning, "a_hat")[:, :60] == signal(learning, "a_hat")[0, :60]).all(), "one link is adapted"


@pytest.mark.parametrize("rotors", [0.0, 2.0])
@pytest.mark.parametrize("joints", [1, 3])
def test_who_knows_the_links_of_an_arm_follows_and_learns_nothing_up_to_the_period(joints: int, rotors: float) -> None:
    """Rotors are known: what they take is no error to be fed back, none to learn from, and no news to a plan."""
    arm = chain(joints, rotors)
    wave, truth = Sinusoid(arm.q0, amplitude=0.3, frequency=0.8, ramp=0.2), InertialRegressor(arm).parameters
    found = []
    for dt in (2e-3, 5e-4):
        adaptive = SlotineLi(wave, kp=20.0, kd=5.0, gain=1.0, composite=1e-2, truth=truth, estimate_floor=1e-6)
        stack = wbc.Stack([adaptive.torque], components=[adaptive])
        controller = wbc.Controller(arm, stack, level=wbc.InverseDynamics(), dt=dt)
        plant = ForwardDynamicsPlant(arm, dt=dt)
        plant.reset(arm.q0)
        run = simulate(controller, plant, duration=0.4)
        assert (signal(run, "estimate_used") == 1.0).all()
        off = run["plant.q"] - [wave(t)[0] for t in run["t"]]
        surprise = np.diff(run["plant.v"], axis=0) / dt - run["a"][:-1]
        learnt = signal(run, "a_hat") - truth
        found.append([np.abs(part).max() for part in (off, surprise, learnt, signal(run, "V"))])
    assert (np.array(found[1]) < 0.5 * np.array(found[0])).all()


def test_V_falls_up_to_an_error_of_integration_that_falls_with_the_period() -> None:
    rises = []
    for dt in (1e-3, 2.5e-4):
        run, _ = adapted(dt=dt, duration=0.5)
        V = signal(run, "V")
        rises.append(float(np.maximum(np.diff(V), 0.0).max()) / V[0])
        assert V[-1] < 0.9 * V[0]
    assert rises[1] < 0.5 * rises[0] + 1e-12
    assert rises[0] < 1e-3


@settings(max_examples=max(5, settings.default.max_examples // 50))
@given(seed=st.integers(0, 999))
def test_all_links_stay_bodies_whatever_is_learnt(seed: int) -> None:
    rng = np.random.default_rng(seed)
    law = InertialLaw("law", ARM, gain=10.0, start=None, links=None, friction_gain=1.0, length=0.3, floor=1e-6)
    for _ in range(20):
        law.step(10.0 * rng.standard_normal(len(law.start)), 0.1)
        assert law.smallest >= 0.99e-6
        assert (law.a_hat[law.p_links :] >= 0.0).all()


@pytest.mark.parametrize("links", [None, [LAST]], ids=["all links", "one"])
def test_V_counts_parameters_by_the_gain_that_they_are_adapted_with(links: Any) -> None:
    """½ |a − â|² in Γ⁻¹ falls at the rate (a − â)ᵀ g while â' = Γ g: what V needs to be a Lyapunov function."""
    law = InertialLaw("law", ARM, gain=10.0, start=None, links=links, friction_gain=2.0, length=0.3, floor=1e-6)
    rng, start, h = np.random.default_rng(0), law.a_hat.copy(), 1e-6
    for _ in range(10):
        gradient, off = 1e-2 * np.abs(rng.standard_normal((2, len(start))))
        law.reset()
        moved = (law.step(gradient, h) - start) / h
        fallen = 0.5 * (law.squared(off) - law.squared(off - h * moved)) / h
        adapted = moved != 0.0
        assert fallen == pytest.approx(float(off[adapted] @ gradient[adapted]), rel=1e-3)


@settings(max_examples=max(20, settings.default.max_examples // 10))
@given(seed=st.integers(0, 9999))
def test_the_projection_never_moves_away_from_any_body(seed: int) -> None:
    """Property 41: in its own metric, so that the Lyapunov function does not grow by it."""
    rng = np.random.default_rng(seed)
    Q = PseudoInertia.metric(0.3)

    def body() -> Vec:
        root = rng.standard_normal((4, 4)) * rng.uniform(0.1, 2.0)
        S = np.diag([0.3, 0.3, 0.3, 1.0])
        J = S @ (root @ root.T + 1e-5 * np.eye(4)) @ S
        about = np.trace(J[:3, :3]) * np.eye(3) - J[:3, :3]
        return np.array([J[3, 3], *J[:3, 3], *about[np.triu_indices(3)][[0, 1, 3, 2, 4, 5]]])

    true, off = body(), body() + rng.standard_normal(10)
    projected = PseudoInertia(off, length=0.3).closed_form().parameters
    before, after = off - true, projected - true
    assert after @ Q @ after <= (before @ Q @ before) * (1 + 1e-9)
    assert PseudoInertia(true, length=0.3).closed_form().parameters == pytest.approx(true, abs=1e-12)


def test_what_was_sent_is_what_the_true_parameters_predict() -> None:
    """The prediction error of composite adaptation vanishes for the truth, without any acceleration."""
    truth = InertialRegressor(ARM).parameters
    law = InertialLaw("law", ARM, gain=1.0, start=None, links=None, friction_gain=0.0, length=0.3, floor=1e-6)
    prediction, state, plant = Prediction(law, 20.0), ARM.state(), ForwardDynamicsPlant(ARM)
    plant.reset(ARM.q0)
    controller = wbc.Controller(ARM, wbc.Stack([Posture(WAVE)]), level=wbc.InverseDynamics())
    for _ in range(150):
        state.update(plant.t, plant.q, plant.v)
        command = controller.tick(plant.t, plant.q, plant.v)
        W, off = prediction.error(state, command.tau, truth, 1e-3)
        assert np.abs(off).max() < 0.02
        plant.step(command)
    assert np.abs(W @ truth).max() > 5.0


def test_composite_adaptation_leakage_and_dead_zone_do_what_they_say() -> None:
    run, composite = adapted(composite=1e-3)
    assert worst(run) < 0.02
    assert abs(composite.a_hat[60] - 4.0 * ARM.pinocchio.inertias[7].mass) < 0.5
    _, leaky = adapted(leakage=50.0)
    _, plain = adapted()
    start = InertialRegressor(ARM).parameters
    assert np.linalg.norm(leaky.a_hat - start) < 0.8 * np.linalg.norm(plain.a_hat - start)
    still, dead = adapted(dead_zone=1e3, duration=0.1)
    assert (dead.a_hat == start).all() and still.rows == 100


def test_a_motion_that_excites_is_told_from_one_that_does_not() -> None:
    moving, _ = adapted(window=0.3, duration=0.6)
    resting, _ = adapted(window=0.3, duration=0.6, target=ARM.q0, true=ARM)
    assert signal(moving, "excitation")[-1] > 100 * signal(resting, "excitation")[-1] >= 0.0


def test_the_plan_computes_with_the_estimate_only_while_that_is_positive_definite() -> None:
    told, _ = adapted(estimate_floor=1e-6, duration=1.0)
    nominal, _ = adapted(duration=1.0)
    assert (signal(told, "estimate_used") == 1.0).all()
    untold, _ = adapted(estimate_floor=1e3, duration=0.05)
    assert not signal(untold, "estimate_used").any()
    # What the plan takes torques to do is nearer to what they do with the load in it.
    wrong = [np.abs(np.diff(r["plant.v"], axis=0) / 1e-3 - r["a"][:-1])[-100:].mean() for r in (told, nominal)]
    assert wrong[0] < 0.3 * wrong[1]


def test_a_frame_follows_a_motion_of_its_own() -> None:
    start = ARM.state().frame("tool").placement.copy()
    path = Sinusoid(start.translation, amplitude=[0.05, 0.08, 0.05], frequency=0.5)

    def target(t: float) -> tuple[Any, Any, Any]:
        position, rate, acceleration = path(t)
        pose = start.copy()
        pose.translation = position
        return pose, np.r_[rate, np.zeros(3)], np.r_[acceleration, np.zeros(3)]

    reached = Position("tool", target=lambda t: path(t)[0], weight=0.0)
    run, _ = adapted(target=target, frame="tool", tasks=[reached])
    stubborn, _ = adapted(target=target, frame="tool", tasks=[reached], frozen=True)
    error, lost = (np.abs(r["error.Position[tool]"][-400:]).max() for r in (run, stubborn))
    assert error < 4e-3
    assert lost > 5 * error


def test_base_parameters_are_fewer_and_give_the_same_torques() -> None:
    _, adaptive = adapted(duration=0.01, links=None)
    regressor, rng = InertialRegressor(ARM), np.random.default_rng(1)
    assert len(adaptive.base_parameters) == len(regressor.independent) < 70
    q, (v, v_r, a_r) = ARM.random_configuration(rng), rng.standard_normal((3, 7))
    Y = regressor(q, v, v_r, a_r)
    np.testing.assert_allclose(Y[:, regressor.independent] @ adaptive.base_parameters, Y @ adaptive.a_hat, atol=1e-9)
    assert len(adaptive.parameter_names) == 70
