"""JointImpedance: joint impedance control: torques of springs and dampers on joints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self, final

import numpy as np

from wbc import checks
from wbc.models import plausible
from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelLinearTask
from wbc.stack.kernel_rows import KernelRows
from wbc.stack.tracking import Tracking, joints_target
from wbc.types import Vec

from .joint_task import TorqueTask
from .trajectories import Sinusoid


@final
class JointImpedance(Tracking, TorqueTask, KernelLinearTask):
    """τ = g(q) + K (q_target − q) + D (q̇_target − q̇), one row a joint [N m, N]; with ``coriolis``, + C(q, q̇) q̇.

    A spring K [N m/rad, N/m] and a damper D [N m s/rad, N s/m] in each joint, which feel the same wherever the arm is:
    on a fixed base M q̈ + C q̇ = K e + D ė + what pushes it, and without ``coriolis`` the energy
    ½ q̇ᵀ M q̇ + ½ eᵀ K e never rises by itself, so that it is safe to touch and stands whatever it touches. A steady
    force F moves it by K⁻¹ Jᵀ F. It does not follow fast targets closely: no inertia is fed forward. A torque is held
    for a tick dt, in which a damper must not turn a joint of inertia m around: D < m / dt. The regularisation ε of
    the level pulls accelerations towards zero, torques by about the share ε / (weight m²): for light joints a large
    weight, or ``exactly()`` in ``subject_to``.

    Rather :class:`~tasks.posture.Posture`, q̈ = kp e + kd ė, where targets are to be met and the model's inertia is
    good (its springs are kp M: stiff far out, soft at the wrist); :class:`~tasks.joint_admittance.JointAdmittance`
    where torques are measured and the inertia that is felt is to be chosen; :class:`~tasks.impedance.Impedance` for a
    frame. For legs that stand see :class:`~tasks.gravity_compensation.GravityCompensation`: g is that of limbs that
    touch nothing. Put no motion task of the same joints in a level above: it would override the spring.

    ``target``: joint positions (nj,), or of the joints named alone, or a configuration (nq,), or a function of time
    giving one or (positions, velocities, accelerations); accelerations are not used. ``stiffness`` and ``damping`` are
    >= 0: scalar, one for each row, or {name or pattern: number} for all of them, and may be assigned between ticks.
    ``joints``: names or patterns (regular expressions that match whole names), for these alone.

    Raises:
        InvalidInput: when a stack is compiled: a target, stiffness or damping of another size, a joint without them.
        UnknownJoint: when a stack is compiled.

    Example:
        >>> import wbc
        >>> from wbc.tasks import JointImpedance
        >>> JointImpedance(wbc.load("arm").q0, stiffness={".*": 80.0, "wrist_.*": 10.0}, damping=4.0)
        JointImpedance(weight=1.0)
    """

    read_once = frozenset({"coriolis"})

    def __init__(
        self, target: Any, *, stiffness: Any, damping: Any, coriolis: bool = False, joints: Sequence[str] | None = None,
        weight: Any = 1.0, name: str | None = None,
    ) -> None:  # fmt: skip
        super().__init__(joints=joints, weight=weight, name=name)
        self.coriolis = checks.truth(f"{self.name}.coriolis", coriolis)
        self.stiffness, self.damping, self.target = stiffness, damping, target

    @property
    def stiffness(self) -> Any:
        """K, as it was given."""
        return self._stiffness

    @stiffness.setter
    def stiffness(self, value: Any) -> None:
        self._stiffness, self._K = self._gain("stiffness", value)

    @property
    def damping(self) -> Any:
        """D, as it was given."""
        return self._damping

    @damping.setter
    def damping(self, value: Any) -> None:
        self._damping, self._D = self._gain("damping", value)

    def _gain(self, what: str, value: Any) -> tuple[Any, Vec]:
        given = self._numbers(what, value)
        return given, self._all_rows(what, given) if hasattr(self, "dim") else np.zeros(0)

    def prepare(self, model: RobotModel) -> None:
        super().prepare(model)
        self.target_dim = model.nj
        self.convert = joints_target(model, model.nq, self._index, model.q0[-model.nj :])
        self.convert_rate = joints_target(model, model.nj, self._index)
        self.stiffness, self.damping, self.target = self.stiffness, self.damping, self.target
        plausible.joints(model, f"{self.name}.target", self.reference(0.0).value)

    def kernel_rows(self) -> KernelRows:
        numbers, bias = [*self._index, *self._K, *self._D], "h" if self.coriolis else "g"
        return KernelRows.tracking(
            self, "wbc.tasks.compiled.force:impedance", numbers=numbers, constant=self._rows_of_joints, bias=bias
        )  # fmt: skip

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        joints = model.q0[-model.nj :]
        last = model.joint_names[-1]
        return [
            cls(Sinusoid(joints, amplitude=0.1, frequency=0.5), stiffness=50.0, damping=5.0, coriolis=True),
            cls([0.1], joints=[last], stiffness={last: 20.0}, damping=[2.0]),
        ]
