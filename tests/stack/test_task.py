"""Weights, gains and switches of tasks, whatever the task does."""

from __future__ import annotations

from dataclasses import FrozenInstanceError
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tasks import CenterOfMass, Damping, JointVelocityLimits, Position, Posture, Sole
from wbc.errors import InvalidInput, NotCompiled
from wbc.stack.task import Task
from wbc.testing import robots

ARM = robots()[0]


class Switch(wbc.Component):
    """Overrides whether a task counts."""

    def __init__(self, active: Any) -> None:
        super().__init__()
        self.active = active

    def before(self, state: Any, last: Any, plan: Any) -> wbc.Overrides:
        return wbc.Overrides(tasks={"Posture": {"active": self.active}})


class Plain(Task):
    """A task of two rows."""

    dim, units = 2, "m"

    def fill(self, state: Any, out: Any) -> None:
        out.e[:], out.J[:], out.drift[:] = 0.0, 0.0, 0.0


class Planar(Task):
    """The end of the arm in a plane, by writing into the arrays or by assigning to them."""

    dim, units = 2, "m"

    def __init__(self, assigns: bool) -> None:
        super().__init__()
        self.assigns, self.is_wrong = assigns, False

    def fill(self, state: Any, out: Any) -> None:
        tool = state.frame("tool")
        e, J, drift = np.array([0.4, 0.2]) - tool.position[:2], tool.jacobian()[:2], tool.drift()[:2]
        if self.is_wrong:
            out.e = np.zeros(3)
        if self.assigns:
            out.e, out.J, out.drift = e, J, drift
        else:
            out.e[:], out.J[:], out.drift[:] = e, J, drift


@pytest.mark.parametrize("level", [wbc.VelocityLevel(), wbc.InverseDynamics()], ids=str)
def test_a_task_may_assign_its_rows_or_write_into_them(level: Any):
    """An assignment of another shape fails its own tick, and no later one."""
    tasks = [Planar(assigns) for assigns in (False, True)]
    controllers = [wbc.Controller(ARM, wbc.Stack([task]), level=level) for task in tasks]
    v = np.full(ARM.nv, 0.1)
    for k in range(4):
        tasks[1].is_wrong = k == 2
        written, assigned = (controller.tick(1e-3 * k, ARM.q0 + 0.1 * k, v) for controller in controllers)
        if k == 2:
            assert not assigned.status.ok and "Planar" in controllers[1].why
        else:
            assert assigned.status.ok
            np.testing.assert_array_equal(assigned.q, written.q)


@given(st.floats(0.01, 1e4))
def test_gains_are_critically_damped_unless_given(kp: float):
    for gain, expected in zip(Plain(kp=kp).gains(), (kp, 2 * np.sqrt(kp), np.sqrt(kp) / 2), strict=True):
        np.testing.assert_allclose(gain, expected)


def test_gains_may_differ_by_row():
    kp, kd, rate = Plain(kp=[4.0, 9.0], kd=[1.0, 3.0]).gains()
    assert kp.tolist() == [4.0, 9.0] and kd.tolist() == [1.0, 3.0] and rate.tolist() == [4.0, 3.0]
    assert Plain(kp=1.0, rate=[5.0, 6.0]).gains()[2].tolist() == [5.0, 6.0]


def test_without_damping_there_is_no_rate_to_guess():
    assert Plain(kp=4.0, kd=0.0).gains()[2].tolist() == [np.inf, np.inf]
    assert Plain(kp=0.0, kd=0.0).gains()[2].tolist() == [0.0, 0.0]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"weight": [1.0, 1e300]}, r"Plain.weight\[1\] is 1e\+300; it must be between 0 and 1e\+15"),
        ({"weight": {"a": 1e300}}, r"Plain.weight\['a'\] is 1e\+300; it must be between 0 and 1e\+15"),
    ],
)
def test_weights_that_are_too_large_are_refused_by_row(arguments: Any, said: str):
    with pytest.raises(InvalidInput, match=said):
        Plain(**arguments)


@pytest.mark.parametrize("argument", ["kp", "kd", "rate", "weight"])
def test_a_vector_of_the_wrong_size_is_refused_by_name_once_the_size_is_known(argument: str):
    task = Posture(np.zeros(7), **{argument: np.ones(5)})
    task.prepare(robots()[0])
    with pytest.raises(InvalidInput, match=rf"Posture.{argument} must have shape \(7,\), not \(5,\)"):
        task.weights()
        task.gains()


