"""A fault is found, named and answered inside the running stack; without the answer the task is lost."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wbc
from tasks import (
    Brake,
    Cap,
    Compensate,
    Comply,
    ContactForce,
    ContactSchedule,
    Derate,
    FaultReaction,
    JointAdmittance,
    JointPositionLimits,
    JointVelocity,
    MomentumObserver,
    Position,
    Posture,
    Release,
    Retarget,
    Sinusoid,
    Stop,
    Thresholds,
    TorqueLimits,
    Weigh,
    When,
    feet,
)
from tasks.components.diagnosis import Diagnosis
from tasks.components.draft import Draft
from tasks.components.reactions import Reaction
from wbc.errors import NotSupported
from wbc.sim.actuator_fault import ActuatorFault
from wbc.sim.disturbance import SensorNoise
from wbc.sim.plant import ForwardDynamicsPlant
from wbc.sim.simulate import simulate

ARM = wbc.load("arm")
SHOULDER = ARM.joint_names[1]
WAVE = Posture(Sinusoid(ARM.q0, amplitude=0.3, frequency=0.5))
TABLE = [
    When("total", [Release()]), When("partial", [Derate()]), When("bias", [Compensate()]), When("saturation", [Cap()]),
]  # fmt: skip
#: From this one on the joint is asked for between 7 and 37 N m, always downwards.
FAULT = 0.5


LIMITS = (TorqueLimits(), JointPositionLimits())


def watched(
    table: Sequence[When], *tasks: Any, brought_back: bool = True, threshold: Any = 0.3, subject_to: Any = LIMITS,
    **settings: Any,
) -> tuple[wbc.Controller, FaultReaction, ForwardDynamicsPlant]:  # fmt: skip
    """The arm under these tasks, its motors watched, and at rest in a plant."""
    observer = MomentumObserver(gain=100.0, threshold=threshold, persistence=2, release=0.5)
    reaction = FaultReaction(observer, table=table, **{"start": 0.0} | settings)
    back = [reaction.limits] if brought_back else []
    stack = wbc.Stack([*tasks, *back], subject_to=subject_to, components=[observer, reaction])
    plant = ForwardDynamicsPlant(ARM)
    plant.reset(ARM.q0)
    return wbc.Controller(ARM, stack, level=wbc.InverseDynamics()), reaction, plant


def failing(controller: wbc.Controller, plant: ForwardDynamicsPlant, duration: float = 0.05, **fault: Any) -> wbc.Run:
    """A run in which the motor of the shoulder fails."""
    return simulate(controller, plant, duration=duration, disturbances=[ActuatorFault(joint=SHOULDER, **fault)])


def driven(
    table: Sequence[When], duration: float = 1.9, *, noise: float = 0.0, tasks: Sequence[Any] = (),
    brought_back: bool = True, **fault: Any,
) -> tuple[wbc.Run, FaultReaction]:  # fmt: skip
    """The arm waves while its shoulder fails."""
    known = Thresholds.predicted(ARM.state(), velocity=noise, gain=100.0, dt=1e-3, floor=0.3)
    controller, reaction, plant = watched(
        table, WAVE, *tasks, brought_back=brought_back, threshold=known.value, start=0.1, noise=known.noise
    )
    faults = [ActuatorFault(joint=SHOULDER, start=FAULT, **fault), SensorNoise(velocity=noise)]
    return simulate(controller, plant, duration=duration, disturbances=faults), reaction


def worst(run: wbc.Run) -> float:
    """Largest error of the wave in the last half second [rad]."""
    return float(np.abs(run["error.Posture"][-500:]).max())


FAULTS: dict[str, dict[str, float]] = {
    "partial": {"effectiveness": 0.4},
    "bias": {"effectiveness": 1.0, "bias": 4.0},
    "bias that looks like a share": {"effectiveness": 1.0, "bias": -12.0},
}


@pytest.mark.parametrize("kind", FAULTS)
def test_with_the_answer_the_wave_goes_on_and_without_it_is_lost(kind: str) -> None:
    lost, _ = driven([], **FAULTS[kind])
    kept, reaction = driven(TABLE, **FAULTS[kind])
    assert worst(lost) > 0.1
    assert worst(kept) < 0.02 * worst(lost)
    last, _ = reaction.events[-1]
    assert (last.kind, last.joint_name) == (kind.split()[0], SHOULDER)


def test_a_motor_that_saturates_is_known_by_its_ceiling_and_is_not_asked_for_more() -> None:
    run, reaction = driven(TABLE, effectiveness=1.0, ceiling=34.0)
    last, _ = reaction.events[-1]
    assert last.kind == "saturation"
    assert last.ceiling == pytest.approx(34.0, abs=0.1)
    assert np.abs(run["tau"][-300:, 1]).max() <= last.ceiling + 1e-9
    uncapped, _ = driven([], effectiveness=1.0, ceiling=34.0)
    assert np.abs(uncapped["tau"][-300:, 1]).max() > 36.0


def test_the_answer_is_in_the_problem_of_the_tick_of_the_decision() -> None:
    """No torque is asked of a dead joint from that tick on, and its limits do not bind it; nothing was compiled."""
    run, reaction = driven(TABLE, duration=1.1)
    ((diagnosis, reactions),) = reaction.events
    assert diagnosis.kind == "total"
    assert [type(r) for r in reactions] == [Release]
    tick = round(diagnosis.t * 1e3)
    assert tick - FAULT * 1e3 <= 4
    assert np.abs(run["tau"][tick - 1, 1]) > 5.0
    assert not run["tau"][tick:, 1].any()
    assert run["signal.FaultReaction.kind"][tick] == 1.0
    assert np.count_nonzero(run["signal.FaultReaction.kind"]) == 1
    assert (run["signal.FaultReaction.share"][tick:, 1] == 0.0).all()
    residual = run["signal.MomentumObserver.residual"][tick]
    assert np.flatnonzero(residual == 0.0).tolist() == [1], "the residual of its joint starts anew, and no other"
    assert (run["status"] == 0).all(), "a joint that falls through its limits must not contradict them"
    assert run["plant.q"][:, 1].max() > ARM.limits.q_max[1] or run["plant.q"][:, 1].min() < ARM.limits.q_min[1]


@settings(max_examples=5)
@given(lost=st.floats(0.25, 0.75))
def test_the_share_lost_is_known_from_the_first_tick_after_the_alarm(lost: float) -> None:
    """Residual and command restart together, so the lag of the observer is in neither."""
    _, reaction = driven(TABLE, duration=0.7, effectiveness=1.0 - lost)
    diagnosis, _ = reaction.events[0]
    assert diagnosis.kind == "partial"
    assert diagnosis.share == pytest.approx(lost, abs=0.01)
    assert diagnosis.t - FAULT < 4.5e-3


def test_a_push_on_one_joint_that_looks_like_a_dead_motor_is_told_from_one() -> None:
    """It goes on when the motor is sent nothing: the motor is sound, and everything is as before."""
    sound, _ = driven(TABLE, duration=FAULT, effectiveness=1.0)
    push = 0.95 * float(sound["tau"][-1, 1])
    run, reaction = driven(TABLE, duration=0.8, effectiveness=1.0, bias=push)
    (first, released), (second, done) = reaction.events[:2]
    assert (first.kind, second.kind, second.instead_of) == ("total", "external", (1,))
    assert [type(r) for r in released] == [Release] and not done
    assert second.t - first.t == pytest.approx(0.1, abs=2e-3)
    before, after = round(first.t * 1e3), round(second.t * 1e3)
    assert not run["tau"][before:after, 1].any()
    assert (run["signal.FaultReaction.share"][after:] == 1.0).all()
    assert np.abs(run["tau"][after:, 1]).min() > 0.0, "its motor is asked again"


def test_what_is_taken_back_for_one_motor_stays_for_another() -> None:
    """A weak elbow is still asked for more after the shoulder's motor was acquitted."""
    elbow = ARM.joint_names[3]
    sound, _ = driven(TABLE, duration=FAULT, effectiveness=1.0)
    push = 0.95 * float(sound["tau"][-1, 1])
    controller, reaction, plant = watched(TABLE, WAVE, lockout=0.1)
    faults = [ActuatorFault(joint=elbow, effectiveness=0.5, start=0.1),
              ActuatorFault(joint=SHOULDER, effectiveness=1.0, bias=push, start=FAULT)]  # fmt: skip
    run = simulate(controller, plant, duration=0.8, disturbances=faults)
    decided = [(d.kind, d.joint_name) for d, _ in reaction.events]
    assert decided[0] == ("partial", elbow) and ("total", SHOULDER) in decided
    acquitted = next(d for d, _ in reaction.events if d.instead_of)
    after = round(acquitted.t * 1e3)
    share = run["signal.FaultReaction.share"]
    assert share[after - 1, 1] == 0.0 and share[after, 1] == 1.0
    np.testing.assert_allclose(share[after - 1 : after + 1, 3], 0.5, atol=0.02)
    limits = controller.plan.torque_bounds
    assert limits[1][1] == ARM.limits.tau_max[1]
    assert limits[1][3] == pytest.approx(0.5 * ARM.limits.tau_max[3], rel=0.05)


