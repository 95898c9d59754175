"""What a member of the library writes, from fresh memory: shared by the tests of single tasks."""

from __future__ import annotations

from typing import Any

import numpy as np

from wbc.models.model import RobotModel, RobotState
from wbc.stack.task import LinearRows, TaskRows
from wbc.types import Vec


def moment(model: RobotModel, q: Vec, v: Vec | None = None, t: float = 0.0) -> RobotState:
    """A state there, at rest unless said otherwise."""
    state = model.state()
    state.update(t, q, np.zeros(model.nv) if v is None else v)
    return state


def rows(task: Any, state: RobotState) -> TaskRows:
    """The rows of a kinematic task."""
    task.prepare(state.model)
    out = TaskRows()
    for array in ("e", "drift", "rate_ref", "acc_ref", "ed"):
        setattr(out, array, np.zeros(task.dim))
    out.J = np.zeros((task.dim, state.model.nv))
    task.fill(state, out)
    return out


def linear_rows(task: Any, state: RobotState, size: int) -> LinearRows:
    """The rows of a linear task on a quantity of ``size``."""
    task.prepare(state.model)
    out = LinearRows()
    out.A, out.b = np.full((task.dim, size), np.nan), np.full(task.dim, np.nan)
    task.fill(state, out)
    return out


def finite(out: TaskRows) -> bool:
    """Whether everything written is a number."""
    return all(np.isfinite(getattr(out, array)).all() for array in ("e", "J", "drift", "rate_ref", "acc_ref"))
