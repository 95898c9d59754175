"""Ten thousand changes of contacts at random, from random states: always an answer, always finite."""

from __future__ import annotations

from collections import Counter
from itertools import chain, combinations
from typing import Any

import numpy as np
import pytest

import wbc
from tasks import CenterOfMass, JointLimits, Orientation, Posture, TorqueLimits, feet
from wbc.stack.component import Schedule

CHANGES = 10_000


class AnyOf(Schedule):
    """Every subset of the contacts, as it is told."""

    def __init__(self, names: list[str]) -> None:
        super().__init__()
        self.sets = [
            frozenset(some) for some in chain.from_iterable(combinations(names, k) for k in range(len(names) + 1))
        ]
        self.now = self.sets[-1]

    def contact_sets(self) -> list[frozenset[str]]:
        return self.sets

    def contacts(self, state: Any, last: object) -> frozenset[str]:
        return self.now


def changes(name: str, count: int) -> tuple[Counter[str], wbc.Controller]:
    """How the ticks ended."""
    robot, rng = wbc.load(name), np.random.default_rng(7)
    state, schedule = robot.state(), AnyOf(list(robot.feet))
    stack = wbc.Stack(
        [
            CenterOfMass(target=state.com), Orientation(robot.frame_names[0], target=np.eye(3)),
            Posture(robot.q0, weight=1e-3),
        ],
        contacts=feet(robot), subject_to=[TorqueLimits(), JointLimits()], components=[schedule],
    )  # fmt: skip
    controller, ended = wbc.Controller(robot, stack, level=wbc.InverseDynamics()), Counter[str]()
    for k in range(count):
        choices = [names for names in schedule.sets if names != schedule.now]
        schedule.now = choices[rng.integers(len(choices))]
        q = robot.integrate(robot.q0, rng.uniform(0.0, 0.1) * rng.normal(size=robot.nv))
        command = controller.tick(1e-3 * k, q, rng.uniform(0.0, 0.3) * rng.normal(size=robot.nv))
        assert np.isfinite(command.tau).all() and np.isfinite(command.a).all()
        ended[command.status.name] += 1
    return ended, controller


@pytest.mark.parametrize("name", ["quadruped", "humanoid"])
def test_changes_at_random_always_have_an_answer(name: str) -> None:
    ended, controller = changes(name, 300)
    assert ended == {"SOLVED": 300}
    assert controller.plans.unplanned == 0


@pytest.mark.deep
@pytest.mark.parametrize("name", ["quadruped", "humanoid"])
def test_ten_thousand_changes_always_have_an_answer(name: str) -> None:
    ended, _ = changes(name, CHANGES)
    assert ended == {"SOLVED": CHANGES}
