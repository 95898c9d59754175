"""The residual is the missing torque through a first-order lag, whatever the robot does; joint by joint."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wbc
from tasks import MeasuredWrench, MomentumObserver, Posture, Torque
from tasks.scenarios.exact_plant import ExactPlant
from wbc.models import Planar4P, PlanarPR
from wbc.models.model import RobotModel
from wbc.sim.actuator_fault import ActuatorFault
from wbc.sim.plant import Delivered
from wbc.sim.simulate import simulate
from wbc.types import Vec

ARM = wbc.load("arm")
PR = PlanarPR(m1=1, m2=1, l2=0.5, d2=0.25, I2=0.1)
ROBOTS: list[RobotModel] = [PR, Planar4P(m=(1, 2, 0.5, 1.5)), ARM]
K = 10.0


def observed(
    robot: RobotModel, faults: Sequence[ActuatorFault] = (), *, tau: Any = None, q: Any = None, v: Any = None,
    duration: float = 0.4, dt: float = 1e-3, components: Sequence[wbc.Component] = (), observer: Any = None,
    wrench: Vec | None = None,
) -> tuple[wbc.Run, MomentumObserver]:  # fmt: skip
    """A run under constant torques, or held by its posture, with an observer beside."""
    observer = observer or MomentumObserver(gain=K)
    task = Posture(robot.q0 if q is None else q, kp=100) if tau is None else Torque(tau, weight=1e6)
    stack = wbc.Stack([task], components=[*components, observer])
    controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), dt=dt)
    push = None if wrench is None else (lambda t: wrench)
    plant = ExactPlant(robot, dt=dt, frame=robot.frame_names[-1], wrench=push)
    plant.reset(robot.q0 if q is None else q, v)
    return simulate(controller, plant, duration=duration, disturbances=faults), observer


def lag(t: Vec, size: float | Vec, gain: float = K) -> Vec:
    """The answer of a first-order lag to a step at 0."""
    return size * (1.0 - np.exp(-gain * t))


def test_the_residual_of_a_total_fault_is_that_of_the_source():
    """Property 63."""
    run, _ = observed(PR, [ActuatorFault(joint="q1")], tau=[5.0, -2.0], q=[0.0, np.pi / 2], v=[1.0, -1.0], duration=0.5)
    t, r = run["t"], run["signal.MomentumObserver.residual"]
    np.testing.assert_allclose(r[:, 0], lag(t, 5.0), atol=1e-6)
    assert r[100, 0] == pytest.approx(3.1606, abs=5e-5)
    assert np.abs(r[:, 1]).max() < 1e-4
    slow, _ = observed(
        PR, [ActuatorFault(joint="q1")], tau=[5.0, -2.0], q=[0.0, np.pi / 2], v=[1.0, -1.0], duration=0.2,
        observer=MomentumObserver(gain=3.0),
    )  # fmt: skip
    assert slow["signal.MomentumObserver.residual"][100, 0] == pytest.approx(1.2959, abs=5e-5)


@settings(max_examples=max(5, settings.default.max_examples // 20))
@given(seed=st.integers(0, 999), robot=st.sampled_from(ROBOTS))
def test_it_is_the_same_for_every_robot_state_and_torque(seed: int, robot: RobotModel):
    """Property 58. A bias is missing of one joint; from where, how fast and with which torque does not matter."""
    rng = np.random.default_rng(seed)
    tau, joint = rng.normal(size=robot.nj), int(rng.integers(robot.nj))
    fault = ActuatorFault(joint=robot.joint_names[joint], effectiveness=1.0, bias=0.5)
    run, _ = observed(
        robot, [fault], tau=tau, q=robot.random_configuration(rng), v=0.5 * rng.normal(size=robot.nv), duration=0.15
    )
    r = run["signal.MomentumObserver.residual"]
    np.testing.assert_allclose(r[:, joint], lag(run["t"], 0.5), atol=3e-3)
    assert np.abs(np.delete(r, joint, axis=1)).max(initial=0.0) < 3e-3


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
def test_without_a_fault_nothing_is_missing_while_it_moves_under_gravity(robot: RobotModel):
    """Property 59."""
    v = np.linspace(1.0, -1.0, robot.nv)
    run, _ = observed(robot, v=v, q=robot.q0 + 0.1)
    assert np.abs(run["plant.q"][-1] - run["plant.q"][0]).max() > 1e-3
    assert np.abs(run["signal.MomentumObserver.residual"]).max() < 2e-3


def test_what_is_left_without_a_fault_falls_with_the_square_of_the_period():
    v, q = [1.0, 4.0], [0.0, 0.3]
    left = [
        np.abs(observed(PR, tau=[0.0, 1.0], q=q, v=v, dt=dt)[0]["signal.MomentumObserver.residual"]).max()
        for dt in (4e-3, 2e-3)
    ]
    assert 3.0 < left[0] / left[1] < 5.0


def test_faults_add_up_and_each_stays_with_its_joint():
    """Properties 60 and 61."""
    one, other = ActuatorFault(joint="q1", effectiveness=0.4), ActuatorFault(joint="q2", effectiveness=1.0, bias=0.3)
    at = {"tau": [5.0, -2.0], "q": [0.0, np.pi / 2], "v": [1.0, -1.0]}
    first, second, both = (
        observed(PR, faults, **at)[0]["signal.MomentumObserver.residual"] for faults in ([one], [other], [one, other])
    )
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
    sensor = MeasuredWrench("end_effector", wrench=wrench)
    for components in ([sensor], [MeasuredWrench("base"), sensor]):
        known, _ = observed(PR, wrench=wrench, components=components, duration=1.0)
        assert np.abs(known["signal.MomentumObserver.residual"]).max() < 2e-3


def test_an_alarm_is_raised_when_the_lag_passes_the_threshold():
    run, observer = observed(
        PR, [ActuatorFault(joint="q1")], tau=[5.0, -2.0], q=[0.0, np.pi / 2], v=[1.0, -1.0],
        observer=MomentumObserver(gain=K, threshold=[1.0, 0.5]),
    )  # fmt: skip
    alarm = run["signal.MomentumObserver.alarm"]
    first = run["t"][np.argmax(alarm[:, 0] > 0)]
    assert first == pytest.approx(-np.log(1 - 1.0 / 5.0) / K, abs=1.5e-3)
    assert not alarm[:, 1].any()
    assert observer.alarm.tolist() == [True, False]


def test_it_starts_with_the_momentum_there_is_and_again_when_ticks_are_missing():
    """Property 64."""
    observer = MomentumObserver(gain=K)
    controller = wbc.Controller(PR, wbc.Stack([Torque([5.0, -2.0], weight=1e6)], components=[observer]),
                                level=wbc.InverseDynamics())  # fmt: skip
    v = np.array([1.0, -1.0])
    controller.tick(0.0, np.array([0.0, np.pi / 2]), v)
    assert not observer.residual.any()
    controller.tick(1e-3, np.array([1e-3, np.pi / 2]), v)  # it should have become faster
    assert observer.residual[0] > 1e-2
    controller.tick(2e-3, np.full(2, np.nan), v)
    controller.tick(3e-3, np.array([3e-3, np.pi / 2]), v)
    assert not observer.residual.any()
    controller.tick(4e-3, np.array([4e-3, np.pi / 2]), v)
    assert observer.residual[0] > 1e-2
    controller.reset()
    controller.tick(0.0, np.array([0.0, np.pi / 2]), v)
    assert not observer.residual.any()


@settings(max_examples=max(5, settings.default.max_examples // 20))
@given(seed=st.integers(0, 999), late=st.floats(-0.2, 0.2), jitter=st.floats(0.0, 0.25))
def test_ticks_may_come_early_and_late(seed: int, late: float, jitter: float):
    """Property 58 in intervals of any lengths, as long as no tick is missing: the lag is one in time, not in ticks."""
    rng = np.random.default_rng(seed)
    observer, plant, fault = MomentumObserver(gain=K), ExactPlant(PR), np.array([0.0, 0.5])
    stack = wbc.Stack([Torque(rng.normal(size=2), weight=1e6)], components=[observer])
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
    hand, observer = PR.frame_names[-1], MomentumObserver(gain=K)
    wrench = np.array([3.0, 2.0, 0.0, 0.0, 0.0, 0.0])
    plant = ExactPlant(PR, frame=hand, wrench=lambda t: wrench)
    stack = wbc.Stack([Torque([1.0, -1.0], weight=1e6)], components=[observer])
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
