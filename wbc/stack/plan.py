"""Plan: a stack compiled for one model at one level. ``fill`` is the hot path.

Everything that has a name, a size or a constant value is decided in ``__init__``: the layout of the rows, the views
each task writes into, the friction cones, the bounds that do not move. ``fill`` lets every task write its rows,
applies all gains at once and completes the row problem (:mod:`wbc.qp.rows.problem`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, final

import numpy as np

from wbc.compiled import Memory
from wbc.errors import InvalidInput, MemberFailed
from wbc.models.model import RobotModel, RobotState
from wbc.qp.problem import QP
from wbc.qp.rows import RowProblem, RowSolver, RowTask
from wbc.stack.applied import Applied
from wbc.stack.compiled import fill_kernel
from wbc.stack.compiled.damping_kernel import share
from wbc.stack.compiled.fill import CompiledFill, MotionMember
from wbc.stack.compiled.fill_kernel import ANSWER, BOUND_SPOILT, FILL, LOOK, OBSERVE, SLOW
from wbc.stack.constraint import TorqueBySpeed, torque_bounds
from wbc.stack.contact import Anchor
from wbc.stack.damping import Damping
from wbc.stack.filled import Filled
from wbc.stack.interval import JointIntervals
from wbc.stack.layout import Layout, of_kind
from wbc.stack.level import Level
from wbc.stack.member import Binding, explained
from wbc.stack.motion import MotionRows
from wbc.stack.overrides import Overrides
from wbc.stack.stack import Stack
from wbc.stack.stopping import Stopping
from wbc.stack.task import Objective, Task
from wbc.stack.writers import (
    BarrierWriter,
    ConstraintWriter,
    LinearWriter,
    SoftConstraintWriter,
    TorqueSpeedWriter,
    Writer,
)
from wbc.types import Status


@final
class Plan(Filled):
    """A compiled stack: sizes, memory, views and row names; made by ``level.compile(model, stack, dt=…)``.

    ``stack`` holds the plan's own copies of the members, prepared for the model and to be read: what users assign to
    the members themselves reaches them at the next ``fill``, what components override reaches them by ``apply``.

    To be read too is what holds in this tick (:class:`~wbc.stack.applied.Applied`): ``torque_bounds`` (lower, upper),
    (nj,) each [N m, N]; ``bounds(quantity)`` on a joint's position, velocity and acceleration; ``extra_bias`` (nv,), a
    generalised force added to h, and ``extra_inertia`` (nv, nv) or None, added to M; ``normal_limits`` and
    ``normal_floors`` (contacts,) [N], in the order of the whole stack's contacts; ``actuators``, what motors make of a
    command.
    """

    __slots__ = (
        "_bound", "_by_speed", "_call", "_called", "_failure", "_filler", "_fills", "_force_weights",
        "_has_components", "_joint_weights", "_looks", "_normal_version", "_own_normals", "_place", "_pressing",
        "_pull_weights", "_qp", "_refusal", "_shares", "_stamp", "_torque_version", "_writers", "anchors",
        "damping", "force_scale", "stopping",
    )  # fmt: skip

    stack: Stack

    def __init__(
        self, model: RobotModel, stack: Stack, level: Level, dt: float, state: RobotState, *,
        like: Plan | None = None,
    ) -> None:  # fmt: skip
        self.model, self.level, self.dt = model, level, dt
        # The members of a plan like another are copies already.
        self.binding = Binding() if like is None else like.binding
        self.stack = stack = stack.bound(self.binding) if like is None else stack
        self.layout = layout = Layout(model, stack, level, prepared=like is not None)
        if like is None:
            self.binding.close()
        self.problem = p = RowProblem(
            layout.n_u, layout.n - layout.n_u, n_range=layout.n_range, n_soft=layout.n_soft, n_equal=layout.n_equal,
            rows=layout.names(), regularisation=level.regularisation,
        )  # fmt: skip
        nv, nb = model.nv, model.nb
        motion = slice(layout.motion_row, layout.n_rows)
        self.motion = MotionRows(level.order, p.G[motion], nv, model.nj, len(layout.on_joints), dt=dt)
        self._fills: list[tuple[Callable[..., None], tuple[Any, ...]]] = []
        self._failure: MemberFailed | None = None
        self._has_components = bool(stack.components)
        self._share(like)

        self._give_views()
        if level.dynamics:
            self._prepare_dynamics()
        self._writers = self._make_writers()
        soft = [writer.barrier for writer in of_kind(self._writers, SoftConstraintWriter)]
        self.barriers: list[BarrierWriter] = [*of_kind(self._writers, BarrierWriter), *of_kind(soft, BarrierWriter)]
        self.joint_bound_rows = p.lb[nb:nv], p.ub[nb:nv]
        joint_wanted = self.motion.wanted[layout.n_rows - layout.motion_row :].reshape(-1, model.nj)
        #: Of each task on the joints, and of their damping: its share of each joint's cost, and what it wants there.
        self.shares = np.zeros(joint_wanted.shape)
        self._joint_wanted = joint_wanted
        self.damping = Damping(layout, self.motion, p, level.lm_damping, dt, least=level.regularisation)
        self._joint_weights = np.zeros((len(layout.on_joints), model.nj))
        #: Weights of what pulls on unknowns: of each task on the joints, and of each soft constraint.
        self._pull_weights = [*self._joint_weights, *(np.zeros(member.dim) for member in layout.soft_constraints)]
        self._connect()
        self._stamp = -1
        #: Why gains that were assigned between ticks cannot be used; until others are, no tick has an answer.
        self._refusal = ""
        #: What a unit of each force (nf,) in the problem is [N, N m]; a new array where it changes.
        self.force_scale = np.ones(layout.nf)
        self._read_weights()
        above = [layout.slack] if layout.slack else []
        p.levels = [[self._row_task(task) for task in tasks] for tasks in (*above, *stack.levels)]
        self._qp: QP | None = None
        self._filler: CompiledFill | None = None
        #: Whether motors can bring the joints to rest before their limits; None where nothing depends on it.
        self.stopping = Stopping.of(self)
        self._first_fill(state, like)
        for component in () if like else stack.components:
            component.check(self)

    def _share(self, like: Plan | None) -> None:
        """What is remembered from tick to tick: the plans of one stack have it in common."""
        model, contacts, limits = self.model, self.layout.contacts, self.layout.motion_limits
        if like is None:
            intervals = JointIntervals.compose(limits, model, self.dt) if limits else None
            torque = torque_bounds(self.layout.torque_limits, model)
            self.applied = Applied(model, self.level, self.binding, contacts, intervals=intervals, torque=torque)
            self.anchors = [Anchor(np.eye(3), np.zeros(3)) for _ in contacts]
        else:
            self.applied = like.applied
            self.anchors = [like.anchors[self.places[contact.name]] for contact in contacts]
        self.intervals = self.applied.intervals
        self.extra_bias = self.applied.bias
        self._place = np.array([self.places[contact.name] for contact in contacts], dtype=np.intp)

    # ---- compile: who writes where
    def _give_views(self) -> None:
        layout, motion, first = self.layout, self.motion, self.layout.motion_row
        for task, row in zip(layout.kinematic, layout.kinematic_rows, strict=True):
            self._fills.append((task.fill, (motion.task_rows(row - first, task),)))
        for constraint, row in zip(layout.exact, layout.exact_rows, strict=True):
            out = motion.task_rows(row - first, constraint.task)
            if constraint.task.on_joints:
                out.J[:], out.drift[:] = np.eye(self.model.nv)[self.model.nb :], 0.0
            self._fills.append((constraint.task.fill, (out,)))
        for contact, row, anchor in zip(layout.contacts, layout.contact_rows, self.anchors, strict=True):
            self._fills.append((contact.fill, (anchor, motion.contact_rows(row - first, contact))))
        behind = layout.n_rows - first
        for i, task in enumerate(layout.on_joints):
            self._fills.append((task.fill, (motion.task_rows(behind + i * self.model.nj, task),)))

    def _prepare_dynamics(self) -> None:
        layout, p, model = self.layout, self.problem, self.model
        presses = [
            (column + contact.wrench_axes.index(2), place)
            for contact, column, place in zip(layout.contacts, layout.force_columns, self._place, strict=True)
            if not contact.bilateral
        ]
        self._normal, self._pressing = np.array(presses, dtype=np.intp).reshape(-1, 2).T
        lower, upper = p.range_bounds()
        self._torque_range = lower[: model.nj], upper[: model.nj]
        self._normal_version, self._own_normals = -1, np.zeros((2, len(presses)))
        self._by_speed = of_kind(layout.torque_limits, TorqueBySpeed)
        self._take_torque_bounds()
        self._force_weights = np.concatenate(
            [np.full(c.dim, c.force_weight) for c in layout.contacts] or [np.zeros(0)]
        )  # fmt: skip

    def _connect(self) -> None:
        """The memory of a tick's compiled call."""
        p, wanted = self.problem, self.motion.wanted
        sizes = np.array([len(p.G), p.n + 1, len(wanted), len(p.lower)], dtype=np.int64)
        self._looks = Memory(sizes, p.G, wanted, p.lower, p.upper)
        self._call = np.zeros(fill_kernel.NUMBER, dtype=np.int64)
        self._call[fill_kernel.LOOKS] = self._looks.address
        self._called = Memory(self._call).addresses.item()
        self.answered_by(None)

    def answered_by(self, solver: RowSolver | None) -> None:
        """The solver whose code :meth:`answer` calls; its levels have their damping by now."""
        p, damping, weights, dampings = (
            self.problem,
            self.damping.in_metric,
            self._joint_weights,
            self.damping.addresses,
        )
        own = damping.base, damping.applied, damping.rate, self.shares, p.metric[damping.columns]
        self._shares = Memory(np.array(weights.shape, dtype=np.int64), p.units, weights, *own)
        k = fill_kernel
        self._call[[k.SHARES, k.DAMPINGS]] = self._shares.address, dampings.__array_interface__["data"][0]
        self._call[[k.N_DAMPINGS, k.PLACE, k.SOLVER]] = len(dampings), *((0, 0) if solver is None else solver.kernel)

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

    def _make_writers(self) -> list[Writer]:
        layout, p = self.layout, self.problem
        writers: list[Writer] = []
        for barrier, row in zip(layout.barriers, layout.barrier_rows, strict=True):
            writers.append(BarrierWriter(barrier, row, p, layout, self.dt))
        for constraint, row in zip(layout.constraints, layout.constraint_rows, strict=True):
            writers.append(ConstraintWriter(constraint, row, p, layout, self.dt))
        for task, row in zip(layout.linear, layout.linear_rows, strict=True):
            writers.append(LinearWriter(task, row, p, layout, self.dt))
        for soft, row, column in zip(
            layout.soft_constraints, layout.soft_constraint_rows, layout.slack_columns, strict=True
        ):
            writers.append(SoftConstraintWriter(soft, (row, column), p, layout, self.dt))
        if self.level.dynamics and self._by_speed:
            writers.append(TorqueSpeedWriter(self._by_speed, self.torque_bounds, self._torque_range))
        return writers

    def _row_task(self, task: Objective) -> RowTask:
        """A task as its level knows it."""
        layout, p, dim = self.layout, self.problem, task.dim
        pulling = [*layout.on_joints, *layout.soft_constraints]
        columns = [*[self.model.nb] * len(layout.on_joints), *layout.slack_columns]
        if task in pulling:
            i = pulling.index(task)
            unknowns, weights = slice(columns[i], columns[i] + dim), self._pull_weights[i]
            if isinstance(task, Task):
                wanted = self._joint_wanted[i]
                return RowTask(task.name, None, unknowns, weights, wanted, np.zeros(dim), scaled=task.is_scaled)
            return RowTask(task.name, None, unknowns, weights, np.zeros(dim), np.zeros(dim))
        starts = [*layout.linear_rows, *layout.kinematic_rows]
        row = starts[[*layout.linear, *layout.kinematic].index(task)]
        rows, weights = slice(row, row + dim), p.weights[row - p.soft.start :][:dim]
        if not isinstance(task, Task):
            return RowTask(task.name, rows, None, weights, np.zeros(dim), np.zeros(dim))
        at = slice(row - layout.motion_row, row - layout.motion_row + dim)
        wanted = self.motion.wanted[at]
        drift = self.motion.drift[at] if self.level.order == 2 else np.zeros(dim)
        return RowTask(task.name, rows, None, weights, wanted, drift, kinematic=True, scaled=task.is_scaled)

    def _first_fill(self, state: RobotState, like: Plan | None) -> None:
        """Fill once, on poisoned memory: what nobody writes is found now, by name."""
        layout, motion = self.layout, self.motion
        if like is None:
            self.start(state)
        first = layout.motion_row
        for member, row, (fill, out) in self.members():
            explained(member.name, fill, state, *out)
            motion.check_written(row - first, member.dim, member.name)
        motion.freeze()
        self.bind(state)()
        self._run(FILL)  # rows about torques are made of these
        for writer in self._writers:
            explained(writer.name, writer.fill, state)
            writer.check()
        self.fill(state)

    def members(self) -> Iterator[MotionMember]:
        """Who writes motion rows."""
        layout, nj = self.layout, self.model.nj
        members = [
            *layout.kinematic,
            *(constraint.task for constraint in layout.exact),
            *layout.contacts,
            *layout.on_joints,
        ]
        behind = range(layout.n_rows, layout.n_rows + len(layout.on_joints) * nj, nj)
        rows = [*layout.kinematic_rows, *layout.exact_rows, *layout.contact_rows, *behind]
        return zip(members, rows, self._fills, strict=True)

    # ---- weights: read again when a task was assigned to
    def _read_weights(self) -> None:
        layout, p = self.layout, self.problem
        self._stamp = self.binding.stamp
        self._read_gains()
        p.weights[:] = np.concatenate([t.weights() for t in (*layout.linear, *layout.kinematic)] or [np.zeros(0)])
        eps, nb, nv, n_u = self.level.regularisation, self.model.nb, self.model.nv, layout.n_u
        joints = np.full(self.model.nj, eps)
        for weights, task in zip(self._pull_weights, (*layout.on_joints, *layout.soft_constraints), strict=True):
            weights[:] = task.weights()
        joints += self._joint_weights.sum(axis=0)
        p.unit = float(joints.max())
        p.metric[: nb - n_u] = eps / p.unit
        self.damping.in_metric.base[:] = joints
        self.damping.read_weights()
        share(self._shares.address)
        if layout.nf:
            forces = self._force_weights + eps
            p.scale[nv : nv + layout.nf] = np.sqrt(p.unit / forces)
            self.force_scale = p.scale[nv : nv + layout.nf].copy()
            self._write_cones()
            pressing = [contact for contact in layout.contacts if not contact.bilateral]
            least = [-np.inf if contact.f_min is None else contact.f_min for contact in pressing]
            most = [np.inf if contact.f_max is None else contact.f_max for contact in pressing]
            self._own_normals = np.array([least, most])
            self._bound_normals()
        for soft, column in zip(layout.soft_constraints, layout.slack_columns, strict=True):
            p.scale[column : column + soft.dim] = np.sqrt(p.unit / (soft.weights() + eps))

    def _read_gains(self) -> None:
        layout, first = self.layout, self.layout.motion_row
        exact = [constraint.task for constraint in layout.exact]
        for task, row in zip([*layout.kinematic, *exact], [*layout.kinematic_rows, *layout.exact_rows], strict=True):
            self.motion.set_gains(row - first, task)
        for i, task in enumerate(layout.on_joints):
            self.motion.set_gains(layout.n_rows - first + i * self.model.nj, task)

    # ---- the hot path
    def start(self, state: RobotState) -> None:
        """Make the contacts where the robot is now (or at their targets); nothing is overridden."""
        self.applied.reset()
        self.binding.refresh()
        if self.stopping is not None:
            self.stopping.reset()
        for writer in self.barriers:
            writer.barrier.reset()
        if self.damping.is_on:
            self.damping.reset()
            share(self._shares.address)
        for contact, anchor in zip(self.layout.contacts, self.anchors, strict=True):
            anchor.move(contact.target or contact.anchor(state))

    def take_over(self, former: Plan, state: RobotState) -> None:
        """Go on where another plan of the same stack stands: make the contacts that it has not."""
        self.binding.refresh()
        for contact, anchor in zip(self.layout.contacts, self.anchors, strict=True):
            if not any(contact is held for held in former.layout.contacts):
                anchor.move(contact.target or contact.anchor(state))

    def go_on_from(self, former: Plan) -> None:
        """Damp as the plan of another stack did."""
        self.damping.go_on_from(former.damping)
        share(self._shares.address)

    def apply(self, said: Sequence[tuple[str, Overrides]]) -> None:
        """From the next ``fill`` on these overrides hold, by the names of those who said them, and no others.

        Raises:
            WbcError: something in them makes no sense, by the component's name; then nothing has changed.
        """
        self.applied.apply(said)

    def _run(self, stages: int) -> int:
        """Compiled stages of a tick."""
        self._call[fill_kernel.ASKED] = stages
        return fill_kernel.tick(self._called)

    def observe(self) -> None:
        """Before a fill: damp the joints by what the answer to the one before left of the kinematic tasks."""
        self._run(OBSERVE)
        if self._call[fill_kernel.LEFT] & SLOW:
            self._slow()

    def _slow(self) -> None:
        self.damping.slow()
        share(self._shares.address)

    def fill(self, state: RobotState) -> None:
        """Write every row of the problem for this state.

        Raises:
            MemberFailed: a member's ``fill`` or target raised, or a bound is NaN; all other rows are written.
        """
        self.binding.refresh()
        self._prepare(state)
        self._fill(state)
        self._refuse_spoilt()

    def answer(self, state: RobotState, solver: RowSolver, *, observes: bool) -> Status:
        """What ``observe``, ``fill`` and the solver do one after the other, in one compiled call.

        For plans that are compiled, and the solver they are :meth:`answered_by`. A level that is damped, and what makes
        no sense, is seen to between the stages.

        Raises:
            MemberFailed: as :meth:`fill`.
            InvalidInput: a row is not finite.
        """
        self.binding.refresh()
        if observes and self.binding.stamp != self._stamp:  # with the weights that the answer was found with
            self.observe()
            observes = False
        self._prepare(state)
        left, code = (OBSERVE if observes else 0) | FILL | LOOK | ANSWER, 0
        if self._failure is None and not (self._refusal or self.damping.follows):
            code = self._run(left)
            left = self._call.item(fill_kernel.LEFT)
        if left & OBSERVE:
            self.observe()
        if left & SLOW:
            self._slow()
        if left & FILL:
            self._fill(state)
        if left:
            self._refuse_spoilt()
            self.refuse_not_finite()
            code = self._run(ANSWER)
        return solver.concluded(code)

    def _prepare(self, state: RobotState) -> None:
        """Before the compiled code fills: weights that were assigned, targets that users write, bounds on forces."""
        self._failure = None
        if self.binding.stamp != self._stamp:
            self._refusal = ""
            try:
                self._read_weights()
            except InvalidInput as cause:
                self._refusal = str(cause)
        filler = self._filler
        (filler if filler is not None and state is filler.state else self.bind(state))()
        if self.level.dynamics:
            if self._torque_version != self.applied.version:
                self._take_torque_bounds()
            if self._normal_version != self.applied.normal_version:
                self._bound_normals()

    def _fill(self, state: RobotState) -> None:
        """All rows, and whether they are finite."""
        self._run(FILL)
        self.damping.follow(state.v)
        for writer in self._bound.writers:
            try:
                writer.fill(state)
            except Exception as cause:
                self.failed(writer.name, cause)
        self._run(LOOK)

    def _refuse_spoilt(self) -> None:
        self._spoilt = self._call.item(fill_kernel.SPOILT)
        if self._spoilt & BOUND_SPOILT:
            i = int(np.isnan(self.problem.bounds).any(axis=0).argmax())
            row = self.problem.rows[i - self.problem.first_row if i > self.problem.n else self.layout.n_rows + i]
            self.failed(row.owner, InvalidInput(f"a bound of {row} is NaN"))
        if self._failure is not None:
            raise self._failure
        if self._refusal:
            raise InvalidInput(self._refusal)

    def failed(self, name: str, cause: Exception) -> None:
        """A member's ``fill`` raised: the first to do so is the one that :meth:`fill` tells of."""
        if self._failure is None:
            self._failure = MemberFailed(f"{name}.fill", cause)
            self._failure.__cause__ = cause

    def _take_torque_bounds(self) -> None:
        self._torque_version = self.applied.version
        for bound, now in zip(self.torque_bounds, self._torque_range, strict=True):
            now[:] = bound

    def _bound_normals(self) -> None:
        """What contacts say of their normal forces, and, before that, what components allow."""
        p, at, pressing, (least, most) = self.problem, self._normal, self._pressing, self._own_normals
        self._normal_version = self.applied.normal_version
        scale, upper = p.scale[at], np.minimum(most, self.normal_limits[pressing])
        p.ub[at] = upper / scale
        p.lb[at] = np.minimum(np.maximum(least, self.normal_floors[pressing]), upper) / scale

    def bind(self, state: RobotState) -> CompiledFill:
        """What fills from this state, also the next time: a plan that is filled from one state loses no time here."""
        self._bound = filler = CompiledFill(self, state, self.members(), self._writers, self.failed)
        self._call[fill_kernel.FILLS] = filler.address
        self._filler = filler if filler.is_complete else None
        return filler

    @property
    def is_compiled(self) -> bool:
        """Whether a fill is compiled code, but for targets that users write, and nobody changes it in a tick."""
        filler = self._filler
        compiled = filler is not None and filler.is_compiled
        return compiled and not (self._has_components or self.stopping)

    @property
    def qp(self) -> QP:
        """The standard form of what was filled last; the same memory each time."""
        if self._qp is None:
            self._qp = self.problem.empty_qp()
        self.problem.write_qp(self._qp)
        return self._qp

    def __repr__(self) -> str:
        n, n_eq, n_in = self.problem.qp_shape
        return (
            f"Plan({self.model.name}, {self.level.name}: {n} unknowns, {n_eq} equalities, {n_in} two-sided rows, "
            f"{self.problem.n_soft} soft rows)"
        )
