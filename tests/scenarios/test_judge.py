"""What a scenario of one's own gets without asking: its obstacles are drawn."""

from __future__ import annotations

import numpy as np
import pinocchio
import pytest

import wbc
from tasks import CollisionAvoidance, JointVelocityLimits, Obstacle, Posture
from tasks.scenarios import judge
from wbc.errors import InvalidInput
from wbc.models.geometry import Sphere
from wbc.sim.plant import IntegratorPlant
from wbc.sim.scenario import Setup, Trial

ARM = wbc.load("arm")


def ball(name: str, x: float) -> Obstacle:
    return Obstacle(name, Sphere(0.05), pinocchio.SE3(np.eye(3), np.array([x, 0.0, 1.5])))


def trial(*limits: CollisionAvoidance) -> Trial:
    stack = wbc.Stack([Posture(ARM.q0)], subject_to=[JointVelocityLimits(), *limits])
    setup = Setup(stack=stack, plant=IntegratorPlant(ARM, level="velocity"), level=wbc.VelocityLevel())
    return setup.run("+".join(limit.name for limit in limits), duration=2e-3)


@pytest.fixture(scope="module")
def trials() -> list[Trial]:
    near, far = ball("near", 1.0), ball("far", 2.0)
    left = CollisionAvoidance([near], self_collision=False, name="left")
    right = CollisionAvoidance([near, far], self_collision=False, name="right")
    return [trial(), trial(left), trial(left, right)]


@pytest.mark.parametrize(
    ("shown", "names"),
    [([0], []), ([1], ["near"]), ([0, 1], ["near"]), ([2], ["near", "far"]), ([1, 2, 0], ["near", "far"])],
)
def test_obstacles_of_all_stacks_are_drawn_once(trials: list[Trial], shown: list[int], names: list[str]):
    result = judge.verdict([trials[i] for i in shown], [])
    assert [one.name for one in result.obstacles] == names
    other = [ball("other", 3.0)]
    assert judge.verdict([trials[i] for i in shown], [], obstacles=other).obstacles == other


def test_trials_that_were_taken_already_are_refused_with_what_to_do(trials: list[Trial]):
    given = iter(trials)
    taken = list(given)
    with pytest.raises(InvalidInput, match="can be taken once; pass on what was taken"):
        judge.verdict(given, [])  # type: ignore[arg-type]
    assert judge.verdict(iter(taken), []).called == taken[0].name  # type: ignore[arg-type]
