"""On a floating base the residual is of the joints alone: what the base does, or is measured to do, is not in it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wbc
from tasks import CenterOfMass, MomentumObserver, Orientation, Posture, Thresholds, TorqueLimits, feet
from wbc.sim.actuator_fault import ActuatorFault
from wbc.sim.disturbance import Disturbance, SensorNoise
from wbc.sim.plant import ForwardDynamicsPlant
from wbc.sim.simulate import simulate
from wbc.types import Vec

QUADRUPED = wbc.load("quadruped", base="floating")
K, JOINT = 100.0, QUADRUPED.joint_names[2]


def flying(
    disturbances: Sequence[Disturbance] = (), *, seed: int = 0, dt: float = 1e-3, duration: float = 0.1, **settings: Any
) -> wbc.Run:
    """The quadruped falls and tumbles freely while its joints hold their posture."""
    rng = np.random.default_rng(seed)
    observer = MomentumObserver(gain=K, **settings)
    stack = wbc.Stack([Posture(QUADRUPED.q0)], components=[observer])
    plant = ForwardDynamicsPlant(QUADRUPED, dt=dt, substeps=4)
    plant.reset(QUADRUPED.q0, 0.5 * rng.standard_normal(QUADRUPED.nv))
    controller = wbc.Controller(QUADRUPED, stack, level=wbc.InverseDynamics(), dt=dt)
    return simulate(controller, plant, duration=duration, disturbances=disturbances)


def residual(run: wbc.Run) -> Vec:
    return np.asarray(run["signal.MomentumObserver.residual"])


@settings(max_examples=max(5, settings.default.max_examples // 20))
@given(seed=st.integers(0, 999))
def test_a_tumbling_robot_misses_nothing(seed: int) -> None:
    run = flying(seed=seed)
    assert np.abs(run["tau"]).max() > 0.1
    assert np.abs(residual(run)).max() < 2e-3
    assert np.abs(run["signal.MomentumObserver.push"]).max() < 1e-3 * 9.81 * QUADRUPED.mass


def test_a_fault_shows_in_its_own_joint_through_the_lag_and_nowhere_else() -> None:
    run = flying([ActuatorFault(joint=JOINT, effectiveness=1.0, bias=0.5)])
    r, i = residual(run), QUADRUPED.joint(JOINT)
    np.testing.assert_allclose(r[:, i], 0.5 * (1.0 - np.exp(-K * run["t"])), atol=3e-3)
    assert np.abs(np.delete(r, i, axis=1)).max() < 3e-3


def test_a_sensor_without_a_reading_leaves_the_residual_as_it_is_without_the_sensor() -> None:
    frame = QUADRUPED.frame_names[-1]
    for entry in (np.nan, np.inf):
        silent = flying(wrenches=lambda entry=entry: {frame: np.array([0.0, entry, 0.0, 0.0, 0.0, 0.0])})
        np.testing.assert_array_equal(residual(silent), residual(flying()))


def test_noise_of_the_bases_velocity_is_in_no_joint() -> None:
    noisy = flying([SensorNoise(base_velocity=0.05, base_angular_velocity=0.05)])
    assert np.abs(residual(noisy)).max() < 0.05
    assert np.abs(noisy["signal.MomentumObserver.push"]).max() > 5.0


def test_noise_of_the_joints_velocities_has_the_predicted_size() -> None:
    """The variance 2 φ² Σ_p / (dt² (2 − φ)) of white noise in the momentum."""
    run = flying([SensorNoise(velocity=0.01)], duration=0.6)
    state = QUADRUPED.state()
    state.update(0.0, run["q"][-1], run["v"][-1])
    predicted = Thresholds.predicted(state, velocity=0.01, gain=K, dt=1e-3)
    seen = residual(run)[100:].std(axis=0)
    assert (seen < 1.5 * predicted.deviation).all() and (seen > 0.5 * predicted.deviation).all()
    learnt = Thresholds.learnt(residual(run)[100:], gain=K, dt=1e-3)
    np.testing.assert_allclose(learnt.noise, predicted.noise, rtol=0.5)
    assert (np.abs(residual(run)) < learnt.value).all()


def test_alarms_wait_for_persistence_and_fall_below_the_release() -> None:
    fault = ActuatorFault(joint=JOINT, effectiveness=1.0, bias=5.0, start=0.02, end=0.06)
    alarms = {
        p: flying([fault], threshold=1.0, persistence=p, release=0.5)["signal.MomentumObserver.alarm"]
        for p in (1, 4)
    }  # fmt: skip
    i = QUADRUPED.joint(JOINT)
    first = {p: int(np.argmax(alarm[:, i] > 0)) for p, alarm in alarms.items()}
    assert first[4] - first[1] == 3
    run = flying([fault])
    above = np.flatnonzero(np.abs(residual(run)[:, i]) > 0.5)
    assert alarms[1][above[-1], i] and not alarms[1][above[-1] + 1, i]


@pytest.mark.parametrize("persistence", [1, 4])
def test_a_joint_that_starts_anew_raises_its_alarm_as_at_first(persistence: int) -> None:
    i, again = QUADRUPED.joint(JOINT), 50
    observer = MomentumObserver(gain=K, threshold=0.1, persistence=persistence)
    stack = wbc.Stack([Posture(QUADRUPED.q0)], components=[observer])
    plant = ForwardDynamicsPlant(QUADRUPED, substeps=4)
    plant.reset(QUADRUPED.q0)
    run = simulate(
        wbc.Controller(QUADRUPED, stack, level=wbc.InverseDynamics()), plant, duration=0.1,
        disturbances=[ActuatorFault(joint=JOINT, effectiveness=1.0, bias=5.0, start=0.02)],
        before_tick=lambda t: observer.restart(i) if round(1e3 * t) == again else None,
    )  # fmt: skip
    above, alarm = np.abs(residual(run)[:, i]) > 0.1, run["signal.MomentumObserver.alarm"][:, i] > 0.0
    for first in (0, again):
        begins = first + np.flatnonzero(above[first:])[persistence - 1]
        assert not alarm[first:begins].any() and alarm[begins]


def test_known_friction_is_no_fault() -> None:
    class Rubbing(Disturbance):
        def begin(self, plant: Any) -> Any:
            from wbc.sim.disturbance import Effect
            from wbc.sim.plant import Delivered

            class Rub(Effect):
                def deliver(self, command: Any) -> Any:
                    return Delivered(command.tau - 0.5 * plant.v[6:], command.a, command.v, command.q)

            return Rub()

        def __str__(self) -> str:
            return "viscous friction of 0.5"

    unknown, known = flying([Rubbing()]), flying([Rubbing()], viscous=0.5)
    assert np.abs(residual(unknown)).max() > 0.1
    assert np.abs(residual(known)).max() < 0.02 * np.abs(residual(unknown)).max() + 5e-3


def test_contacts_have_to_be_measured() -> None:
    stack = wbc.Stack([Posture(QUADRUPED.q0)], contacts=feet(QUADRUPED), components=[MomentumObserver(gain=K)])
    controller = wbc.Controller(QUADRUPED, stack, level=wbc.InverseDynamics())
    command = controller.tick(0.0, QUADRUPED.q0, np.zeros(QUADRUPED.nv))
    assert not command.status.ok and np.isfinite(command.tau).all()
    assert "needs the wrenches that the contacts measure: give it wrenches=function" in controller.why


@pytest.mark.physics
def test_standing_in_physics_with_measured_feet_a_fault_is_seen_to_a_thousandth() -> None:
    pytest.importorskip("mujoco", reason="the extra `sim`")
    from wbc.sim.mujoco_ import MujocoPlant

    contacts = feet(QUADRUPED, kp=0.0, kd=20.0)
    plant = MujocoPlant(QUADRUPED, contacts=contacts)
    observer = MomentumObserver(gain=K, wrenches=plant.wrenches)
    state = QUADRUPED.state()
    state.update(0.0, QUADRUPED.q0, np.zeros(QUADRUPED.nv))
    base = QUADRUPED.frame_names[0]
    tasks = [
        CenterOfMass(target=state.com.copy()), Orientation(base, target=np.array(state.frame(base).rotation)),
        Posture(QUADRUPED.q0, weight=1e-3),
    ]  # fmt: skip
    stack = wbc.Stack(tasks, subject_to=[TorqueLimits()], contacts=contacts, components=[observer])
    plant.reset(plant.settled(QUADRUPED.q0))
    fault = ActuatorFault(joint=JOINT, effectiveness=1.0, bias=4.0, start=0.1)
    controller = wbc.Controller(QUADRUPED, stack, level=wbc.InverseDynamics())
    run = simulate(controller, plant, duration=0.2, disturbances=[fault])
    r, i, since = residual(run), QUADRUPED.joint(JOINT), run["t"] - 0.1
    expected = np.where(since > 0, 4.0 * (1.0 - np.exp(-K * since)), 0.0)
    np.testing.assert_allclose(r[:, i], expected, atol=4e-3)
    assert np.abs(np.delete(r, i, axis=1)).max() < 4e-3