def test_with_noise_it_waits_until_the_share_is_known() -> None:
    run, reaction = driven(TABLE, noise=0.01, effectiveness=0.5)
    diagnosis, _ = reaction.events[0]
    assert (diagnosis.kind, diagnosis.joint_name) == ("partial", SHOULDER)
    assert diagnosis.share == pytest.approx(0.5, abs=0.25)
    assert worst(run) < 0.05
    assert run["signal.FaultReaction.share"][-1, 1] == pytest.approx(0.5, abs=0.1)


def test_a_reset_takes_everything_back() -> None:
    posture = Posture(ARM.q0, kp=50.0)
    answer = When("total", [Release(), Weigh("Posture", 3.0), Comply()])
    controller, reaction, plant = watched([answer], posture)
    first = controller.tick(0.0, ARM.q0, np.zeros(ARM.nv))
    limits = controller.plan.bounds("position")
    failing(controller, plant, 0.1)
    assert reaction.events
    changed = controller.plan.stack.tasks[0]
    assert (changed.weights() == 3.0).all() and not np.any(changed.kp)
    assert (posture.weight, posture.kp, posture.kd) == (1.0, 50.0, None), "what the user holds stays as it is"
    assert controller.plan.torque_bounds[1][1] == 0.0
    assert controller.plan.bounds("position")[1][1] == np.inf
    controller.reset()
    again = controller.tick(0.0, ARM.q0, np.zeros(ARM.nv))
    assert (changed.weight, changed.kp, changed.kd) == (1.0, 50.0, None)
    assert not reaction.events
    np.testing.assert_array_equal(again.tau, first.tau)
    np.testing.assert_array_equal(controller.plan.bounds("position"), limits)


