"""Plan: a stack compiled for one model at one level. ``fill`` is the hot path.

Everything that has a name, a size or a constant value is decided in ``__init__``: the layout of the rows, the views
each task writes into, the friction cones, the bounds that do not move. ``fill`` lets every task write its rows,
applies all gains at once and completes the row problem (:mod:`wbc.qp.rows.problem`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, final

import numpy as np

from wbc.errors import InvalidInput
from wbc.models.model import RobotModel, RobotState
from wbc.qp.problem import QP
from wbc.qp.rows import RowProblem
from wbc.stack.constraint import Barrier, BarrierRows, ConstraintRows, LinearConstraint
from wbc.stack.contact import Anchor
from wbc.stack.formulation import Formulation
from wbc.stack.interval import JointIntervals
from wbc.stack.layout import Layout
from wbc.stack.motion import MotionRows
from wbc.stack.stack import Stack
from wbc.stack.task import LinearRows, LinearTask, Objective
from wbc.types import Vec


@final
class Plan:
    """A compiled stack: sizes, memory, views and row names; made by ``level.compile(model, stack, dt=…)``.

    Components may write into ``torque_bounds`` (lower, upper), (nj,) each, and ``extra_bias`` (nv,), a generalised
    force added to h, before the plan is filled.
    """

    def __init__(self, model: RobotModel, stack: Stack, level: Formulation, dt: float) -> None:
        self.model, self.stack, self.level, self.dt = model, stack, level, dt
        self.layout = layout = Layout(model, stack, level)
        self.problem = p = RowProblem(
            layout.n_u, layout.n - layout.n_u, n_range=layout.n_range, n_soft=layout.n_soft, n_law=layout.n_law,
            rows=layout.names(), regularisation=level.regularisation,
        )  # fmt: skip
        nv, nb = model.nv, model.nb
        self._column = p.G[:, p.n]
        motion = slice(layout.motion_row, layout.n_rows)
        self.motion = MotionRows(level.order, p.G[motion, :nv], self._column[motion], model.nj, len(layout.on_joints))
        self.anchors = [Anchor(np.eye(3), np.zeros(3)) for _ in layout.contacts]
        self._fills: list[tuple[Callable[..., None], tuple[Any, ...]]] = []
        self._after: list[Callable[[RobotState], None]] = []
        self.extra_bias = np.zeros(nv)
        self._has_extra_bias = bool(stack.components)

        self._give_views()
        if level.dynamics:
            self._prepare_dynamics()
        self._prepare_barriers_and_constraints()
        self._joints = JointIntervals.compose(layout.motion_limits, model, dt) if layout.motion_limits else None
        self._joint_lower, self._joint_upper = p.lb[nb:nv], p.ub[nb:nv]
        self._centre_joints = p.centre[nb - layout.n_u : nv - layout.n_u]
        joint_wanted = self.motion.wanted[layout.n_rows - layout.motion_row :].reshape(-1, model.nj)
        #: Of each task on the joints: its share of the cost of each joint, and what it wants there.
        self._pulls = list(zip(np.zeros(joint_wanted.shape), joint_wanted, strict=True))
        self._stamp = -1
        self._read_weights()
        self._qp: QP | None = None
        self._first_fill()

    # ---- compile: who writes where
    def _give_views(self) -> None:
        layout, motion, first = self.layout, self.motion, self.layout.motion_row
        for task, row in zip(layout.kinematic, layout.kinematic_rows, strict=True):
            self._fills.append((task.fill, (motion.task_rows(row - first, task),)))
        for law, row in zip(layout.exact, layout.exact_rows, strict=True):
            out = motion.task_rows(row - first, law.task)
            if law.task.on_joints:
                out.J[:], out.drift[:] = np.eye(self.model.nv)[self.model.nb :], 0.0
            self._fills.append((law.task.fill, (out,)))
        for contact, row, anchor in zip(layout.contacts, layout.contact_rows, self.anchors, strict=True):
            self._fills.append((contact.fill, (anchor, motion.contact_rows(row - first, contact))))
        behind = layout.n_rows - first
        for i, task in enumerate(layout.on_joints):
            self._fills.append((task.fill, (motion.task_rows(behind + i * self.model.nj, task),)))

    def _prepare_dynamics(self) -> None:
        layout, p, model = self.layout, self.problem, self.model
        nv, nf = model.nv, layout.nf
        self._T_a, self._T_f, self._T_h = p.G[:nv, :nv], p.G[:nv, nv : nv + nf], self._column[:nv]
        contacts = slice(layout.contact_row, layout.n_rows)
        self._J_contacts_T = p.G[contacts, :nv].T
        lower, upper = p.range_bounds()
        self.torque_bounds = (lower[: model.nj], upper[: model.nj])
        for law in layout.torque_limits:
            low, high = law.bounds(model)
            np.maximum(self.torque_bounds[0], low, out=self.torque_bounds[0])
            np.minimum(self.torque_bounds[1], high, out=self.torque_bounds[1])
        self._force_weights = np.concatenate(
            [np.full(c.dim, c.force_weight) for c in layout.contacts] or [np.zeros(0)]
        )  # fmt: skip

    def _write_cones(self) -> None:
        """Constant rows K f <= 0, on the scaled forces."""
        layout, p = self.layout, self.problem
        row = layout.cone_row
        for contact, column in zip(layout.contacts, layout.force_columns, strict=True):
            cone = contact.cone()
            columns = slice(column, column + contact.dim)
            p.G[row : row + len(cone), columns] = cone * p.scale[columns]
            p.upper[p.item(row) : p.item(row + len(cone))] = 0.0
            row += len(cone)

    def _prepare_barriers_and_constraints(self) -> None:
        layout = self.layout
        for barrier, row in zip(layout.barriers, layout.barrier_rows, strict=True):
            self._after.append(self._barrier_filler(barrier, row))
        for law, row in zip(layout.constraints, layout.constraint_rows, strict=True):
            self._after.append(self._constraint_filler(law, row))
        for task, row in zip(layout.linear, layout.linear_rows, strict=True):
            self._after.append(self._linear_filler(task, row))

    def _barrier_filler(self, barrier: Barrier, row: int) -> Callable[[RobotState], None]:
        p, nv = self.problem, self.model.nv
        rows, items = slice(row, row + barrier.dim), slice(p.item(row), p.item(row + barrier.dim))
        out = BarrierRows()
        out.J, out.h, out.drift = p.G[rows, :nv], np.zeros(barrier.dim), np.zeros(barrier.dim)
        right, lower, rate, order = self._column[rows], p.lower[items], barrier.rate, self.level.order

        def fill(state: RobotState) -> None:
            barrier.fill(state, out)
            if order == 1:
                np.multiply(out.h, -rate, lower)
            else:
                right[:] = out.drift
                lower[:] = -2.0 * rate * (out.J @ state.v) - rate**2 * out.h

        return fill

    def _quantity_map(self, on: str, member: LinearTask | LinearConstraint) -> Callable[[Any, Any, Vec], None]:
        """Writes rows A y as rows of x̂ for a quantity y: ``write(rows of G, A, state velocity)``."""
        p, model, layout = self.problem, self.model, self.layout
        nv, nb = model.nv, model.nb
        if on == "torque":
            torques = p.G[nb:nv]
            return lambda rows, A, v: np.matmul(A, torques, out=rows)
        if on == "force":
            i = layout.contact(member)
            columns = slice(layout.force_columns[i], layout.force_columns[i] + layout.contacts[i].dim)

            def on_force(rows: Any, A: Any, v: Vec) -> None:
                np.multiply(A, p.scale[columns], out=rows[:, columns])

            return on_force
        if on == "acceleration" or self.level.order == 1:

            def on_unknown(rows: Any, A: Any, v: Vec) -> None:
                rows[:, :nv] = A

            return on_unknown

        def on_next_velocity(rows: Any, A: Any, v: Vec) -> None:
            np.multiply(A, self.dt, out=rows[:, :nv])
            rows[:, -1] = A @ v

        return on_next_velocity

    def _size_of(self, member: LinearTask | LinearConstraint) -> int:
        if member.on == "force":
            return self.layout.contacts[self.layout.contact(member)].dim
        return self.model.nj if member.on == "torque" else self.model.nv

    def _linear_filler(self, task: LinearTask, row: int) -> Callable[[RobotState], None]:
        rows = self.problem.G[row : row + task.dim]
        out = LinearRows()
        out.A, out.b = np.full((task.dim, self._size_of(task)), np.nan), np.full(task.dim, np.nan)
        write = self._quantity_map(task.on, task)

        def fill(state: RobotState) -> None:
            task.fill(state, out)
            write(rows, out.A, state.v)
            rows[:, -1] -= out.b

        return self._clearing(rows, task.on, fill)

    def _constraint_filler(self, law: LinearConstraint, row: int) -> Callable[[RobotState], None]:
        p = self.problem
        rows, items = p.G[row : row + law.dim], slice(p.item(row), p.item(row + law.dim))
        out = ConstraintRows()
        out.A = np.full((law.dim, self._size_of(law)), np.nan)
        out.lo, out.hi = p.lower[items], p.upper[items]
        write = self._quantity_map(law.on, law)

        def fill(state: RobotState) -> None:
            law.fill(state, out)
            write(rows, out.A, state.v)

        return self._clearing(rows, law.on, fill)

    @staticmethod
    def _clearing(rows: Any, on: str, fill: Callable[[RobotState], None]) -> Callable[[RobotState], None]:
        """The last column is added to, so it starts from zero unless the quantity writes all of it."""
        if on == "torque":
            return fill

        def cleared(state: RobotState) -> None:
            rows[:, -1] = 0.0
            fill(state)

        return cleared

    def _first_fill(self) -> None:
        """Fill once at the model's reference, on poisoned memory: a row nobody writes is found now, by name."""
        state, layout, motion = self.model.state(), self.layout, self.motion
        self.start(state)
        for fill, out in self._fills:
            fill(state, *out)
        first = layout.motion_row
        members: list[Any] = [*layout.kinematic, *(law.task for law in layout.exact), *layout.contacts]
        starts = [*layout.kinematic_rows, *layout.exact_rows, *layout.contact_rows]
        for member, row in zip(members, starts, strict=True):
            motion.check_written(row - first, member.dim, member.name)
        for i, task in enumerate(layout.on_joints):
            motion.check_written(layout.n_rows - first + i * self.model.nj, task.dim, task.name)
        motion.freeze()
        self.fill(state)
        for row in range(layout.n_rows):
            if not np.isfinite(self.problem.G[row]).all():
                raise InvalidInput(f"{self.problem.rows[row].owner}.fill left NaN in a row")

    # ---- weights: read again when a task was assigned to
    def _objectives(self) -> list[Objective]:
        return [*self.layout.linear, *self.layout.kinematic, *self.layout.on_joints]

    def _read_weights(self) -> None:
        layout, p = self.layout, self.problem
        p.weights[:] = np.concatenate([t.weights() for t in (*layout.linear, *layout.kinematic)] or [np.zeros(0)])
        eps, nb, nv, n_u = self.level.regularisation, self.model.nb, self.model.nv, layout.n_u
        joints = np.full(self.model.nj, eps)
        shares = [task.weights() for task in layout.on_joints]
        for weights in shares:
            joints += weights
        for (share, _), weights in zip(self._pulls, shares, strict=True):
            np.divide(weights, joints, out=share)
        p.unit = float(joints.max())
        p.metric[: nb - n_u] = eps / p.unit
        p.metric[nb - n_u : nv - n_u] = joints / p.unit
        if layout.nf:
            forces = self._force_weights + eps
            p.scale[nv:] = np.sqrt(p.unit / forces)
            self._force_scale_negative = -p.scale[nv:]
            self._write_cones()
        p.version += 1
        self._stamp = sum(task.stamp for task in self._objectives())
        self._tasks = self._objectives()

    # ---- the hot path
    def start(self, state: RobotState) -> None:
        """Make the contacts where the robot is now (or at their targets)."""
        for contact, anchor in zip(self.layout.contacts, self.anchors, strict=True):
            made = contact.target or contact.anchor(state)
            anchor.rotation[:], anchor.position[:] = made.rotation, made.position

    def fill(self, state: RobotState) -> None:
        """Write every row of the problem for this state. The tick spends its time here."""
        stamp = 0
        for task in self._tasks:
            stamp += task.stamp
        if stamp != self._stamp:
            self._read_weights()
        for fill, out in self._fills:
            fill(state, *out)
        self.motion.lower(state.v, state.v_joints)
        if self._pulls:
            share, wanted = self._pulls[0]
            np.multiply(share, wanted, self._centre_joints)
            for share, wanted in self._pulls[1:]:
                self._centre_joints += share * wanted
        if self.level.dynamics:
            self._fill_dynamics(state)
        for fill_rows in self._after:
            fill_rows(state)
        if self._joints is not None:
            self._fill_joint_bounds(state)

    def _fill_dynamics(self, state: RobotState) -> None:
        """τ̂ = M a + h − Jᵀ f, base rows first: one row of G each."""
        np.copyto(self._T_a, state.M)
        self._T_h[:] = state.h
        if self._has_extra_bias:
            self._T_h += self.extra_bias
        if self.layout.nf:
            np.multiply(self._J_contacts_T, self._force_scale_negative, self._T_f)

    def _fill_joint_bounds(self, state: RobotState) -> None:
        assert self._joints is not None
        if self.level.order == 1:
            self._joints.velocity(state.q_joints, state.v_joints, self._joint_lower, self._joint_upper)
        else:
            self._joints.acceleration(state.q_joints, state.v_joints, self._joint_lower, self._joint_upper)

    # ---- what others read
    @property
    def qp(self) -> QP:
        """The standard form of what was filled last; the same memory each time."""
        if self._qp is None:
            self._qp = self.problem.empty_qp()
        self.problem.write_qp(self._qp)
        return self._qp

    def errors(self) -> Mapping[str, Vec]:
        """Error e of each kinematic task (dim,), a copy."""
        layout, e = self.layout, self.motion.e
        first = layout.motion_row
        found = {
            task.name: e[row - first : row - first + task.dim].copy()
            for task, row in zip(layout.kinematic, layout.kinematic_rows, strict=True)
        }
        nj, behind = self.model.nj, layout.n_rows - first
        for i, task in enumerate(layout.on_joints):
            found[task.name] = e[behind + i * nj : behind + (i + 1) * nj].copy()
        for law, row in zip(layout.exact, layout.exact_rows, strict=True):
            found[law.name] = e[row - first : row - first + law.task.dim].copy()
        return found

    def bound_owner(self, unknown: int, *, upper: bool) -> str:
        """Which law gives an unknown the bound it has now."""
        joint = unknown - self.model.nb
        if self._joints is not None and 0 <= joint < self.model.nj:
            return self._joints.owner(joint, upper=upper)
        return self.problem.rows[self.layout.n_rows + unknown].owner

    def __repr__(self) -> str:
        n, n_eq, n_in = self.problem.qp_shape
        return (
            f"Plan({self.model.name}, {self.level.name}: {n} unknowns, {n_eq} equalities, {n_in} two-sided rows, "
            f"{self.problem.n_soft} soft rows)"
        )
