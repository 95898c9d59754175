"""Rows of the library's members are written by compiled code, and say what the members say when they are called."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

import wbc
import wbc.stack.compiled.fill as fill_module
from tasks import (
    Admittance,
    CapturePoint,
    FrameVelocityLimits,
    FrozenJoints,
    GravityCompensation,
    HalfSpaceLimit,
    JointCoupling,
    JointImpedance,
    Posture,
    Yaw,
)
from tests.tasks.own_kernel import Radius
from tests.tasks.test_contract import MEMBERS
from tests.test_features import contacts_of
from wbc import InverseDynamics, Stack
from wbc.errors import InvalidInput, NotSupported
from wbc.models.model import RobotModel
from wbc.stack.contact import Contact
from wbc.stack.task import Objective
from wbc.testing import moments
from wbc.testing.levels import LEVELS

ROBOTS = {name: wbc.load(name) for name in ("arm", "humanoid", "quadruped")}
UP = (0.0, 0.0, 1.0)
COUPLED = JointCoupling(ROBOTS["humanoid"].joint_names[0], to={ROBOTS["humanoid"].joint_names[1]: -2.0})

#: Members that Python writes in every tick, and why.
CALLED = {
    "KineticEnergy": "a factor of the whole inertia matrix and its rate, by LAPACK",
    "ManipulabilityTask": "second derivatives of a determinant",
    "ProjectedGradient": "users write criteria",
    "CollisionAvoidance": "distances come from a compiled search with memory of its own",
    "InternalForce": "contacts say where they are",
    "Torque": "weighed by the inertia: a factor of the whole matrix, by LAPACK",
    "JointLimits": "with torques that fall with speed",
    "TorqueSpeedLimits": "users write constraints of this kind",
    "Impedance": "a factor of the whole inertia matrix, by LAPACK",
}  # fmt: skip


def stack_with(member: Any, robot: RobotModel) -> Stack:
    """A stack with a member, and a contact for one that is about a force."""
    posture = Posture(robot.q0, weight=1e-3, name="beside it")
    if isinstance(member, Objective):
        return Stack([member, posture], contacts=contacts_of(member, robot))
    place = "contacts" if isinstance(member, Contact) else "subject_to"
    return Stack([posture], **{place: [member]})  # type: ignore[arg-type]


def plans(member: Any, robot: RobotModel) -> Iterator[Any]:
    """Of each sample at each level that carries it."""
    for sample in member.samples(robot):
        for level in LEVELS:
            try:
                yield level.compile(robot, stack_with(sample, robot), dt=1e-3)
            except NotSupported:
                continue


def rows_of(plan: Any) -> dict[str, np.ndarray]:
    """Everything that members write."""
    p, motion = plan.problem, plan.motion
    return {
        "rows": p.G.copy(), "wanted": motion.wanted.copy(), "errors": motion.e.copy(), "centre": p.centre.copy(),
        "lower": np.nan_to_num(p.lower, copy=True), "upper": np.nan_to_num(p.upper, copy=True),
        **{f"margins of {name}": h for name, (_, h) in plan.margins().items()},
    }  # fmt: skip


@pytest.mark.parametrize("robot", ROBOTS.values(), ids=ROBOTS)
@pytest.mark.parametrize("member", [*MEMBERS, Radius], ids=lambda member: member.__name__)
def test_a_tick_writes_what_members_write_when_they_are_called(member: Any, robot: RobotModel, monkeypatch: Any):
    """The other way reads the state's own Jacobians, drifts and velocities; the contract compares it with differences.

    The plan that is called is another one: nothing that compiled code wrote is left in its memory.
    """
    for plan, other in zip(plans(member, robot), plans(member, robot), strict=True):
        assert_same(plan, other, robot, monkeypatch)


def assert_same(plan: Any, other: Any, robot: RobotModel, monkeypatch: Any) -> None:
    """The rows of a plan that is compiled, and of one whose members are called."""
    second = plan.level.order == 2
    state, same = robot.state(drifts=second), robot.state(drifts=second)
    for k, moment in enumerate(moments(robot)):
        for one in (state, same):
            one.update(*moment)
        if k == 0:
            plan.start(state)
            other.start(same)
        plan.fill(state)
        with monkeypatch.context() as patch:
            patch.setattr(fill_module, "kernel_rows_of", lambda member: None)
            other.bind(same)
            other.fill(same)
        found, expected = rows_of(plan), rows_of(other)
        plan.fill(state)
        for what, values in rows_of(plan).items():
            np.testing.assert_array_equal(values, found[what], err_msg=f"{what} of {plan}, written twice")
        for what, values in expected.items():
            tolerance = 1e-9 * (1.0 + np.abs(values).max(initial=0.0))
            np.testing.assert_allclose(found[what], values, rtol=0, atol=tolerance, err_msg=f"{what} of {plan}")


@pytest.mark.parametrize("member", [*MEMBERS, Radius], ids=lambda member: member.__name__)
def test_a_stack_of_library_members_calls_no_python_between_pinocchio_and_the_command(member: Any):
    robot = ROBOTS["humanoid"]
    called = [f"{plan}" for plan in plans(member, robot) if not plan.is_compiled]
    if member.__name__ in CALLED:
        assert called, f"{member.__name__} has compiled rows: it need not be listed"
    else:
        assert not called


@pytest.mark.parametrize(
    "make",
    [
        lambda robot: Stack([Posture(robot.q0)], subject_to=[Yaw("head", target=0.1).exactly()]),
        lambda robot: Stack([Posture(robot.q0)], subject_to=[CapturePoint(target=[0.0, 0.0], height=0.8).exactly()]),
        lambda robot: Stack([Posture(robot.q0)], subject_to=[HalfSpaceLimit("head", normal=UP, offset=0, slack=None)]),
        lambda robot: Stack([Posture(robot.q0), FrameVelocityLimits("head", linear=0.1, slack=None).softly()]),
        lambda robot: Stack([Posture(robot.q0)], contacts=[FrozenJoints([robot.joint_names[0]]).with_reaction()]),
        lambda robot: Stack([Posture(robot.q0)], contacts=[Yaw("head", target=0.1).with_reaction()]),
        lambda robot: Stack([Posture(robot.q0)], subject_to=[Yaw("head", target=lambda t: t).within(0.2)]),
        lambda robot: Stack([Posture(robot.q0)], subject_to=[Posture(robot.q0).within(-np.inf, 0.5, slack=10.0)]),
        lambda robot: Stack([Posture(robot.q0), COUPLED.within(0.1, name="close").softly(weight=2.0)]),
    ],
    ids=[
        "equality", "linear equality", "hard limit", "soft limit", "brake", "reaction", "interval", "joint interval",
        "soft interval",
    ],
)  # fmt: skip
def test_what_is_made_of_a_task_is_compiled_as_the_task_is(make: Any, monkeypatch: Any):
    robot = ROBOTS["humanoid"]
    for level in LEVELS[1:]:
        plan, other = (level.compile(robot, make(robot), dt=1e-3) for _ in range(2))
        assert plan.is_compiled
        assert_same(plan, other, robot, monkeypatch)


def test_settings_that_are_assigned_between_ticks_are_read_again():
    robot = ROBOTS["humanoid"]
    limit, push = HalfSpaceLimit("head", normal=UP, offset=0.1), GravityCompensation()
    guided = Admittance("head", target=np.eye(4), inertia=2.0, damping=20.0, stiffness=0.0)
    spring = JointImpedance(robot.q0, stiffness=20.0, damping=2.0)
    plan = InverseDynamics().compile(robot, Stack([guided, spring, push], subject_to=[limit]), dt=1e-3)
    state = robot.state()
    plan.fill(state)
    before = rows_of(plan)
    guided.wrench, limit.offset, limit.rate, spring.stiffness = [5.0, 0.0, 0.0], 0.2, 20.0, 40.0
    spring.target = 0.9 * robot.q0
    plan.fill(state)
    after = rows_of(plan)
    expected = InverseDynamics().compile(robot, Stack([guided, spring, push], subject_to=[limit]), dt=1e-3)
    expected.fill(state)
    for what, values in rows_of(expected).items():
        np.testing.assert_array_equal(after[what], values, err_msg=what)
    assert np.abs(after["rows"] - before["rows"]).max() > 1.0


@pytest.mark.parametrize(
    ("kernel", "why"),
    [
        ("tests.tasks.own_kernels:radius", "there is no kernel 'tests.tasks.own_kernels:radius', .*: No module named"),
        ("tests.tasks.own_kernel:radios", "tests.tasks.own_kernel has no function 'radios' that is a kernel"),
        ("tests.tasks.own_kernel", "tests.tasks.own_kernel has no function '' that is a kernel"),
        ("tests.tasks.own_kernel:across", "no function 'across' that is decorated with wbc.compiled.callee"),
        ("tests.tasks.own_kernel:rows", "no function 'rows' that is decorated with wbc.compiled.callee"),
        (":radius", "there is no kernel ':radius', \"module:function\""),
        (".own_kernel:radius", "there is no kernel '.own_kernel:radius', \"module:function\""),
    ],
)
def test_a_kernel_that_is_none_is_refused_though_the_task_could_write_its_rows(kernel: str, why: str):
    robot = ROBOTS["arm"]
    with pytest.raises(InvalidInput, match=why):
        InverseDynamics().compile(robot, Stack([Radius("tool", target=[0.3], kernel=kernel)]), dt=1e-3)
