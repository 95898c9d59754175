"""Arguments by default: nothing that was not asked for, unit directions, sizes and times of a robot's scale."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import tasks
import wbc
from tests.tasks.test_contract import is_member
from wbc.testing import robots

#: Names of arguments that are one where nothing is said, that bound nothing, and that are directions.
ONE = {"weight", "persistence", "release", "gain", "damping"}
BOUNDS_NOTHING = {
    "lower": -np.inf, "upper": np.inf, "linear": np.inf, "angular": np.inf, "threshold": np.inf,
    "standing_rate": np.inf,
}  # fmt: skip
DIRECTIONS = {"direction", "normal", "axle", "axis"}
#: Ranges of those that are chosen, in SI units: what is farther off is of another scale than robots are.
CHOSEN = {
    "rate": (1.0, 100.0), "filter": (1.0, 100.0),  # of decay [1/s]
    "slack": (1e4, 1e12), "force_weight": (0.0, 1e-4),  # far above every weight, and far below
    "reach": (0.05, 0.5), "margin": (0.0, 0.05), "nearest": (1e-3, 0.1), "length": (0.1, 1.0),  # [m]
    "ramp": (0.02, 2.0), "early": (0.01, 0.2), "start": (0.1, 2.0), "lockout": (0.1, 2.0), "settle": (0.005, 0.1),
    "recheck": (0.05, 0.5), "lag": (0.01, 0.5),  # [s]
    "force_rate": (0.01, 0.2), "friction_share": (0.5, 1.0), "dominance": (2.0, 20.0), "sides": (4, 4),
    "smoothing": (1e-4, 1e-2), "floor": (1e-8, 1e-4),
}  # fmt: skip
MADE = {name: made for name, made in sorted(vars(tasks).items()) if callable(made) and not name.startswith("_")}


def defaults(made: Any) -> dict[str, np.ndarray]:
    """What is made of numbers by default, by argument."""
    found = {}
    for argument, known in inspect.signature(made).parameters.items():
        value = np.asarray(known.default, dtype=object)
        if value.size and all(isinstance(entry, int | float) and not isinstance(entry, bool) for entry in value.flat):
            found[argument] = value.astype(float)
    return found


#: What has no samples, with no more arguments than it must have.
BARE: dict[str, Callable[[], Any]] = {
    "Clearance": lambda: tasks.Clearance("tool", point=[0.0, 0.0, 0.0]),
    "Comply": tasks.Comply,
    "ContactSchedule": lambda: tasks.ContactSchedule([(0.0, ["foot"])]),
    "FaultReaction": lambda: tasks.FaultReaction(tasks.MomentumObserver(gain=1.0)),
    "Follow": lambda: tasks.Follow([0.0], velocity=1.0, acceleration=1.0, jerk=1.0),
    "MeasuredWrench": lambda: tasks.MeasuredWrench("tool"),
    "MinimumJerk": lambda: tasks.MinimumJerk([0.0], [1.0], duration=1.0),
    "MomentumObserver": lambda: tasks.MomentumObserver(gain=1.0),
    "PoseInterpolation": lambda: tasks.PoseInterpolation(np.eye(4), np.eye(4), duration=1.0),
    "Sinusoid": lambda: tasks.Sinusoid([0.0], amplitude=1.0, frequency=1.0),
    "SlotineLi": lambda: tasks.SlotineLi([0.0], kp=1.0, kd=1.0, gain=1.0),
    "feet": lambda: tasks.feet(wbc.load("humanoid")),
}


def samples(name: str) -> list[Any]:
    """Some of a class, or what a function makes, with few arguments."""
    if is_member(MADE[name]):
        return [sample for robot in robots() for sample in MADE[name].samples(robot)]
    return [BARE[name]()] if name in BARE else []


@pytest.mark.parametrize("name", MADE)
def test_a_default_is_nothing_or_of_a_robots_scale(name: str):
    assert samples(name) or not defaults(MADE[name]), "it cannot be made without them"
    for argument, value in defaults(MADE[name]).items():
        if argument in ("kp", "kd"):
            continue  # see below
        if (name, argument) == ("SlotineLi", "weight"):  # the law is the command
            assert 1e4 < value < 1e8
        elif argument in ONE:
            assert value == 1.0, argument
        elif argument in BOUNDS_NOTHING:
            assert value == BOUNDS_NOTHING[argument], argument
        elif argument in DIRECTIONS:
            assert np.linalg.norm(value) == 1.0, argument
        elif argument in CHOSEN:
            low, high = CHOSEN[argument]
            assert low <= value <= high, argument
        else:
            assert not value.any() or np.array_equal(value, np.eye(3)), argument


@pytest.mark.parametrize("name", [name for name, made in MADE.items() if is_member(made)])
def test_gains_by_default_settle_in_seconds(name: str):
    """ë + kd ė + kp e = 0, or ė + kd e = 0 of a task on rates; no gain stated is critical damping."""
    assert samples(name)
    default = defaults(MADE[name])
    kp, kd = default.get("kp"), default.get("kd")
    if kp is None and kd is None:
        return
    rates = -np.roots([1.0, 2.0 * np.sqrt(kp) if kd is None else kd, kp] if kp else [1.0, kd]).real
    assert 1.0 <= min(rates) and max(rates) <= 100.0


def test_the_names_above_are_those_of_arguments():
    arguments = {argument for made in MADE.values() for argument in defaults(made)}
    assert {*ONE, *BOUNDS_NOTHING, *DIRECTIONS, *CHOSEN} <= arguments
