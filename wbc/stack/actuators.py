"""Actuators: what motors make of a command, as far as it is known."""

from __future__ import annotations

from typing import final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput
from wbc.types import Vec


@final
class Actuators:
    """Motor i turns the command u_i into the torque τ_i = share_i u_i − offset_i [N m, N]; sound: share 1, offset 0.

    Components say here what they found out; the controller then sends the command that gives the torque decided,
    u = (τ + offset) / share. A motor of share 0 gives nothing whatever it is sent, and is sent 0.

    Example:
        >>> import numpy as np
        >>> from wbc.stack.actuators import Actuators
        >>> motors = Actuators(2)
        >>> motors.set(1, share=0.5, offset=1.0)
        >>> motors.command(np.array([3.0, 3.0])), motors.torque(np.array([3.0, 8.0]))
        (array([3., 8.]), array([3., 3.]))
    """

    def __init__(self, nj: int) -> None:
        self._share, self._offset = np.ones(nj), np.zeros(nj)
        self._inverse = np.ones(nj)
        self._sound = True

    @property
    def share(self) -> Vec:
        """(nj,), a copy."""
        return self._share.copy()

    @property
    def offset(self) -> Vec:
        """(nj,) [N m, N], a copy."""
        return self._offset.copy()

    def set(self, joint: int, *, share: float = 1.0, offset: float = 0.0) -> None:
        """From this tick on motor ``joint`` is like that.

        Raises:
            InvalidInput: no such joint, a share that is not between 0 and 1, an offset that is not finite.
        """
        if not 0 <= joint < len(self._share):
            raise InvalidInput(f"joint is {joint}; there are joints 0 to {len(self._share) - 1}")
        self._share[joint] = checks.number("share", share, low=0.0, high=1.0)
        self._offset[joint] = checks.number("offset", offset)
        self._inverse[joint] = 1.0 / share if share > 0.0 else 0.0
        self._sound = bool((self._share == 1.0).all() and (self._offset == 0.0).all())

    def reset(self) -> None:
        """All motors are sound."""
        self._share[:], self._offset[:], self._inverse[:], self._sound = 1.0, 0.0, 1.0, True

    def command(self, tau: Vec) -> Vec:
        """u (nj,) that gives the torques ``tau`` (nj,); the same array where all motors are sound."""
        if self._sound:
            return tau
        command: Vec = (tau + self._offset) * self._inverse
        command.flags.writeable = False
        return command

    def torque(self, command: Vec) -> Vec:
        """τ (nj,) that ``command`` (nj,) gives; the same array where all motors are sound."""
        return command if self._sound else self._share * command - self._offset

    def bounds(self, lower: Vec, upper: Vec) -> tuple[Vec, Vec]:
        """Torques (nj,) that commands within ``lower`` and ``upper`` (nj,) give."""
        return self._share * lower - self._offset, self._share * upper - self._offset
