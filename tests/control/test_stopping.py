"""Joints stay within their limits wherever motors can hold them up, however hard targets pull, however weak they are.

The oracle integrates the torques of the commands with Pinocchio's forward dynamics; it reads no acceleration of ours.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio
import pytest

import wbc
from tasks import (
    JointAccelerationLimits,
    JointJerkLimits,
    JointLimits,
    JointPositionLimits,
    JointVelocityLimits,
    Position,
    Posture,
    Sinusoid,
    TorqueLimits,
)
from tests.control.random_arms import arm, holding_torque, restless_posture, walk
from wbc.control.answer import active
from wbc.models.model import RobotModel
from wbc.stack.component import Component
from wbc.stack.stopping import Stopping
from wbc.types import Vec


def kept(robot: RobotModel, tau_max: Vec, seed: int, ticks: int, **settings: Any) -> None:
    """Walk with targets that jump and pull into the limits, and find every joint within them after every tick."""
    rng = np.random.default_rng(seed)
    kp, dt = float(rng.choice([30.0, 100.0, 400.0, 2500.0])), float(rng.choice([1e-3, 2e-3, 4e-3]))
    every = float(rng.choice([0.1, 0.3, 1.0]))
    tasks: list[Any] = [Posture(restless_posture(robot, seed, every), kp=kp)]
    if rng.random() < 0.3:
        tasks = [
            Position(robot.frame_names[-1], target=rng.uniform(-1.0, 1.0, 3), kp=kp),
            Posture(restless_posture(robot, seed, every), kp=0.25 * kp, weight=1e-2),
        ]
    if rng.random() < 0.3:
        limits: list[Any] = [JointLimits(tau_max=tau_max, a_max=float(10.0 ** rng.uniform(0.5, 2.3)))]
    else:
        limits = [JointPositionLimits(), JointVelocityLimits(), TorqueLimits(tau_max)]
    stack = wbc.Stack(tasks, subject_to=limits)
    controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), dt=dt, **settings)
    low, high = robot.limits.q_min, robot.limits.q_max
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    q = middle + 0.8 * half * rng.uniform(-1.0, 1.0, robot.nj)
    found = walk(robot, controller, q, np.zeros(robot.nv), ticks)
    assert found["outside"] == 0 and found["too fast"] == 0, dict(found)
    assert found["SOLVED/solved"] + found["INFEASIBLE/relaxed"] == ticks, dict(found)


@pytest.mark.parametrize("seed", range(8))
def test_arms_that_can_hold_themselves_up_stay_within_their_limits(seed: int, tmp_path: Path) -> None:
    robot, tau_max = arm(seed, tmp_path, share=0.5 + 0.05 * seed)
    kept(robot, tau_max, seed, 150)


@pytest.mark.parametrize("seed, ticks", [(101, 830), (183, 1000)])
def test_a_way_to_rest_that_no_longer_fits_is_looked_for_anew(seed: int, ticks: int, tmp_path: Path) -> None:
    """Joints that stop sooner than the way found before says need more torque; of the second arm no way fits at all."""
    robot, tau_max = arm(seed, tmp_path, share=np.random.default_rng(seed).uniform(0.3, 0.9))
    kept(robot, tau_max, seed, ticks)


@pytest.mark.parametrize("seed", range(4))
def test_an_active_bound_that_is_said_to_be_of_a_velocity_is_what_the_velocity_limit_leaves(
    seed: int, tmp_path: Path
) -> None:
    """What the way to rest within position limits takes away is not said to be of another limit."""
    robot, tau_max = arm(seed, tmp_path)
    limits = [JointPositionLimits(), JointVelocityLimits(), JointAccelerationLimits(150.0), TorqueLimits(tau_max)]
    stack = wbc.Stack([Posture(restless_posture(robot, seed, 0.1), kp=400.0)], subject_to=limits)
    controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), dt=1e-3)
    q, v = 0.5 * (robot.limits.q_min + robot.limits.q_max), np.zeros(robot.nv)
    owners = set()
    for k in range(400):
        command = controller.tick(k * controller.dt, q, v)
        for one in active(controller) if command.status.ok else ():
            sign = 1.0 if one.upper else -1.0
            if one.row.owner == "JointVelocityLimits":
                joint = robot.joint(one.row.label)
                left = (robot.limits.v_max[joint] - sign * v[joint]) / controller.dt
                assert sign * one.bound == pytest.approx(left, rel=1e-6, abs=1e-6)
            elif one.row.owner == "JointAccelerationLimits":
                assert sign * one.bound == pytest.approx(150.0)
            owners.add(one.row.owner)
        q, v = command.q, command.v
    assert "JointPositionLimits" in owners


@pytest.mark.deep
@pytest.mark.parametrize("seed", range(100, 200))
def test_many_arms_stay_within_their_limits(seed: int, tmp_path: Path) -> None:
    robot, tau_max = arm(seed, tmp_path, share=np.random.default_rng(seed).uniform(0.3, 0.9))
    kept(robot, tau_max, seed, 1000)


@pytest.mark.parametrize("name", ["arm", "quadruped", "humanoid"])
def test_our_robots_stay_within_their_limits_with_feet_in_the_air(name: str) -> None:
    robot = wbc.load(name, base="fixed")
    kept(robot, np.maximum(holding_torque(robot) / 0.7, 0.5), 1, 80)


@pytest.mark.parametrize("share, elbow", [(0.7, 1.2), (0.8, 1.2)])
def test_an_arm_whose_motors_mostly_hold_it_up_follows_a_slow_circle(share: float, elbow: float) -> None:
    robot = wbc.load("arm")
    state, q, v = robot.state(), robot.configuration({"elbow": elbow}), np.zeros(robot.nv)
    state.update(0.0, q, v)
    circle = Sinusoid(
        state.frame("tool").position.copy(), amplitude=[0.0, 0.05, 0.05], frequency=0.5, phase=[0.0, 0.0, np.pi / 2]
    )
    stack = wbc.Stack(
        [Position("tool", target=circle, kp=400.0), Posture(q, weight=1e-5)],
        subject_to=[JointLimits(tau_max=np.maximum(np.abs(state.h) / share, 1.0))],
    )
    controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), dt=2e-3)
    for k in range(1000):
        command = controller.tick(controller.dt * k, q, v)
        assert command.status is wbc.Status.SOLVED
        assert np.linalg.norm(controller.plan.errors()["Position[tool]"]) < 1e-3
        q, v = command.q, command.v


def test_an_arm_that_stopped_moves_on_where_it_can() -> None:
    """All of what is wanted is more than can be braked in every tick; a part of it is not."""
    robot = wbc.load("arm")
    q, v = robot.q0.copy(), np.zeros(robot.nv)
    target = q + 0.3
    stack = wbc.Stack([Posture(target, kp=2500.0)], subject_to=[JointLimits()])
    controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), dt=2e-3)
    stopping = controller.plan.stopping
    assert stopping is not None
    controller.tick(0.0, q, v)
    stopping._share = 0.0  # as after ticks that could only brake
    calls = iter([False])
    stopping._is_safe_after = lambda plan, state: next(calls, True)  # type: ignore[method-assign]
    assert np.abs(controller.tick(2e-3, q, v).v).max() > 1e-3


def turntable(folder: Path, *, inertia: float, tau_max: float, limit: float) -> RobotModel:
    """One joint without gravity."""
    path = folder / "turntable.urdf"
    path.write_text(
        '<robot name="turntable"><link name="a"/><link name="b"><inertial><mass value="1"/>'
        f'<inertia ixx="{inertia}" iyy="{inertia}" izz="{inertia}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/>'
        f'<limit lower="-{limit}" upper="{limit}" velocity="10" effort="{tau_max}"/></joint></robot>'
    )
    return wbc.load(str(path))


def stopping_of(robot: RobotModel, limits: list[Any]) -> Stopping:
    """The one of a plan with these limits."""
    found = wbc.InverseDynamics().compile(robot, wbc.Stack([Posture(robot.q0)], subject_to=limits), dt=1e-3).stopping
    assert found is not None
    return found


@pytest.mark.parametrize("inertia, tau_max, limit", [(2.0, 3.0, 1.5), (200.0, 300.0, 0.5), (0.02, 0.03, 1.0)])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_way_to_rest_leaves_a_twentieth_of_the_torque_range_on_either_side(
    inertia: float, tau_max: float, limit: float, side: float, tmp_path: Path
) -> None:
    """So the fastest state that is safe is the one that nine tenths of the torque bring to rest at the limit."""
    stopping = stopping_of(turntable(tmp_path, inertia=inertia, tau_max=tau_max, limit=limit), [JointLimits()])
    safe, unsafe = 0.0, 10.0
    while unsafe - safe > 1e-6:
        speed = 0.5 * (safe + unsafe)
        is_safe = stopping.is_safe(0.0, np.zeros(1), np.array([side * speed]))
        safe, unsafe = (speed, unsafe) if is_safe else (safe, speed)
    assert safe == pytest.approx(np.sqrt(2.0 * 0.9 * tau_max / inertia * limit), rel=1e-3)


def stops_together(robot: RobotModel, tau_max: Vec, q: Vec, v: Vec, seconds: float) -> bool:
    """Whether motors can bring all joints to rest at one time, each at its own rate, with 15 % of the torques left."""
    limits, data, a = robot.limits, robot.pinocchio.createData(), -v / seconds
    end = q + 0.5 * v * seconds
    if not ((end <= limits.q_max - 0.02) & (end >= limits.q_min + 0.02)).all():
        return False
    moments = [(q + v * t + 0.5 * a * t * t, v + a * t, a) for t in np.linspace(0.0, seconds, 40)]
    moments.append((end, 0.0 * v, 0.0 * v))
    return all((np.abs(pinocchio.rnea(robot.pinocchio, data, *one)) <= 0.85 * tau_max).all() for one in moments)


@pytest.mark.parametrize("seed", [0, 28, 37])
def test_a_state_from_which_all_joints_can_stop_together_is_safe(seed: int, tmp_path: Path) -> None:
    robot, tau_max = arm(seed, tmp_path, share=0.6)
    low, high, fast, braking = robot.limits.q_min, robot.limits.q_max, robot.limits.v_max, 3.0
    limits = [JointPositionLimits(braking=braking), JointVelocityLimits(), TorqueLimits(tau_max)]
    stopping, rng, count = stopping_of(robot, limits), np.random.default_rng(seed), 0
    for _ in range(300):
        q, v = rng.uniform(low, high), rng.uniform(-1.0, 1.0, robot.nj) * fast * rng.choice([0.3, 1.0])
        if stops_together(robot, tau_max, q, v, 1.001 * float(np.abs(v).max()) / braking):
            assert stopping.is_safe(0.0, q, v), (q, v)
            count += 1
    assert count


@pytest.mark.parametrize("seed", range(8))
def test_a_way_to_rest_is_a_policy_that_motors_can_follow(seed: int, tmp_path: Path) -> None:
    """Each moment by Pinocchio: one β for all joints, as large as torques allow, and no joint beyond its limit."""
    rng = np.random.default_rng(seed)
    robot, tau_max = arm(seed, tmp_path, share=0.9)
    low, high, fast, dt = robot.limits.q_min, robot.limits.q_max, robot.limits.v_max, 1e-3
    least, most = (np.where(rng.random(robot.nj) < 0.8, limit, far) for limit, far in ((low, -np.inf), (high, np.inf)))
    least[0] = low[0]
    limits = [JointPositionLimits(lower=least, upper=most), TorqueLimits(tau_max)]
    stopping, data, count = stopping_of(robot, limits), robot.pinocchio.createData(), 0
    up, down = rng.uniform(3.0, 9.0, (2, robot.nj))
    stopping._intervals.replace("acceleration", -down, up, by_plan=True)
    for _ in range(100):
        q, v = rng.uniform(low, high), rng.uniform(-1.0, 1.0, robot.nj) * fast * rng.choice([1e-3, 0.1, 0.5])
        v[rng.random(robot.nj) < 0.2] = 0.0
        assert not stopping.is_safe(0.0, np.append(low[0] - 0.01, q[1:]), np.append(-0.01, v[1:]))
        if not stopping.is_safe(0.0, q, v) or stopping._way is None:
            continue
        _, step, sizes = stopping._way
        last = np.zeros(robot.nj)
        for size in sizes:
            speed, B, count = np.abs(v), np.where(v > 0.0, down, up), count + 1
            room = np.where(v > 0.0, most - q, q - least) - 0.5 * dt * speed
            time = max(stopping._gentle * (speed / B).max(), dt)
            D = np.minimum(np.minimum(B, speed / dt), np.maximum(speed / time, speed**2 / 2 / room))
            share = float((size / np.where(D > 0.0, D, 1.0)).max())
            np.testing.assert_allclose(size, share * D, rtol=1e-9)
            a = -np.sign(v) * size
            tau, before, held = (np.abs(pinocchio.rnea(robot.pinocchio, data, q, v, x)) for x in (a, last, 0.0 * a))
            allowed = np.maximum(0.9 * tau_max, 0.5 * (tau_max + held))
            over = (tau - allowed).max()
            assert share <= 1.0 + 1e-9 and over <= 1e-8 and (before <= 0.9 * allowed + 0.1 * tau_max + 1e-8).all()
            assert share >= 1.0 - 1e-9 or over >= -1e-8 or not speed.any()
            stop = np.minimum(step, speed / np.maximum(size, 1e-300))
            end, last = v + a * stop, np.where(stop < step - 1e-9, 0.0, a)
            q, v = q + 0.5 * (v + end) * stop, np.where(np.abs(end) < 1e-9 * speed, 0.0, end)
            assert ((least - 1e-8 <= q) & (q <= most + 1e-8)).all()
        assert (speed <= 2.0 * dt * size).all()
    assert count


def test_a_fast_arm_is_braked_while_its_motor_can_still_stop_it(tmp_path: Path) -> None:
    """One joint without gravity: with the deceleration τ / I it comes to rest at its limit, at most 15 % earlier."""
    inertia, tau_max, limit = 2.0, 3.0, 1.5
    robot = turntable(tmp_path, inertia=inertia, tau_max=tau_max, limit=limit)
    stack = wbc.Stack([Posture(lambda t: np.array([9.0 * (t > 0.0)]), kp=400.0)], subject_to=[JointLimits()])
    controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), dt=5e-3)
    q, v, fastest = np.array([-1.4]), np.zeros(1), 0.0
    for k in range(700):
        command = controller.tick(k * controller.dt, q, v)
        assert command.status is wbc.Status.SOLVED
        q, v = command.q, command.v
        fastest = max(fastest, float(v[0]))
        assert q[0] <= limit + 1e-9
    best = np.sqrt(tau_max / inertia * (limit + 1.4))  # half of the way speeding up, half of it braking
    assert 0.85 * best <= fastest <= best
    assert limit - 1e-3 <= q[0]


class Carries(Component):
    """Torques (nv,) that the motors have to give besides, and that are there."""

    def __init__(self, bias: Vec) -> None:
        super().__init__(name="carries")
        self.bias = bias

    def before(self, state: Any, last: object, plan: Any) -> wbc.Overrides:
        return wbc.Overrides(bias=self.bias)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, pytest.param(3, marks=pytest.mark.deep), 6])
def test_what_components_say_that_motors_carry_is_counted_in_the_way_to_rest(seed: int, tmp_path: Path) -> None:
    robot, tau_max = arm(seed, tmp_path, share=0.5)
    bias = 0.45 * tau_max * np.random.default_rng(seed).choice([-1.0, 1.0], robot.nj)
    stack = wbc.Stack(
        [Posture(restless_posture(robot, seed, 0.1), kp=2500.0)],
        subject_to=[JointPositionLimits(), JointVelocityLimits(), TorqueLimits(tau_max)], components=[Carries(bias)],
    )  # fmt: skip
    dt, low, high = 4e-3, robot.limits.q_min, robot.limits.q_max
    controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), dt=dt)
    q, v, data = 0.5 * (low + high), np.zeros(robot.nv), robot.pinocchio.createData()
    for k in range(500):
        command = controller.tick(dt * k, q, v)
        a = pinocchio.aba(robot.pinocchio, data, q, v, command.tau - bias)
        q, v = q + dt * v + 0.5 * dt**2 * a, v + dt * a
        assert np.maximum(q - high, low - q).max() <= 1e-6, k


@pytest.mark.parametrize("seed", range(4))
def test_braking_relaxes_limits_on_jerk_and_none_on_acceleration(seed: int) -> None:
    """States beside the position limits, some too fast for the limit on acceleration, as a new stack may find them."""
    rng, robot = np.random.default_rng(seed), wbc.load("arm")
    low, high = robot.limits.q_min, robot.limits.q_max
    for _ in range(15):
        a_max, dt = float(10.0 ** rng.uniform(0.5, 1.3)), float(10.0 ** rng.uniform(-3.3, -2.0))
        limits = [
            JointPositionLimits(), JointVelocityLimits(), TorqueLimits(), JointAccelerationLimits(a_max),
            JointJerkLimits(a_max * float(10.0 ** rng.uniform(0.5, 3.0))),
        ]  # fmt: skip
        tasks = [Posture(robot.q0 + rng.normal(size=robot.nj), kp=float(10.0 ** rng.uniform(0.0, 3.0)))]
        stack = wbc.Stack(tasks, subject_to=limits)
        controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), dt=dt)
        up, room = rng.random(robot.nj) < 0.5, 10.0 ** rng.uniform(-4.0, -1.0, robot.nj)
        q = np.where(up, high - room, low + room)
        v = np.where(up, 1.0, -1.0) * rng.uniform(0.0, 0.5, robot.nj)
        for k in range(6):
            command = controller.tick(k * dt, q, v)
            assert command.status.ok
            assert (np.abs(command.v - v) <= dt * a_max + 1e-9).all()
            q, v = command.q, command.v


@pytest.mark.parametrize("seed", range(4))
def test_a_joint_without_position_limits_is_one_whose_limits_are_out_of_reach(seed: int, tmp_path: Path) -> None:
    """As a continuous joint is; ways to rest are looked for, as motors are weak and jerk is limited."""
    rng = np.random.default_rng(seed)
    robot, tau_max = arm(seed, tmp_path, share=0.9)
    low, high = robot.limits.q_min.copy(), robot.limits.q_max.copy()
    free = rng.random(robot.nj) < 0.5
    free[int(rng.integers(robot.nj))] = True
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    target = middle + 0.8 * half * rng.uniform(-1.0, 1.0, robot.nj)
    moves = []
    for far in (1e6, np.inf):
        low[free], high[free] = -far, far
        limits = [
            JointPositionLimits(lower=low, upper=high), JointVelocityLimits(), TorqueLimits(tau_max),
            JointJerkLimits(2000.0),
        ]  # fmt: skip
        stack = wbc.Stack([Posture(target, kp=100.0)], subject_to=limits)
        controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), dt=1e-3)
        q, v, found = middle, np.zeros(robot.nv), []
        with np.errstate(invalid="raise", divide="raise"):
            for k in range(150):
                command = controller.tick(1e-3 * k, q, v)
                q, v = command.q, command.v
                found.append(q)
        moves.append(np.array(found))
    np.testing.assert_allclose(moves[0], moves[1], rtol=0, atol=1e-6)


@pytest.mark.parametrize("seed", range(8))
def test_strong_motors_bring_joints_back_into_their_limits_as_if_nothing_limited_torques(
    seed: int, tmp_path: Path
) -> None:
    """Some joints are outside and move on, by as little as noise makes of it; the others are somewhere."""
    rng = np.random.default_rng(seed)
    robot, tau_max = arm(seed, tmp_path)
    low, high, n = robot.limits.q_min, robot.limits.q_max, robot.nj
    out, up = rng.random(n) < 0.5, rng.random(n) < 0.5
    out[int(rng.integers(n))] = True
    beyond = 10.0 ** rng.uniform(-6.0, -1.5)
    speed = np.where(up, 1.0, -1.0) * rng.uniform(0.0, 0.2, n) * np.minimum(1.0, 1e3 * beyond)
    start = np.where(out, np.where(up, high + beyond, low - beyond), rng.uniform(low, high))
    target = rng.uniform(low, high)
    moves = []
    for motors in ([], [TorqueLimits(1e4 * tau_max)]):
        stack = wbc.Stack(
            [Posture(target, kp=25.0)], subject_to=[JointPositionLimits(), JointVelocityLimits(), *motors]
        )
        controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics())
        q, v, found = start, np.where(out, speed, 0.0), []
        for k in range(150):
            command = controller.tick(controller.dt * k, q, v)
            assert command.fallback_level == "solved", controller.why
            q, v = command.q, command.v
            found.append(command.a)
        moves.append(np.array(found))
    np.testing.assert_allclose(moves[0], moves[1], rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("seed", [0, 3])
def test_what_is_relaxed_is_said_of_the_limits_of_the_tick_whatever_braking_needs(seed: int, tmp_path: Path) -> None:
    """Weak arms too fast for their limits on jerk: braking takes other bounds than a controller that does not brake."""
    rng = np.random.default_rng(seed)
    robot, tau_max = arm(seed, tmp_path, share=0.9)
    low, high = robot.limits.q_min, robot.limits.q_max
    relaxed = 0
    for _ in range(50):
        a_max, dt = float(10.0 ** rng.uniform(0.5, 1.5)), float(10.0 ** rng.uniform(-3.3, -2.0))
        limits = [
            JointPositionLimits(), JointVelocityLimits(), TorqueLimits(tau_max), JointAccelerationLimits(a_max),
            JointJerkLimits(a_max * float(10.0 ** rng.uniform(0.5, 2.0))),
        ]  # fmt: skip
        stack = wbc.Stack([Posture(rng.uniform(low, high), kp=400.0)], subject_to=limits)
        controller, other = (wbc.Controller(robot, stack, level=wbc.InverseDynamics(), dt=dt) for _ in range(2))
        other.plan.stopping = None
        q = rng.uniform(low, high)
        v = rng.uniform(-0.7, 0.7, robot.nj) * robot.limits.v_max
        command = controller.tick(0.0, q, v)
        if command.fallback_level == "relaxed" and other.tick(0.0, q, v).fallback_level == "relaxed":
            relaxed += 1
            bounds = other.qp
            np.testing.assert_allclose((controller.qp.lb, controller.qp.ub), (bounds.lb, bounds.ub), rtol=1e-12)
            off = np.abs(command.a - np.clip(command.a, bounds.lb, bounds.ub))
            said = {part.split(" by ")[0].split()[-1]: float(part.split(" by ")[1].split()[0])
                    for part in controller.why.removeprefix("relaxed: ").split(", ")}  # fmt: skip
            worst = np.argsort(-off)[: len(said)]
            assert said == pytest.approx({robot.joint_names[i]: off[i] for i in worst}, rel=6e-3)
    assert relaxed


@pytest.mark.parametrize("level", [wbc.VelocityLevel, wbc.AccelerationLevel, wbc.InverseDynamics])
def test_a_tick_that_relaxes_a_limit_on_jerk_says_so_and_no_other_does(level: Any, tmp_path: Path) -> None:
    relaxed = 0
    for seed in range(4):
        robot, tau_max = arm(seed, tmp_path, share=0.8)
        stack = wbc.Stack(
            [Posture(restless_posture(robot, seed, 0.1), kp=400.0, rate=30.0)],
            subject_to=[
                JointLimits(a_max=40.0, j_max=2000.0, **({"tau_max": tau_max} if level is wbc.InverseDynamics else {}))
            ],
        )
        controller = wbc.Controller(robot, stack, level=level(), dt=1e-3)
        q, v, last = robot.q0, np.zeros(robot.nv), np.zeros(robot.nv)
        for k in range(250):
            command = controller.tick(1e-3 * k, q, v)
            a = (command.v - v) / 1e-3
            jerk = np.abs(a - last).max() / 1e-3
            if command.status.ok and not 2000.0 <= jerk <= 2001.0:
                assert ("jerk: joint" in controller.why) == (jerk > 2000.0), (seed, k, jerk, controller.why)
            relaxed += command.status.ok and jerk > 2001.0
            q, v, last = command.q, command.v, a
    assert relaxed > 0 or level is not wbc.InverseDynamics
