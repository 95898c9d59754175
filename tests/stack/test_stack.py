"""A stack is an immutable, printable value that refuses what does not belong together."""

from __future__ import annotations

from dataclasses import FrozenInstanceError
from typing import Any

import numpy as np
import pytest

import wbc
from tasks import CenterOfMass, Damping, JointVelocityLimits, Position, Posture, Sole
from wbc.errors import InvalidInput


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
