"""Knobs: what of a stack's tasks a view may change while the controller runs, through their public attributes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, final

import numpy as np
import pinocchio

from wbc.models.model import RobotModel
from wbc.stack.objective import Objective
from wbc.types import Vec

GAINS = ("weight", "kp", "kd", "rate")
MOST = 4.0  # a slider goes from 0 to so many times the value it starts at
#: How far a target can be moved from where it was, either way, by unit.
REACH = {"m": 0.3, "rad": 1.0}
STEPS = 200


@final
@dataclass(frozen=True)
class Knob:
    """A number of one task: ``what`` of it, in ``unit``, from ``low`` to ``high``; ``value`` is where it starts."""

    task: str
    what: str
    unit: str
    value: float
    low: float
    high: float

    @property
    def step(self) -> float:
        """The least change."""
        return (self.high - self.low) / STEPS


@final
class Knobs:
    """The knobs of ``tasks``, and how they are turned. ``planned`` are the same tasks by name, with rows."""

    def __init__(self, tasks: Sequence[Objective], planned: Sequence[Objective], robot: RobotModel) -> None:
        self.all: list[Knob] = []
        self._turn: list[Callable[[float], None]] = []
        rows = {task.name: task for task in planned}
        for task in tasks:
            self._add(Knob(task.name, "active", "", float(task.active), 0.0, 1.0), _Switch(task))
            for gain in GAINS:
                start = getattr(task, gain, None)
                if isinstance(start, float | int) and start > 0.0:
                    self._add(Knob(task.name, gain, "", start, 0.0, MOST * start), _Number(task, gain))
                elif isinstance(start, np.ndarray):
                    self._add(Knob(task.name, f"{gain} ×", "", 1.0, 0.0, MOST), _Number(task, gain, start))
            named_alone = getattr(task, "joints", None) is not None  # their targets have other rows than the task
            if task.name in rows and getattr(task, "target", None) is not None and not named_alone:
                self._add_target(task, rows[task.name], robot)

    def set(self, number: int, value: float) -> str:
        """Turn a knob, and say what became of it.

        Raises:
            WbcError: a value that the task refuses.
        """
        knob = self.all[number]
        value = float(np.clip(value, knob.low, knob.high))
        self._turn[number](value)
        return f"{knob.task}: {knob.what} = {value:.4g}{f' {knob.unit}' if knob.unit else ''}"

    def _add(self, knob: Knob, turn: Callable[[float], None]) -> None:
        self.all.append(knob)
        self._turn.append(turn)

    def _add_target(self, task: Objective, rows: Objective, robot: RobotModel) -> None:
        """Sliders that move the target, for what is measured in metres, and for joints."""
        moved = _Target(task, rows.dim)
        for row in range(rows.dim):
            unit, label = rows.unit(row), rows.label(row)
            if unit in REACH and (label in ("x", "y", "z") or label in robot.joint_names):
                knob = Knob(task.name, f"target {label} +", unit, 0.0, -REACH[unit], REACH[unit])
                self._add(knob, partial(moved.move, row))


@final
class _Switch:
    def __init__(self, task: Objective) -> None:
        self._task = task

    def __call__(self, value: float) -> None:
        self._task.active = value > 0.5


@final
class _Number:
    """A gain, or the numbers of all rows times a factor."""

    def __init__(self, task: Objective, gain: str, rows: Vec | None = None) -> None:
        self._task, self._gain, self._rows = task, gain, rows

    def __call__(self, value: float) -> None:
        setattr(self._task, self._gain, value if self._rows is None else value * self._rows)


@final
class _Target:
    """The target that a task has, moved by an offset, whether it stands or moves."""

    def __init__(self, task: Any, rows: int) -> None:
        self._task, self._offset = task, np.zeros(rows)
        self._before = self._after = task.target

    def move(self, row: int, value: float) -> None:
        """Move it along one row of the task."""
        self._offset[row] = value
        if self._task.target is not self._after:  # somebody else gave it another one
            self._before = self._task.target
        before, offset = self._before, self._offset.copy()
        self._task.target = (lambda t: _moved(before(t), offset)) if callable(before) else _moved(before, offset)
        self._after = self._task.target


def _moved(target: Any, offset: Vec) -> Any:
    """A target plus an offset: numbers, whose last are those of the rows, a pose, or either with its rates."""
    if isinstance(target, tuple):
        return _moved(target[0], offset), *target[1:]
    if isinstance(target, pinocchio.SE3):
        return pinocchio.SE3(target.rotation, target.translation + offset[:3])
    values = np.array(target, dtype=np.float64)
    if values.shape == (4, 4):
        values[:3, 3] += offset[:3]
    else:
        values[len(values) - len(offset) :] += offset
    return values
