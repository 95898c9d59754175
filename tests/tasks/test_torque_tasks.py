"""Torques by their equations: gravity compensation, springs, preferred torques, and what a measured force spares."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tasks as T
import wbc
from tasks.scenarios.exact_plant import ExactPlant
from tests.stack.conftest import moving
from wbc.methods import WeightedTorque
from wbc.models import PlanarPR
from wbc.models.model import RobotModel, RobotState
from wbc.sim.plant import ForwardDynamicsPlant
from wbc.sim.simulate import simulate
from wbc.testing.strategies import states
from wbc.types import Vec

ARM, HUMANOID = wbc.load("arm"), wbc.load("humanoid")
LEVEL = wbc.InverseDynamics(regularisation=1e-12)
K = np.array([80.0, 80.0, 60.0, 60.0, 5.0, 5.0, 2.0])
#: Critical for each joint alone: held for a tick, more would turn light joints around.
D = 2.0 * np.sqrt(K * np.diag(ARM.state().M))


def controller(*tasks: Any, **more: Any) -> wbc.Controller:
    return wbc.Controller(ARM, wbc.Stack([list(tasks)], **more), level=LEVEL, dt=1e-3)


@given(states(ARM))
def test_an_arm_that_carries_its_own_weight_goes_on_as_it_would_without_gravity(state: RobotState):
    command = controller(T.GravityCompensation()).tick(0.0, state.q, state.v)
    np.testing.assert_allclose(command.tau, state.g, atol=1e-5 * (1.0 + np.abs(state.g).max()))


@pytest.mark.parametrize("coriolis", [False, True])
@given(states(ARM))
def test_torques_are_those_of_springs_and_dampers_and_of_the_weight(coriolis: bool, state: RobotState):
    wave = T.Sinusoid(ARM.q0, amplitude=0.2, frequency=0.5)
    command = controller(T.JointImpedance(wave, stiffness=K, damping=D, coriolis=coriolis)).tick(0.3, state.q, state.v)
    target, rate, _ = wave(0.3)
    wanted = (state.h if coriolis else state.g) + K * (target - state.q) + D * (rate - state.v)
    np.testing.assert_allclose(command.tau, wanted, atol=1e-5 * (1.0 + np.abs(wanted).max()))


def test_the_energy_of_springs_and_links_only_falls_and_the_arm_comes_to_its_target():
    target = ARM.q0 + 0.3
    ticking = controller(T.JointImpedance(target, stiffness=K, damping=D))
    plant = ForwardDynamicsPlant(ARM, dt=1e-3)
    state, energies = ARM.state(), []
    for _ in range(3000):
        state.update(plant.t, plant.q, plant.v)
        e = target - plant.q
        energies.append(0.5 * plant.v @ state.M @ plant.v + 0.5 * e @ (K * e))
        plant.step(ticking.tick(plant.t, plant.q, plant.v))
    assert np.diff(energies).max() < 1e-3 * energies[0]
    assert np.abs(target - plant.q).max() < 0.02


def test_a_guided_arm_comes_to_rest_by_damping_without_being_pulled_back():
    ticking = controller(T.GravityCompensation(), T.Damping(kd=5.0, weight=1e3))
    plant = ForwardDynamicsPlant(ARM, dt=1e-3)
    plant.reset(ARM.q0, np.full(7, 0.3))
    for _ in range(2000):
        plant.step(ticking.tick(plant.t, plant.q, plant.v))
    assert np.abs(plant.v).max() < 1e-2 and np.abs(plant.q - ARM.q0).max() > 0.02


def test_arms_of_a_humanoid_are_springs_while_it_stands():
    arms = [
        name for name in HUMANOID.joint_names if name.startswith("left_") and ("elbow" in name or "shoulder" in name)
    ]
    others = {name: 0.0 for name in arms}
    target = HUMANOID.q0[-HUMANOID.nj :] + 0.1
    spring = T.JointImpedance(target, joints=["left_(shoulder|elbow).*"], stiffness=30.0, damping=2.0, weight=10.0)
    balance = [
        T.CenterOfMass(target=HUMANOID.state().com, weight=10.0),
        T.Orientation(HUMANOID.frame_names[0], target=np.eye(3)),
    ]
    rest = T.Posture(HUMANOID.q0, weight={".*": 1e-1} | others)
    stack = wbc.Stack([*balance, spring, rest], contacts=T.feet(HUMANOID))
    command = wbc.Controller(HUMANOID, stack, level=LEVEL).tick(0.0, HUMANOID.q0, np.zeros(HUMANOID.nv))
    index = [HUMANOID.joint(name) for name in arms]
    assert command.status.ok and arms
    wanted = HUMANOID.state().g[HUMANOID.nb :][index] + 30.0 * 0.1
    np.testing.assert_allclose(command.tau[index], wanted, atol=0.05)


def test_stiffness_may_be_assigned_between_ticks_by_name_too():
    task = T.JointImpedance(ARM.q0 + 0.1, stiffness=K, damping=D)
    ticking = controller(task)
    before = ticking.tick(0.0, ARM.q0, np.zeros(7)).tau
    task.stiffness = {".*": 50.0, "elbow": 5.0}
    after = ticking.tick(0.0, ARM.q0, np.zeros(7)).tau
    stiffness = np.where(np.array(ARM.joint_names) == "elbow", 5.0, 50.0)
    np.testing.assert_allclose(after - before, 0.1 * (stiffness - K), atol=1e-4)


# ---- a measured force is a known term
WRENCH = np.array([3.0, -2.0, 5.0, 0.4, 0.1, -0.3])


def ticked(*components: wbc.Component) -> tuple[Any, Any]:
    """The command of a stack with these components, and the state it was decided in."""
    stack = wbc.Stack(
        [T.Position("tool", target=[0.5, 0.2, 0.4]), T.Posture(ARM.q0, weight=1e-2)], components=components
    )
    controller = wbc.Controller(ARM, stack, level=wbc.InverseDynamics())
    q, v = moving(ARM, 3)
    command = controller.tick(0.0, q, v)
    assert command.status.ok
    return command, controller.state


def test_the_motion_stays_and_the_torque_is_less_by_what_the_wrench_does():
    """Property 51."""
    without, state = ticked()
    with_wrench, _ = ticked(T.MeasuredWrench("tool", wrench=WRENCH))
    spared: Vec = state.frame("tool").jacobian().T @ WRENCH
    np.testing.assert_allclose(with_wrench.a, without.a, atol=1e-8)
    np.testing.assert_allclose(with_wrench.tau, without.tau - spared, atol=1e-7)


def test_a_force_is_a_wrench_without_moment_and_wrenches_add_up():
    force, _ = ticked(T.MeasuredWrench("tool", wrench=WRENCH[:3]))
    same, _ = ticked(T.MeasuredWrench("tool", wrench=lambda t: np.r_[WRENCH[:3], 0, 0, 0]))
    halves, _ = ticked(*(T.MeasuredWrench("tool", wrench=0.5 * WRENCH[:3], name=name) for name in ("one", "other")))
    np.testing.assert_allclose(force.tau, same.tau, atol=1e-12)
    np.testing.assert_allclose(force.tau, halves.tau, atol=1e-9)


def test_it_acts_in_each_tick_once_and_follows_what_is_assigned():
    sensor = T.MeasuredWrench("tool")
    stack = wbc.Stack([T.Posture(ARM.q0)], components=[sensor])
    controller = wbc.Controller(ARM, stack, level=wbc.InverseDynamics())
    q, v = moving(ARM, 3)
    free = controller.tick(0.0, q, v).tau
    sensor.wrench = WRENCH
    pushed = [controller.tick(0.0, q, v).tau for _ in range(3)]
    np.testing.assert_allclose(pushed[0], pushed[2], atol=1e-9)
    np.testing.assert_allclose(free - pushed[0], controller.state.frame("tool").jacobian().T @ WRENCH, atol=1e-7)
    np.testing.assert_array_equal(sensor.signals()["wrench"], WRENCH)
    sensor.wrench = lambda t: WRENCH if t == 0.0 else np.full(6, np.nan)
    controller.tick(0.0, q, v)
    assert controller.tick(1.0, q, v).status.ok
    np.testing.assert_array_equal(sensor.signals()["wrench"], WRENCH)


# ---- a task that is a constraint and a preferred torque are the weighted torque method, on any robot
PR = PlanarPR(m1=1, m2=1, l2=0.5, d2=0.25, I2=0.1)
EXACT = wbc.InverseDynamics(regularisation=1e-11)
CASES: dict[str, tuple[RobotModel, str, str]] = {
    "planar_pr": (PR, "end_effector", "x"), "arm": (ARM, "tool", "xyz"), "arm along z": (ARM, "tool", "z"),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
@given(seed=st.integers(0, 9999))
def test_it_is_the_closed_form_with_feedback_gravity_and_a_measured_force(case: str, seed: int):
    """Property 43: the task acceleration of the forward dynamics is the one commanded."""
    robot, frame, axes = CASES[case]
    rng = np.random.default_rng(seed)
    q, v = robot.q0 + 0.2 * rng.normal(size=robot.nq), 0.5 * rng.normal(size=robot.nv)
    target, rate, second = 0.5 * rng.normal(size=(3, len(axes)))
    tau_0, wrench = rng.normal(size=robot.nj), rng.normal(size=6)
    task = T.Position(frame, axes=axes, target=lambda t: (target, rate, second), kp=60.0, kd=13.0)
    stack = wbc.Stack(
        [T.Torque(tau_0, weight="inverse_inertia")],
        subject_to=[task.exactly()], components=[T.MeasuredWrench(frame, wrench=wrench)],
    )  # fmt: skip
    controller = wbc.Controller(robot, stack, level=EXACT)
    command, state = controller.tick(0.0, q, v), controller.state
    rows = slice("xyz".index(axes[0]), "xyz".index(axes[-1]) + 1)
    J, drift, at = state.frame(frame).jacobian(), state.frame(frame).drift()[rows], state.frame(frame).position[rows]
    wanted = second + 13.0 * (rate - J[rows] @ v) + 60.0 * (target - at)
    method = WeightedTorque(
        state.M, state.h, J[rows], wanted, drift=drift, tau_0=tau_0, tau_external=J.T @ wrench
    )  # fmt: skip
    size = 1.0 + np.abs(command.tau).max()
    np.testing.assert_allclose(command.tau, method.closed_form().tau, atol=1e-5 * size)
    forward = np.linalg.solve(state.M, command.tau + J.T @ wrench - state.h)
    np.testing.assert_allclose(J[rows] @ forward + drift, wanted, atol=1e-6 * (1.0 + np.abs(wanted).max()))


def test_an_error_vanishes_at_the_rate_its_gains_give():
    """Property 52: ë + kd ė + kp e = 0, critically damped with kp = 100, kd = 20."""
    offset = 0.05
    task = T.Position("end_effector", axes="x", target=[offset], kp=100.0)
    stack = wbc.Stack([T.Torque(weight="inverse_inertia")], subject_to=[task.exactly(name="x")])
    plant = ExactPlant(PR, dt=5e-4)
    plant.reset([0.0, np.pi / 2])
    run = simulate(wbc.Controller(PR, stack, level=EXACT, dt=5e-4), plant, duration=0.6)
    expected = offset * (1.0 + 10.0 * run["t"]) * np.exp(-10.0 * run["t"])
    np.testing.assert_allclose(run["error.x"][:, 0], expected, atol=2e-3 * offset)


def test_limits_that_are_active_hold_and_the_task_with_them():
    """Property 53."""
    q, v = np.array([0.0, 0.7]), np.array([0.2, -1.0])
    task = T.Position("end_effector", axes="x", target=[0.5], kp=100.0)
    stack = [T.Torque([3.0, 2.0], weight="inverse_inertia")]
    free = wbc.Controller(PR, wbc.Stack(stack, subject_to=[task.exactly()]), level=EXACT).tick(0.0, q, v)
    bound = 0.9 * np.abs(free.tau)
    limits = T.TorqueLimits([1e3, bound[1]])
    cut = wbc.Controller(PR, wbc.Stack(stack, subject_to=[task.exactly(), limits]), level=EXACT).tick(0.0, q, v)
    assert cut.status.ok and abs(cut.tau[1]) == pytest.approx(bound[1], abs=1e-8)
    state = PR.state()
    state.update(0.0, q, v)
    J = state.frame("end_effector").jacobian()[:1]
    np.testing.assert_allclose(J @ cut.a, J @ free.a, atol=1e-6)


def free_energy(robot: RobotModel, state: Any, tau: Vec, tau_0: Vec) -> float:
    """½ |a − a_0|²_M, a_0 what tau_0 alone gives: the cost by Gauss' principle."""
    selected = np.eye(robot.nv)[:, robot.nb :]
    off = np.linalg.solve(state.M, selected @ (tau - tau_0))
    return float(0.5 * off @ state.M @ off)


