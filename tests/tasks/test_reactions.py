"""What a reaction changes does not depend on how tasks were written, and a stop stops."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import wbc
from tasks import (
    Comply,
    ContactForce,
    ContactSchedule,
    JointAdmittance,
    JointVelocity,
    Position,
    Posture,
    Release,
    Stop,
    TorqueLimits,
    Weigh,
    feet,
)
from tasks.components.diagnosis import Diagnosis
from tasks.components.draft import Draft
from tasks.components.reactions import Reaction
from wbc.errors import NotSupported

ARM = wbc.load("arm")
Q = ARM.q0 + 0.3
STILL = np.zeros(ARM.nv)
DIAGNOSIS = Diagnosis("total", 1, ARM.joint_names[1], alarmed=0.0, t=0.0, missing=np.zeros(ARM.nj))
FIRST, SOME = ARM.joint_names[0], ARM.joint_names[:3]
#: The same gains and weights, written in several ways: of all joints, and of some.
KP, KD, WEIGHT = (np.where(np.arange(ARM.nj) == 0, 2.0 * x, x) for x in (30.0, 8.0, 0.5))
WRITTEN: dict[str, list[dict[str, Any]]] = {
    "all": [
        {"kp": KP, "kd": KD, "weight": WEIGHT},
        {"kp": {".*": 30.0, FIRST: 60.0}, "kd": {".*": 8.0, FIRST: 16.0}, "weight": list(WEIGHT)},
    ],
    "some": [
        {"joints": SOME, "kp": KP[:3], "kd": KD[:3], "weight": WEIGHT[:3]},
        {"joints": SOME, "kp": KP, "kd": KD, "weight": WEIGHT},
        {"joints": SOME, "kp": {".*": 30.0, FIRST: 60.0}, "kd": KD, "weight": {".*": 0.5, FIRST: 1.0}},
    ],
}  # fmt: skip


class Reacts(wbc.Component):
    """The reactions to a diagnosis in the second tick, which stand from then on."""

    def __init__(self, *reactions: Reaction) -> None:
        super().__init__()
        self.reactions = reactions
        self.said: wbc.Overrides | None = None

    def check(self, plan: Any) -> None:
        for reaction in self.reactions:
            reaction.prepare(plan)

    def before(self, state: Any, last: Any, plan: Any) -> wbc.Overrides | None:
        if last is not None and self.said is None:
            draft = Draft(plan)
            for reaction in self.reactions:
                reaction.apply(DIAGNOSIS, reaction.decide(DIAGNOSIS, state, plan), draft)
            self.said = draft.overrides()
        return self.said


def controller(tasks: list[Any], *reactions: Reaction) -> wbc.Controller:
    """Of the arm at the level of torques."""
    stack = wbc.Stack(tasks, subject_to=[TorqueLimits()], components=[Reacts(*reactions)])
    return wbc.Controller(ARM, stack, level=wbc.InverseDynamics())


@pytest.mark.parametrize("joints", WRITTEN)
@pytest.mark.parametrize(
    "reactions",
    [(Release(),), (Comply(0.5, 2.0),), (Weigh("Posture", 0.1),), (Release(), Comply(0.5), Weigh("Posture", 3.0))],
    ids=lambda reactions: " ".join(type(reaction).__name__ for reaction in reactions),
)
def test_reactions_are_the_same_however_gains_and_weights_are_written(
    joints: str, reactions: tuple[Reaction, ...]
) -> None:
    reach = Position("tool", target=[0.4, 0.2, 0.5])
    commands = []
    for settings in WRITTEN[joints]:
        target = ARM.q0 if joints == "all" else ARM.q0[:3]
        control = controller([Posture(target, name="Posture", **settings), reach], *reactions)
        for k in range(2):
            command = control.tick(k * control.dt, Q, STILL)
            assert command.status.ok, control.explain()
        commands.append(command)
    for command in commands[1:]:
        np.testing.assert_allclose(command.tau, commands[0].tau, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    "velocities",
    [[JointVelocity(np.full(ARM.nj, 0.5))], [JointAdmittance(ARM.q0, inertia=1.0, damping=5.0, stiffness=0.0)]],
    ids=["velocity", "admittance without stiffness"],
)
def test_a_stop_drops_tasks_on_the_velocities_of_joints(velocities: list[Any]) -> None:
    """A configuration is no velocity: it would be run at."""
    control = controller([*velocities, Posture(ARM.q0, kp=100.0, weight=1e-2)], Stop())
    q, v = Q, np.full(ARM.nv, 0.5)
    control.tick(0.0, q, v)
    for k in range(1, 1500):
        command = control.tick(k * control.dt, q, v)
        q, v = command.q, command.v
    assert command.status.ok and np.abs(v).max() <= 1e-3 and np.abs(q - Q).max() <= 1e-3
    with pytest.raises(NotSupported, match="Stop holds"):
        controller(velocities, Stop())


@pytest.mark.parametrize("reaction, share", [(Weigh("pressing", 0.25), 0.25), (Stop(), 0.0)], ids=["Weigh", "Stop"])
def test_a_task_on_the_force_of_an_open_contact_is_changed_too(reaction: Reaction, share: float) -> None:
    """The decision falls while the foot is up, and holds when it is down again."""
    robot = wbc.load("quadruped")
    held = feet(robot)
    names, up = [foot.name for foot in held], held[0].name
    pressing = ContactForce(up, target=[0.0, 0.0, 30.0], weight=0.01, name="pressing")
    steps = ContactSchedule([(0.0, names[1:]), (0.005, names)])
    stack = wbc.Stack(
        [Posture(robot.q0), pressing], contacts=held, subject_to=[TorqueLimits()], components=[steps, Reacts(reaction)]
    )
    control = wbc.Controller(robot, stack, level=wbc.InverseDynamics())
    for k in range(10):
        command = control.tick(k * control.dt, robot.q0, np.zeros(robot.nv))
        assert command.status.ok, control.explain()
    (task,) = (task for task in control.plan.stack.tasks if task.name == "pressing")
    np.testing.assert_allclose(task.weights(), share * pressing.weights())
