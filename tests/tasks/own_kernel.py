"""A compiled task in a module of a user's own, with rows that it also writes by hand: see test_compiled_rows.py."""

from __future__ import annotations

from math import sqrt
from typing import Any, Self

import numpy as np

from wbc.compiled import callee, kernel
from wbc.models.model import RobotModel, RobotState
from wbc.stack.compiled.geometry import Three, dot, plus, scaled, three
from wbc.stack.compiled.row_kernel import rows
from wbc.stack.kernel_rows import KernelRows
from wbc.stack.target import vector_target
from wbc.stack.task import Task, TaskRows
from wbc.stack.tracking import Tracking


@kernel
def across(x: Three, axis: Three) -> Three:
    """What of a vector is not along a unit axis."""
    return plus(x, -dot(axis, x), axis)


@callee
def radius(at: int) -> int:
    """How far a frame is from a line; ``numbers``: a point of the line, its direction."""
    k = rows(at)
    axis = three(k.numbers, 3)
    away = across(plus(three(k.place[0], 9), -1.0, three(k.numbers, 0)), axis)
    sideways = across(three(k.motion[0], 0), axis)
    r = sqrt(dot(away, away))
    n = scaled(1.0 / r, away)
    k.e[0] = k.value[0] - r
    k.C[0, 0], k.C[0, 1], k.C[0, 2] = n[0], n[1], n[2]
    k.bent[0] = (dot(sideways, sideways) - dot(n, sideways) ** 2) / r
    k.rate_ref[0], k.acc_ref[0] = k.rate[0], k.second[0]
    return 1


class Radius(Tracking, Task):
    """e = target − distance of a frame from a line [m]: one row."""

    dim, units, convert = 1, "m", staticmethod(vector_target(1))

    def __init__(self, frame: str, *, target: Any, kernel: str = f"{__name__}:radius", **settings: Any) -> None:
        self.frame = self.subject = frame
        super().__init__(**settings)
        self.kernel, self.target = kernel, target
        self.point, self.axis = np.array([0.1, -0.7, 0.2]), np.array([0.48, 0.6, 0.64])

    def kernel_rows(self) -> KernelRows:
        return KernelRows.tracking(self, self.kernel, self.frame, numbers=[*self.point, *self.axis])

    def fill(self, state: RobotState, out: TaskRows) -> None:
        frame, P = state.frame(self.frame), np.eye(3) - np.outer(self.axis, self.axis)
        away, J = P @ (frame.position - self.point), P @ frame.jacobian()[:3]
        r = np.linalg.norm(away)
        n, sideways, target = away / r, J @ state.v, self.reference(state.t)
        out.e, out.J = target.value - r, n @ J
        out.drift = n @ frame.drift()[:3] + (sideways @ sideways - (n @ sideways) ** 2) / r
        out.rate_ref, out.acc_ref = target.rate, target.second

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        frame = model.frame_names[-1]
        return [cls(frame, target=[0.3]), cls(frame, target=lambda t: ([0.3 + 0.1 * t], [0.1], [0.0]))]
