"""KineticEnergy: kinetic-energy regularisation: minimises ½ vᵀ M v, so light parts move rather than heavy ones."""

from __future__ import annotations

from typing import Any, final

import numpy as np
from scipy.linalg import lapack

from wbc.models.model import RobotModel, RobotState
from wbc.stack.task import Task, TaskRows

from .required import inertia


@final
class KineticEnergy(Task):
    """The cost at the velocity level is w T, T = ½ vᵀ M v: nv rows y = Lᵀ v [√J] with M = L Lᵀ, to be zero.

    Acceleration level: ẏ = −kd y, so that T falls as e^(−2 kd t) if there is no other task. Of the motions that
    fulfil the other tasks equally well, the one with the least kinetic energy is chosen.
    L̇ = L Φ(L⁻¹ Ṁ L⁻ᵀ), Φ the lower half and half the diagonal, Ṁ = C + Cᵀ.

    Raises:
        NotSupported: when a stack is compiled, a joint with which no inertia moves: M has no such L.

    Example:
        >>> from wbc.tasks import KineticEnergy
        >>> KineticEnergy(kd=5.0, weight=1e-3)
        KineticEnergy(weight=0.001)
    """

    units = "√J s"

    def __init__(self, *, kd: Any = 10.0, weight: Any = 1.0, name: str | None = None) -> None:
        super().__init__(kp=0.0, kd=kd, weight=weight, name=name)

    def prepare(self, model: RobotModel) -> None:
        inertia(self.name, model)
        self.dim = model.nv
        self._half = np.tril(np.ones((model.nv, model.nv)), -1) + 0.5 * np.eye(model.nv)

    def fill(self, state: RobotState, out: TaskRows) -> None:
        L, _ = lapack.dpotrf(state.M, 1)
        out.e[:] = 0.0
        out.J[:] = L.T
        if state.drifts:
            # L̇ᵀ v = Φᵀ Lᵀ v
            inverse, _ = lapack.dtrtri(L, 1)
            C = np.dot(np.dot(inverse, state.coriolis), inverse.T)
            np.dot(((C + C.T) * self._half).T, np.dot(L.T, state.v), out.drift)
