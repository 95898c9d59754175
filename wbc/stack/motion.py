"""All kinematic rows of a plan in one block: gains are applied once for all of them, not task by task."""

from __future__ import annotations

from typing import Any, final

import numpy as np
from scipy.linalg.blas import dgemv

from wbc.errors import InvalidInput
from wbc.stack.contact import Contact, ContactRows
from wbc.stack.task import Task, TaskRows
from wbc.types import Mat, Vec


@final
class MotionRows:
    """Rows J of all kinematic tasks and contacts, and what they are wanted to give.

    Order 1 (velocities):     J v = ẏ_ref + rate e
    Order 2 (accelerations):  J a = ÿ_ref + kd ė + kp e − J̇ v,   ė = ẏ_ref − J v

    ``J`` (m, nv) and ``right`` (m,) are views into the row array: J x − wanted = 0 is [J … −wanted]. Behind the m rows
    stand the ``on_joints`` tasks, nj entries each, whose Jacobian is the identity and is never written.
    """

    def __init__(self, order: int, J: Mat, right: Vec, nj: int, n_joint_tasks: int) -> None:
        self.order, self.J, self._right = order, J, right
        m, n = len(J), len(J) + n_joint_tasks * nj
        self._m = m
        # What is wanted is a sum of four terms, each a gain times what stands in one row of a block.
        written = np.zeros((5, n))
        self._references, self._terms = written[:2], written[1:]
        self.rate_ref, self.acc_ref, self.e, self._ed, self.drift = written
        self.e.fill(np.nan)
        self.drift[:m] = np.nan
        self._gains, self._weighted, self._ones = np.ones((4, n)), np.zeros((4, n)), np.ones(4)
        self.kp, self.kd = self._gains[1:3]
        self._gains[1:3], self._gains[3] = 0.0, -1.0
        self.rate, self.wanted = np.zeros(n), np.zeros(n)
        self.own_ed = np.full(n, np.nan)
        self.writes_ed: Any = None
        self._Jv = np.zeros(n)
        self._Jv_rows, self._wanted_rows = self._Jv[:m], self.wanted[:m]
        self._Jv_joints = self._Jv[m:].reshape(n_joint_tasks, nj)
        self._has_joints = n_joint_tasks > 0

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
            InvalidInput: at the velocity level, a task with kp > 0, kd = 0 and no rate.
        """
        rows = slice(first, first + task.dim)
        self.kp[rows], self.kd[rows], rate = task.gains()
        if self.order == 1 and np.isinf(rate).any():
            raise InvalidInput(f"{task.name} has kd = 0, so kp / kd says nothing at the velocity level; give it a rate")
        self.rate[rows] = rate

    def contact_rows(self, first: int, contact: Contact) -> ContactRows:
        """The views a contact writes into."""
        rows = slice(first, first + contact.dim)
        out = ContactRows()
        out.J, out.e, out.drift, out.ed = self.J[rows], self.e[rows], self.drift[rows], self.own_ed[rows]
        out.rate_ref, out.acc_ref = self.rate_ref[rows], self.acc_ref[rows]
        out.J[:] = np.nan
        self.kp[rows], self.kd[rows], self.rate[rows] = contact.gains()
        if self.order == 1 and np.isinf(self.rate[rows]).any():
            raise InvalidInput(f"{contact.name} has kd = 0, so kp / kd says nothing at the velocity level")
        return out

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

    def lower(self, v: Vec, v_joints: Vec) -> None:
        """From errors to wanted velocities or accelerations, for all rows at once."""
        wanted = self.wanted
        if not len(wanted):  # BLAS refuses empty vectors
            return
        if self.order == 1:
            np.multiply(self.rate, self.e, wanted)
            wanted += self.rate_ref
        else:
            np.dot(self.J, v, self._Jv_rows)
            if self._has_joints:
                self._Jv_joints[:] = v_joints
            np.subtract(self.rate_ref, self._Jv, self._ed)
            if self.writes_ed is not None:
                np.copyto(self._ed, self.own_ed, where=self.writes_ed)
            np.multiply(self._gains, self._terms, self._weighted)
            dgemv(1.0, self._weighted.T, self._ones, 0.0, wanted, 0, 1, 0, 1, 0, 1)  # the sum of the rows, in place
        np.negative(self._wanted_rows, self._right)
