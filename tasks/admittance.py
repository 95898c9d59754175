"""Admittance: admittance control: moves a frame like a chosen mass, spring and damper under the measured force."""

from __future__ import annotations

from typing import Any, Self, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelTask
from wbc.stack.kernel_rows import KernelRows
from wbc.stack.target import Target
from wbc.stack.tracking import Tracking, pose_target, wrench_target

from .motions import pose_motion, swing
from .trajectories import Sinusoid


@final
class Admittance(Tracking, KernelTask):
    """M (ẍ − ẍ_target) = K e + D ė + F for the measured wrench F; six rows, position then orientation, world axes.

    Acceleration level: that equation, kp = K / M, kd = D / M. Velocity level: the same without inertia,
    D (ẋ − ẋ_target) = K e + F, rate = K / D. Where K > 0 the force moves the target, by F / K; where K = 0 there is no
    place to go back to, and the frame moves with F / D for as long as it is pushed: guiding by hand.

    ``inertia`` M [kg, kg m²], ``damping`` D [N s/m, N m s/rad], both > 0, ``stiffness`` K >= 0 [N/m, N m/rad]: scalar
    or (6,). ``wrench`` F on the frame's origin: (3,), the force alone, or (6,), or a function of time giving the
    reading; it may be assigned between ticks. With ``InverseDynamics`` a :class:`~tasks.MeasuredWrench` beside it
    tells the dynamics about the same force. Source: Hogan, J. Dynamic Systems, Measurement, and Control 1985.

    Raises:
        InvalidInput: a target that is no pose, a wrench of another shape, inertia or damping that are not positive.
        UnknownFrame: when a stack is compiled.

    Example:
        >>> from wbc.tasks import Admittance
        >>> here = [[1, 0, 0, 0.4], [0, 1, 0, 0], [0, 0, 1, 0.5], [0, 0, 0, 1]]
        >>> guided = Admittance("tool", target=here, inertia=2.0, damping=20.0, stiffness=0.0)
        >>> guided.wrench = [5.0, 0.0, 0.0]  # what the sensor reads now
    """

    dim, units, convert = 6, ("m", "m", "m", "rad", "rad", "rad"), staticmethod(pose_target)
    labels = ("x", "y", "z", "roll", "pitch", "yaw")
    read_once = frozenset({"inertia", "damping", "kd", "kp", "stiffness"})

    def __init__(
        self, frame: str, *, target: Any, inertia: Any, damping: Any, stiffness: Any, wrench: Any = (0.0, 0.0, 0.0),
        weight: Any = 1.0, name: str | None = None,
    ) -> None:  # fmt: skip
        self.frame = self.subject = frame
        self._name = name
        self.inertia, self.damping, self.stiffness = (
            checks.gains(f"{self.name}.{what}", value, self.dim)
            for what, value in (("inertia", inertia), ("damping", damping), ("stiffness", stiffness))
        )
        for what, values in (("inertia", self.inertia), ("damping", self.damping)):
            if not values.all():
                raise InvalidInput(f"{self.name}.{what}[{int(np.argmin(values))}] is 0; it must be > 0")
        super().__init__(
            kp=self.stiffness / self.inertia, kd=self.damping / self.inertia, weight=weight, name=name
        )  # fmt: skip
        self._held = self.stiffness > 0.0
        self._compliance = np.divide(1.0, self.stiffness, out=np.zeros(6), where=self._held)
        self._mobility = np.where(self._held, 0.0, 1.0 / self.damping)
        self.target, self.wrench = target, wrench

    @property
    def wrench(self) -> Any:
        """What was given."""
        return self._measured

    @wrench.setter
    def wrench(self, value: Any) -> None:
        self._reading = Target(f"{self.name}.wrench", value, self.dim, wrench_target)
        self._measured = value

    def prepare(self, model: RobotModel) -> None:
        model.check_frame(self.frame)

    def _read(self, t: float) -> Target:
        return self._reading.at(t)

    def kernel_rows(self) -> KernelRows:
        numbers = [*self._held, *self._compliance, *self._mobility]
        return KernelRows.tracking(
            self, "wbc.tasks.compiled.frame:admittance", self.frame, numbers=numbers, also=(self._read,), leads=True
        )

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        position = Sinusoid([0.3, 0.0, 0.5], amplitude=0.1, frequency=0.5)
        motion = pose_motion(position, swing(np.eye(3), [1, 2, 3], angle=0.4, frequency=0.6))
        frame = model.frame_names[-1]
        return [
            cls(frame, target=motion, inertia=2.0, damping=20.0, stiffness=100.0, wrench=[5.0, -3.0, 2.0]),
            cls(frame, target=np.eye(4), inertia=2.0, damping=20.0, stiffness=0.0, wrench=[1.0, 2, 3, 4, 5, 6]),
        ]  # fmt: skip
