"""Torque: prefers given joint torques."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self, final

import numpy as np
from scipy.linalg import lapack

from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel, RobotState
from wbc.stack.kernel_members import KernelLinearTask
from wbc.stack.kernel_rows import KernelRows
from wbc.stack.target import vector_target
from wbc.stack.task import LinearRows
from wbc.stack.tracking import Tracking
from wbc.types import Vec

from .joint_task import TorqueTask
from .trajectories import Sinusoid


@final
class Torque(Tracking, TorqueTask, KernelLinearTask):
    """τ = τ₀, one row a joint [N m, N]; the cost is ½ w ‖τ − τ₀‖², or ½ ‖τ − τ₀‖²_W with weight="inverse_inertia".

    W = S M⁻¹ Sᵀ (nj, nj), S the selection of the joints; on a fixed base W = M⁻¹. Below tasks that are constraints this
    is Gauss' principle: the acceleration nearest, in the metric M, to the one τ₀ alone would give. With M = L Lᵀ the
    rows are A = (L⁻¹)_joints (its last nj rows and columns, AᵀA = W) and b = A τ₀. ``target``: τ₀, scalar or (nj,),
    or a function of time giving it. ``joints``: names or patterns (regular expressions that match whole names),
    for these alone, (dim,) rows in that order; with zero and ``exactly()`` they are joints without motors.
    Source: Khatib, IEEE J. Robotics and Automation 1987.

    Raises:
        InvalidInput: a weight that is neither, a target of another size, joints named twice or with a weight for all.
        UnknownJoint: when a stack is compiled.

    Example:
        >>> from wbc.tasks import Torque
        >>> Torque(weight="inverse_inertia")
        Torque(weight=1.0)
        >>> Torque(0.0, joints=["wrist_roll"], name="passive wrist").exactly()
        passive wrist exactly
    """

    def __init__(
        self, target: Any = 0.0, *, joints: Sequence[str] | None = None, weight: Any = 1.0, name: str | None = None
    ) -> None:
        self._by_inertia = isinstance(weight, str)
        if self._by_inertia and (weight != "inverse_inertia" or joints is not None):
            raise InvalidInput(f"Torque.weight is {weight!r}; it must be numbers or 'inverse_inertia', of all joints")
        super().__init__(joints=joints, weight=1.0 if self._by_inertia else weight, name=name)
        self.target = target

    def prepare(self, model: RobotModel) -> None:
        super().prepare(model)
        self._vector = vector_target(self.dim)
        self.target = self.target

    def convert(self, name: str, value: Any, strict: bool) -> Vec:
        return self._vector(name, np.full(self.dim, value) if checks.ndim(value) == 0 else value, strict)

    def kernel_rows(self) -> KernelRows | None:
        if self._by_inertia:
            return None
        return KernelRows.tracking(self, "wbc.tasks.compiled.force:target", constant=self._rows_of_joints)

    def fill(self, state: RobotState, out: LinearRows) -> None:
        if not self._by_inertia:
            return super().fill(state, out)
        factor, _ = lapack.dpotrf(state.M, 1)
        # L⁻¹ is lower triangular: its joint columns are zero above their own block.
        nb = state.model.nb
        out.A[:] = lapack.dtrtri(factor, 1)[0][nb:, nb:]
        np.dot(out.A, self.reference(state.t).value, out.b)

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        wave = Sinusoid([1.0] * model.nj, amplitude=2.0, frequency=0.5)
        some = cls([0.0, 2.0], joints=model.joint_names[1::-1])
        return [cls(), cls(wave, weight=1e-4), cls(1.0, weight="inverse_inertia"), some]
