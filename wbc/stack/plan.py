"""Plan: a stack compiled for one model at one level. ``fill`` is the hot path.

Everything that has a name, a size or a constant value is decided in ``__init__``: the layout of the rows, the views
each task writes into, the friction cones, the bounds that do not move. ``fill`` lets every task write its rows,
applies all gains at once and completes the row problem (:mod:`wbc.qp.rows.problem`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, TypeVar, final

import numpy as np

from wbc.compiled import Memory
from wbc.errors import Infeasible, InvalidInput, MemberFailed, WbcError
from wbc.models.model import RobotModel, RobotState
from wbc.qp.conflict import conflict
from wbc.qp.problem import QP
from wbc.qp.rows import RowProblem, RowSolver
from wbc.qp.solver import Solver
from wbc.stack.applied import Applied
from wbc.stack.block import Block, MotionBlock
from wbc.stack.compiled import fill_kernel
from wbc.stack.compiled.damping_kernel import share
from wbc.stack.compiled.fill import CompiledFill
from wbc.stack.compiled.fill_kernel import ANSWER, BOUND_SPOILT, FILL, LOOK, OBSERVE
from wbc.stack.constraint import Barrier, TorqueBySpeed
from wbc.stack.contact import Anchor
from wbc.stack.damping import Damping
from wbc.stack.filled import Filled
from wbc.stack.hierarchy import Hierarchy
from wbc.stack.interval import JointIntervals
from wbc.stack.layout import Layout, of_kind
from wbc.stack.level import Level
from wbc.stack.member import Binding, explained
from wbc.stack.motion import MotionRows
from wbc.stack.stack import Stack
from wbc.stack.stopping import Stopping
from wbc.types import Status, Vec

_B = TypeVar("_B", bound=Block)


@final
class Plan(Filled):
    """A compiled stack: sizes, memory, views and row names; made by ``level.compile(model, stack, dt=…)``.

    ``stack`` holds the plan's own copies of the members, prepared for the model and read-only. Assignments to the
    members of the user reach the copies at the next ``fill``, overrides of components by ``applied.apply``.

    Read-only values of this tick: ``torque_bounds`` (lower, upper), (nj,) each [N m, N]; ``bounds(quantity)`` on a
    joint's position, velocity and acceleration; ``extra_bias`` (nv,), a generalised force added to h; ``actuators``,
    what motors make of a command; in ``applied`` (:class:`~wbc.stack.applied.Applied`) the ``inertia`` (nv, nv) or None
    that is added to M, and ``normal_limits`` and ``normal_floors`` (contacts,) [N], in the order of the whole stack's
    contacts.
    """

    __slots__ = (
        "_bound", "_by_speed", "_call", "_called", "_cones", "_failure", "_force_weights", "_joint_weights",
        "_own_normals", "_place", "_pressing", "_qp", "_shares", "_stamp", "_version", "anchors", "damping",
        "force_scale", "stopping",
    )  # fmt: skip

    stack: Stack

    def __init__(
        self, model: RobotModel, stack: Stack, level: Level, dt: float, state: RobotState, *, hierarchy: Hierarchy,
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
            rows=layout.names, regularisation=level.regularisation,
        )  # fmt: skip
        nv, nb = model.nv, model.nb
        self.motion = MotionRows(level.order, p.G[layout.motion_row :], nv, model.nj, len(layout.joints), dt=dt)
        self._failure: WbcError | None = None
        self._share(like)
        #: Weights of the tasks on the joints.
        self._joint_weights = np.zeros((len(layout.joints), model.nj))
        self._connect_blocks()
        self._by_speed: list[TorqueBySpeed] = of_kind(layout.torque_limits, TorqueBySpeed) if level.dynamics else []
        if level.dynamics:
            self._prepare_dynamics()
        self.barriers = [block for block in layout.others if isinstance(block.says, Barrier)]
        self.joint_bound_rows = p.lb[nb:nv], p.ub[nb:nv]
        #: Of each task on the joints, and of their damping: its share of each joint's cost.
        self.shares = np.zeros((self.motion.n_joint_blocks, model.nj))
        tasks = {block.member: block.row_task() for block in layout.objectives}
        above = [layout.slack] if layout.slack else []
        p.levels = [[tasks[task] for task in level] for level in (*above, *stack.levels)]
        self.damping = Damping(
            layout, self.motion, p, level.lm_damping, dt, least=level.regularisation, ranks=hierarchy.ranks(p.levels)
        )
        self._connect()
        self._stamp = -1
        #: What a unit of each force (nf,) in the problem is [N, N m]; a new array where it changes.
        self.force_scale = np.ones(layout.nf)
        self._read_weights()
        self._qp: QP | None = None
        #: Whether motors can bring the joints to rest before their limits; None where nothing depends on it.
        self.stopping = Stopping.of(self)
        self._first_fill(state, like)
        if like is None:
            self.binding.refuse_missing(stack.components)
        for component in () if like else stack.components:
            with explained(f"{component.name}.check"):
                component.check(self)

    def _share(self, like: Plan | None) -> None:
        """What is remembered from tick to tick: the plans of one stack have it in common."""
        model, contacts, limits = self.model, self.stack.contacts, [limit for limit, *_ in self.layout.joint_limits]
        if like is None:
            intervals = JointIntervals(limits, model, self.dt)
            applied = Applied(model, self.level, self.binding, contacts, intervals)
        else:
            applied = like.applied
        self.all_tasks = self.stack.tasks if like is None else like.all_tasks
        self.applied, self.intervals, self.extra_bias = applied, applied.intervals, applied.bias
        self.torque_bounds = applied.torque_bounds
        self._place = np.array([applied.places[contact.name] for contact in contacts], dtype=np.intp)
        if like is None:
            self.anchors = [Anchor(np.eye(3), np.zeros(3)) for _ in contacts]
        else:
            self.anchors = [like.anchors[place] for place in self._place]

    # ---- compile: who writes where
    def _connect_blocks(self) -> None:
        """Give every block the memory that it writes into, and its weights."""
        layout, p, model = self.layout, self.problem, self.model
        for contact, anchor in zip(layout.contacts, self.anchors, strict=True):
            contact.anchor = anchor
        for motion in layout.motions:
            motion.connect(self.motion, model)
        for row in layout.others:
            row.connect(p, model, self.dt, order=self.level.order, forces=layout.forces_of(row.says))
        soft_rows: list[Block] = [*layout.linear, *layout.kinematic]
        for block in soft_rows:
            block.weights = p.weights[block.rows.start - p.soft.start :][: block.dim]
        for joints, weights in zip(layout.joints, self._joint_weights, strict=True):
            joints.weights = weights
        for soft in layout.soft:
            soft.weights = np.zeros(soft.dim)

    def _prepare_dynamics(self) -> None:
        layout, p, model = self.layout, self.problem, self.model
        presses = [
            (contact.unknowns.start + [*contact.member.wrench_axes].index(2), place)
            for contact, place in zip(layout.contacts, self._place, strict=True)
            if not contact.member.bilateral
        ]
        self._normal, self._pressing = np.array(presses, dtype=np.intp).reshape(-1, 2).T
        lower, upper = p.range_bounds()
        self.torque_range = lower[: model.nj], upper[: model.nj]
        self._version, self._own_normals = -1, np.zeros((2, len(presses)))
        self._cones = {block: p.G[block.cone, block.unknowns].copy() for block in layout.contacts}
        self._force_weights = np.concatenate(
            [np.full(block.dim, block.member.force_weight) for block in layout.contacts] or [np.zeros(0)]
        )  # fmt: skip

    def _connect(self) -> None:
        """The memory of a tick's compiled call."""
        p, weights, damping = self.problem, self._joint_weights, self.damping.in_metric
        own = damping.base, damping.applied, damping.rate, self.shares, p.metric[damping.columns]
        self._shares = Memory(np.array(weights.shape, dtype=np.int64), p.units, weights, *own)
        self._call = np.zeros(fill_kernel.NUMBER, dtype=np.int64)
        self._call[[fill_kernel.SHARES, fill_kernel.DAMPINGS]] = self._shares.address, self.damping.address
        self._called = Memory(self._call).addresses.item()

    def opened(self, hierarchy: Hierarchy, solver: Solver) -> RowSolver:
        """A solver of the plan's problem."""
        return hierarchy.open(self.problem, solver, self.damping.pulls, may_break=bool(self.layout.slack))

    def answered_by(self, solver: RowSolver) -> None:
        """The solver whose code :meth:`answer` calls."""
        self._call[[fill_kernel.PLACE, fill_kernel.SOLVER]] = solver.kernel

    def _first_fill(self, state: RobotState, like: Plan | None) -> None:
        """Fill once, on poisoned memory: what nobody writes is found now, by name.

        From a state of its own: what a state was asked for it computes for ever, and most rows are compiled code's.
        """
        if like is None:
            self.start(state)
        trial = self.model.state(drifts=state.drifts)
        trial.update(state.t, state.q, state.v)
        for block in self.layout.motions:
            with explained(f"{block.name}.fill"):
                block.fill(trial)
            block.check(self.level.order)
        self.motion.writes_ed[:] = ~np.isnan(self.motion.own_ed)
        self.bind(trial)()
        self._run(FILL)  # rows about torques are made of these
        for row in self.layout.others:
            with explained(f"{row.name}.fill"):
                row.fill(trial)
            row.check(self.level.order)
        if self._by_speed:
            with explained(f"{self._by_speed[0].name}.fill"):
                self._bound_torques(trial)
        self.fill(state)

    # ---- weights: read again of what was assigned to
    def _read_weights(self) -> None:
        """Gains, weights, cones and bounds on forces; where one cannot be used, no tick has an answer.

        Those of members that have not changed are as they were read last.

        Raises:
            InvalidInput: gains with which errors grow from tick to tick.
            MemberFailed: a member raised, or gave what none can be.
        """
        layout, p = self.layout, self.problem
        since, self._stamp = self._stamp, -1  # where one raises, all are read again
        for motion in self._changed(layout.motions, since):
            with explained(f"{motion.name}.gains"):
                self.motion.set_gains(motion.motion, motion.says)
        for block in self._changed(layout.objectives, since):
            with explained(f"{block.name}.weights"):
                block.weights[:] = block.member.weights()
        eps, nb, nv, n_u = self.level.regularisation, self.model.nb, self.model.nv, layout.n_u
        joints = eps + self._joint_weights.sum(axis=0)
        unit, p.unit = p.unit, float(joints.max())
        p.metric[: nb - n_u] = eps / p.unit
        self.damping.in_metric.base[:] = joints
        self.damping.read_weights()
        share(self._shares.address)
        contacts = self._changed(layout.contacts, since) if layout.nf else []
        for block in contacts:  # constant rows K f <= 0, on the scaled forces
            with explained(f"{block.name}.cone"):
                self._cones[block][:] = block.member.cone()
            p.upper[p.item(block.cone.start) : p.item(block.cone.stop)] = 0.0
        if contacts or (layout.nf and p.unit != unit):
            p.scale[nv : nv + layout.nf] = np.sqrt(p.unit / (self._force_weights + eps))
            self.force_scale = p.scale[nv : nv + layout.nf].copy()
            for block, cone in self._cones.items():
                p.G[block.cone, block.unknowns] = cone * p.scale[block.unknowns]
            if contacts:
                pressing = [block.member for block in layout.contacts if not block.member.bilateral]
                for contact, bounds in zip(pressing, self._own_normals.T, strict=True):
                    with explained(f"bounds on the force of {contact.name}"):
                        bounds[0] = -np.inf if contact.f_min is None else contact.f_min
                        bounds[1] = np.inf if contact.f_max is None else contact.f_max
            self._bound_normals()
        for soft in layout.soft:
            p.scale[soft.unknowns] = np.sqrt(p.unit / (soft.weights + eps))
        self._stamp = self.binding.stamp

    def _changed(self, blocks: Iterable[_B], since: int) -> list[_B]:
        """Those whose members may be others than in this version of the binding."""
        return [block for block in blocks if self.binding.has_changed(block.member, since)]

    # ---- the hot path
    def start(self, state: RobotState) -> None:
        """Make the contacts where the robot is now (or at their targets); nothing is overridden."""
        self.applied.reset()
        self.binding.refresh()
        if self.stopping is not None:
            self.stopping.reset()
        for barrier in self.barriers:
            with explained(f"{barrier.name}.reset"):
                barrier.says.reset()
        if self.damping.is_on:
            self.damping.reset()
            share(self._shares.address)
        for block in self.layout.contacts:
            self._make(block, state)

    def _make(self, block: MotionBlock, state: RobotState) -> None:
        """Make a contact: at its target, or where the robot is."""
        assert block.anchor is not None, "it is a contact"
        with explained(f"{block.name}.anchor"):
            block.anchor.move(block.member.target or block.member.anchor(state))

    def take_over(self, former: Plan, state: RobotState) -> None:
        """Go on where another plan of the same stack stands: make the contacts that it has not."""
        self.binding.refresh()
        held = [block.member for block in former.layout.contacts]
        for block in self.layout.contacts:
            if block.member not in held:
                self._make(block, state)

    def go_on_from(self, former: Plan) -> None:
        """Damp as the plan of another stack did."""
        self.damping.go_on_from(former.damping)
        share(self._shares.address)

    def _run(self, stages: int) -> int:
        """Compiled stages of a tick."""
        return fill_kernel.tick(self._called, stages)

    def observe(self) -> None:
        """Before a fill: damp the joints by what the answer to the one before left of the kinematic tasks."""
        self._run(OBSERVE)

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

        For plans that are compiled, and the solver they are :meth:`answered_by`. What makes no sense is seen to between
        the stages.

        Raises:
            MemberFailed: as :meth:`fill`.
            InvalidInput: a row is not finite.
        """
        if self.binding.is_behind:
            self.binding.refresh()
        if observes and self.binding.stamp != self._stamp:  # with the weights that the answer was found with
            self.observe()
            observes = False
        self._prepare(state)
        if self._failure is None:
            code = self._run((OBSERVE if observes else 0) | FILL | LOOK | ANSWER)
            if code >= 0:
                return solver.concluded(code)
        else:
            self._fill(state)
        self._refuse_spoilt()
        self.refuse_not_finite()
        return solver.concluded(self._run(ANSWER))

    def _prepare(self, state: RobotState) -> None:
        """Before the compiled code fills: weights that were assigned, targets that users write, bounds on forces."""
        self._failure = None
        if self.binding.stamp != self._stamp:
            try:
                self._read_weights()
            except WbcError as cause:
                self._failure = cause
        filler = self._bound
        (filler if state is filler.state and filler.is_complete else self.bind(state))()
        if self.level.dynamics and self._version != self.applied.version:
            self._version = self.applied.version
            self._bound_normals()
            if not self._by_speed:
                self._bound_torques(state)

    def _fill(self, state: RobotState) -> None:
        """All rows, and whether they are finite."""
        self._run(FILL)
        for block in self._bound.others:
            self._try(block.name, block.fill, state)
        if self._by_speed:
            self._try(self._by_speed[0].name, self._bound_torques, state)
        self._run(LOOK)

    def _try(self, name: str, fill: Callable[[Any], None], given: Any) -> bool:
        """Whether a member did not raise."""
        try:
            fill(given)
        except Exception as cause:
            self.failed(name, cause)
            return False
        return True

    def _refuse_spoilt(self) -> None:
        self._spoilt = self._call.item(fill_kernel.SPOILT)
        if self._spoilt & BOUND_SPOILT:
            i = int(np.isnan(self.problem.bounds).any(axis=0).argmax())
            row = self.problem.rows[i - self.problem.first_row if i > self.problem.n else self.layout.n_rows + i]
            self.failed(row.owner, InvalidInput(f"a bound of {row} is NaN"))
        if self._failure is not None:
            raise self._failure

    def failed(self, name: str, cause: Exception) -> None:
        """A member's ``fill`` raised: the first to do so is the one that :meth:`fill` tells of."""
        if self._failure is None:
            self._failure = MemberFailed(f"{name}.fill", cause)
            self._failure.__cause__ = cause

    def _bound_torques(self, state: RobotState) -> None:
        for now, bound in zip(self.torque_range, self.torques_at(state), strict=True):
            now[:] = bound

    def torques_at(self, state: RobotState) -> tuple[Vec, Vec]:
        """Bounds on torques (lower, upper), (nj,) each, at the speed of a state; the problem keeps its own."""
        return self.applied.torques_at(state.v_joints, self._by_speed) if self._by_speed else self.torque_bounds

    def _bound_normals(self) -> None:
        """What contacts say of their normal forces, and, before that, what components allow."""
        applied, p, at, pressing = self.applied, self.problem, self._normal, self._pressing
        least, most = self._own_normals
        scale, upper = p.scale[at], np.minimum(most, applied.normal_limits[pressing])
        p.ub[at] = upper / scale
        p.lb[at] = np.minimum(np.maximum(least, applied.normal_floors[pressing]), upper) / scale

    def bind(self, state: RobotState) -> CompiledFill:
        """What fills from this state, also the next time: a plan that is filled from one state loses no time here."""
        self._bound = filler = CompiledFill(self, state, self._try)
        self._call[fill_kernel.FILLS] = filler.address
        return filler

    @property
    def is_compiled(self) -> bool:
        """Whether a fill is compiled code, but for targets that users write, and nobody changes it in a tick."""
        return self._bound.is_compiled and not (self.stack.components or self.stopping or self._by_speed)

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