@pytest.mark.filterwarnings("ignore::wbc.models.plausible.NothingHoldsTheBase")
def test_on_a_floating_base_it_is_gauss_principle_too():
    robot = wbc.load("quadruped", base="floating")
    rng = np.random.default_rng(1)
    q, v = robot.integrate(robot.q0, 0.05 * rng.normal(size=robot.nv)), 0.1 * rng.normal(size=robot.nv)
    foot, tau_0 = next(iter(robot.feet)), rng.normal(size=robot.nj)
    state = robot.state()
    state.update(0.0, q, v)
    task = T.Position(foot, target=state.frame(foot).position + np.array([0.02, 0.0, 0.05]), kp=100.0)
    stack = wbc.Stack([T.Torque(tau_0, weight="inverse_inertia")], subject_to=[task.exactly()])
    command = wbc.Controller(robot, stack, level=EXACT).tick(0.0, q, v)
    assert command.status.ok
    # Rows of the torque that the task leaves free: along them the cost must not fall.
    selected = np.eye(robot.nv)[:, robot.nb :]
    A = state.frame(foot).jacobian()[:3] @ np.linalg.solve(state.M, selected)
    free = np.linalg.svd(A)[2][3:]
    best = free_energy(robot, state, command.tau, tau_0)
    for direction in np.vstack([free, -free]):
        assert free_energy(robot, state, command.tau + 0.1 * direction, tau_0) > best
    # Without a task nothing is better than what was asked for.
    alone = wbc.Stack([T.Torque(tau_0, weight="inverse_inertia"), T.JointVelocity(np.zeros(12), weight=0.0)])
    np.testing.assert_allclose(wbc.Controller(robot, alone, level=EXACT).tick(0.0, q, v).tau, tau_0, atol=1e-6)
