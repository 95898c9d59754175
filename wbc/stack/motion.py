"""All kinematic rows of a plan in one block: gains are applied once for all of them, by compiled code."""

from __future__ import annotations

from typing import Any, final

import numpy as np

from wbc.errors import InvalidInput
from wbc.stack.contact import Contact, ContactRows
from wbc.stack.task import Task, TaskRows
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
    wants a multiple of.
    """

    def __init__(self, order: int, rows: Mat, nv: int, nj: int, n_joint_tasks: int, *, dt: float) -> None:
        self._dt = dt
        self.order, self.J = order, rows[:, :nv]
        self.n_joint_blocks = n_joint_tasks + 1
        m, n = len(rows), len(rows) + self.n_joint_blocks * nj
        self._m = m
        self._references = np.zeros((2, n))
        self.rate_ref, self.acc_ref = self._references
        self.e, self.drift, self.wanted = np.zeros(n), np.zeros(n), np.zeros(n)
        self.kp, self.kd, self.rate = np.zeros(n), np.zeros(n), np.zeros(n)
        self.e[: n - nj] = np.nan
        self.drift[:m] = np.nan
        self.own_ed = np.full(n, np.nan)
        self.writes_ed: Any = None
        self.kd[n - nj :] = 1.0

    def task_rows(self, first: int, task: Task) -> TaskRows:
        """The views a task writes into; for an ``on_joints`` task, J is left out."""
        rows = slice(first, first + task.dim)
        out = TaskRows()
        if first < self._m:
            out.J = self.J[rows]
            out.J[:] = np.nan
        out.e, out.drift, out.ed = self.e[rows], self.drift[rows], self.own_ed[rows]
        out.rate_ref, out.acc_ref = self.rate_ref[rows], self.acc_ref[rows]
        self.set_gains(first, task)
        return out

    def set_gains(self, first: int, task: Task) -> None:
        """Read the gains of a task.

        Raises:
            InvalidInput: gains with which errors grow from tick to tick; at the velocity level, a task with kp > 0,
                kd = 0 and no rate.
        """
        self._set_gains(slice(first, first + task.dim), task, "; give it a rate")

    def contact_rows(self, first: int, contact: Contact) -> ContactRows:
        """The views a contact writes into."""
        rows = slice(first, first + contact.dim)
        out = ContactRows()
        out.J, out.e, out.drift, out.ed = self.J[rows], self.e[rows], self.drift[rows], self.own_ed[rows]
        out.rate_ref, out.acc_ref = self.rate_ref[rows], self.acc_ref[rows]
        out.J[:] = np.nan
        self._set_gains(rows, contact, "")
        return out

    def _set_gains(self, rows: slice, member: Task | Contact, advice: str) -> None:
        self.kp[rows], self.kd[rows], self.rate[rows] = member.gains()
        if self.order == 1 and np.isinf(self.rate[rows]).any():
            raise InvalidInput(f"{member.name} has kd = 0, so kp / kd says nothing at the velocity level{advice}")
        self._refuse_unstable(rows, member.name)

    def _refuse_unstable(self, rows: slice, name: str) -> None:
        """Refuse gains that no time step of this size can carry.

        Order 1: e⁺ = (1 − rate dt) e is stable for rate <= 2/dt. Order 2, with q⁺ = q + v dt + ½ a dt² and
        v⁺ = v + a dt: both eigenvalues are in the unit circle for kd <= 2/dt and kp <= 2 kd/dt (Jury's criterion).
        kd = 0, damping left to another task, is allowed up to the largest kp of any kd, 4/dt².
        """
        most = 2.0 / self._dt * (1.0 + SAME)
        if self.order == 1:
            checks = [("rate", self.rate[rows], np.full(rows.stop - rows.start, most), "2/dt")]
        else:
            kp, kd = self.kp[rows], self.kd[rows]
            checks = [
                ("kd", kd, np.full(len(kd), most), "2/dt"),
                ("kp", kp, most * np.where(kd > 0.0, kd, most), "2 kd/dt, or 4/dt² without kd"),
            ]
        for what, value, limit, formula in checks:
            beyond = value > limit
            if beyond.any():
                i = int(np.argmax(beyond))
                raise InvalidInput(
                    f"{name}.{what} is {value[i]:g}; with dt = {self._dt:g} s more than {limit[i]:g} ({formula}) makes "
                    "the error grow from tick to tick"
                )

    def clear(self) -> None:
        """References that a task does not write are zero, in every tick."""
        self._references.fill(0.0)

    def check_written(self, first: int, dim: int, name: str) -> None:
        """After a first fill on poisoned memory: everything needed must have been written.

        Raises:
            InvalidInput: naming the member and what it left out.
        """
        rows = slice(first, first + dim)
        needed = {"e": self.e[rows]}
        if first < self._m:
            needed["J"] = self.J[rows]
            if self.order == 2:
                needed["drift"] = self.drift[rows]
        for what, values in needed.items():
            if np.isnan(values).any():
                raise InvalidInput(f"{name}.fill left NaN in out.{what}[{int(np.argwhere(np.isnan(values))[0][0])}]")
        own = np.isnan(self.own_ed[rows])
        if own.any() and not own.all():
            raise InvalidInput(f"{name}.fill wrote only a part of out.ed; write all of it or none")
        if self.order == 1:
            self.drift[rows] = 0.0

    def freeze(self) -> None:
        """Called once after all checks: remember which tasks write their own error rate."""
        writes = ~np.isnan(self.own_ed)
        self.writes_ed = writes if writes.any() else None
