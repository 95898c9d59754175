"""TaskRows: where kinematic tasks and contacts write."""

from __future__ import annotations

from wbc.types import Mat, Vec


class TaskRows:
    """Where a kinematic task, or a contact, writes: views into the plan's own memory, ``dim`` rows.

    e (dim,)          error, target − actual; of a pose ``linear`` is e[:3] and ``angular`` e[3:]
    J (dim, nv)       Jacobian of the actual value
    drift (dim,)      J̇ v; read at the acceleration level only
    rate_ref (dim,)   velocity of the target, zero unless written
    acc_ref (dim,)    acceleration of the target, zero unless written
    ed (dim,)         rate of the error; left alone it is rate_ref − J v, which the plan computes for all tasks at once

    Assign with ``out.e[:] = …``: the arrays stay, their contents change.
    """

    __slots__ = ("J", "_e", "acc_ref", "angular", "drift", "ed", "linear", "rate_ref")

    J: Mat
    linear: Vec
    angular: Vec
    ed: Vec
    drift: Vec
    rate_ref: Vec
    acc_ref: Vec

    @property
    def e(self) -> Vec:
        """The error."""
        return self._e

    @e.setter
    def e(self, e: Vec) -> None:
        self._e, self.linear, self.angular = e, e[:3], e[3:]
