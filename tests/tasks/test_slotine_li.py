"""The adaptive law in a stack: the command is the law, errors vanish without knowing a mass, V falls.

Of arms from URDFs ten numbers a link are learnt, always those of bodies.
"""

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
from tasks.scenarios.exact_plant import ExactPlant
from tests.models.test_inertial_regressor import chain
from wbc.methods import PseudoInertia
from wbc.models import Planar4P
from wbc.models.inertial_regressor import InertialRegressor
from wbc.models.planar import PlanarRobot
from wbc.sim.plant import ForwardDynamicsPlant
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


def controlled(adaptive: SlotineLi, model: Any, dt: float = DT, limits: Any = (), *tasks: Any) -> wbc.Controller:
    """A controller of the law alone, or of the law beside some tasks."""
    stack = wbc.Stack([adaptive.torque, *tasks], components=[adaptive], subject_to=limits)
    return wbc.Controller(model, stack, level=wbc.InverseDynamics(), dt=dt)


def adapted(
    target: Any, *, model: PlanarRobot = MODEL, true: PlanarRobot = TRUE, duration: float = 6.0, dt: float = DT,
    q: Any = None, v: Any = None, limits: Any = (), **settings: Any,
) -> wbc.Run:  # fmt: skip
    arguments = {"kp": 100.0, "kd": 40.0, "gain": 10.0, "truth": true.coefficients} | settings
    adaptive = SlotineLi(target, **arguments)
    plant = ExactPlant(true, dt=dt)
    plant.reset(true.q0 if q is None else q, v)
    return simulate(controlled(adaptive, model, dt, limits), plant, duration=duration)


def signal(run: wbc.Run, name: str) -> Vec:
    return run[f"signal.SlotineLi.{name}"]


def errors(run: wbc.Run, wave: Any) -> Vec:
    """By how much it is off its wave (ticks, nj)."""
    return np.array([wave(t)[0] for t in run["t"]]) - run["q"]


@given(seed=st.integers(0, 9999), exact=st.booleans())
def test_with_no_limit_active_the_command_is_the_law(seed: int, exact: bool):
    rng = np.random.default_rng(seed)
    kp, kd, a_hat = rng.uniform(1, 200, 4), rng.uniform(1, 60, 4), rng.uniform(0, 5, 4)
    adaptive = SlotineLi(ALL, kp=kp, kd=kd, gain=rng.uniform(0.1, 10.0), a_hat=a_hat)
    controller = controlled(adaptive, MODEL, 1e-3, [TorqueLimits(1e4)] if exact else [])
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
    t, e, e_rate = run["t"], errors(run, ALL), np.array([ALL(t)[1] for t in run["t"]]) - run["v"]
    expected = -(40.0 * e_rate**2).sum(axis=1) - (100.0**2 / 40.0 * e**2).sum(axis=1)
    found = np.gradient(signal(run, "V"), t)
    np.testing.assert_allclose(found[2:-2], expected[2:-2], atol=2e-2 * np.abs(expected).max())


@pytest.mark.slow
def test_errors_vanish_and_an_exciting_motion_identifies_every_coefficient():
    """Property 40."""
    run = adapted(ALL, duration=20.0, gain=60.0, dt=4e-3)
    assert np.abs(errors(run, ALL)[-500:]).max() < 2e-3
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


def test_the_gain_may_be_a_matrix_and_a_reset_forgets():
    adaptive = SlotineLi(ALL, kp=50.0, kd=20.0, gain=np.eye(4) + 0.5, truth=TRUE.coefficients)
    controller = controlled(adaptive, MODEL)
    first = controller.tick(0.0, np.zeros(4), np.zeros(4)).tau
    assert np.isfinite(adaptive.signals()["V"])
    assert adaptive.a_hat.any()
    controller.reset()
    np.testing.assert_array_equal(controller.tick(0.0, np.zeros(4), np.zeros(4)).tau, first)
    unknown = SlotineLi(ALL, kp=50.0, kd=20.0, gain=1.0)
    controlled(unknown, MODEL).tick(0.0, np.zeros(4), np.zeros(4))
    assert np.isnan(unknown.signals()["V"])


# ---- arms from URDFs: nothing but the motion is known
ARM = wbc.load("arm")
LAST = ARM.joint_names[-1]
WAVE = Sinusoid(ARM.q0, amplitude=0.3, frequency=np.linspace(0.6, 1.2, 7))
KD = np.minimum(20.0, 200.0 * np.diag(ARM.state().M))
HEAVY = np.array([1.0] * 6 + [4.0])  # the last link weighs four times as much as the controller thinks


def arm_adapted(
    *, dt: float = 1e-3, duration: float = 1.5, true: Any = None, tasks: Any = (), frozen: bool = False,
    target: Any = WAVE, **settings: Any,
) -> tuple[wbc.Run, SlotineLi]:  # fmt: skip
    true = ARM.with_masses(HEAVY) if true is None else true
    truth = np.concatenate([link.toDynamicParameters() for link in list(true.pinocchio.inertias)[1:]])
    arguments: dict[str, Any] = {"kp": 10.0 * KD, "kd": KD, "gain": 50.0, "links": [LAST], "truth": truth}
    adaptive = SlotineLi(target, **arguments | settings)
    adaptive.frozen = frozen
    plant = ForwardDynamicsPlant(true, dt=dt)
    plant.reset(ARM.q0)
    controller = controlled(adaptive, ARM, dt, [TorqueLimits(1e4)], *tasks)
    return simulate(controller, plant, duration=duration), adaptive


