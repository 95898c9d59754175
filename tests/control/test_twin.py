"""A dry tick has no effect: commands, memory and what users gave are the same with and without it, bit for bit."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

import wbc
import wbc.tasks as T
from wbc.control.twin import Twin
from wbc.models.geometry import Sphere
from wbc.testing import robots
from wbc.types import Vec

ARM, _, HUMANOID = robots()
HIERARCHIES = [wbc.Weighted(), wbc.Strict(), wbc.Scaled()]
LEVELS = [wbc.VelocityLevel(), wbc.AccelerationLevel(), wbc.InverseDynamics()]


class Learner(wbc.Component):
    """Remembers everything it hears, and pushes by what it has heard."""

    def __init__(self) -> None:
        super().__init__()
        self.heard: list[bytes] = []

    def before(self, state: Any, last: Any, plan: Any) -> wbc.Overrides | None:
        self.heard.append(state.q.tobytes())
        if plan.level.order == 1:
            return None
        return wbc.Overrides(tasks={"Posture": {"weight": 1e-2 + 1e-4 * len(self.heard)}})

    def after(self, state: Any, command: Any) -> None:
        self.heard.append(command.a.tobytes() + command.v.tobytes())


def described(controller: wbc.Controller, command: Any) -> list[Any]:
    """Everything of a controller that the next tick, a report or a user could see."""
    plan = controller.plan
    problem = plan.problem
    memory = [problem.G, problem.bounds, problem.value, problem.metric, problem.centre, problem.weights, plan.motion.e]
    members = [
        (name, array.tobytes())
        for member in (*plan.stack.tasks, *plan.stack.subject_to)
        for name, array in sorted(member.__dict__.items())
        if isinstance(array, np.ndarray)
    ]
    watch = controller.watch
    return [
        *(x.tobytes() for x in (command.q, command.v, command.a, command.tau)),
        command.status, command.fallback_level, controller.why, controller.ticks, controller.serial,
        controller.active_count,
        *(x.tobytes() for x in memory), *members, controller.state.q.tobytes(), controller.state.t,
        repr(controller.counts),
        dict(controller.fallbacks.counts), len(controller.fallbacks.log), watch.late, watch.stale, watch.backwards,
        [component.heard for component in controller.components if isinstance(component, Learner)],
        [pickle.dumps(component.signals()) for component in controller.components],
    ]  # fmt: skip


def reaching(asked: list[float], level: Any, hierarchy: Any) -> wbc.Controller:
    """An arm with a ball in its way, a target that counts its calls, and a component that learns."""

    def target(t: float) -> Vec:
        asked.append(t)
        return np.array([0.4, 0.3 * np.sin(3.0 * t), 0.5])

    ball = T.Obstacle("ball", Sphere(0.05), ARM.state().frame("tool").placement)
    constraints = [T.JointLimits(), T.CollisionAvoidance([ball]), *([T.TorqueLimits()] if level.dynamics else [])]
    tasks = [[T.Position("tool", target=target)], [T.Posture(ARM.q0, weight=1e-2)]]
    return wbc.Controller(
        ARM, wbc.Stack(tasks, subject_to=constraints, components=[Learner()]), level=level, hierarchy=hierarchy
    )  # fmt: skip


def stepping(asked: list[float], level: Any, hierarchy: Any) -> wbc.Controller:
    """A humanoid that lifts a foot."""
    state = HUMANOID.state()
    com, soles = np.array(state.com), list(HUMANOID.feet)

    def target(t: float) -> Vec:
        asked.append(t)
        return com + np.array([0.0, 0.02 * np.sin(5.0 * t), 0.0])

    contacts = [T.Sole(name, half_size=(0.08, 0.04), friction=0.6) for name in soles]
    timeline = [(0.0, soles), (0.02, soles[:1]), (0.04, soles)]
    stack = wbc.Stack(
        [
            [T.CenterOfMass(target=target)],
            [T.Orientation("pelvis", target=np.eye(3)), T.Posture(HUMANOID.q0, weight=1e-2)],
        ],
        subject_to=[T.JointLimits(), T.TorqueLimits()],
        contacts=contacts,
        components=[T.ContactSchedule(timeline), Learner()],
    )
    return wbc.Controller(HUMANOID, stack, level=level, hierarchy=hierarchy)


def told(make: Any, level: Any, hierarchy: Any, seed: int, *, dry: bool) -> list[Any]:
    """What a run looks like from outside, tick by tick, with or without dry ticks in between."""
    rng, asked = np.random.default_rng(seed), list[float]()
    controller = make(asked, level, hierarchy)
    twin = Twin(controller) if dry else None
    before = len(asked)
    robot, seen = controller.model, []
    q, v = np.array(robot.q0), np.zeros(robot.nv)
    for k in range(60):
        if rng.random() < 0.1:  # pushed, or not to be believed
            v = v + (0.2 * rng.normal(size=robot.nv) if rng.random() < 0.8 else np.nan)
        times = int(rng.integers(3))
        for _ in range(times if twin is not None else 0):
            assert twin is not None
            twin()
        if k == 30:
            controller.stack.tasks[1].weight = 3e-2
        command = controller.tick(k * 1e-3, q, v)
        seen.append(described(controller, command))
        q, v = command.q, command.v
    return [*seen, asked[before:]]


@pytest.mark.slow
@settings(max_examples=12, phases=[Phase.explicit, Phase.generate])
@given(st.integers(0, 2**32 - 1), st.sampled_from(LEVELS), st.sampled_from(HIERARCHIES), st.booleans())
def test_nobody_notices_a_dry_tick(seed: int, level: Any, hierarchy: Any, steps: bool):
    make, level = (stepping, wbc.InverseDynamics()) if steps else (reaching, level)
    with_dry, without = (told(make, level, hierarchy, seed, dry=dry) for dry in (True, False))
    for k, (one, other) in enumerate(zip(with_dry, without, strict=True)):
        assert one == other, f"tick {k}"


def test_a_dry_tick_does_the_work_of_a_tick():
    """Else it would warm nothing: the twin has filled and solved the same problem."""
    asked: list[float] = []
    controller = reaching(asked, wbc.InverseDynamics(), wbc.Weighted())
    twin = Twin(controller)
    command = controller.tick(0.0, ARM.q0, np.zeros(ARM.nv))
    assert command.status.ok
    twin()
    mirrored = twin._twin
    assert mirrored.status.ok and mirrored.ticks == 1
    np.testing.assert_array_equal(mirrored.plan.problem.G.shape, controller.plan.problem.G.shape)
    np.testing.assert_array_equal(mirrored.state.q, controller.state.q)


def test_what_is_assigned_later_is_not_told_to_the_twin():
    calls: list[float] = []
    controller = reaching([], wbc.AccelerationLevel(), wbc.Weighted())
    twin = Twin(controller)

    def target(t: float) -> Vec:
        calls.append(t)
        return np.full(3, 0.4)

    controller.stack.tasks[0].target = target
    known = len(calls)
    twin()
    assert len(calls) == known


def test_targets_of_tasks_that_other_members_hold_are_not_asked_either():
    asked: list[float] = []

    def target(t: float) -> Any:
        asked.append(t)
        return np.array([0.4, 0.0, 0.5])

    reach = T.Position("tool", target=target)
    stack = wbc.Stack(
        [T.Posture(ARM.q0), T.JointVelocityLimits().softly(), T.Position("forearm", target=target).scaled()],
        subject_to=[reach.within(1.0), T.TorqueLimits()],
        contacts=[T.Position("tool", target=target, name="held").with_reaction()],
    )
    controller = wbc.Controller(ARM, stack, level=wbc.InverseDynamics())
    twin = Twin(controller)
    known = len(asked)
    twin()
    assert len(asked) == known and twin._twin.ticks == 1
    controller.tick(0.0, ARM.q0, np.zeros(ARM.nv))
    assert len(asked) > known


def test_no_function_of_time_is_asked_by_a_twin_or_where_one_is_made():
    """Targets that are read when a plan is made, measured forces and poses of obstacles are such functions too."""
    asked: list[str] = []

    def counted(name: str, value: Any) -> Any:
        return lambda t: (asked.append(name), value)[1]

    place, nothing = ARM.state().frame("tool").placement, np.zeros(ARM.nj)
    joint = T.JointAdmittance(
        counted("admittance", ARM.q0), inertia=1.0, damping=9.0, stiffness=9.0, torque=counted("torque", nothing)
    )
    hand = T.Admittance(
        "tool", target=counted("pose", place), inertia=1.0, damping=9.0, stiffness=9.0,
        wrench=counted("wrench", np.zeros(6)),
    )  # fmt: skip
    ball = T.Obstacle("ball", Sphere(0.05), counted("ball", place))
    moving = (ARM.q0, nothing, nothing)
    stack = wbc.Stack(
        [T.Posture(counted("posture", moving)), joint, hand],
        subject_to=[T.TorqueLimits(), T.CollisionAvoidance([ball])],
    )
    controller = wbc.Controller(ARM, stack, level=wbc.InverseDynamics())
    for ticks in (0, 1):
        known = len(asked)
        twin = Twin(controller)
        twin()
        assert asked[known:] == [] and twin._twin.status.ok, f"after {ticks} ticks"
        controller.tick(0.0, ARM.q0, nothing)
    assert set(asked[known:]) == {"admittance", "torque", "pose", "wrench", "ball", "posture"}


def test_members_that_a_component_sets_are_in_the_twin_without_it():
    law, observer = T.SlotineLi(ARM.q0, kp=100.0, kd=20.0, gain=1.0), T.MomentumObserver(gain=100.0, threshold=1.0)
    reaction = T.FaultReaction(observer)
    for tasks, components in (([law.torque], [law]), ([T.Posture(ARM.q0), reaction.limits], [observer, reaction])):
        stack = wbc.Stack(tasks, subject_to=[T.TorqueLimits()], components=components)
        twin = Twin(wbc.Controller(ARM, stack, level=wbc.InverseDynamics()))
        twin()
        assert twin._twin.status.ok and stack.tasks[-1].set_by is components[-1]
