"""Yaw: which way an axis of a frame points on the map."""

from __future__ import annotations

from typing import Any, Self, final

import numpy as np
import pinocchio

from wbc import checks
from wbc.models.model import RobotModel, RobotState
from wbc.stack.target import vector_target
from wbc.stack.task import Task, TaskRows
from wbc.stack.tracking import Tracking
from wbc.types import Vec

from .directions import unit_axis
from .trajectories import Sinusoid

#: Below this length of its shadow on the ground an axis counts as having that one: upright, it points nowhere.
_SHORTEST = 1e-2


@final
class Yaw(Tracking, Task):
    """e = ψ_target − ψ [rad] in [−π, π): one row. ψ = atan2(u_y, u_x), u = R ``axis`` in the world.

    ψ̇ = (u_x u̇_y − u_y u̇_x) / ρ², ρ² = u_x² + u_y². An upright axis points nowhere on the map: below ρ = 0.01, half a
    degree from upright, ψ̇ is computed with 0.01, so that it stays finite.

    ``axis`` (3,) in the frame, by default its x; ``target`` [rad], any number of turns, or a function of time giving it
    or (angle, rate, acceleration), (1,) each.

    Raises:
        InvalidInput: an axis that is zero, a target that is no number. UnknownFrame: when a stack is compiled.

    Example:
        >>> from wbc.tasks import Yaw
        >>> Yaw("torso", target=0.5, kp=50)
        Yaw[torso](weight=1.0)
    """

    dim, units, labels = 1, "rad", ("yaw",)

    def __init__(
        self, frame: str, *, target: Any, axis: Any = (1.0, 0.0, 0.0), kp: Any = 100.0, kd: Any = None,
        rate: Any = None, weight: Any = 1.0, name: str | None = None,
    ) -> None:  # fmt: skip
        self.frame = self.subject = frame
        super().__init__(kp=kp, kd=kd, rate=rate, weight=weight, name=name)
        self.axis = unit_axis(f"{self.name}.axis", axis)
        self.target = target

    @staticmethod
    def convert(name: str, value: Any, strict: bool) -> Vec:
        """An angle, as a number or (1,)."""
        return _angle(name, [value] if checks.ndim(value) == 0 else value, strict)

    def prepare(self, model: RobotModel) -> None:
        model.check_frame(self.frame)

    def fill(self, state: RobotState, out: TaskRows) -> None:
        frame, target = state.frame(self.frame), self.reference(state.t)
        turn, u = frame.jacobian()[3:], np.dot(frame.rotation, self.axis)
        x, y, z = u.tolist()
        shadow = max(x * x + y * y, _SHORTEST**2)
        # u̇ = ω × u, so x u̇_y − y u̇_x = (−x z, −y z, x² + y²) · ω
        across = np.array([-x * z, -y * z, x * x + y * y]) / shadow
        out.e[:] = (target.value - np.arctan2(y, x) + np.pi) % (2.0 * np.pi) - np.pi
        out.J[0] = np.dot(across, turn)
        out.rate_ref[:], out.acc_ref[:] = target.rate, target.second
        if state.drifts:
            spin = pinocchio.skew(np.dot(turn, state.v))
            rate = np.dot(spin, u)
            second = np.dot(pinocchio.skew(frame.angular_drift()), u) + np.dot(spin, rate)
            yaw_rate = (x * rate[1] - y * rate[0]) / shadow
            out.drift[:] = (x * second[1] - y * second[0] - 2.0 * yaw_rate * (x * rate[0] + y * rate[1])) / shadow

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        frame, moving = model.frame_names[-1], Sinusoid([0.3], amplitude=0.5, frequency=0.7)
        return [cls(frame, target=0.2), cls(frame, target=moving, axis=[0.0, 1.0, 1.0])]


_angle = vector_target(1)
