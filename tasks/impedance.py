"""Impedance: Cartesian impedance control: a frame yields to forces like a spring and a damper."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, ClassVar, Self, final

import numpy as np
from scipy.linalg import lapack

from wbc import checks
from wbc.models.model import RobotModel, RobotState
from wbc.stack.task import LinearRows, LinearTask
from wbc.stack.tracking import Tracking, pose_target, rotation_error

from .motions import pose_motion, swing
from .required import inertia
from .trajectories import Sinusoid


@final
class Impedance(Tracking, LinearTask):
    """Λ (ẍ − ẍ_target) = K e + D ė + F: the frame's own inertia, a spring and a damper, for an unmeasured force F.

    Six rows on a: J a + J̇ v = ẍ_target + Λ⁻¹ (K e + D ė) with Λ⁻¹ = J M⁻¹ Jᵀ, e as :class:`~tasks.frame.Frame` has it,
    ė = ẋ_target − J v. Λ⁻¹ exists in every posture; where the frame cannot move, the spring does not move it. The
    inertia is that of a robot without contacts: on a fixed base, or in flight, the equation above is exact.

    ``stiffness`` K [N/m, N m/rad] and ``damping`` D [N s/m, N m s/rad]: scalar or (6,), >= 0. ``target`` as for Frame.
    To give it another inertia, measure the force: :class:`~tasks.admittance.Admittance`.
    Source: Hogan, J. Dynamic Systems, Measurement, and Control 1985; Khatib, IEEE J. Robotics and Automation 1987.

    Raises:
        InvalidInput: a target that is no pose, negative stiffness or damping. UnknownFrame: when a stack is
            compiled. NotSupported: then, a joint with which no inertia moves.

    Example:
        >>> from wbc.tasks import Impedance
        >>> here = [[1, 0, 0, 0.4], [0, 1, 0, 0], [0, 0, 1, 0.5], [0, 0, 0, 1]]
        >>> Impedance("tool", target=here, stiffness=[500, 500, 200, 20, 20, 20], damping=[60, 60, 40, 2, 2, 2])
        Impedance[tool](weight=1.0)
    """

    on, dim, units = "acceleration", 6, ("m/s²",) * 3 + ("rad/s²",) * 3
    labels, convert = ("x", "y", "z", "roll", "pitch", "yaw"), staticmethod(pose_target)
    checked: ClassVar[Mapping[str, Any]] = {
        "stiffness": partial(checks.gains, size=6), "damping": partial(checks.gains, size=6),
    }  # fmt: skip

    def __init__(
        self, frame: str, *, target: Any, stiffness: Any, damping: Any, weight: Any = 1.0, name: str | None = None
    ) -> None:
        self.frame = self.subject = frame
        super().__init__(weight=weight, name=name)
        self.stiffness, self.damping = stiffness, damping
        self.target = target

    def prepare(self, model: RobotModel) -> None:
        model.check_frame(self.frame)
        inertia(self.name, model)

    def fill(self, state: RobotState, out: LinearRows) -> None:
        frame, target = state.frame(self.frame), self.reference(state.t)
        rotation, position = target.value
        J = frame.jacobian()
        error = np.concatenate([position - frame.position, rotation_error(rotation, frame.rotation)])
        force = self.stiffness * error + self.damping * (target.rate - np.dot(J, state.v))
        factor, _ = lapack.dpotrf(state.M, 1)
        reached, _ = lapack.dpotrs(factor, np.dot(force, J), 1)  # M⁻¹ Jᵀ F
        out.A[:] = J
        out.b[:] = target.second + np.dot(J, reached) - frame.drift()

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        position = Sinusoid([0.3, 0.0, 0.5], amplitude=0.1, frequency=0.5)
        motion = pose_motion(position, swing(np.eye(3), [1, 2, 3], angle=0.4, frequency=0.6))
        frame = model.frame_names[-1]
        stiff = [500.0, 500.0, 200.0, 20.0, 20.0, 0.0]
        return [
            cls(frame, target=np.eye(4), stiffness=stiff, damping=30.0),
            cls(frame, target=motion, stiffness=9, damping=0),
        ]
