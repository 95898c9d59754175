"""A compiled stack is the QP that the mathematics says, whatever way it is solved."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio
import pytest

import tasks as T
import wbc
from tests.stack.conftest import feet, moving, standing
from wbc.models.pinocchio_ import PinocchioModel
from wbc.stack.constraint import Barrier, BarrierRows, ConstraintRows, LinearConstraint
from wbc.stack.task import Task, TaskRows

SEEDS = range(4)


def controller(robot: PinocchioModel, stack: wbc.Stack, **settings: Any) -> wbc.Controller:
    return wbc.Controller(robot, stack, level=settings.pop("level", wbc.InverseDynamics()), **settings)


# ---- the QP is the right one
@pytest.mark.parametrize("seed", SEEDS)
def test_the_answer_obeys_newton_and_holds_its_contacts(humanoid: PinocchioModel, seed: int) -> None:
    q, v = moving(humanoid, seed)
    command = controller(humanoid, standing(humanoid)).tick(0.0, q, v)
    assert command.status.ok
    model, data = humanoid.pinocchio, humanoid.pinocchio.createData()
    external = pinocchio.StdVec_Force()
    for _ in range(model.njoints):
        external.append(pinocchio.Force.Zero())
    pinocchio.framesForwardKinematics(model, data, q)
    for foot in humanoid.feet.values():
        frame = model.frames[humanoid.frames[foot.frame]]
        at_point = frame.placement * pinocchio.SE3(np.eye(3), np.array(foot.origin))
        external[frame.parentJoint] += at_point.act(pinocchio.Force(command.f[foot.frame]))
    tau = pinocchio.rnea(model, data, q, v, command.a, external)
    np.testing.assert_allclose(tau[:6], 0.0, atol=1e-8)
    np.testing.assert_allclose(tau[6:], command.tau, atol=1e-8)


@pytest.mark.parametrize("seed", SEEDS)
def test_an_arm_gets_the_least_squares_of_its_tasks(arm: PinocchioModel, seed: int) -> None:
    q, v = moving(arm, seed)
    goal = np.array([0.5, 0.1, 0.4])
    stack = wbc.Stack([T.Position("tool", target=goal, kp=50, kd=9, weight=3.0), T.Posture(arm.q0, kp=10, weight=0.2)])
    command = controller(arm, stack, level=wbc.AccelerationLevel()).tick(0.0, q, v)
    state = arm.state()
    state.update(0.0, q, v)
    tool = state.frame("tool")
    J = tool.jacobian()[:3]
    wanted = 50 * (goal - tool.position) - 9 * (J @ v) - tool.drift()[:3]
    posture = 10 * (arm.q0 - q) - 2 * np.sqrt(10) * v
    H = 3.0 * J.T @ J + (0.2 + 1e-8) * np.eye(arm.nv)
    np.testing.assert_allclose(command.a, np.linalg.solve(H, 3.0 * J.T @ wanted + 0.2 * posture), rtol=1e-7)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("name", ["arm", "quadruped", "humanoid"])
def test_every_answer_is_certified_against_the_standard_form(name: str, seed: int) -> None:
    robot = wbc.load(name)
    q, v = moving(robot, seed)
    if robot.nb:
        stack = standing(robot, shift=0.1)
    else:
        stack = wbc.Stack(
            [T.Frame("tool", target=np.eye(4)), T.Posture(robot.q0, weight=1e-3)],
            subject_to=[T.TorqueLimits(), T.JointVelocityLimits(), T.JointPositionLimits()],
        )
    command = controller(robot, stack).tick(0.0, q, v)
    assert command.solution.certificate.residual <= 1e-7, command.solution.certificate
    assert command.certificate.within(1e-8)


@pytest.mark.parametrize("solver", ["daqp", "proxqp", "clarabel", "osqp"])
def test_any_solver_gives_the_same_command(quadruped: PinocchioModel, solver: str) -> None:
    q, v = moving(quadruped, 2)
    ours = controller(quadruped, standing(quadruped)).tick(0.0, q, v)
    if wbc.qp.solvers.by_name(solver).offline:
        pytest.skip(f"{solver} is for offline use")
    other = controller(quadruped, standing(quadruped), solver=solver).tick(0.0, q, v)
    assert other.status.ok
    np.testing.assert_allclose(other.tau, ours.tau, atol=2e-3)


def test_torque_limits_bind_and_are_kept(quadruped: PinocchioModel) -> None:
    state = quadruped.state()
    stack = wbc.Stack(
        [T.CenterOfMass(target=state.com + np.array([0.0, 0.0, 0.3]), kp=400), T.Posture(quadruped.q0, weight=1e-3)],
        contacts=feet(quadruped),
        subject_to=[T.TorqueLimits(12.0)],
    )
    control = controller(quadruped, stack)
    command = control.tick(0.0, quadruped.q0, np.zeros(quadruped.nv))
    assert command.status.ok
    assert np.abs(command.tau).max() == pytest.approx(12.0, abs=1e-8)
    assert control.active_count > 0
    assert "TorqueLimits" in control.explain()


# ---- constraints
def test_a_task_as_a_constraint_holds_exactly_whatever_else_is_wanted(arm: PinocchioModel) -> None:
    q, v = moving(arm, 3)
    up = T.Orientation("tool", kp=100)
    pull = T.Position("tool", target=[0.9, 0.9, 0.9], kp=1000, weight=1e4)
    control = controller(arm, wbc.Stack([pull, T.Posture(arm.q0)], subject_to=[up.exactly()]))
    command = control.tick(0.0, q, v)
    state = arm.state()
    state.update(0.0, q, v)
    tool = state.frame("tool")
    J, drift = tool.jacobian()[3:], tool.drift()[3:]
    wanted = 100 * pinocchio.log3(tool.rotation.T) - 20 * (J @ v)
    np.testing.assert_allclose(J @ command.a + drift, wanted, atol=1e-8)


def test_a_posture_as_a_constraint_holds_every_joint(arm: PinocchioModel) -> None:
    q, v = moving(arm, 3)
    hold = T.Posture(arm.q0, kp=4.0)
    stack = wbc.Stack([T.Position("tool", target=[0.9, 0.9, 0.9])], subject_to=[hold.exactly()])
    command = controller(arm, stack, level=wbc.AccelerationLevel()).tick(0.0, q, v)
    np.testing.assert_allclose(command.a, 4.0 * (arm.q0 - q) - 4.0 * v, atol=1e-7)


class Ceiling(Barrier):
    """The tool stays below a height [m]."""

    dim, units = 1, "m"

    def __init__(self, height: float) -> None:
        super().__init__(rate=20.0)
        self.height = height

    def fill(self, state: Any, out: BarrierRows) -> None:
        tool = state.frame("tool")
        out.h[:] = self.height - tool.position[2]
        out.J[:] = -tool.jacobian()[2]
        out.drift[:] = -tool.drift()[2]


@pytest.mark.parametrize("level", [wbc.VelocityLevel(), wbc.AccelerationLevel(), wbc.InverseDynamics()])
def test_a_barrier_is_approached_and_never_passed(arm: PinocchioModel, level: Any) -> None:
    height = float(arm.state().frame("tool").position[2]) + 0.05
    goal = arm.state().frame("tool").position + np.array([0.0, 0.0, 0.2])
    stack = wbc.Stack([T.Position("tool", target=goal), T.Posture(arm.q0, weight=1e-3)], subject_to=[Ceiling(height)])
    control = controller(arm, stack, level=level, dt=1e-3)
    q, v, highest = np.array(arm.q0), np.zeros(arm.nv), -np.inf
    for k in range(1500):
        command = control.tick(k * 1e-3, q, v)
        assert command.status.ok
        q, v = command.q, command.v
        highest = max(highest, float(control.state.frame("tool").position[2]))
    assert highest <= height + 1e-5
    assert highest >= height - 5e-3


class SharedLoad(LinearConstraint):
    """Joints 1 and 2 together give at most ``limit`` [N m]."""

    on, dim, units = "torque", 1, "N m"

    def __init__(self, limit: float) -> None:
        super().__init__()
        self.limit = limit

    def fill(self, state: Any, out: ConstraintRows) -> None:
        out.A[:] = 0.0
        out.A[0, 1:3] = 1.0
        out.lo[:], out.hi[:] = -self.limit, self.limit


class VelocitySum(LinearConstraint):
    """The sum of the velocities that the next tick reaches is zero."""

    on, dim, units = "velocity", 1, "rad/s"

    def fill(self, state: Any, out: ConstraintRows) -> None:
        out.A[:] = 1.0
        out.lo[:] = out.hi[:] = 0.0


def test_linear_constraints_hold_on_torques_and_velocities(arm: PinocchioModel) -> None:
    q, v = moving(arm, 5)
    stack = wbc.Stack(
        [T.Position("tool", target=[0.6, 0.4, 0.3], kp=400), T.Posture(arm.q0, weight=1e-2)],
        subject_to=[SharedLoad(5.0), VelocitySum()],
    )
    command = controller(arm, stack).tick(0.0, q, v)
    assert command.status.ok
    assert abs(command.tau[1] + command.tau[2]) <= 5.0 + 1e-8
    assert command.v.sum() == pytest.approx(0.0, abs=1e-10)


@pytest.mark.parametrize("name", ["arm", "quadruped", "humanoid"])
@pytest.mark.parametrize("seed", range(3))
def test_each_bound_of_a_joint_names_the_limit_that_gives_it(name: str, seed: int) -> None:
    robot = wbc.load(name)
    slow = np.random.default_rng(seed).random(robot.nj) < 0.5  # at rest these may gain 0.1 / dt, the others 5 rad/s²
    limits = [
        T.JointVelocityLimits(np.where(slow, 0.1, 50.0), name="speeds"),
        T.JointAccelerationLimits(np.where(slow, 1e4, 5.0), name="starts"),
    ]
    plan = wbc.InverseDynamics().compile(robot, wbc.Stack([T.Posture(robot.q0)], subject_to=limits), dt=1e-3)
    for joint in range(robot.nj):
        for upper in (False, True):
            owner = plan.bounded_row(plan.layout.n_range + robot.nb + joint, robot.state(), upper=upper).owner
            assert owner == ("speeds" if slow[joint] else "starts"), robot.joint_names[joint]


def test_acceleration_limits_at_the_velocity_level_bound_the_change_of_velocity(arm: PinocchioModel) -> None:
    stack = wbc.Stack([T.Posture(arm.q0 + 1.0, rate=100.0)], subject_to=[T.JointAccelerationLimits(5.0)])
    v = np.full(arm.nv, 0.1)
    command = controller(arm, stack, level=wbc.VelocityLevel(), dt=0.01).tick(0.0, arm.q0, v)
    np.testing.assert_allclose(command.v, 0.1 + 5.0 * 0.01)


# ---- linear tasks
def test_a_torque_task_as_a_constraint_is_met_exactly(arm: PinocchioModel) -> None:
    tau_0 = np.linspace(-2.0, 3.0, arm.nj)
    stack = wbc.Stack([T.Posture(arm.q0, kp=1e4, weight=1e3)], subject_to=[T.Torque(tau_0).exactly()])
    command = controller(arm, stack).tick(0.0, *moving(arm, 1))
    np.testing.assert_allclose(command.tau, tau_0, atol=1e-7)


def test_a_torque_task_alone_is_met_and_a_force_task_is_met_in_its_contact(
    arm: PinocchioModel, quadruped: PinocchioModel
) -> None:
    tau_0 = np.linspace(-2.0, 3.0, arm.nj)
    level = wbc.InverseDynamics(regularisation=1e-13)
    command = controller(arm, wbc.Stack([T.Torque(tau_0)]), level=level).tick(0.0, *moving(arm, 1))
    np.testing.assert_allclose(command.tau, tau_0, atol=1e-5)
    foot = next(iter(quadruped.feet))
    weight = quadruped.mass * 9.81
    press = T.ContactForce(foot, target=[0.0, 0.0, 0.4 * weight], weight=10.0)
    command = controller(quadruped, standing(quadruped, extra=(press,))).tick(0.0, quadruped.q0, np.zeros(quadruped.nv))
    assert command.f[foot][2] == pytest.approx(0.4 * weight, rel=1e-2)


# ---- what may change between ticks


def test_a_task_switched_off_counts_for_nothing(humanoid: PinocchioModel) -> None:
    q, v = moving(humanoid, 2)
    stack = standing(humanoid)
    control = controller(humanoid, stack)
    stack.tasks[0].active = False
    without = wbc.Stack(stack.tasks[1:], contacts=stack.contacts, subject_to=stack.subject_to)
    np.testing.assert_allclose(
        control.tick(0.0, q, v).tau, controller(humanoid, without).tick(0.0, q, v).tau, atol=1e-6
    )


def test_switching_the_posture_off_leaves_a_certified_answer(humanoid: PinocchioModel) -> None:
    stack = standing(humanoid)
    control = controller(humanoid, stack)
    control.tick(0.0, humanoid.q0, np.zeros(humanoid.nv))
    stack.tasks[2].active = False
    assert control.tick(1e-3, humanoid.q0, np.zeros(humanoid.nv)).solution.certificate.ok


class OwnRate(Task):
    """A position task that writes its error rate itself."""

    dim, units = 3, "m"

    def fill(self, state: Any, out: TaskRows) -> None:
        tool = state.frame("tool")
        out.J[:] = tool.jacobian()[:3]
        out.e[:] = np.array([0.4, 0.1, 0.4]) - tool.position
        out.drift[:] = tool.drift()[:3]
        out.ed[:] = -out.J @ state.v


class HalfRate(OwnRate):
    """One whose error changes half as fast as the tool moves."""

    def fill(self, state: Any, out: TaskRows) -> None:
        super().fill(state, out)
        out.ed *= 0.5


def test_what_is_wanted_has_a_gain_for_each_term_also_when_gains_change(arm: PinocchioModel) -> None:
    q, v = moving(arm, 5)
    goal, rate, second = np.array([0.4, 0.1, 0.4]), np.array([0.1, 0.2, -0.3]), np.array([1.0, -2.0, 0.5])
    own, moved = HalfRate(), T.Position("tool", target=lambda t: (goal, rate, second))
    control = controller(arm, wbc.Stack([own, moved, T.Posture(arm.q0)]), level=wbc.AccelerationLevel())
    for kp, kd in ((100.0, 20.0), (9.0, 5.0), (0.0, 7.0)):
        own.kp, own.kd, moved.kp, moved.kd = kp, kd, kp, kd
        assert control.tick(0.0, q, v).status.ok
        tool = control.state.frame("tool")
        e, Jv, drift = goal - tool.position, tool.jacobian()[:3] @ v, tool.linear_drift()
        wanted = {task.name: task.wanted for task in control.plan.problem.levels[0]}
        np.testing.assert_allclose(wanted[own.name], kp * e - kd * 0.5 * Jv - drift, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(
            wanted[moved.name], second + kd * (rate - Jv) + kp * e - drift, rtol=1e-12, atol=1e-12
        )


@pytest.mark.filterwarnings("error")
def test_a_jacobian_without_end_warns_of_nothing_where_a_task_writes_its_own_rate(arm: PinocchioModel) -> None:
    class Endless(OwnRate):
        entry = 1.0

        def fill(self, state: Any, out: TaskRows) -> None:
            super().fill(state, out)
            out.J[0, 0], out.ed[:] = self.entry, 0.0

    task = Endless()
    control = controller(arm, wbc.Stack([task, T.Posture(arm.q0)]), level=wbc.AccelerationLevel())
    q, v = moving(arm, 6)
    for entry, ok in ((1.0, True), (np.inf, False), (1.0, True)):
        task.entry = entry
        assert control.tick(0.0, q, v).status.ok == ok


# ---- the tick


def test_names_and_units_belong_to_every_row(humanoid: PinocchioModel) -> None:
    qp = controller(humanoid, standing(humanoid)).qp
    assert len(qp.rows) == qp.shape.n_eq + qp.shape.n_in + qp.shape.n
    assert all(row.owner and row.unit for row in qp.rows)
    owners = {row.owner for row in qp.rows}
    assert {
        "base dynamics",
        "TorqueLimits",
        "JointVelocityLimits",
        "contact[left_sole]",
        "friction[left_sole]",
    } <= owners
