"""One task, three uses: a task, an equality, an interval; with the same error in the same units."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import tasks
import wbc
from tasks import CenterOfMass, Distance, Frame, JointVelocityLimits, Position, Posture, Rolling, Sinusoid
from wbc.errors import InvalidInput
from wbc.stack.task import Task
from wbc.testing import check_constraint, robots
from wbc.testing.differences import rotation_blocks

ROBOTS = robots()
ARM = ROBOTS[0]
TOOL = ARM.frame_names[-1]
#: Tasks that have an error in every row.
MEMBERS = [
    member
    for _, member in sorted(vars(tasks).items())
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
    path = Sinusoid(start.frame(TOOL).position, amplitude=[0.0, 0.15, 0.0], frequency=0.5, ramp=1.0)
    follow = Position(TOOL, target=path)
    stack = wbc.Stack(
        [Posture(start.q, kp=25.0)], subject_to=[follow.within(0.05, rate=20.0), JointVelocityLimits(20.0)]
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
    apart = Distance(TOOL, to=[0.0, 0.0, 0.3], target=0.4)
    constraint = apart.within(-np.inf, 0.0)  # e = 0.4 - r <= 0: at least 0.4 m apart
    constraint.prepare(ARM)
    assert constraint.dim == 1 and constraint.label(0) == "<=" and constraint.unit(0) == "m"
    stack = wbc.Stack([constraint.softly(weight=10.0), Posture(ARM.q0, weight=1e-3)])
    assert wbc.Controller(ARM, stack, level=wbc.VelocityLevel()).tick(0.0, ARM.q0, np.zeros(7)).status.ok


def test_bounds_are_said_in_the_units_and_by_the_rows_of_the_task():
    constraint = Frame(TOOL, target=np.eye(4)).within([-0.1, -0.1, -0.1, -0.5, -np.inf, -0.5], 0.6)
    constraint.prepare(ARM)
    assert constraint.dim == 11
    assert [(constraint.label(i), constraint.unit(i)) for i in (0, 4, 10)] == [
        ("x >=", "m"),
        ("yaw >=", "rad"),
        ("yaw <=", "rad"),
    ]


def test_rows_that_ask_for_velocities_have_no_interval():
    wheel = Rolling(TOOL, radius=0.1, ground=0.0)
    with pytest.raises(InvalidInput, match="row 0 has kp = 0, so it is a velocity task"):
        wheel.within(0.1).prepare(ARM)
    constraint = wheel.within([-np.inf, -np.inf, -0.1], np.inf)
    constraint.prepare(ARM)
    assert [constraint.label(i) for i in range(constraint.dim)] == ["height >="]


def test_tolerances_count_on_both_sides():
    constraint = CenterOfMass(target=[0.0, 0.0, 0.8]).within([0.1, 0.2, 0.3])
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
        Position(TOOL, target=[0.3, 0.0, 0.5]).within(*bounds)