def test_weight_and_switch_may_be_assigned():
    task = Plain(weight=2.0)
    task.weight = [1.0, 3.0]
    assert task.weights().tolist() == [1.0, 3.0]
    task.active = False
    assert task.weights().tolist() == [0.0, 0.0]


@pytest.mark.parametrize("value", ["no", 0, 1.0, None, [True], np.ones(2, bool)])
def test_a_switch_is_true_or_false_and_nothing_else(value: Any):
    task = Posture(ARM.q0)
    with pytest.raises(InvalidInput, match=r"Posture.active is .*; it must be True or False"):
        task.active = value
    controller = wbc.Controller(ARM, wbc.Stack([task], components=[Switch(value)]), level=wbc.VelocityLevel())
    assert controller.tick(0.0, ARM.q0, 0 * ARM.q0).status is wbc.Status.FAILED
    assert "Switch.tasks: InvalidInput: Posture.active is" in controller.why
    task.active = np.False_
    assert task.active is False


def test_what_follows_from_the_robot_is_refused_before_there_is_one():
    task = Posture(ARM.q0)
    for ask in (task.gains, task.weights, lambda: task.unit(0), lambda: task.within(0.1).unit(0)):
        with pytest.raises(NotCompiled, match=r"has no (dim|units) yet: its rows are known once a stack"):
            ask()
    assert not hasattr(task, "dim")
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        task.nothing  # noqa: B018


def test_what_weights_gives_is_a_copy():
    task = Plain(weight=[1.0, 3.0])
    task.weights()[:] = 7.0
    assert task.weights().tolist() == [1.0, 3.0]


def test_a_name_is_the_class_unless_given():
    assert Plain().name == "Plain" and Plain(name="hand").name == "hand"


# ---- a stack is an immutable, printable value that refuses what does not belong together
def hand(**more: Any) -> Position:
    return Position("hand", target=np.zeros(3), **more)


def test_a_flat_list_is_one_level():
    tasks = [hand(), Damping()]
    assert wbc.Stack(tasks).levels == (tuple(tasks),)


def test_a_list_of_lists_is_levels_in_order():
    first, second = hand(), Damping()
    stack = wbc.Stack([[first], [second]])
    assert stack.levels == ((first,), (second,)) and stack.tasks == (first, second)


def test_an_empty_stack_may_be_written():
    assert wbc.Stack([]).tasks == ()


def test_two_members_of_one_name_are_refused():
    with pytest.raises(
        InvalidInput, match=r"two members of the stack are called 'Position\[hand\]'; give one .* name="
    ):
        wbc.Stack([hand(), hand()])
    with pytest.raises(InvalidInput, match="called 'same'"):
        wbc.Stack([hand(name="same")], subject_to=[JointVelocityLimits(name="same")])
    assert len(wbc.Stack([hand(), hand(name="again")]).tasks) == 2


def test_a_task_may_also_be_a_constraint():
    task = hand()
    stack = wbc.Stack([task], subject_to=[task.exactly()])
    assert stack.subject_to[0].name == "Position[hand] exactly"


def test_a_stack_does_not_change():
    tasks = [hand()]
    stack = wbc.Stack(tasks)
    tasks.append(Damping())
    assert len(stack.tasks) == 1
    with pytest.raises(FrozenInstanceError):
        stack.levels = ()  # type: ignore[misc]


def test_a_stack_prints_as_it_was_written():
    stack = wbc.Stack(
        [[CenterOfMass(target=np.zeros(3)), hand(weight=0.1)], [Posture(np.zeros(7), weight=1e-3)]],
        contacts=[Sole("left_sole", half_size=(0.1, 0.05), friction=0.3)],
        subject_to=[JointVelocityLimits()],
    )
    assert str(stack).splitlines() == [
        "Stack",
        "  level 1: CenterOfMass(weight=1.0), Position[hand](weight=0.1)",
        "  level 2: Posture(weight=0.001)",
        "  subject to: JointVelocityLimits",
        "  contacts: Sole[left_sole](friction=0.3)",
    ]
