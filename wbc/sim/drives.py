"""PositionDrives: joints whose drives follow positions, as most industrial and many legged robots have."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel
from wbc.types import Vec, read_only

#: A drive of the usual stiffness gives all its torque at this distance from where it is to be [rad, m].
DEFLECTION = 0.1
#: Usual damping over stiffness [s].
DAMPING_TIME = 0.05


@final
@dataclass(frozen=True, kw_only=True, eq=False)
class PositionDrives(metaclass=TellsArguments):
    """Drives that hold each joint at its commanded position, like a spring and a damper:

        τ = K (q* − q) + D (q̇* − q̇) + τ*        cut to the joint's torque limit

    in every step of the physics, between commands too. q* and q̇* are ``command.q`` and ``command.v``, the state at the
    end of the tick; τ* is ``command.tau``, where the level decides torques and ``feed_forward`` is set, else 0.

    Args:
        stiffness: K [N m/rad, N/m], one for all joints or (nj,); default: the torque limit per 0.1 rad (0.1 m).
        damping: D [N m s/rad, N s/m], likewise; default: K times 0.05 s.
        feed_forward: whether the drives add the torques that are sent with the positions.

    Raises:
        InvalidInput: a number that is negative or none. In a plant: gains for another number of joints; no stiffness
            given, and a joint without torque limit.

    Example:
        >>> import wbc
        >>> from wbc.sim.drives import PositionDrives
        >>> robot = wbc.load("arm")
        >>> stiffness, damping = PositionDrives().gains(robot)
        >>> bool((stiffness == 10.0 * robot.limits.tau_max).all())
        True
    """

    stiffness: Any = None
    damping: Any = None
    feed_forward: bool = True

    def __post_init__(self) -> None:
        checks.truth("feed_forward", self.feed_forward)
        for name in ("stiffness", "damping"):
            given = getattr(self, name)
            if given is None:
                continue
            object.__setattr__(self, name, read_only(checks.one_or_more(name, given, low=0.0)))

    def gains(self, robot: RobotModel) -> tuple[Vec, Vec]:
        """K and D (nj,) of ``robot``.

        Raises:
            InvalidInput: gains for another number of joints; no stiffness given, and a joint without torque limit.
        """
        if self.stiffness is None and not np.isfinite(robot.limits.tau_max).all():
            endless = robot.joint_names[int(np.argmin(np.isfinite(robot.limits.tau_max)))]
            raise InvalidInput(f"joint {endless!r} has no torque limit to take a stiffness from: give stiffness")
        usual = robot.limits.tau_max / DEFLECTION
        stiffness = self._spread("stiffness", usual if self.stiffness is None else self.stiffness, robot)
        usual = stiffness * DAMPING_TIME
        return stiffness, self._spread("damping", usual if self.damping is None else self.damping, robot)

    @staticmethod
    def _spread(name: str, values: Any, robot: RobotModel) -> Vec:
        if np.ndim(values) and np.shape(values) != (robot.nj,):
            raise InvalidInput(f"{name} has shape {np.shape(values)}; {robot.name} has {robot.nj} joints")
        return np.array(np.broadcast_to(values, (robot.nj,)), dtype=np.float64)

    def as_dict(self, robot: RobotModel) -> dict[str, Any]:
        """Every setting by name, for a report."""
        stiffness, damping = self.gains(robot)
        return {
            "stiffness": stiffness.tolist(), "damping": damping.tolist(), "feed_forward": self.feed_forward,
        }  # fmt: skip
