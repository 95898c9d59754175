"""A constraint among the tasks costs nothing while it holds, and has a slack at its weight where it cannot."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import tasks as T
import wbc
from tests.stack.conftest import moving, standing
from wbc.errors import InvalidInput, NotSupported
from wbc.models.pinocchio_ import PinocchioModel
from wbc.stack.constraint import Barrier, BarrierRows, ConstraintRows, LinearConstraint
from wbc.stack.task import Task
from wbc.testing import check_constraint, robots
from wbc.testing.differences import rotation_blocks

LEVELS = (wbc.VelocityLevel(), wbc.AccelerationLevel(), wbc.InverseDynamics())


class Ceiling(Barrier):
    """The tool stays below a height."""

    dim, units = 1, "m"

    def __init__(self, z_max: float) -> None:
        super().__init__(name=f"Ceiling at {z_max}")
        self.z_max = z_max

    def fill(self, state, out: BarrierRows) -> None:
        tool = state.frame("tool")
        out.h[:] = self.z_max - tool.position[2]
        out.J[:] = -tool.jacobian()[2]
        out.drift[:] = -tool.drift()[2]


class SlowSum(LinearConstraint):
    """|sum of all velocities| is small."""

    on, dim, units = "velocity", 1, "rad/s"

    def __init__(self, most: float) -> None:
        super().__init__()
        self.most = most

    def fill(self, state, out: ConstraintRows) -> None:
        out.A[:] = 1.0
        out.lo[:], out.hi[:] = -self.most, self.most


def reach(arm: PinocchioModel, *soft: object, hard: tuple = ()) -> wbc.Stack:
    return wbc.Stack(
        [T.Position("tool", target=[0.5, 0.1, 0.4], kp=50), T.Posture(arm.q0, kp=10, weight=1e-2), *soft],
        subject_to=hard,
    )


def decided(robot: PinocchioModel, stack: wbc.Stack, level: wbc.stack.formulation.Formulation, seed: int = 3) -> object:
    q, v = moving(robot, seed)
    return wbc.Controller(robot, stack, level=level, dt=0.01).tick(0.0, q, v)


@pytest.mark.parametrize("level", LEVELS, ids=lambda level: level.name)
def test_a_soft_constraint_that_holds_changes_nothing(arm: PinocchioModel, level) -> None:
    constraints = [Ceiling(9.0), SlowSum(1e3), T.JointVelocityLimits(90.0), T.JointPositionLimits()]
    if level.dynamics:
        constraints.append(T.TorqueLimits(1e4))
    bare = decided(arm, reach(arm), level)
    soft = decided(arm, reach(arm, *(constraint.softly(weight=5.0) for constraint in constraints)), level)
    assert soft.status.ok
    np.testing.assert_allclose(soft.v, bare.v, atol=1e-7)


@pytest.mark.parametrize("level", LEVELS, ids=lambda level: level.name)
@pytest.mark.parametrize(
    "constraint",
    [Ceiling(0.3), SlowSum(0.01), T.JointVelocityLimits(0.02), T.TorqueLimits(2.0)],
    ids=lambda constraint: constraint.name,
)
def test_a_very_heavy_soft_constraint_is_the_constraint_and_a_light_one_is_none(
    arm: PinocchioModel, level, constraint
) -> None:
    if isinstance(constraint, T.TorqueLimits) and not level.dynamics:
        with pytest.raises(NotSupported, match="torque"):
            decided(arm, reach(arm, constraint.softly()), level)
        return
    hard = decided(arm, reach(arm, hard=(constraint,)), level)
    heavy = decided(arm, reach(arm, constraint.softly(weight=1e7)), level)
    light = decided(arm, reach(arm, constraint.softly(weight=1e-9)), level)
    bare = decided(arm, reach(arm), level)
    away = np.abs(hard.v - bare.v).max()
    assert heavy.status.ok
    assert away > 1e-4 or not hard.status.ok
    if hard.status.ok:
        np.testing.assert_allclose(heavy.v, hard.v, atol=1e-3 * away)
    np.testing.assert_allclose(light.v, bare.v, atol=1e-3 * max(away, 1e-3))


def test_a_soft_limit_is_exceeded_by_its_share_of_the_least_squares(arm: PinocchioModel) -> None:
    q, v = moving(arm, 1)
    limit, weight, rate = 0.05, 3.0, 2.0
    stack = wbc.Stack([T.Posture(arm.q0 + 1.0, rate=rate), T.JointVelocityLimits(limit).softly(weight=weight)])
    command = wbc.Controller(arm, stack, level=wbc.VelocityLevel()).tick(0.0, q, v)
    wanted = rate * (arm.q0 + 1.0 - q)  # per joint: ½ (v − wanted)² + ½ · 3 · (v − limit)², above the limit
    np.testing.assert_allclose(command.v, (wanted + weight * limit) / (1 + weight), rtol=1e-6)


def test_soft_torque_limits_keep_a_humanoid_standing_with_less_torque(humanoid: PinocchioModel) -> None:
    bare = decided(humanoid, standing(humanoid), wbc.InverseDynamics())
    soft = decided(humanoid, standing(humanoid, extra=(T.TorqueLimits(8.0).softly(weight=1.0),)), wbc.InverseDynamics())
    assert soft.status.ok and soft.certificate.ok
    over = [np.maximum(np.abs(command.tau) - 8.0, 0.0).sum() for command in (soft, bare)]
    assert over[0] < 0.9 * over[1]
    assert set(soft.f) == set(bare.f)


def test_a_soft_constraint_names_its_rows_and_its_slack(arm: PinocchioModel) -> None:
    stack = reach(arm, T.JointVelocityLimits(0.02).softly(weight=2.0), Ceiling(0.3).softly())
    plan = wbc.VelocityLevel().compile(arm, stack, dt=0.01)
    names = [str(row) for row in plan.problem.rows]
    assert f"JointVelocityLimits softly: {arm.joint_names[0]}" in names
    assert f"JointVelocityLimits softly: slack: {arm.joint_names[0]}" in names
    assert [row.unit for row in plan.problem.rows if row.owner == "Ceiling at 0.3 softly"] == ["m/s"]
    assert "JointVelocityLimits softly(weight=2.0)" in repr(stack)


# ---- one task, three uses: a task, an equality, an interval; with the same error in the same units
ROBOTS = robots()
ARM = ROBOTS[0]
TOOL = ARM.frame_names[-1]
#: Tasks that have an error in every row.
MEMBERS = [
    member
    for _, member in sorted(vars(T).items())
    if isinstance(member, type)
    and issubclass(member, Task)
    and member.__name__ not in ("ProjectedGradient", "Rolling", "OmniWheel")
]


@pytest.mark.parametrize("robot", ROBOTS, ids=lambda robot: robot.name)
@pytest.mark.parametrize("member", MEMBERS, ids=lambda member: member.__name__)
def test_any_task_with_an_error_is_a_barrier(member: Any, robot: Any):
    for sample in member.samples(robot):
        sample.prepare(robot)
        turns = rotation_blocks([sample.unit(i) for i in range(sample.dim)]) if not sample.on_joints else []
        if turns or not sample.gains()[0].any():
            continue
        check_constraint(sample.within(-0.3, 0.2), robot)


@pytest.mark.parametrize("level", [wbc.VelocityLevel(), wbc.AccelerationLevel()], ids=lambda level: level.name)
def test_a_hand_follows_within_its_tolerance_and_no_nearer_than_it_must(level: Any):
    start = ARM.state()
    start.update(0.0, ARM.q0 + 0.5, np.zeros(7))
    path = T.Sinusoid(start.frame(TOOL).position, amplitude=[0.0, 0.15, 0.0], frequency=0.5, ramp=1.0)
    follow = T.Position(TOOL, target=path)
    stack = wbc.Stack(
        [T.Posture(start.q, kp=25.0)], subject_to=[follow.within(0.05, rate=20.0), T.JointVelocityLimits(20.0)]
    )
    controller = wbc.Controller(ARM, stack, level=level, dt=2e-3)
    q, v, found = start.q.copy(), np.zeros(7), []
    for tick in range(1500):
        command = controller.tick(2e-3 * tick, q, v)
        assert command.status.ok
        q, v = command.q, command.v
        start.update(2e-3 * (tick + 1), q, v)
        found.append(path(2e-3 * (tick + 1))[0] - start.frame(TOOL).position)
    largest = np.abs(found).max(axis=0)
    assert largest.max() < 0.0501 and largest[1] > 0.045


def test_an_interval_may_be_one_sided_and_may_be_a_wish():
    apart = T.Distance(TOOL, to=[0.0, 0.0, 0.3], target=0.4)
    constraint = apart.within(-np.inf, 0.0)  # e = 0.4 - r <= 0: at least 0.4 m apart
    constraint.prepare(ARM)
    assert constraint.dim == 1 and constraint.label(0) == "<=" and constraint.unit(0) == "m"
    stack = wbc.Stack([constraint.softly(weight=10.0), T.Posture(ARM.q0, weight=1e-3)])
    assert wbc.Controller(ARM, stack, level=wbc.VelocityLevel()).tick(0.0, ARM.q0, np.zeros(7)).status.ok


def test_bounds_are_said_in_the_units_and_by_the_rows_of_the_task():
    constraint = T.Frame(TOOL, target=np.eye(4)).within([-0.1, -0.1, -0.1, -0.5, -np.inf, -0.5], 0.6)
    constraint.prepare(ARM)
    assert constraint.dim == 11
    assert [(constraint.label(i), constraint.unit(i)) for i in (0, 4, 10)] == [
        ("x >=", "m"),
        ("yaw >=", "rad"),
        ("yaw <=", "rad"),
    ]


def test_rows_that_ask_for_velocities_have_no_interval():
    wheel = T.Rolling(TOOL, radius=0.1, ground=0.0)
    with pytest.raises(InvalidInput, match="row 0 has kp = 0, so it is a velocity task"):
        wheel.within(0.1).prepare(ARM)
    constraint = wheel.within([-np.inf, -np.inf, -0.1], np.inf)
    constraint.prepare(ARM)
    assert [constraint.label(i) for i in range(constraint.dim)] == ["height >="]


def test_tolerances_count_on_both_sides():
    constraint = T.CenterOfMass(target=[0.0, 0.0, 0.8]).within([0.1, 0.2, 0.3])
    constraint.prepare(ROBOTS[2])
    assert constraint.dim == 6 and constraint.name == "CenterOfMass within"


@pytest.mark.parametrize(
    ("bounds", "which"),
    [
        (("abc",), "tolerance"), (([[1.0, 2.0], [3.0]],), "tolerance"), ((None,), "tolerance"), ((1j,), "tolerance"),
        (("abc", 1.0), "lower"), ((0.0, [[1.0, 2.0], [3.0]]), "upper"),
    ],
)  # fmt: skip
def test_bounds_that_are_no_numbers_are_refused_by_name(bounds: Any, which: str):
    with pytest.raises(InvalidInput, match=rf"Position\[{TOOL}\] within.{which} must be an array of numbers, not"):
        T.Position(TOOL, target=[0.3, 0.0, 0.5]).within(*bounds)
