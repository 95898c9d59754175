"""TaskRows: where kinematic tasks and contacts write, and what is known of one that does."""

from __future__ import annotations

from typing import ClassVar, Protocol

from wbc.models.model import RobotModel, RobotState
from wbc.types import Mat, Vec


class TaskRows:
    """Where a kinematic task writes: views into the plan's own memory, ``dim`` rows.

    e (dim,)          error, target − actual; of a pose ``linear`` is e[:3] and ``angular`` e[3:]
    J (dim, nv)       Jacobian of the actual value
    drift (dim,)      J̇ v; read at the acceleration level only
    rate_ref (dim,)   velocity of the target, zero unless written
    acc_ref (dim,)    acceleration of the target, zero unless written
    ed (dim,)         rate of the error; left alone it is rate_ref − J v, which the plan computes for all tasks at once

    Assign with ``out.e[:] = …``: the arrays stay, their contents change.
    """

    __slots__ = ("J", "_e", "acc_ref", "angular", "drift", "ed", "linear", "rate_ref")

    J: Mat
    linear: Vec
    angular: Vec
    ed: Vec
    drift: Vec
    rate_ref: Vec
    acc_ref: Vec

    @property
    def e(self) -> Vec:
        """The error."""
        return self._e

    @e.setter
    def e(self, e: Vec) -> None:
        self._e, self.linear, self.angular = e, e[:3], e[3:]


class Kinematic(Protocol):
    """What constraints and contacts that are made of a task know of it; :class:`~wbc.stack.task.Task` is one."""

    dim: int
    on_joints: ClassVar[bool]

    @property
    def name(self) -> str:
        """What the stack calls it."""

    def prepare(self, model: RobotModel) -> None:
        """Check arguments against the model and fix ``dim``."""

    def fill(self, state: RobotState, out: TaskRows) -> None:
        """Write its rows for this state."""

    def gains(self) -> tuple[Vec, Vec, Vec]:
        """kp, kd and rate of each row."""

    def unit(self, row: int) -> str:
        """Unit of one row of the error."""

    def label(self, row: int) -> str:
        """What one row is called in reports."""