def test_tasks_no_longer_pull_a_released_joint_and_still_damp_it() -> None:
    controller, _, plant = watched([When("total", [Release()])], Posture(ARM.q0, kp=50.0))
    failing(controller, plant)
    kp, kd, _ = controller.plan.stack.tasks[0].gains()
    np.testing.assert_array_equal(kp, np.where(np.arange(ARM.nj) == 1, 0.0, 50.0))
    np.testing.assert_allclose(kd, 2.0 * np.sqrt(50.0))


@pytest.mark.parametrize(
    "reaction, kp, active",
    [(Release(), [50.0, 0.0], [True, True]), (Comply(0.1), [5.0, 5.0], [True, True]), (Stop(), [50.0, 50.0], [1, 0])],
    ids=["Release", "Comply", "Stop"],
)
def test_a_decision_holds_for_the_tasks_of_a_stack_that_replaces_its_own(
    reaction: Any, kp: list[float], active: list[bool]
) -> None:
    controller, answers, plant = watched([When("total", [reaction])], Posture(ARM.q0, kp=50.0, name="one"))
    failing(controller, plant)
    assert answers.events
    reach = Position("tool", target=ARM.state().frame("tool").position, weight=0.1)
    other = [Posture(ARM.q0, kp=50.0, name="two"), reach]
    controller.replace(wbc.Stack(other, subject_to=LIMITS, components=controller.stack.components))
    assert controller.tick(0.05, plant.q, plant.v).status.ok, controller.explain()
    posture, reach = controller.plan.stack.tasks
    np.testing.assert_allclose(posture.gains()[0][:2], kp)
    assert [posture.active, reach.active] == active


def test_a_brake_leaves_the_joint_at_rest_and_its_torque_free() -> None:
    braked: list[str] = []
    reach = Position("tool", target=ARM.state().frame("tool").position + 0.1)
    table = [When("total", [Brake(braked.append)])]
    controller, reaction, plant = watched(table, reach, Posture(ARM.q0, weight=1e-2), brought_back=False)
    run = failing(controller, plant, start=0.02)
    assert braked == [SHOULDER]
    after = round(reaction.events[0][0].t * 1e3)
    assert np.abs(run["a"][:after, 1]).max() > 1e-3
    assert np.abs(run["a"][after:, 1]).max() < 1e-8
    assert not run["tau"][after:, 1].any(), "the motor is sent nothing"


