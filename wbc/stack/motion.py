"""All kinematic rows of a plan in one place: gains are applied once for all of them, by compiled code."""

from __future__ import annotations

from typing import Any, final

import numpy as np

from wbc.errors import InvalidInput
from wbc.tolerances import SAME
from wbc.types import Mat


@final
class MotionRows:
    """Rows J of all kinematic tasks and contacts, and what they are wanted to give.

    Order 1 (velocities):     J v = ẏ_ref + rate e
    Order 2 (accelerations):  J a = ÿ_ref + kd ė + kp e − J̇ v,   ė = ẏ_ref − J v

    ``rows`` (m, width) belong to the row array: J x − wanted = 0 is [J 0 −wanted], J (m, nv). Behind the m rows stand
    the ``on_joints`` tasks, nj entries each, whose Jacobian is the identity and is never written, and last the nj
    entries of −v, or of nothing at order 1, which the damping of joints (:class:`~wbc.stack.damping.ResidualDamping`)
    wants a multiple of. ``numbers`` (10, n) has all numbers of a row in one column, in the order of the kernel.
    """

    def __init__(self, order: int, rows: Mat, nv: int, nj: int, n_joint_tasks: int, *, dt: float) -> None:
        self._dt = dt
        self.order, self.J = order, rows[:, :nv]
        self.n_joint_blocks = n_joint_tasks + 1
        m, n = len(rows), len(rows) + n_joint_tasks * nj
        self.numbers = np.zeros((10, n + nj))
        self.e, self.drift, self.rate_ref, self.acc_ref, self.wanted = self.numbers[:5]
        self.kp, self.kd, self.rate, self.own_ed, self.writes_ed = self.numbers[5:]
        self.e[:n] = self.drift[:m] = self.own_ed[:] = np.nan
        self.kd[n:] = 1.0

    def set_gains(self, at: slice, member: Any) -> None:
        """Read the gains of a task or contact, and refuse those that no time step of this size can carry.

        Order 1: e⁺ = (1 − rate dt) e is stable for rate <= 2/dt. Order 2, with q⁺ = q + v dt + ½ a dt² and
        v⁺ = v + a dt: both eigenvalues are in the unit circle for kd <= 2/dt and kp <= 2 kd/dt (Jury's criterion).
        kd = 0, damping left to another task, is allowed up to the largest kp of any kd, 4/dt².

        Raises:
            InvalidInput: gains with which errors grow from tick to tick; at the velocity level, kp > 0, kd = 0 and no
                rate.
        """
        kp, kd, rate = self.kp[at], self.kd[at], self.rate[at]
        kp[:], kd[:], rate[:] = member.gains()
        most = 2.0 / self._dt * (1.0 + SAME)
        if self.order == 1:
            if np.isinf(rate).any():
                raise InvalidInput(
                    f"{member.name} has kd = 0, so kp / kd says nothing at the velocity level; give it a rate"
                )
            checks = [("rate", rate, np.full(len(rate), most), "2/dt")]
        else:
            largest = most * np.where(kd > 0.0, kd, most)
            checks = [("kd", kd, np.full(len(kd), most), "2/dt"), ("kp", kp, largest, "2 kd/dt, or 4/dt² without kd")]
        for what, value, limit, formula in checks:
            beyond = value > limit
            if beyond.any():
                i = int(np.argmax(beyond))
                raise InvalidInput(
                    f"{member.name}.{what} is {value[i]:g}; with dt = {self._dt:g} s more than {limit[i]:g} "
                    f"({formula}) makes the error grow from tick to tick"
                )
