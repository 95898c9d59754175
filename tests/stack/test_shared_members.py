"""Members are settings: one object serves several controllers, robots and threads, and each keeps what is its own."""

from __future__ import annotations

import copy
import threading
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tasks as T
import wbc
from tests.stack.conftest import Saying, moving, standing
from wbc.errors import InvalidInput, NotSupported, WbcError
from wbc.stack.member import UnknownSetting, bound

ARM, QUADRUPED, HUMANOID = wbc.load("arm"), wbc.load("quadruped"), wbc.load("humanoid")
LEVELS = [wbc.VelocityLevel(), wbc.AccelerationLevel(), wbc.InverseDynamics()]


def decided(robot: Any, tasks: list[Any], level: Any, **stack: Any) -> wbc.Controller:
    return wbc.Controller(robot, wbc.Stack(tasks, **stack), level=level)


def answer(controller: wbc.Controller, q: Any, v: Any, t: float = 0.0) -> Any:
    command = controller.tick(t, q, v)
    assert command.status.ok, controller.why
    return command.v if controller.level.order == 1 else command.a


@pytest.mark.parametrize("level", LEVELS, ids=repr)
@given(
    weight=st.floats(0.01, 100.0), kd=st.floats(1.0, 50.0), which=st.sampled_from(["weight", "kd", "active"]),
    seed=st.integers(0, 9),
)  # fmt: skip
@pytest.mark.filterwarnings("ignore::wbc.models.plausible.NothingHoldsTheBase")
def test_one_task_on_two_robots_is_as_two_tasks(level: Any, weight: float, kd: float, which: str, seed: int) -> None:
    """And what is assigned to it between ticks holds on both."""
    shared = T.Damping(kd=10.0, name="shared")
    robots = [ARM, HUMANOID]
    both = [decided(robot, [shared, T.Posture(robot.q0, weight=0.5)], level) for robot in robots]
    states = [moving(robot, seed) for robot in robots]
    for controller, state in zip(both, states, strict=True):
        controller.tick(0.0, *state)
    value: Any = {"weight": weight, "kd": kd, "active": False}[which]
    setattr(shared, which, value)
    for controller, robot, state in zip(both, robots, states, strict=True):
        alone = T.Damping(kd=10.0, name="shared")
        setattr(alone, which, value)
        other = decided(robot, [alone, T.Posture(robot.q0, weight=0.5)], level)
        np.testing.assert_allclose(answer(controller, *state), answer(other, *state), rtol=1e-9, atol=1e-9)


def test_what_depends_on_the_model_is_not_in_the_member() -> None:
    posture, damping = T.Posture(ARM.q0), T.Damping()
    fingers = T.Position("tool", target=[0.4, 0.2, 0.5]).within(0.3)
    before = {member: dict(member.__dict__) for member in (posture, damping, fingers)}
    decided(ARM, [posture, damping], LEVELS[0], subject_to=[fingers])
    for member, values in before.items():
        assert {k: v for k, v in member.__dict__.items() if k != "_ties"} == values
    own = bound(damping, HUMANOID)
    assert own.dim == HUMANOID.nj and not hasattr(damping, "dim")


def test_limits_contacts_and_what_holds_a_task_are_shared_too() -> None:
    limits, reach = T.JointLimits(), T.Position("tool", target=[0.4, 0.2, 0.5])
    shared = [limits, reach.within(0.5), T.CollisionAvoidance(margin=0.01)]
    first, second = (decided(ARM, [T.Posture(ARM.q0)], LEVELS[1], subject_to=shared) for _ in range(2))
    q, v = moving(ARM, 1)
    np.testing.assert_array_equal(answer(first, q, v), answer(second, q, v))
    stack = standing(QUADRUPED)
    pair = [wbc.Controller(QUADRUPED, stack, level=wbc.InverseDynamics()) for _ in range(2)]
    states = [moving(QUADRUPED, seed) for seed in (1, 2)]
    taken = [controller.tick(0.0, *state).tau for controller, state in zip(pair, states, strict=True)]
    alone = wbc.Controller(QUADRUPED, standing(QUADRUPED), level=wbc.InverseDynamics()).tick(0.0, *states[0])
    np.testing.assert_array_equal(taken[0], alone.tau)
    assert not np.array_equal(pair[0].plan.anchors[0].position, pair[1].plan.anchors[0].position)


SETTINGS: dict[str, Any] = {
    "weight": 7.0, "kp": 3.0, "kd": 0.5, "rate": 2.0, "active": False, "target": ARM.q0 + 0.3,
}  # fmt: skip


