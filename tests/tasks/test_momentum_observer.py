"""The residual is the missing torque through a first-order lag, whatever the robot does; joint by joint.

On a floating base it is of the joints alone: what the base does, or is measured to do, is not in it. What is called
the loss of a joint, and from when on a residual is a fault, is as docs/adaptive.md says.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tasks as T
import wbc
from tasks.components.diagnosis import Diagnoser, Diagnosis
from tasks.scenarios.exact_plant import ExactPlant
from wbc.errors import InvalidInput
from wbc.models import Planar4P, PlanarPR
from wbc.models.model import RobotModel
from wbc.sim.actuator_fault import ActuatorFault
from wbc.sim.disturbance import Disturbance, Effect, SensorNoise
from wbc.sim.plant import Delivered, ForwardDynamicsPlant
from wbc.sim.simulate import simulate
from wbc.types import Vec

ARM, QUADRUPED = wbc.load("arm"), wbc.load("quadruped", base="floating")
PR = PlanarPR(m1=1, m2=1, l2=0.5, d2=0.25, I2=0.1)
ROBOTS: list[RobotModel] = [PR, Planar4P(m=(1, 2, 0.5, 1.5)), ARM]
K, FLYING_K, JOINT = 10.0, 100.0, QUADRUPED.joint_names[2]
#: A moving planar robot under constant torques.
MOVING: dict[str, Any] = {"tau": [5.0, -2.0], "q": [0.0, np.pi / 2], "v": [1.0, -1.0]}
few = settings(max_examples=max(5, settings.default.max_examples // 20))


def residual(run: wbc.Run) -> Vec:
    return np.asarray(run["signal.MomentumObserver.residual"])


def lag(t: Vec, size: float | Vec, gain: float = K) -> Vec:
    """The answer of a first-order lag to a step at 0."""
    return size * (1.0 - np.exp(-gain * t))


def observed(
    robot: RobotModel, faults: Sequence[ActuatorFault] = (), *, tau: Any = None, q: Any = None, v: Any = None,
    duration: float = 0.4, dt: float = 1e-3, components: Sequence[wbc.Component] = (), observer: Any = None,
    wrench: Vec | None = None,
) -> tuple[wbc.Run, T.MomentumObserver]:  # fmt: skip
    """A run under constant torques, or held by its posture, with an observer beside."""
    observer = observer or T.MomentumObserver(gain=K)
    task = T.Posture(robot.q0 if q is None else q, kp=100) if tau is None else T.Torque(tau, weight=1e6)
    stack = wbc.Stack([task], components=[*components, observer])
    controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), dt=dt)
    push = None if wrench is None else (lambda t: wrench)
    plant = ExactPlant(robot, dt=dt, frame=robot.frame_names[-1], wrench=push)
    plant.reset(robot.q0 if q is None else q, v)
    return simulate(controller, plant, duration=duration, disturbances=faults), observer


@pytest.mark.parametrize(("gain", "after"), [(K, 3.1606), (3.0, 1.2959)])
def test_the_residual_of_a_total_fault_is_that_of_the_source(gain: float, after: float):
    """Property 63."""
    run, _ = observed(PR, [ActuatorFault(joint="q1")], **MOVING, observer=T.MomentumObserver(gain=gain))
    r = residual(run)
    np.testing.assert_allclose(r[:, 0], lag(run["t"], 5.0, gain), atol=1e-6)
    assert r[100, 0] == pytest.approx(after, abs=5e-5)
    assert np.abs(r[:, 1]).max() < 1e-4


@few
@given(seed=st.integers(0, 999), robot=st.sampled_from(ROBOTS))
def test_it_is_the_same_for_every_robot_state_and_torque(seed: int, robot: RobotModel):
    """Property 58. A bias is missing of one joint; from where, how fast and with which torque does not matter."""
    rng = np.random.default_rng(seed)
    tau, joint = rng.normal(size=robot.nj), int(rng.integers(robot.nj))
    fault = ActuatorFault(joint=robot.joint_names[joint], effectiveness=1.0, bias=0.5)
    run, _ = observed(
        robot, [fault], tau=tau, q=robot.random_configuration(rng), v=0.5 * rng.normal(size=robot.nv), duration=0.15
    )
    r = residual(run)
    np.testing.assert_allclose(r[:, joint], lag(run["t"], 0.5), atol=3e-3)
    assert np.abs(np.delete(r, joint, axis=1)).max(initial=0.0) < 3e-3


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
def test_without_a_fault_nothing_is_missing_while_it_moves_under_gravity(robot: RobotModel):
    """Property 59."""
    v = np.linspace(1.0, -1.0, robot.nv)
    run, _ = observed(robot, v=v, q=robot.q0 + 0.1)
    assert np.abs(run["plant.q"][-1] - run["plant.q"][0]).max() > 1e-3
    assert np.abs(residual(run)).max() < 2e-3


def test_what_is_left_without_a_fault_falls_with_the_square_of_the_period():
    v, q = [1.0, 4.0], [0.0, 0.3]
    left = [np.abs(residual(observed(PR, tau=[0.0, 1.0], q=q, v=v, dt=dt)[0])).max() for dt in (4e-3, 2e-3)]
    assert 3.0 < left[0] / left[1] < 5.0


def test_faults_add_up_and_each_stays_with_its_joint():
    """Properties 60 and 61."""
    one, other = ActuatorFault(joint="q1", effectiveness=0.4), ActuatorFault(joint="q2", effectiveness=1.0, bias=0.3)
    first, second, both = (residual(observed(PR, faults, **MOVING)[0]) for faults in ([one], [other], [one, other]))
    np.testing.assert_allclose(both, first + second, atol=1e-4)
    np.testing.assert_allclose(first[-1], [3.0 * (1 - np.exp(-K * 0.399)), 0.0], atol=1e-4)
    np.testing.assert_allclose(second[-1], [0.0, 0.3 * (1 - np.exp(-K * 0.399))], atol=1e-4)


def test_a_wrench_looks_like_a_fault_of_the_other_sign_unless_it_is_measured():
    """Property 68."""
    wrench = np.array([3.0, 2.0, 0.0, 0.0, 0.0, 0.0])
    unknown, observer = observed(PR, wrench=wrench, duration=1.0)
    state = PR.state()
    state.update(0.0, unknown["plant.q"][-1], unknown["plant.v"][-1])
    seen = -state.frame("end_effector").jacobian().T @ wrench
    assert np.abs(observer.residual - seen).max() < 0.15 * np.abs(seen).max()
    sensor = T.MeasuredWrench("end_effector", wrench=wrench)
    for components in ([sensor], [T.MeasuredWrench("base"), sensor]):
        known, _ = observed(PR, wrench=wrench, components=components, duration=1.0)
        assert np.abs(residual(known)).max() < 2e-3


def test_an_alarm_is_raised_when_the_lag_passes_the_threshold():
    run, observer = observed(
        PR, [ActuatorFault(joint="q1")], **MOVING, observer=T.MomentumObserver(gain=K, threshold=[1.0, 0.5])
    )
    alarm = run["signal.MomentumObserver.alarm"]
    first = run["t"][np.argmax(alarm[:, 0] > 0)]
    assert first == pytest.approx(-np.log(1 - 1.0 / 5.0) / K, abs=1.5e-3)
    assert not alarm[:, 1].any()
    assert observer.alarm.tolist() == [True, False]


def test_it_starts_with_the_momentum_there_is_and_again_when_ticks_are_missing():
    """Property 64."""
    observer = T.MomentumObserver(gain=K)
    controller = wbc.Controller(PR, wbc.Stack([T.Torque([5.0, -2.0], weight=1e6)], components=[observer]),
                                level=wbc.InverseDynamics())  # fmt: skip

    def ticked(t: float, q: float) -> float:
        """The residual of the first joint, which should have become faster and has not."""
        controller.tick(t, np.array([q, np.pi / 2]), np.array([1.0, -1.0]))
        return float(observer.residual[0])

    assert ticked(0.0, 0.0) == 0.0 and ticked(1e-3, 1e-3) > 1e-2
    ticked(2e-3, np.nan)
    assert ticked(3e-3, 3e-3) == 0.0 and ticked(4e-3, 4e-3) > 1e-2
    controller.reset()
    assert ticked(0.0, 0.0) == 0.0


@few
@given(seed=st.integers(0, 999), late=st.floats(-0.2, 0.2), jitter=st.floats(0.0, 0.25))
def test_ticks_may_come_early_and_late(seed: int, late: float, jitter: float):
    """Property 58 in intervals of any lengths, as long as no tick is missing: the lag is one in time, not in ticks."""
    rng = np.random.default_rng(seed)
    observer, plant, fault = T.MomentumObserver(gain=K), ExactPlant(PR), np.array([0.0, 0.5])
    stack = wbc.Stack([T.Torque(rng.normal(size=2), weight=1e6)], components=[observer])
    controller = wbc.Controller(PR, stack, level=wbc.InverseDynamics())
    plant.reset(rng.normal(size=2), rng.normal(size=2))
    t = 0.0
    for _ in range(150):
        command = controller.tick(t, plant.q, plant.v)
        np.testing.assert_allclose(observer.residual, lag(np.array(t), fault), atol=3e-3)
        plant.dt = controller.dt * (1.0 + late + jitter * rng.uniform(-1.0, 1.0))
        plant.step(Delivered(command.tau - fault, command.a, command.v, command.q))
        t += plant.dt
    assert observer.dt > 0.0 and observer.residual[1] > 0.2


def test_measured_wrenches_that_are_assigned_between_ticks_count_from_the_next_interval_on():
    """No tick is lost: where the force acts is known only from the tick on in which its frame appeared."""
    hand, observer = PR.frame_names[-1], T.MomentumObserver(gain=K)
    wrench = np.array([3.0, 2.0, 0.0, 0.0, 0.0, 0.0])
    plant = ExactPlant(PR, frame=hand, wrench=lambda t: wrench)
    stack = wbc.Stack([T.Torque([1.0, -1.0], weight=1e6)], components=[observer])
    controller = wbc.Controller(PR, stack, level=wbc.InverseDynamics())
    missing = []
    for k, measured in enumerate([None, None, *3 * [{hand: wrench}], *2 * [{"base": 0 * wrench, hand: wrench}]]):
        observer.wrenches = None if measured is None else lambda measured=measured: measured
        command = controller.tick(plant.t, plant.q, plant.v)
        assert command.status.ok, (k, controller.why)
        missing.append(np.abs(observer.missing).max())
        plant.step(command)
    assert min(missing[1:3]) > 1.0
    assert max(missing[3:]) < 1e-2


# ---- on a floating base
def flying(
    disturbances: Sequence[Disturbance] = (), *, seed: int = 0, dt: float = 1e-3, duration: float = 0.1, **settings: Any
) -> wbc.Run:
    """The quadruped falls and tumbles freely while its joints hold their posture."""
    rng = np.random.default_rng(seed)
    observer = T.MomentumObserver(gain=FLYING_K, **settings)
    stack = wbc.Stack([T.Posture(QUADRUPED.q0)], components=[observer])
    plant = ForwardDynamicsPlant(QUADRUPED, dt=dt, substeps=4)
    plant.reset(QUADRUPED.q0, 0.5 * rng.standard_normal(QUADRUPED.nv))
    controller = wbc.Controller(QUADRUPED, stack, level=wbc.InverseDynamics(), dt=dt)
    return simulate(controller, plant, duration=duration, disturbances=disturbances)


@few
@given(seed=st.integers(0, 999))
def test_a_tumbling_robot_misses_nothing(seed: int) -> None:
    run = flying(seed=seed)
    assert np.abs(run["tau"]).max() > 0.1
    assert np.abs(residual(run)).max() < 2e-3
    assert np.abs(run["signal.MomentumObserver.push"]).max() < 1e-3 * 9.81 * QUADRUPED.mass


def test_a_fault_shows_in_its_own_joint_through_the_lag_and_nowhere_else() -> None:
    run = flying([ActuatorFault(joint=JOINT, effectiveness=1.0, bias=0.5)])
    r, i = residual(run), QUADRUPED.joint(JOINT)
    np.testing.assert_allclose(r[:, i], lag(run["t"], 0.5, FLYING_K), atol=3e-3)
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
    predicted = T.Thresholds.predicted(state, velocity=0.01, gain=FLYING_K, dt=1e-3)
    seen = residual(run)[100:].std(axis=0)
    assert (seen < 1.5 * predicted.deviation).all() and (seen > 0.5 * predicted.deviation).all()
    learnt = T.Thresholds.learnt(residual(run)[100:], gain=FLYING_K, dt=1e-3)
    np.testing.assert_allclose(learnt.noise, predicted.noise, rtol=0.5)
    assert (np.abs(residual(run)) < learnt.value).all()


def test_an_alarm_falls_below_the_release() -> None:
    fault = ActuatorFault(joint=JOINT, effectiveness=1.0, bias=5.0, start=0.02, end=0.06)
    i = QUADRUPED.joint(JOINT)
    run = flying([fault], threshold=1.0, persistence=1, release=0.5)
    alarm = run["signal.MomentumObserver.alarm"][:, i] > 0.0
    last = np.flatnonzero(np.abs(residual(run)[:, i]) > 0.5)[-1]
    assert alarm[last] and not alarm[last + 1]


@pytest.mark.parametrize("persistence", [1, 4])
def test_a_joint_that_starts_anew_raises_its_alarm_as_at_first(persistence: int) -> None:
    i, again = QUADRUPED.joint(JOINT), 50
    observer = T.MomentumObserver(gain=FLYING_K, threshold=0.1, persistence=persistence)
    stack = wbc.Stack([T.Posture(QUADRUPED.q0)], components=[observer])
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
    stack = wbc.Stack(
        [T.Posture(QUADRUPED.q0)], contacts=T.feet(QUADRUPED), components=[T.MomentumObserver(gain=FLYING_K)]
    )
    controller = wbc.Controller(QUADRUPED, stack, level=wbc.InverseDynamics())
    command = controller.tick(0.0, QUADRUPED.q0, np.zeros(QUADRUPED.nv))
    assert not command.status.ok and np.isfinite(command.tau).all()
    assert "needs the wrenches that the contacts measure: give it wrenches=function" in controller.why


@pytest.mark.physics
def test_standing_in_physics_with_measured_feet_a_fault_is_seen_to_a_thousandth() -> None:
    pytest.importorskip("mujoco", reason="the extra `sim`")
    from wbc.sim.mujoco_ import MujocoPlant

    contacts = T.feet(QUADRUPED, kp=0.0, kd=20.0)
    plant = MujocoPlant(QUADRUPED, contacts=contacts)
    observer = T.MomentumObserver(gain=FLYING_K, wrenches=plant.wrenches)
    state, base = QUADRUPED.state(), QUADRUPED.frame_names[0]
    tasks = [
        T.CenterOfMass(target=state.com.copy()), T.Orientation(base, target=np.array(state.frame(base).rotation)),
        T.Posture(QUADRUPED.q0, weight=1e-3),
    ]  # fmt: skip
    stack = wbc.Stack(tasks, subject_to=[T.TorqueLimits()], contacts=contacts, components=[observer])
    plant.reset(plant.settled(QUADRUPED.q0))
    fault = ActuatorFault(joint=JOINT, effectiveness=1.0, bias=4.0, start=0.1)
    controller = wbc.Controller(QUADRUPED, stack, level=wbc.InverseDynamics())
    run = simulate(controller, plant, duration=0.2, disturbances=[fault])
    r, i, since = residual(run), QUADRUPED.joint(JOINT), run["t"] - 0.1
    np.testing.assert_allclose(r[:, i], np.where(since > 0, lag(since, 4.0, FLYING_K), 0.0), atol=4e-3)
    assert np.abs(np.delete(r, i, axis=1)).max() < 4e-3


# ---- from when on a residual is a fault, and of which kind
NAMES = ("hip", "knee", "ankle")


def watching(lockout: float, recheck: float) -> Diagnoser:
    return Diagnoser(NAMES, noise=np.zeros(3), lockout=lockout, settle=0.1, recheck=recheck, dominance=3.0, start=0.0)


def said_at(tick: int, watcher: Diagnoser, command: Vec, missing: Vec) -> Diagnosis | None:
    """What a watcher says of what an observer without noise shows."""
    observer = SimpleNamespace(
        command=command, known=np.zeros(3), missing=missing, residual=missing, threshold=np.full(3, 1e-3),
        alarm=np.abs(missing) > 1e-3, dt=1e-3, rows=None,
    )  # fmt: skip
    return watcher.tick(SimpleNamespace(t=1e-3 * tick), observer)  # type: ignore[arg-type]


def diagnosed(share: float, command: np.ndarray, joint: int, ticks: int = 80) -> Diagnosis | None:
    """What is said of a joint that loses ``share`` of every command, the others nothing, without noise."""
    watcher, missing = watching(0.0, 0.5), np.where(np.arange(3) == joint, share * command, 0.0)
    told = (said_at(tick, watcher, command, missing) for tick in range(ticks))
    return next((said for said in told if said is not None), None)


@given(
    share=st.one_of(st.floats(0.02, 2.0), st.sampled_from([0.14, 0.16, 0.79, 0.81, 1.29, 1.31])),
    command=st.floats(1.0, 100.0), sign=st.sampled_from([-1.0, 1.0]), joint=st.integers(0, 2),
)  # fmt: skip
def test_a_share_between_015_and_13_is_a_loss_total_above_08_and_any_other_is_a_bias(
    share: float, command: float, sign: float, joint: int
):
    said = diagnosed(share, sign * command * np.array([1.0, 2.0, 0.5]), joint)
    assert said is not None and said.joint == joint
    if 0.15 < share < 1.3:
        assert said.kind == ("total" if share > 0.8 else "partial")
        assert said.share == pytest.approx(min(share, 1.0), rel=1e-9)
    else:
        assert said.kind == "bias"


@pytest.mark.parametrize(
    ("joint", "left", "wait"), [(0, True, 0.1), (0, False, 0.1), (1, True, 0.3), (1, False, 0.3)],
    ids=["the same, left alone", "the same", "another, first left alone", "another"],
)  # fmt: skip
def test_the_same_joint_is_judged_again_once_it_has_settled_and_another_after_the_lockout(
    joint: int, left: bool, wait: float
):
    watcher, decided = watching(0.3, 5.0), list[tuple[float, int]]()
    for tick in range(500):
        missing = np.zeros(3)
        if not decided:
            missing[0] = 4.0
        elif tick > round(1e3 * decided[0][0]) + 1:  # the first alarm has fallen
            missing[joint] = 4.0
        said = said_at(tick, watcher, np.full(3, 10.0), missing)
        if said is not None:
            decided.append((said.t, said.joint))
            if left:
                watcher.leave(said)
    assert [who for _, who in decided[:2]] == [0, joint]
    assert decided[1][0] - decided[0][0] == pytest.approx(wait, abs=3e-3)


@given(
    deviation=st.lists(st.floats(1e-3, 1e2), min_size=3, max_size=3),
    mean=st.lists(st.floats(-10.0, 10.0), min_size=3, max_size=3), floor=st.sampled_from([0.0, 1.0]),
)  # fmt: skip
def test_thresholds_are_seven_standard_deviations_and_one_and_a_half_times_the_largest_mean(
    deviation: list[float], mean: list[float], floor: float
):
    noise = np.tile([[1.0], [-1.0]], (500, 1))  # of standard deviation 1 and mean 0 in every window
    residual = np.asarray(mean) + noise * deviation
    learnt = T.Thresholds.learnt(residual, gain=100.0, dt=1e-3, floor=floor)
    expected = np.maximum(7.0 * np.asarray(deviation) + 1.5 * np.abs(mean), floor)
    np.testing.assert_allclose(learnt.value, expected, rtol=1e-9)


@pytest.mark.parametrize(("dt", "ticks"), [(1e-3, 200), (2e-3, 100), (0.2, 1), (1.0, 1)])
def test_two_windows_of_a_fifth_of_a_second_or_of_a_tick_are_enough_for_thresholds(dt: float, ticks: int):
    residual = np.repeat([[1.0], [-3.0]], ticks, axis=0)
    learnt = T.Thresholds.learnt(residual, gain=100.0, dt=dt)
    assert learnt.deviation == 0.0 and learnt.value == pytest.approx(1.5 * 3.0)
    with pytest.raises(InvalidInput, match=f"at least two windows of {ticks}"):
        T.Thresholds.learnt(residual[1:], gain=100.0, dt=dt)


def test_predicted_thresholds_are_seven_of_the_deviations_that_noise_of_the_velocity_gives():
    state = wbc.load("arm").state()
    predicted = T.Thresholds.predicted(state, velocity=0.01, gain=100.0, dt=1e-3)
    momentum = state.M @ (0.01 * np.random.default_rng(0).normal(size=(7, 20_000)))
    missing = np.diff(momentum) / 1e-3
    share, filtered, values = -np.expm1(-0.1), np.zeros(7), []
    for sample in missing.T:  # the observer's first-order lag
        filtered = filtered + share * (sample - filtered)
        values.append(filtered)
    np.testing.assert_allclose(predicted.value, 7.0 * np.std(values[200:], axis=0), rtol=0.05)
    np.testing.assert_allclose(predicted.noise, missing.std(axis=1), rtol=0.05)
