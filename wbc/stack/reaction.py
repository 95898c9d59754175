"""Reaction: a kinematic task as a part of the mechanism. Its rows hold by a force, not by the motors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, final

import numpy as np

from wbc.models.model import RobotModel, RobotState
from wbc.stack.contact import Anchor, Contact, ContactRows
from wbc.stack.kernel_rows import KernelRows, kernel_rows_of
from wbc.stack.task_rows import Kinematic
from wbc.types import Mat

_FORCES = {"m": "N", "rad": "N m"}


@final
class Reaction(Contact):
    """The rows of a task as constraints that a force λ holds, M a + h = Sᵀ τ + Jᵀ λ; made by ``task.with_reaction()``.

    It stands in ``contacts``. A wheel that rolls, a gear with one motor, a brake on a joint: what the mechanism or the
    ground forbids costs no torque, where ``task.exactly()`` makes motors do it. λ is ``command.f[name]``, one number a
    row, N for metres and N m for radians, bounded by no cone; ``force_weight`` weighs ½ λ², by default nothing but the
    level's regularisation does. Gains are read when the stack is compiled, the target in each tick.

    Example:
        >>> from wbc.tasks import JointCoupling
        >>> JointCoupling("elbow", to={"shoulder_pitch": -2.0}).with_reaction(name="gear")
        gear
    """

    bilateral = True

    def __init__(self, task: Kinematic, *, force_weight: float = 0.0, name: str | None = None) -> None:
        self.task = task
        # Nothing slips: friction is only asked of surfaces.
        super().__init__(task.name, friction=1.0, force_weight=force_weight, name=name or task.name)

    def prepare(self, model: RobotModel) -> None:
        self.task.prepare(model)
        self.dim = self.task.dim
        self._joints = np.eye(model.nv)[model.nb :] if self.task.on_joints else None

    def gains(self) -> tuple[Any, Any, Any]:
        """Those of the task."""
        return self.task.gains()

    def anchor(self, state: RobotState) -> Anchor:
        del state  # the target of the task says where
        return Anchor(np.eye(3), np.zeros(3))

    def kernel_rows(self) -> KernelRows | None:
        """Those of the task, where it has some."""
        said = kernel_rows_of(self.task)
        return None if said is None else said()

    def fill(self, state: RobotState, anchor: Anchor, out: ContactRows) -> None:
        del anchor
        if self._joints is not None:
            out.J[:], out.drift[:] = self._joints, 0.0
        self.task.fill(state, out)

    def cone(self) -> Mat:
        return np.zeros((0, self.dim))

    def cone_labels(self) -> list[tuple[str, str]]:
        return []

    def motion_units(self) -> list[str]:
        return [self.task.unit(i) for i in range(self.dim)]

    def motion_labels(self) -> Sequence[str]:
        """The task's."""
        return [self.task.label(i) for i in range(self.dim)]

    def force_labels(self) -> list[tuple[str, str]]:
        """The task's rows, in the unit whose product with theirs is an energy."""
        return [
            (label, _FORCES.get(unit, f"J/({unit})"))
            for label, unit in zip(self.motion_labels(), self.motion_units(), strict=True)
        ]

    def __repr__(self) -> str:
        return self.name
