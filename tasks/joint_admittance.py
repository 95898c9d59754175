"""JointAdmittance: joint admittance control: moves joints like chosen inertias on springs under measured torques."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelTask
from wbc.stack.kernel_rows import KernelRows
from wbc.stack.target import Target
from wbc.stack.tracking import Tracking, joints_target
from wbc.types import Vec

from .joint_task import JointTask
from .trajectories import Sinusoid


@final
class JointAdmittance(Tracking, JointTask, KernelTask):
    """M (q̈ − q̈_target) = K (q_target − q) + D (q̇_target − q̇) + τ for measured outer torques τ; one row a joint.

    :class:`~tasks.admittance.Admittance` for joints: at the acceleration level that equation, at the velocity level the
    same without inertia. Where K > 0 the torque moves the target, by τ / K; where K = 0 the joint moves with τ / D for
    as long as it is pushed. ``inertia`` M [kg m², kg] and ``damping`` D > 0, ``stiffness`` K >= 0: scalar or (nj,),
    or by name or pattern, as ``joints`` and weight are too, see :class:`~tasks.joint_task.JointTask`.
    ``target`` as :class:`~tasks.posture.Posture` has it. ``torque`` τ [N m, N]: scalar or (nj,), or a function of time
    giving (nj,); it may be assigned between ticks.

    Raises:
        InvalidInput: when a stack is compiled: another size, inertia or damping that are not positive.

    Example:
        >>> import wbc
        >>> from wbc.tasks import JointAdmittance
        >>> guided = JointAdmittance(wbc.load("arm").q0, inertia=0.5, damping=4.0, stiffness=0.0)
        >>> guided.torque = [0.0, 1.5, 0.0, 0.0, 0.0, 0.0, 0.0]  # what the sensors of the joints read now
    """

    read_once = frozenset({"damping", "inertia", "kd", "kp", "stiffness"})

    def __init__(
        self, target: Any, *, inertia: Any, damping: Any, stiffness: Any, torque: Any = 0.0,
        joints: Sequence[str] | None = None, weight: Any = 1.0, name: str | None = None,
    ) -> None:  # fmt: skip
        super().__init__(joints=joints, weight=weight, name=name)
        self.inertia, self.damping, self.stiffness = inertia, damping, stiffness
        self.target, self.torque = target, torque

    @property
    def torque(self) -> Any:
        """What was given."""
        return self._measured

    @torque.setter
    def torque(self, value: Any) -> None:
        dim = getattr(self, "dim", None)
        if dim is not None:
            given = np.full(dim, value) if not callable(value) and checks.ndim(value) == 0 else value
            self._reading = Target(f"{self.name}.torque", given, dim, self._as_torques)
        self._measured = value

    def prepare(self, model: RobotModel) -> None:
        super().prepare(model)
        M, D, K = (self._all_rows(what, getattr(self, what)) for what in ("inertia", "damping", "stiffness"))
        own = self.own_rows(np.ones(model.nj)) > 0.0
        M, D = np.where(own, M, 1.0), np.where(own, D, 1.0)
        for what, values in (("inertia", M), ("damping", D)):
            if not values.all():
                raise InvalidInput(f"{self.name}.{what}[{int(np.argmin(values))}] is 0; it must be > 0")
        self._kp, self._kd = K / M, D / M
        held = K > 0.0
        self._held: Vec = held.astype(np.float64)
        self._compliance = np.divide(1.0, K, out=np.zeros(model.nj), where=held)
        self._mobility = np.where(held, 0.0, 1.0 / D)
        self._read_targets(model, model.nq)
        self._as_torques = joints_target(model, model.nj, self._chosen)
        self.target, self.torque = self.target, self.torque

    def _read(self, t: float) -> Target:
        return self._reading.at(t)

    def kernel_rows(self) -> KernelRows:
        numbers = [*self._held, *self._compliance, *self._mobility]
        return KernelRows.tracking(self, "wbc.tasks.compiled.joint:admittance", numbers=numbers, also=(self._read,))

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        joints = model.q0[-model.nj :]
        moving = Sinusoid(joints, amplitude=0.1, frequency=0.5)
        two = model.joint_names[:2]
        return [
            cls([0.1, 0.2], joints=two, inertia={two[0]: 1.0, ".*": 2.0}, damping=[5.0, 8.0], stiffness={".*": 3.0}),
            cls(moving, inertia=1.0, damping=10.0, stiffness=50.0, torque=2.0),
            cls(joints, inertia=1.0, damping=10.0, stiffness=0.0, torque=np.arange(1.0, model.nj + 1.0)),
        ]
