"""JointLimits: all limits of joints in one object: position, velocity, acceleration, jerk, torque."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self, final

from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel
from wbc.stack.constraint import Constraint, Constraints, JointInterval

from .joint_acceleration import JointAccelerationLimits
from .joint_jerk import JointJerkLimits
from .joint_position import JointPositionLimits
from .joint_velocity import JointVelocityLimits
from .torque import TorqueLimits
from .torque_speed import TorqueSpeedLimits

_OPTIONAL = ("position", "velocity", "torque")


@final
class JointLimits(Constraints):
    """Position, velocity, acceleration, jerk and torque of every joint, as one interval that is never empty.

    By default the model's own limits on position, velocity and torque; ``without`` leaves some of them out, and
    ``lower``, ``upper`` (positions), ``v_max`` and ``tau_max`` replace them: scalar, (nj,) or {joint: value}.
    ``braking``: see :class:`~tasks.limits.joint_position.JointPositionLimits`. Accelerations ``a_max`` and jerks
    ``j_max`` are limited where given. ``no_load_speed`` makes the torque limits fall with speed, see
    :class:`~tasks.limits.torque_speed.TorqueSpeedLimits`.

    Positions, velocities, accelerations and jerks become one interval for each joint, a bound on the unknown of the
    level (:class:`~wbc.stack.interval.JointIntervals`). docs/limits.md says in which order they hold, and how fast a
    joint outside its limits returns. Torque limits are rows of inverse dynamics. Other levels leave them out, and
    refuse ``tau_max`` and ``no_load_speed``.

    Raises:
        InvalidInput: a limit that makes no sense, by joint name; ``without`` anything else. UnknownJoint.

    Example:
        >>> import wbc
        >>> from wbc.tasks import JointLimits
        >>> limits = JointLimits(a_max=20.0, j_max=500.0, without=["torque"])
        >>> [constraint.name for constraint in limits.constraints(wbc.InverseDynamics().bounds)]
        ['JointLimits.position', 'JointLimits.velocity', 'JointLimits.acceleration', 'JointLimits.jerk']
    """

    def __init__(
        self, *, lower: Any = None, upper: Any = None, v_max: Any = None, a_max: Any = None, j_max: Any = None,
        tau_max: Any = None, no_load_speed: Any = None, braking: float | None = None, without: Sequence[str] = (),
        name: str | None = None,
    ) -> None:  # fmt: skip
        super().__init__(name=name)
        given = {"position": (lower, upper), "velocity": (v_max,), "torque": (tau_max, no_load_speed)}
        without = [without] if isinstance(without, str) else checks.items(f"{self.name}.without", without, "quantities")
        for i, quantity in enumerate(without):
            checks.one_of(f"{self.name}.without[{i}]", quantity, _OPTIONAL)
            if any(value is not None for value in given[quantity]):
                raise InvalidInput(f"{self.name} is without {quantity} and has limits on it")
        if braking is not None:
            checks.number(f"{self.name}.braking", braking, low=0.0, strict=True)
        self._constraints: list[JointInterval] = []
        if "position" not in without:
            self._constraints.append(
                JointPositionLimits(lower=lower, upper=upper, braking=braking, name=f"{self.name}.position")
            )
        if "velocity" not in without:
            self._constraints.append(JointVelocityLimits(v_max, name=f"{self.name}.velocity"))
        if a_max is not None:
            self._constraints.append(JointAccelerationLimits(a_max, name=f"{self.name}.acceleration"))
        if j_max is not None:
            self._constraints.append(JointJerkLimits(j_max, name=f"{self.name}.jerk"))
        if no_load_speed is not None:
            self._constraints.append(TorqueSpeedLimits(no_load_speed, tau_max, name=f"{self.name}.torque"))
        elif "torque" not in without:
            self._constraints.append(TorqueLimits(tau_max, name=f"{self.name}.torque"))
        self._asks_for_torque = tau_max is not None or no_load_speed is not None

    def prepare(self, model: RobotModel) -> None:
        for constraint in self._constraints:
            if constraint.quantity != "torque" or self._asks_for_torque:
                constraint.prepare(model)

    def constraints(self, carried: frozenset[str]) -> Sequence[Constraint]:
        asked = self._asks_for_torque
        return [
            constraint
            for constraint in self._constraints
            if constraint.quantity in carried or constraint.quantity != "torque" or asked
        ]

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        return [cls(), cls(a_max=20.0, j_max=500.0, no_load_speed=20.0), cls(lower=-1.0, upper=1.0, without=["torque"])]
