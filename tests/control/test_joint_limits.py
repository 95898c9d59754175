"""A controller with JointLimits keeps every limit of every joint, tick after tick, and finds back from outside."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tasks import JointLimits, JointPositionLimits, JointVelocityLimits, Posture, TorqueLimits
from wbc import AccelerationLevel, Controller, InverseDynamics, Stack, VelocityLevel
from wbc.errors import NotSupported
from wbc.models.model import RobotModel
from wbc.sim.plant import IntegratorPlant
from wbc.testing import robots
from wbc.types import Status, Vec

ARM, QUADRUPED, HUMANOID = robots()
A_MAX, J_MAX = 20.0, 1000.0
DT = 1e-3


def bounded(robot: RobotModel) -> Vec:
    """Position limits of the robot, ±π where there are none (2, nj)."""
    return np.clip((robot.limits.q_min, robot.limits.q_max), -np.pi, np.pi)


class Restless:
    """Joint positions that nobody can reach in time, some beyond the limits, every 0.2 s others."""

    def __init__(self, robot: RobotModel, seed: int) -> None:
        self._rng, (low, high) = np.random.default_rng(seed), bounded(robot)
        self._middle, self._half = 0.5 * (low + high), 0.5 * (high - low)
        self._at, self._now = -1, self._middle

    def __call__(self, t: float) -> Vec:
        if int(t / 0.2) != self._at:
            self._at = int(t / 0.2)
            self._now = self._middle + self._half * self._rng.uniform(-1.5, 1.5, len(self._half))
        return self._now


def worst_of_a_walk(robot: RobotModel, level: Any, ticks: int, seed: int = 0) -> dict[str, float]:
    """How far each limit was exceeded at worst, what the jerk was at most, and how many ticks were not solved."""
    low, high = bounded(robot)
    everything = JointLimits(lower=low, upper=high, a_max=A_MAX, j_max=J_MAX, without=["torque"])
    task = Posture(Restless(robot, seed), kp=400.0, rate=50.0)
    controller = Controller(robot, Stack([task], subject_to=[everything]), level=level, dt=DT)
    nb, nq = robot.nb, robot.nq - robot.nj
    q, v, last = np.array(robot.q0), np.zeros(robot.nv), np.zeros(robot.nj)
    q[nq:] = 0.5 * (low + high)
    worst = dict.fromkeys(("position", "velocity", "acceleration", "jerk", "unsolved"), 0.0)
    for k in range(ticks):
        command = controller.tick(k * DT, q, v)
        a = (command.v - v)[nb:] / DT
        q, v = command.q, command.v
        joints = q[nq:]
        found = {
            "position": float(np.maximum(low - joints, joints - high).max()),
            "velocity": float((np.abs(v[nb:]) - robot.limits.v_max).max()),
            "acceleration": float(np.abs(a).max()) - A_MAX,
            "jerk": float(np.abs(a - last).max()) / DT - J_MAX,
        }
        for quantity, value in found.items():
            worst[quantity] = max(worst[quantity], value)
        worst["unsolved"] += command.status is not Status.SOLVED
        last = a
    return worst


@pytest.mark.parametrize(
    ("robot", "ticks"),
    [(ARM, 10_000), (QUADRUPED, 1000), (HUMANOID, 1000)]
    + [pytest.param(robot, 10_000, marks=pytest.mark.deep) for robot in (QUADRUPED, HUMANOID)],
    ids=str,
)
@pytest.mark.parametrize("level", [VelocityLevel(), AccelerationLevel(), InverseDynamics()], ids=lambda x: x.name)
@pytest.mark.filterwarnings("ignore::wbc.models.plausible.NothingHoldsTheBase")
def test_inside_stays_inside_whatever_the_tasks_ask_for(robot: RobotModel, ticks: int, level: Any):
    worst = worst_of_a_walk(robot, level, ticks)
    assert worst["unsolved"] == 0
    assert max(worst[quantity] for quantity in ("position", "velocity", "acceleration")) <= 1e-6
    assert worst["jerk"] <= 1e-6 * J_MAX  # a difference of velocities, divided by dt twice


@pytest.mark.parametrize("level", [VelocityLevel(), AccelerationLevel(), InverseDynamics()], ids=lambda x: x.name)
@given(seed=st.integers(0, 1000), pushed=st.sampled_from([1.0, 4.0]))
def test_from_outside_it_is_back_within_the_stated_time(level: Any, seed: int, pushed: float):
    rng = np.random.default_rng(seed)
    v_max = 2.0
    everything = JointLimits(lower=-1.0, upper=1.0, v_max=v_max, a_max=A_MAX, j_max=J_MAX, without=["torque"])
    task = Posture(np.sign(rng.normal(size=ARM.nj)) * 3.0, kp=100.0, rate=10.0)
    controller = Controller(ARM, Stack([task], subject_to=[everything]), level=level, dt=DT)
    q = rng.uniform(-2.0, 2.0, ARM.nj)
    v = pushed * rng.uniform(-v_max, v_max, ARM.nj)
    furthest = np.maximum(np.abs(q) - 1.0, 0.0) + v**2 / (2 * A_MAX) + np.abs(v) * DT / 2
    allowed = 1.1 * float((np.abs(v) / A_MAX + furthest / v_max + v_max / (2 * A_MAX)).max()) + 2 * DT
    t = 0.0
    while np.abs(q).max() > 1.0 + 1e-6:
        assert t <= allowed
        command = controller.tick(t, q, v)
        assert command.status is Status.SOLVED
        q, v, t = command.q, command.v, t + DT


def test_a_tick_from_outside_says_that_it_recovers():
    stack = Stack([Posture(ARM.q0)], subject_to=[JointLimits(lower=-1.0, upper=1.0)])
    controller = Controller(ARM, stack, level=AccelerationLevel())
    q = np.zeros(ARM.nj)
    q[3] = 1.25
    controller.tick(0.0, q, 0 * q)
    assert controller.why == f"recovery: joint {ARM.joint_names[3]!r} is 0.25 rad outside its position limits"
    controller.tick(0.0, 0 * q, 0 * q)
    assert controller.why == ""


def test_torque_limits_stand_above_the_interval_of_a_joint():
    q = np.array(ARM.q0)
    q[1] = 1.5
    everything = JointLimits(
        lower={ARM.joint_names[1]: 0.0}, upper={ARM.joint_names[1]: 0.5}, tau_max=1.0, without=["velocity"]
    )
    controller = Controller(ARM, Stack([Posture(ARM.q0)], subject_to=[everything]), level=InverseDynamics())
    command = controller.tick(0.0, q, np.zeros(ARM.nv))
    assert (command.status, command.fallback_level) == (Status.INFEASIBLE, "relaxed")
    assert np.abs(command.tau).max() <= 1.0 + 1e-8
    assert command.certificate.ok
    what = r"relaxed: JointLimits.position shoulder_pitch by [\d.]+ rad/s²"
    assert re.match(what, controller.why) and re.match(what, controller.fallbacks.log[-1].why)


def test_only_levels_that_decide_torques_limit_them():
    names = {
        level.name: [constraint.name for constraint in JointLimits().constraints(level.bounds)]
        for level in (VelocityLevel(), InverseDynamics())
    }
    assert names["velocity level"] == ["JointLimits.position", "JointLimits.velocity"]
    assert names["inverse dynamics"][-1] == "JointLimits.torque"
    asked = Stack([Posture(ARM.q0)], subject_to=[JointLimits(tau_max=10.0)])
    with pytest.raises(NotSupported, match=r"JointLimits.torque is about torque, which the velocity level"):
        Controller(ARM, asked, level=VelocityLevel())


def test_one_object_is_all_the_single_limits():
    single = [JointPositionLimits(braking=5.0), JointVelocityLimits(1.0), TorqueLimits(30.0)]
    stacks = [single, [JointLimits(v_max=1.0, tau_max=30.0, braking=5.0)]]
    task = Posture(lambda t: ARM.q0 + 0.5 * np.sin(9 * t), kp=900.0)
    controllers = [
        Controller(ARM, Stack([task], subject_to=constraints), level=InverseDynamics()) for constraints in stacks
    ]
    plants = [IntegratorPlant(ARM, level="acceleration") for _ in stacks]
    for plant in plants:
        plant.reset(np.array(ARM.q0))
    q, v = np.array(ARM.q0), np.zeros(ARM.nv)
    for k in range(100):
        one, other = (controller.tick(k * DT, q, v) for controller in controllers)
        np.testing.assert_array_equal(one.tau, other.tau)
        q, v = one.q, one.v
