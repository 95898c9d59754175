"""Measured: the state that a tick is given, as numbers of the controller's own."""

from __future__ import annotations

from typing import Any, final

import numpy as np

from wbc import checks
from wbc.compiled import Memory
from wbc.control.compiled.measured_kernel import spoilt
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel
from wbc.tolerances import HUGE
from wbc.types import Vec

_NUMBERS = np.dtype(np.float64)
#: No time [s] is as late.
NEVER = HUGE**2


@final
class Measured:
    """Reads a configuration and a velocity, and says whether a robot can be in that state.

    ``moment`` (nq + nv,) is the memory of both; ``q`` (nq,) and ``v`` (nv,) are its parts. The next ``take`` overwrites
    it.
    """

    __slots__ = ("_address", "_has_quaternion", "_memory", "_q_shape", "_v_shape", "moment", "q", "v")

    def __init__(self, model: RobotModel) -> None:
        self._q_shape, self._v_shape = (model.nq,), (model.nv,)
        self._has_quaternion = model.nb == 6 and model.nq - model.nj == 7
        self.moment = np.zeros(model.nq + model.nv)
        self.q, self.v = self.moment[: model.nq], self.moment[model.nq :]
        self._memory = Memory(np.array([len(self.moment), self._has_quaternion], dtype=np.int64), self.moment)
        self._address = self._memory.address

    def read(self, t: Any, q: Any, v: Any) -> tuple[float, Vec, Vec]:
        """The arguments as numbers of the right shape; arrays that are that already are not copied.

        Raises:
            InvalidInput: q or v has another shape, or an argument is not real numbers.
        """
        name = "t"
        try:
            t = t if type(t) is float else float(checks.floats(t)[()])
            name = "q"
            q = q if type(q) is np.ndarray and q.dtype is _NUMBERS else checks.floats(q)
            name = "v"
            v = v if type(v) is np.ndarray and v.dtype is _NUMBERS else checks.floats(v)
        except Exception:  # a conversion may raise whatever it likes
            wrong = f"{name} is {checks.shown({'t': t, 'q': q, 'v': v}[name])}"
            raise InvalidInput(f"tick(t, q, v) takes a time [s] and two vectors of real numbers; {wrong}") from None
        if q.shape != self._q_shape or v.shape != self._v_shape:
            name, vector, shape = ("v", v, self._v_shape) if q.shape == self._q_shape else ("q", q, self._q_shape)
            raise InvalidInput(f"{name} must have shape {shape}, not {vector.shape}")
        return t, q, v

    def take(self, t: float, q: Vec, v: Vec) -> str:
        """Copy a state that was read into ``moment``; why no robot can be in it, or "".

        A quaternion of nearly norm 1 is normalised in the copy.
        """
        self.q[...] = q
        self.v[...] = v
        if -NEVER < t < NEVER and not spoilt(self._address):
            return ""
        return self._reason(t)

    def _reason(self, t: float) -> str:
        if not -NEVER < t < NEVER:
            return f"t is {t:g}"
        quaternion = self.q[3:7]
        # The parts of a quaternion are named by its norm, unless one of them is no number.
        if not self._has_quaternion or not np.isfinite(self.q).all() or np.abs(quaternion).max() < HUGE:
            for name, vector in (("q", self.q), ("v", self.v)):
                sound = np.abs(vector) < HUGE
                if not sound.all():
                    return f"{name}[{sound.argmin()}] is {vector[sound.argmin()]:g}"
        return f"the base's quaternion q[3:7] has norm {np.hypot.reduce(quaternion):g}"