@pytest.mark.parametrize("hierarchy", [wbc.Weighted(), wbc.Strict(), wbc.Scaled()], ids=repr)
@pytest.mark.parametrize("level", LEVELS, ids=repr)
@pytest.mark.parametrize("what", SETTINGS)
def test_what_a_component_overrides_holds_in_its_own_controller_and_tick_alone(
    what: str, level: Any, hierarchy: Any
) -> None:
    value = SETTINGS[what]
    saying, shared = Saying(), [T.Posture(ARM.q0, kp=50.0), T.Damping(weight=0.3)]
    first = wbc.Controller(ARM, wbc.Stack(shared, components=[saying]), level=level, hierarchy=hierarchy)
    second = wbc.Controller(ARM, wbc.Stack(shared), level=level, hierarchy=hierarchy)
    q, v = moving(ARM, 3)
    usual = answer(second, q, v)
    np.testing.assert_allclose(answer(first, q, v), usual, atol=1e-9)
    saying.now = wbc.Overrides(tasks={"Posture": {what: value}})
    changed = answer(first, q, v, 1e-3)
    np.testing.assert_array_equal(answer(second, q, v, 1e-3), usual)
    user = [T.Posture(ARM.q0, kp=50.0), T.Damping(weight=0.3)]
    setattr(user[0], what, value)
    by_user = wbc.Controller(ARM, wbc.Stack(user), level=level, hierarchy=hierarchy)
    np.testing.assert_allclose(changed, answer(by_user, q, v), rtol=1e-9, atol=1e-9)
    shared[1].weight = 0.6  # what users assign meanwhile counts
    user[1].weight = 0.6
    np.testing.assert_allclose(answer(first, q, v, 2e-3), answer(by_user, q, v, 2e-3), rtol=1e-9, atol=1e-9)
    saying.now = None
    np.testing.assert_allclose(answer(first, q, v, 3e-3), answer(second, q, v, 3e-3), rtol=1e-9, atol=1e-9)
    shared[1].weight = 0.3
    np.testing.assert_allclose(answer(first, q, v, 4e-3), usual, rtol=1e-9, atol=1e-9)


def test_a_component_serves_the_controller_that_was_made_or_started_last() -> None:
    """Any other is told so, in its status, until it is reset; what it was not asked of leaves no trace in it."""

    class Counts(wbc.Component):
        seen = 0

        def reset(self, state: Any) -> None:
            self.seen = 0

        def before(self, state: Any, last: Any, plan: Any) -> None:
            self.seen += 1

        def after(self, state: Any, command: Any) -> None:
            self.seen += 10

    counts = Counts()
    stack = wbc.Stack([T.Posture(ARM.q0)], components=[counts])
    first = wbc.Controller(ARM, stack, level=LEVELS[1])
    answer(first, ARM.q0, np.zeros(7))
    second = wbc.Controller(ARM, stack, level=LEVELS[1])
    for loser, winner in ((first, second), (second, first)):
        winner.reset()
        answer(winner, ARM.q0, np.zeros(7))
        assert not loser.tick(1.0, ARM.q0, np.zeros(7)).status.ok
        assert "Counts serves another controller" in loser.why and counts.seen == 11
        answer(winner, ARM.q0, np.zeros(7), 1e-3)
        assert counts.seen == 22
    alike = copy.copy(first)
    for k in (2, 3):
        answer(alike, ARM.q0, np.zeros(7), 1e-3 * k)
        answer(first, ARM.q0, np.zeros(7), 1e-3 * k)
    first.replace(wbc.Stack([T.Posture(ARM.q0, kp=5.0)], components=[counts]))
    answer(first, ARM.q0, np.zeros(7), 4e-3)


