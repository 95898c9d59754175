"""Commands: what a level does not decide is NaN, and asking for it changes nothing."""

from __future__ import annotations

import numpy as np
import pytest

import wbc
from tasks import ContactSchedule, Edge, JointVelocityLimits, Posture, feet
from wbc.stack.formulation import Formulation


def command(level: Formulation, *constraints: wbc.Constraint) -> wbc.Command:
    """One tick of an arm that is told to move every joint by 0.1 rad."""
    robot = wbc.load("arm")
    stack = wbc.Stack([Posture(robot.q0 + 0.1)], subject_to=constraints)
    return wbc.Controller(robot, stack, level=level).tick(0.0, robot.q0, np.zeros(robot.nv))


def test_asking_for_the_acceleration_leaves_the_next_configuration_alone():
    answer = command(wbc.VelocityLevel())
    assert np.isnan(answer.a).all() and np.isnan(answer.tau).all()
    assert np.isfinite(answer.q).all() and np.isfinite(answer.v).all()


@pytest.mark.parametrize("level", [wbc.VelocityLevel(), wbc.AccelerationLevel(), wbc.InverseDynamics()])
@pytest.mark.parametrize(
    "constraints", [(), (JointVelocityLimits(),), (JointVelocityLimits(1e-4),)], ids=["free", "limited", "held"]
)
def test_a_posture_alone_is_a_stack(level: Formulation, constraints: tuple[wbc.Constraint, ...]):
    answer = command(level, *constraints)
    assert answer.status is wbc.Status.SOLVED
    assert (answer.q > wbc.load("arm").q0).all()


@pytest.mark.parametrize("level", [wbc.VelocityLevel(), wbc.AccelerationLevel(), wbc.InverseDynamics()])
def test_no_array_of_a_command_can_be_written(level: Formulation):
    """The controller goes on from what it commanded, and a loop may hold a command as long as it likes."""
    robot = wbc.load("quadruped")
    stack = wbc.Stack([Posture(robot.q0)], contacts=feet(robot), subject_to=[JointVelocityLimits()])
    controller = wbc.Controller(robot, stack, level=level, recovery=wbc.Recovery(hold_ticks=1))
    made = []
    for q in (robot.q0, *[np.full(robot.nq, np.nan)] * 2):
        decided = controller.tick(controller.dt * len(made), q, np.zeros(robot.nv))
        made.append(decided.fallback_level)
        for values in (decided.q, decided.v, decided.a, decided.tau, *decided.f.values()):
            with pytest.raises(ValueError, match="read-only"):
                values[0] = 0.0
    assert made == ["solved", "hold", "damped"]


def test_a_frame_of_two_contacts_names_neither_of_their_forces():
    """A foot that stands flat or on its toe: by its frame the force would be of either."""
    robot = wbc.load("humanoid")
    left, right = feet(robot)
    toe = Edge(left.frame, half_length=0.05, origin=(0.1, 0.0, 0.0), friction=0.5, name="toe")
    schedule = ContactSchedule([(0.0, [left.name, right.name])])
    stack = wbc.Stack([Posture(robot.q0)], contacts=[left, right, toe], components=[schedule])
    f = wbc.Controller(robot, stack, level=wbc.InverseDynamics()).tick(0.0, robot.q0, np.zeros(robot.nv)).f
    assert f[left.name][2] > 100.0 and (f["toe"] == 0.0).all() and f[right.frame] is f[right.name]
    assert left.frame not in f and f.get(left.frame) is None
    with pytest.raises(KeyError, match="did you mean"):
        f[left.frame]
