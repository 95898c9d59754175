"""Members of a stack as users may write them at worst: they raise, and give NaN, crossed bounds and other shapes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, final

import numpy as np

from wbc.models.model import RobotState
from wbc.stack.component import Component
from wbc.stack.overrides import QUANTITIES, Motor, Overrides
from wbc.stack.plan_view import PlanView
from wbc.stack.stack import Stack
from wbc.types import Vec

#: Numbers that have broken something somewhere.
RUBBISH = (np.nan, np.inf, -np.inf, 1e300, -1e300, 1e-300, 5e-324, -0.0, 1e154, 1e20, -1e6, 1e12, 1e-12, 7.0)
_ERRORS = (ValueError, KeyError, TypeError, ZeroDivisionError, StopIteration, RecursionError, MemoryError, OSError)
_NO_NUMBERS = (None, "three", 1j, object(), np.datetime64("2026-01-01"), [[1], [2, 3]], 10**400)
#: In what share of the ticks a component, and in what share of the calls a function of time, misbehaves.
_OFTEN, _NOW_AND_THEN = 0.2, 0.02


def spoilt(values: Any, rng: np.random.Generator) -> Vec:
    """A copy of an array with up to three numbers of :data:`RUBBISH` in it."""
    copied: Vec = np.array(values, dtype=np.float64)
    if copied.size:
        where = rng.integers(copied.size, size=int(rng.integers(1, 4)))
        copied.reshape(-1)[where] = rng.choice(RUBBISH, size=len(where))
    return copied


@final
class SpoiltTarget:
    """A target as a function of time that mostly gives ``target``, and now and then rubbish, or raises.

    The first call is sound, as whoever assigns a function is told at once what is wrong with its first value.
    """

    def __init__(self, target: Any, rng: np.random.Generator) -> None:
        self._target, self._rng, self._calls = target, rng, 0

    def __call__(self, t: float) -> Any:
        self._calls += 1
        if self._calls == 1 or self._rng.uniform() > _NOW_AND_THEN:
            return self._target
        return _rubbish(self._target, self._rng)


@final
class SpoiltComponent(Component):
    """Overrides with rubbish in any field, no overrides at all, or an exception; mostly it does nothing.

    It lifts no limits of torques: what a soak holds commands to.
    """

    def __init__(self, stack: Stack, rng: np.random.Generator) -> None:
        super().__init__(name="spoilt component")
        self._rng = rng
        self._tasks = [task.name for task in stack.tasks] + ["nobody"]
        self._contacts = [contact.name for contact in stack.contacts] + ["nobody"]

    def before(self, state: RobotState, last: object, plan: PlanView) -> Overrides | None:
        rng, nj, nv = self._rng, plan.model.nj, plan.model.nv
        if rng.uniform() > _OFTEN:
            return None
        joint = int(rng.integers(-1, nj + 1))
        fields: list[Callable[[], dict[str, Any]]] = [
            lambda: {str(rng.choice(QUANTITIES)): tuple(_rubbish(sign * np.ones(nj), rng) for sign in (-1.0, 1.0))},
            lambda: {str(rng.choice(QUANTITIES)): (1.0, -1.0)},
            lambda: {"bias": _rubbish(np.zeros(nv), rng)},
            lambda: {"inertia": _rubbish(np.zeros((nv, nv)), rng)},
            lambda: {"lifted": {str(rng.choice(QUANTITIES[1:])): _rubbish(np.zeros(2), rng)}},
            lambda: {"motors": {joint: Motor(*_rubbish(np.ones(2), rng))}},
            lambda: {
                str(rng.choice(("normal_limits", "normal_floors"))): {
                    str(rng.choice(self._contacts)): _rubbish(np.ones(1), rng)
                }
            },
            lambda: {
                "tasks": {
                    str(rng.choice(self._tasks)): {
                        str(rng.choice(("weight", "kp", "kd", "target", "active"))): _rubbish(np.ones(1), rng)[0]
                    }
                }
            },
        ]
        which = int(rng.integers(len(fields) + 1))
        return _rubbish(np.zeros(1), rng) if which == len(fields) else Overrides(**fields[which]())

    def after(self, state: RobotState, command: object) -> None:
        if self._rng.uniform() < _NOW_AND_THEN:
            raise _raised(self._rng)


def _rubbish(like: Any, rng: np.random.Generator) -> Any:
    """Rubbish among numbers, another shape, no numbers at all, or an exception."""
    kind = int(rng.integers(8))
    if kind == 0:
        raise _raised(rng)
    if kind == 1:
        return _NO_NUMBERS[int(rng.integers(len(_NO_NUMBERS)))]
    try:
        values = spoilt(like, rng)
    except (TypeError, ValueError):  # a pose is no array
        return np.full(3, rng.choice(RUBBISH))
    return np.resize(values, int(rng.integers(12))) if kind == 2 else values


def _raised(rng: np.random.Generator) -> Exception:
    return _ERRORS[int(rng.integers(len(_ERRORS)))]("users' code")