def test_threads_that_share_members_are_serial_to_the_bit() -> None:
    def made() -> list[wbc.Controller]:
        moves = T.Posture(lambda t: (ARM.q0 + 0.1 * np.sin(9.0 * t), np.full(7, 0.9 * np.cos(9.0 * t)), np.zeros(7)))
        shared = [T.Position("tool", target=lambda t: np.array([0.4, 0.2 * np.sin(7.0 * t), 0.5])), moves]
        limits = [T.JointVelocityLimits(), T.TorqueLimits(), shared[0].within(2.0)]
        return [decided(ARM, shared, wbc.InverseDynamics(), subject_to=limits) for _ in range(2)]

    def run(controller: wbc.Controller, offset: float, into: list[Any]) -> None:
        q, v = moving(ARM, 1)
        for k in range(300):
            into.append(controller.tick(offset + 1e-3 * k, q, v).tau)

    serial: list[list[Any]] = [[], []]
    for controller, offset, into in zip(made(), (0.0, 5.0), serial, strict=True):
        run(controller, offset, into)
    parallel: list[list[Any]] = [[], []]
    threads = [
        threading.Thread(target=run, args=(controller, offset, into))
        for controller, offset, into in zip(made(), (0.0, 5.0), parallel, strict=True)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    np.testing.assert_array_equal(parallel, serial)


def test_an_assignment_that_one_of_its_plans_cannot_take_is_refused_and_changes_nothing() -> None:
    shared = T.Damping()
    controllers = [decided(robot, [shared], LEVELS[1]) for robot in (ARM, HUMANOID)]
    for what in ("weight", "kd"):
        before = getattr(shared, what)
        with pytest.raises(InvalidInput, match=rf"Damping\.{what} must have shape \(30,\), not \(7,\)"):
            setattr(shared, what, np.ones(7))
        assert getattr(shared, what) is before
    del controllers[1]
    posture = T.Posture(ARM.q0)
    keep = decided(ARM, [posture], LEVELS[1])
    with pytest.raises(InvalidInput, match=r"Posture\.target must have shape \(7,\)"):
        posture.target = np.zeros(5)
    assert answer(keep, ARM.q0, np.zeros(7)).shape == (7,)


def test_an_attribute_that_does_not_exist_is_refused_by_the_name_that_is_near() -> None:
    for member, slip, near in (
        (T.Posture(ARM.q0), "kpp", "kp"),
        (T.Position("tool", target=[0.4, 0.2, 0.5]), "tarqet", "target"),
        (T.JointVelocityLimits(), "vmax", "v_max"),
        (T.Point("front_left_foot", friction=0.5), "fricton", "friction"),
        (T.Posture(ARM.q0).exactly(), "taks", "task"),
    ):
        with pytest.raises(UnknownSetting, match=rf"no setting '{slip}'; did you mean '{near}'") as refused:
            setattr(member, slip, 3.0)
        assert isinstance(refused.value, WbcError) and isinstance(refused.value, AttributeError)
    controller = decided(ARM, [T.Damping()], LEVELS[0])
    with pytest.raises(NotSupported, match=r"controller\.dt is fixed at 0\.001 s"):
        controller.dt = 2e-3


def test_what_a_component_sees_is_to_be_read() -> None:
    """A write of the old kind is refused by name, and the tick answers within bounds."""

    class Writes(wbc.Component):
        def __init__(self, write: Any) -> None:
            super().__init__()
            self.write = write

        def before(self, state: Any, last: Any, plan: Any) -> None:
            self.write(plan)

    def torques(plan: Any) -> None:
        plan.torque_bounds[1][0] = np.nan

    def bias(plan: Any) -> None:
        plan.extra_bias[:] = np.nan

    def normals(plan: Any) -> None:
        plan.applied.normal_limits[:] = np.nan

    def motion(plan: Any) -> None:
        plan.intervals.replace("velocity", -1.0, 1.0)

    def weight(plan: Any) -> None:
        plan.stack.tasks[0].weight = 0.0

    for write in (torques, bias, normals, motion, weight):
        stack = wbc.Stack([T.Posture(ARM.q0)], subject_to=[T.JointLimits()], components=[Writes(write)])
        controller = wbc.Controller(ARM, stack, level=wbc.InverseDynamics())
        command = controller.tick(0.0, *moving(ARM, 2))
        assert not command.status.ok and "Writes.before raised" in controller.why
        assert (np.abs(command.tau) <= ARM.limits.tau_max).all()


def test_what_is_written_into_an_array_after_it_was_assigned_goes_unseen():
    """Two tasks are given one array, one after the other, with other numbers in it."""
    left, right = T.Position("left_hand", target=np.zeros(3)), T.Position("right_hand", target=np.zeros(3))
    controller = decided(HUMANOID, [left, right, T.Damping(weight=1e-3)], wbc.VelocityLevel())
    controller.tick(0.0, HUMANOID.q0, np.zeros(HUMANOID.nv))
    place = np.array([0.3, 0.2, 1.0])
    left.target = place
    place[:] = 0.3, -0.2, 1.0
    right.target = place
    controller.tick(1e-3, HUMANOID.q0, np.zeros(HUMANOID.nv))
    errors, state = controller.plan.errors(), controller.state
    for task, target in ((left, [0.3, 0.2, 1.0]), (right, [0.3, -0.2, 1.0])):
        np.testing.assert_allclose(errors[task.name], target - state.frame(task.frame).position, atol=1e-12)


class Coupled(T.Posture):
    """Whose setting ``first`` takes ``second`` back."""

    _first = _second = 0

    @property
    def first(self) -> int:
        return self._first

    @first.setter
    def first(self, value: int) -> None:
        self._first, self._second = value, 0

    @property
    def second(self) -> int:
        return self._second

    @second.setter
    def second(self, value: int) -> None:
        self._second = value


@given(st.lists(st.tuples(st.sampled_from(["first", "second"]), st.integers(1, 9)), min_size=1, max_size=5))
def test_what_is_assigned_between_ticks_comes_in_its_order(assigned: list[tuple[str, int]]):
    task = Coupled(ARM.q0)
    controller = decided(ARM, [task], wbc.AccelerationLevel())
    for name, value in assigned:
        setattr(task, name, value)
    answer(controller, ARM.q0, np.zeros(ARM.nv))
    (own,) = controller.plan.stack.tasks
    assert (own.first, own.second) == (task.first, task.second)
