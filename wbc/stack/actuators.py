"""Actuators: what motors make of a command, as far as it is known."""

from __future__ import annotations

from typing import Any, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput
from wbc.types import Vec


@final
class Actuators:
    """Motor i turns the command u_i into the torque τ_i = share_i u_i − offset_i [N m, N]; sound: share 1, offset 0.

    Components say what they found out as ``Overrides(motors=...)``; the controller then sends the command that gives
    the torque decided, u = (τ + offset) / share. A motor of share 0 gives nothing whatever it is sent, and is sent 0.

    Args:
        share: (nj,), each between 0 and 1.
        offset: (nj,) [N m, N].

    Raises:
        InvalidInput: another size, a share that is not between 0 and 1, an offset that is not finite.

    Example:
        >>> import numpy as np
        >>> from wbc.stack.actuators import Actuators
        >>> motors = Actuators([1.0, 0.5], [0.0, 1.0])
        >>> motors.command(np.array([3.0, 3.0])), motors.torque(np.array([3.0, 8.0]))
        (array([3., 8.]), array([3., 3.]))
    """

    def __init__(self, share: Any, offset: Any) -> None:
        #: (nj,), read-only.
        self.share = checks.array("share", share, (None,))
        #: (nj,) [N m, N], read-only.
        self.offset = checks.array("offset", offset, self.share.shape)
        wrong = ~((self.share >= 0.0) & (self.share <= 1.0))
        if wrong.any():
            i = int(np.argmax(wrong))
            raise InvalidInput(f"share[{i}] is {self.share[i]:g}; it must be between 0 and 1")
        gives = self.share > 0.0
        self._inverse = np.divide(1.0, self.share, out=np.zeros_like(self.share), where=gives)
        self._is_sound = bool((self.share == 1.0).all() and (self.offset == 0.0).all())
        for array in (self.share, self.offset):
            array.flags.writeable = False

    def command(self, tau: Vec) -> Vec:
        """u (nj,) that gives the torques ``tau`` (nj,); the same array where all motors are sound."""
        if self._is_sound:
            return tau
        command: Vec = (tau + self.offset) * self._inverse
        command.flags.writeable = False
        return command

    def torque(self, command: Vec) -> Vec:
        """τ (nj,) that ``command`` (nj,) gives; the same array where all motors are sound."""
        return command if self._is_sound else self.share * command - self.offset