def worst(run: wbc.Run) -> float:
    """Largest error of the joints in the last third [rad]."""
    return float(np.abs(errors(run, WAVE))[-run.rows // 3 :].max())


def test_it_learns_a_load_and_follows_while_the_same_gains_alone_do_not() -> None:
    learning, adaptive = arm_adapted(duration=3.0)
    stubborn, _ = arm_adapted(duration=3.0, frozen=True)
    assert worst(learning) < worst(stubborn) / 10
    true_mass = 4.0 * ARM.pinocchio.inertias[7].mass
    assert adaptive.a_hat[60] == pytest.approx(true_mass, rel=0.1)
    assert (signal(learning, "smallest") > 0.0).all()
    assert (signal(stubborn, "a_hat") == signal(stubborn, "a_hat")[0]).all()
    assert (signal(learning, "a_hat")[:, :60] == signal(learning, "a_hat")[0, :60]).all(), "one link is arm_adapted"


@pytest.mark.parametrize("rotors", [0.0, 2.0])
@pytest.mark.parametrize("joints", [1, 3])
def test_who_knows_the_links_of_an_arm_follows_and_learns_nothing_up_to_the_period(joints: int, rotors: float) -> None:
    """Rotors are known: what they take is no error to be fed back, none to learn from, and no news to a plan."""
    arm = chain(joints, rotors)
    wave, truth = Sinusoid(arm.q0, amplitude=0.3, frequency=0.8, ramp=0.2), InertialRegressor(arm).parameters
    found = []
    for dt in (2e-3, 5e-4):
        adaptive = SlotineLi(wave, kp=20.0, kd=5.0, gain=1.0, composite=1e-2, truth=truth, estimate_floor=1e-6)
        plant = ForwardDynamicsPlant(arm, dt=dt)
        plant.reset(arm.q0)
        run = simulate(controlled(adaptive, arm, dt), plant, duration=0.4)
        assert (signal(run, "estimate_used") == 1.0).all()
        surprise = np.diff(run["plant.v"], axis=0) / dt - run["a"][:-1]
        learnt = signal(run, "a_hat") - truth
        found.append([np.abs(part).max() for part in (errors(run, wave), surprise, learnt, signal(run, "V"))])
    assert (np.array(found[1]) < 0.5 * np.array(found[0])).all()


def test_V_falls_up_to_an_error_of_integration_that_falls_with_the_period() -> None:
    rises = []
    for dt in (1e-3, 2.5e-4):
        run, _ = arm_adapted(dt=dt, duration=0.5)
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
        arm_adapted = moved != 0.0
        assert fallen == pytest.approx(float(off[arm_adapted] @ gradient[arm_adapted]), rel=1e-3)


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
    run, composite = arm_adapted(composite=1e-3)
    assert worst(run) < 0.02
    assert abs(composite.a_hat[60] - 4.0 * ARM.pinocchio.inertias[7].mass) < 0.5
    _, leaky = arm_adapted(leakage=50.0)
    _, plain = arm_adapted()
    start = InertialRegressor(ARM).parameters
    assert np.linalg.norm(leaky.a_hat - start) < 0.8 * np.linalg.norm(plain.a_hat - start)
    still, dead = arm_adapted(dead_zone=1e3, duration=0.1)
    assert (dead.a_hat == start).all() and still.rows == 100


def test_a_motion_that_excites_is_told_from_one_that_does_not() -> None:
    moving, _ = arm_adapted(window=0.3, duration=0.6)
    resting, _ = arm_adapted(window=0.3, duration=0.6, target=ARM.q0, true=ARM)
    assert signal(moving, "excitation")[-1] > 100 * signal(resting, "excitation")[-1] >= 0.0


def test_the_plan_computes_with_the_estimate_only_while_that_is_positive_definite() -> None:
    told, _ = arm_adapted(estimate_floor=1e-6, duration=1.0)
    nominal, _ = arm_adapted(duration=1.0)
    assert (signal(told, "estimate_used") == 1.0).all()
    untold, _ = arm_adapted(estimate_floor=1e3, duration=0.05)
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
    run, _ = arm_adapted(target=target, frame="tool", tasks=[reached])
    stubborn, _ = arm_adapted(target=target, frame="tool", tasks=[reached], frozen=True)
    error, lost = (np.abs(r["error.Position[tool]"][-400:]).max() for r in (run, stubborn))
    assert error < 4e-3
    assert lost > 5 * error


def test_base_parameters_are_fewer_and_give_the_same_torques() -> None:
    _, adaptive = arm_adapted(duration=0.01, links=None)
    regressor, rng = InertialRegressor(ARM), np.random.default_rng(1)
    assert len(adaptive.base_parameters) == len(regressor.independent) < 70
    q, (v, v_r, a_r) = ARM.random_configuration(rng), rng.standard_normal((3, 7))
    Y = regressor(q, v, v_r, a_r)
    np.testing.assert_allclose(Y[:, regressor.independent] @ adaptive.base_parameters, Y @ adaptive.a_hat, atol=1e-9)
    assert len(adaptive.parameter_names) == 70