def refuse_contradictions(plan: Plan, state: RobotState) -> None:
    """Look for rows that contradict each other in every state: found when a stack is compiled, not in a tick.

    The rows that are looked at are the same in this state and another; plan and state are as before afterwards.

    A force that friction cannot give, a joint speed above its limit: what depends on no state is told while building.

    Raises:
        Infeasible: with the rows, and how much each must give.
    """
    t, q, v = state.t, state.q.copy(), state.v.copy()
    step = 0.1 * np.sin(1.0 + np.arange(len(v)))  # any other state, the same one each time
    # The time of the second tick: a target need not be defined any later.
    state.update(t + plan.dt, plan.model.integrate(q, step), step[::-1])
    plan.fill(state)
    other = plan.qp.copy()
    state.update(t, q, v)
    plan.fill(state)
    qp = _same(plan.qp, other)
    found = None if qp is None else conflict(qp)
    if found is not None:
        raise Infeasible(f"these constraints cannot hold together in any state: {found}", conflict=found, qp=qp)


def _same(qp: QP, other: QP) -> QP | None:
    """The rows and bounds that both have, None where no conflict can be among them or they are no problem."""
    rows, bounds = np.split((qp.sides == other.sides).all(axis=0), [len(qp.matrix)])
    rows &= (qp.matrix == other.matrix).all(axis=1)
    if not (rows.any() or (qp.lb > qp.ub)[bounds].any()):
        return None
    sound = np.isfinite(qp.matrix[rows]).all() and not np.isnan(np.concatenate([qp.lower[rows], qp.upper[rows]])).any()
    if not sound:
        return None
    equal, free = rows[: qp.n_eq], rows[qp.n_eq :]
    names = [row for row, kept in zip(qp.rows, [*rows, *np.ones(qp.n, bool)], strict=True) if kept]
    return QP(
        np.eye(qp.n), np.zeros(qp.n), A=qp.A[equal], b=qp.b[equal], C=qp.C[free], cl=qp.cl[free], cu=qp.cu[free],
        lb=np.where(bounds, qp.lb, -np.inf), ub=np.where(bounds, qp.ub, np.inf), rows=names,
    )  # fmt: skip
