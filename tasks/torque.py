"""Torque: which joint torques to prefer."""

from __future__ import annotations

from typing import Any, Self, final

import numpy as np
from scipy.linalg import lapack

from tasks.trajectories import Sinusoid
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel, RobotState
from wbc.stack.task import LinearRows, LinearTask, vector_target
from wbc.stack.tracking import Tracking
from wbc.types import Vec


@final
class Torque(Tracking, LinearTask):
    """τ = τ₀, one row a joint [N m, N]; the cost is ½ w ‖τ − τ₀‖², or ½ ‖τ − τ₀‖²_W with weight="inverse_inertia".

    W = S M⁻¹ Sᵀ (nj, nj), S the selection of the joints; on a fixed base W = M⁻¹. Below tasks that are laws this is
    Gauss' principle: the acceleration nearest, in the metric M, to the one τ₀ alone would give. With M = L Lᵀ the rows
    are A = (L⁻¹)_joints (its last nj rows and columns, AᵀA = W) and b = A τ₀. ``tau_0`` (also ``target``): scalar or
    (nj,), or a function of time giving it. Source: Khatib, IEEE J. Robotics and Automation 1987.

    Raises:
        InvalidInput: a weight that is neither, a target of another size.

    Example:
        >>> from tasks import Torque
        >>> Torque(weight="inverse_inertia")
        Torque(weight=1.0)
    """

    on = "torque"

    def __init__(self, tau_0: Any = 0.0, *, weight: Any = 1.0, name: str | None = None) -> None:
        self._by_inertia = isinstance(weight, str)
        if self._by_inertia and weight != "inverse_inertia":
            raise InvalidInput(f"Torque.weight is {weight!r}; it must be numbers or 'inverse_inertia'")
        super().__init__(weight=1.0 if self._by_inertia else weight, name=name)
        self.target = tau_0

    def prepare(self, model: RobotModel) -> None:
        self.dim, self.labels = model.nj, model.joint_names
        self.units = tuple("N" if unit == "m" else "N m" for unit in model.joint_units)
        self._identity, self._vector = np.eye(model.nj), vector_target(model.nj)
        self.target = self.target

    def convert(self, name: str, value: Any, strict: bool) -> Vec:
        return self._vector(name, np.full(self.dim, value) if np.ndim(value) == 0 else value, strict)

    def fill(self, state: RobotState, out: LinearRows) -> None:
        tau_0 = self.reference(state.t).value
        if self._by_inertia:
            factor, _ = lapack.dpotrf(state.M, 1)
            # L⁻¹ is lower triangular: its joint columns are zero above their own block.
            nb = state.model.nb
            out.A[:] = lapack.dtrtri(factor, 1)[0][nb:, nb:]
            np.dot(out.A, tau_0, out.b)
        else:
            out.A[:] = self._identity
            out.b[:] = tau_0

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        wave = Sinusoid([1.0] * model.nj, amplitude=2.0, frequency=0.5)
        return [cls(), cls(wave, weight=1e-4), cls(1.0, weight="inverse_inertia")]