def test_other_reactions_change_the_tasks_they_speak_of() -> None:
    goal = ARM.q0 + 0.1
    table = [When("total", [Weigh("Position[tool]", 0.0), Retarget("Posture", goal)], joints=[SHOULDER])]
    reach = Position("tool", target=[0.4, 0.2, 0.5])
    run, reaction = driven(table, duration=0.7, tasks=[reach])
    assert len(reaction.events[0][1]) == 2
    tick = round(reaction.events[0][0].t * 1e3)
    jump = np.abs(np.diff(run["error.Posture"], axis=0)).max(axis=1)
    assert jump.argmax() == tick - 1, "the posture has another target from then on"
    assert reach.weight == 1.0, "what the user holds stays as it is"
    _, reaction = driven([When("total", [Release()], joints=[ARM.joint_names[0]])], duration=0.7)
    assert reaction.events[0][1] == (), "the line is about another joint"


def test_a_stop_holds_the_robot_where_it_is() -> None:
    reach = Position("tool", target=[0.4, 0.2, 0.5])
    run, reaction = driven([When("partial", [Derate(), Stop()])], tasks=[reach], effectiveness=0.5)
    tick = round(reaction.events[0][0].t * 1e3)
    assert reach.active, "what the user holds stays as it is"
    assert np.abs(run["plant.q"][-1] - run["plant.q"][tick]).max() < 0.05
    assert np.abs(run["plant.v"][-1]).max() < 1e-2


def test_a_released_joint_is_braked_where_it_leaves_its_limits_and_is_not_thrown_back() -> None:
    """−kd v is asked of it there; kp (limit − q) is not."""
    table = [When("total", [Release()], joints=[SHOULDER])]
    controller, _, plant = watched(table, Posture(ARM.q0, weight=1e-6), subject_to=(), recheck=1e3)
    failing(controller, plant)
    rng = np.random.default_rng(1)
    for k in range(30):
        q, v = plant.q + 0.1 * rng.standard_normal(ARM.nj), 0.5 * rng.standard_normal(ARM.nv)
        limit, side = ((ARM.limits.q_max[1], 1.0), (ARM.limits.q_min[1], -1.0))[k % 2]
        q[1] = limit + side * rng.uniform(0.01, 0.5)
        a = controller.tick(plant.t + k * controller.dt, q, v).a
        assert a[1] == pytest.approx(-40.0 * v[1], rel=1e-2, abs=0.1)


def test_only_released_joints_beyond_their_limits_count() -> None:
    limits, state = FaultReaction(MomentumObserver(gain=100.0)).limits, ARM.state()
    beyond = ARM.limits.q_max + 0.1
    state.update(0.0, np.where(np.isin(np.arange(ARM.nj), [1, 2]), beyond, ARM.q0), np.zeros(ARM.nv))
    for released in ((1,), ()):
        assert tuple(np.flatnonzero(limits.wanted(state, released))) == released


def test_a_stack_with_the_task_pulls_from_when_a_released_joint_is_about_to_leave_its_limits() -> None:
    pulled, free = (driven(TABLE, duration=1.1, brought_back=brought_back)[0] for brought_back in (True, False))
    soon = free["plant.q"][:, 1] + 0.05 * free["plant.v"][:, 1]
    leaves = int((np.abs(soon) > ARM.limits.q_max[1]).argmax())
    np.testing.assert_allclose(pulled["tau"][:leaves], free["tau"][:leaves], rtol=0, atol=1e-6)
    assert np.abs(pulled["tau"][leaves + 1] - free["tau"][leaves + 1]).max() > 1.0


# ---- however tasks were written, what a reaction changes is the same
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


def reacting(tasks: list[Any], *reactions: Reaction) -> wbc.Controller:
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
    for written in WRITTEN[joints]:
        target = ARM.q0 if joints == "all" else ARM.q0[:3]
        control = reacting([Posture(target, name="Posture", **written), reach], *reactions)
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
    control = reacting([*velocities, Posture(ARM.q0, kp=100.0, weight=1e-2)], Stop())
    q, v = Q, np.full(ARM.nv, 0.5)
    control.tick(0.0, q, v)
    for k in range(1, 1500):
        command = control.tick(k * control.dt, q, v)
        q, v = command.q, command.v
    assert command.status.ok and np.abs(v).max() <= 1e-3 and np.abs(q - Q).max() <= 1e-3
    with pytest.raises(NotSupported, match="Stop holds"):
        reacting(velocities, Stop())


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
