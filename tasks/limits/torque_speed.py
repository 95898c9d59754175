"""TorqueSpeedLimits: limits joint torques by the torque-speed curve of the motors."""

from __future__ import annotations

from typing import Any, Self, final

import numpy as np

from wbc.errors import InvalidInput
from wbc.models.model import RobotModel
from wbc.stack.constraint import TorqueBySpeed
from wbc.types import Vec

from .per_joint import per_joint, positive


@final
class TorqueSpeedLimits(TorqueBySpeed):
    """A motor's torque against its speed: full up to the corner, then falling to nothing at the no-load speed v₀.

    τ <= tau_max · clip((v₀ − v) / (v₀ − v_c), 0, 1) and mirrored for the other direction: a motor that is driven
    backwards may brake with all it has. ``no_load_speed`` v₀ and ``corner_speed`` v_c < v₀ [rad/s, m/s], ``tau_max``
    [N m, N]: scalar, (nj,) or {joint: value}; v₀ is inf for joints left out, v_c 0, the straight line of a DC motor,
    and tau_max the model's.

    Raises:
        InvalidInput: zero, negative or NaN, a corner that is not below the no-load speed, by joint name. UnknownJoint.

    Example:
        >>> import numpy as np, wbc
        >>> from wbc.tasks import TorqueSpeedLimits
        >>> constraint, robot = TorqueSpeedLimits(4.0, 40.0), wbc.load("arm")
        >>> constraint.prepare(robot)
        >>> lower, upper = constraint.bounds(robot)
        >>> constraint.narrow(np.full(robot.nj, 3.0), lower, upper)
        >>> float(lower[0]), float(upper[0])
        (-40.0, 10.0)
    """

    read_once = frozenset({"corner_speed", "no_load_speed", "tau_max"})

    def __init__(
        self, no_load_speed: Any, tau_max: Any = None, *, corner_speed: Any = None, name: str | None = None
    ) -> None:
        super().__init__(name=name)
        self.no_load_speed, self.tau_max, self.corner_speed = no_load_speed, tau_max, corner_speed

    def prepare(self, model: RobotModel) -> None:
        what = f"{self.name}.no_load_speed"
        free = positive(what, per_joint(what, self.no_load_speed, model, np.full(model.nj, np.inf)), model)
        corner = per_joint(f"{self.name}.corner_speed", self.corner_speed, model, np.zeros(model.nj))
        for joint, v_c, v_0 in zip(model.joint_names, corner, free, strict=True):
            if not 0.0 <= v_c < v_0:
                raise InvalidInput(
                    f"{self.name}: joint {joint!r} has the corner speed {v_c:g}; it must be at least 0 and below the "
                    f"no-load speed {v_0:g}"
                )
        self._tau_max = self.bounds(model)[1]
        # Share of the torque left: offset − slope v upwards, offset + slope v downwards; 1 for joints left out.
        limited = np.isfinite(free)
        slope = np.divide(1.0, free - corner, out=np.zeros(model.nj), where=limited)
        self._slope = np.array([-slope, slope])
        self._offset = np.where(limited, free, 1.0) * np.where(limited, slope, 1.0)
        self._left = np.zeros((2, model.nj))

    def bounds(self, model: RobotModel) -> tuple[Vec, Vec]:
        what = f"{self.name}.tau_max"
        tau_max = positive(what, per_joint(what, self.tau_max, model, model.limits.tau_max), model)
        for joint, tau, v_0 in zip(
            model.joint_names, tau_max,
            per_joint(f"{self.name}.no_load_speed", self.no_load_speed, model, np.full(model.nj, np.inf)), strict=True,
        ):  # fmt: skip
            if np.isinf(tau) and np.isfinite(v_0):
                raise InvalidInput(f"{self.name}: joint {joint!r} has a no-load speed and no tau_max")
        return -tau_max, tau_max

    def narrow(self, v: Vec, lower: Vec, upper: Vec) -> None:
        left = np.multiply(self._slope, v, self._left)
        left += self._offset
        np.maximum(left, 0.0, out=left)
        np.minimum(left, 1.0, out=left)
        left *= self._tau_max
        np.minimum(upper, left[0], out=upper)
        np.maximum(lower, -left[1], out=lower)

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        joint = model.joint_names[0]
        return [cls(20.0, 30.0), cls({joint: 8.0}, corner_speed={joint: 5.0})]
