"""GravityCompensation: gives joints the torques of their own weight, so that a person can lead an arm by hand."""

from __future__ import annotations

from typing import Self, final

from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelLinearTask
from wbc.stack.kernel_rows import KernelRows

from .joint_task import TorqueTask


@final
class GravityCompensation(TorqueTask, KernelLinearTask):
    """τ = g(q), one row a joint [N m, N]: the torques that hold the links still, at rest, wherever they are.

    Alone on a fixed base it makes an arm that floats and is led by hand: M q̈ + C q̇ = what pushes it; add
    :class:`~tasks.damping.Damping` or :class:`~tasks.joint_impedance.JointImpedance` so that it comes to rest. In a
    level below other tasks it sets the torques that these leave free, in place of zero (:class:`~tasks.torque.Torque`).

    g is that of the links beyond each joint. It is right for limbs that touch nothing: an arm on a fixed base, those of
    a humanoid by ``joints``. It is wrong for a leg that stands, whose torques depend on the forces of its contacts;
    there tasks on motion decide, gravity being in the dynamics already. ``joints``: names or patterns.

    Raises:
        InvalidInput: no names, or one twice. UnknownJoint: when a stack is compiled.

    Example:
        >>> import numpy as np, wbc
        >>> from wbc.tasks import GravityCompensation
        >>> robot = wbc.load("arm")
        >>> controller = wbc.Controller(robot, wbc.Stack([GravityCompensation()]), level=wbc.InverseDynamics())
        >>> bool(np.abs(controller.tick(0.0, robot.q0, np.zeros(7)).a).max() < 1e-6)
        True
    """

    def kernel_rows(self) -> KernelRows:
        return KernelRows(
            "wbc.tasks.compiled.force:gravity", numbers=self._index, constant=self._rows_of_joints, bias="g"
        )

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        return [cls(), cls(joints=[model.joint_names[-1]], weight=1e-2)]
