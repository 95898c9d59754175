"""A world that is only mirrored, turned, weighed, ordered or measured otherwise gets the same physical command.

Each relation is tried on whole controllers, at every level and under every hierarchy, in states of the week's seed:
around a stance, with errors of centimetres and with limits that hold the robot back.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.metamorphic.worlds import (
    HIERARCHIES,
    LEVELS,
    Answer,
    Back,
    World,
    drawn,
    heavier,
    measured,
    mirrored,
    renamed,
    turned,
)  # fmt: skip
from tests.seeds import generator

DRAWS = 8  # of worlds, until one can be met as it is asked
LEGGED, ALL = ("quadruped", "humanoid"), ("arm", "quadruped", "humanoid")
Relation = Callable[[World, np.random.Generator, Path], tuple[World, Back]]


def same(answer: Answer) -> Answer:
    """Nothing is to be read otherwise."""
    return answer


RELATIONS: dict[str, tuple[Relation, tuple[str, ...]]] = {
    "mirrored": (lambda w, rng, folder: mirrored(w), LEGGED),
    "turned about the vertical and shifted": (lambda w, rng, folder: turned(w, rng), LEGGED),
    "heavier": (lambda w, rng, folder: heavier(w, float(10.0 ** rng.uniform(-1.0, 1.0)), folder), ALL),
    "in another order": (renamed, ALL),
    "limits given twice": (lambda w, rng, folder: (replace(w, repeated=2), same), ALL),
    "tasks split in two": (lambda w, rng, folder: (replace(w, copies=2), same), ALL),
    "in another unit of length": (
        lambda w, rng, folder: measured(w, float(10.0 ** rng.uniform(-1.0, 0.4)), folder),
        ALL,
    ),
}
CASES = [(name, robot) for name, (_, robots) in RELATIONS.items() for robot in robots]


@pytest.mark.parametrize("hierarchy", HIERARCHIES)
@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize(("relation", "robot"), CASES)
def test_the_same_physical_command(relation: str, robot: str, level: str, hierarchy: str, tmp_path: Path):
    rng = generator("metamorphic", relation, robot, level, hierarchy)
    for _ in range(DRAWS):
        world = drawn(robot, rng)
        other, back = RELATIONS[relation][0](world, rng, tmp_path)
        expected, answer = world.answer(level, hierarchy), back(other.answer(level, hierarchy))
        # A level that is held back by pushes of a millionth is not certified under Strict and Scaled, in one order of
        # rows and not in another: the status says so, and another world is drawn.
        if hierarchy != "weighted" and "not certified" in (answer.fallback_level, expected.fallback_level):
            continue
        assert (answer.status, answer.fallback_level) == (expected.status, expected.fallback_level)
        if expected.fallback_level == "solved":
            break
    assert expected.fallback_level == "solved", "no world that was drawn can be met"
    difference = np.abs(answer.vector(expected) - expected.vector(expected))
    assert difference.max() <= 1e-6
