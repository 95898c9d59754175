"""Recovery: the fallback sequence of a controller for a tick whose problem has no certified answer.

    other solver       the same hierarchy on the default solver; where that is the solver that failed, on Clarabel
    not certified      the answer meets all constraints, and its distance from the optimum is not proved
    not optimised      a strict hierarchy used its budget of QPs: lower levels are where the upper ones left them
    weighted fallback  a strict hierarchy has no answer: one QP with the weighted sum of all levels
    relaxed            constraints are relaxed in a declared order, each as little as possible, but that what is left of
                       exact tasks damps the joints; torques, friction and physics hold; ``controller.why`` says which
                       constraints, and by how much
    closed form        the minimum of the cost under the equalities alone, cut to the limits; on legs if it needs no cut
    hold               the last certified command
    damped             brake to rest, see :mod:`wbc.control.fallback`

The first level solves the problem of the tick, with a certificate: its status is ok. The status of every other level is
not ok. The next three levels solve a weaker problem within all constraints, a relaxed solution is certified for the
relaxed problem, and the others are failures. After ``hold_ticks`` failures in a row only the last level is used, until
``resume_after`` ticks in a row have an answer that is no failure. Every level keeps the limits on position, velocity,
acceleration and torque, except for those that the relaxed problem relaxes. ``controller.fallbacks.log`` has every such
tick.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from time import perf_counter
from typing import NamedTuple, final

import numpy as np

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.control import fallback
from wbc.control.command import Command, Proof
from wbc.control.solving import Solving
from wbc.errors import InvalidProblem
from wbc.models.model import RobotState
from wbc.qp.certificate import TOLERANCE, Certificate
from wbc.qp.problem import QP
from wbc.qp.relax import relaxed
from wbc.qp.rows import RowSolver
from wbc.qp.rows.row_task import NOT_OPTIMISED, WEIGHTED
from wbc.qp.solver import Solution, Solver
from wbc.qp.solvers import by_name
from wbc.stack.plan import Plan
from wbc.tolerances import DISTANCE, MET, ROUNDING
from wbc.types import Status, Vec, read_only

#: What may be relaxed, in the order in which it is.
RELAXABLE = ("force rates", "constraints", "contacts", "barriers", "joint limits")

_NO_PROOF = Certificate.none()
#: Levels that solve a weaker problem within all constraints, the better ones first.
NOT_CERTIFIED = "not certified"
WEAKER = (NOT_CERTIFIED, NOT_OPTIMISED, WEIGHTED)
#: No acceleration, force or torque is larger: rounding of it would be a whole unit.
_HUGE = 1.0 / ROUNDING
#: How well a closed form meets its rows, in their units.
_PRECISE = DISTANCE * MET
#: What the largest curvature of the cost counts beside a unit of violation, and its pull beside the largest of them.
_SHARE = 1e-3
_OF_RELAXED = ("pdas", "clarabel")


@final
@dataclass(frozen=True, kw_only=True)
class Recovery(metaclass=TellsArguments):
    """Settings of the fallback sequence: what a controller does in a tick without a certified solution.

    Args:
        hold_ticks: how many failed ticks in a row may be answered by a closed form or the last certified command
            before the robot is braked.
        relax: what may be relaxed where constraints contradict each other, in this order: "force rates" (bounds of a
            schedule on normal forces), "constraints" (exact tasks and linear constraints), "contacts" (their motion),
            "barriers", "joint limits" (position, velocity, acceleration). Torque limits, friction and the dynamics
            never do. () for nothing.
        resume_after: ticks in a row with an answer that is no failure; so many end a stop.
        budget: time [s] of a tick after which no further solver is tried; None for no limit.

    Raises:
        InvalidInput: a number out of range, or something else in ``relax``, or the same twice.
    """

    hold_ticks: int = 10
    relax: tuple[str, ...] = RELAXABLE
    resume_after: int = 1
    budget: float | None = None

    def __post_init__(self) -> None:
        checks.number("hold_ticks", self.hold_ticks, low=0)
        checks.number("resume_after", self.resume_after, low=1)
        if self.budget is not None:
            checks.number("budget", self.budget, low=0.0)
        if checks.items("relax", self.relax, f"of {', '.join(RELAXABLE)}"):
            checks.names("relax", self.relax, RELAXABLE)


class Event(NamedTuple):
    """One tick that was not simply solved: when, how it ended, which fallback level made the command, and why."""

    t: float
    tick: int
    status: Status
    fallback_level: str
    why: str


class _Weaker(NamedTuple):
    """The solution of a weaker problem: its fallback level and status, the solver, and the problem's values."""

    level: str
    status: Status
    solver: RowSolver
    value: Vec


@final
class FallbackSequence:
    """The fallback levels below "solved", for one controller.

    ``counts`` is the number of commands that each level made, ``log`` the last 1000 ticks that were not simply solved.
    """

    __slots__ = (
        "_answered", "_controller", "counts", "failures", "good", "log", "recovery",
    )  # fmt: skip

    def __init__(self, controller: Solving, recovery: Recovery | None = None) -> None:
        recovery = Recovery() if recovery is None else recovery
        self._controller = controller
        self.recovery = checks.instance("recovery", recovery, Recovery, "wbc.Recovery(...)")
        self.log: deque[Event] = deque(maxlen=1000)
        self.counts: Counter[str] = Counter()
        self.reset()

    def reset(self) -> None:
        """No failure yet."""
        self.good: Command | None = None
        self.failures = 0
        self._answered = 0

    @np.errstate(all="ignore")
    def unposed(self, status: Status, moment: Vec | None = None) -> Command:
        """The command of a tick without a problem to solve: hold, or brake. A member failed; or the state cannot be
        right, so that there is no ``moment``."""
        self._controller.has_problem = False
        return self._fail(status, self._expected() if moment is None else moment)

    def spoilt(self, command: Command, failure: str) -> None:
        """Write down that a component failed once the command was decided: the command stands, not ok."""
        controller = self._controller
        controller.why = f"{controller.why}; {failure}" if controller.why else failure
        controller.status = command.status = Status.FAILED
        self.write_down(command, controller.why)

    @np.errstate(all="ignore")
    def descend(self, status: Status, moment: Vec) -> Command:
        """The command of the first fallback level that has one."""
        controller, start = self._controller, perf_counter()
        weaker = self._weaker(status)
        if status is not Status.INFEASIBLE and (weaker is None or weaker.level != NOT_OPTIMISED):
            answer = self._other_solver(status)
            if answer.ok:
                return self._certified(Status.SOLVED, "other solver", moment, controller.answering.proof)
            other = self._weaker(answer)
            if other is not None and (weaker is None or WEAKER.index(other.level) < WEAKER.index(weaker.level)):
                weaker = other
            status = answer
        if weaker is not None and status is not Status.INFEASIBLE:
            controller.plan.problem.value[:] = weaker.value
            controller.answering = weaker.solver
            return self._certified(weaker.status, weaker.level, moment, weaker.solver.certificate)
        controller.status = status
        unlimited = controller.plan.unlimited_joints(*controller.plan.joint_bound_rows)
        if not unlimited:
            found = self._relaxed(start) if status is Status.INFEASIBLE else None
            if found is not None:
                return self._certified(status, "relaxed", moment, found)
            if self.failures < self.recovery.hold_ticks and self._in_time(start) and self._closed_form():
                self.failures += 1
                return self._note(controller.decode(moment, status, "closed form", _NO_PROOF))
        elif status is Status.INFEASIBLE:
            more = [f"{len(unlimited) - 3} more"] if len(unlimited) > 3 else []
            named = ", ".join([*unlimited[:3], *more])
            controller.why = f"the rows contradict each other; none is relaxed, as no limit bounds {named}"
        return self._fail(status, moment)

    def resume(self, command: Command, moment: Vec) -> Command:
        """The command of an answered tick: after a stop a brake, until enough ticks in a row have an answer."""
        stopped = self.failures > self.recovery.hold_ticks
        self._answered += 1
        if stopped and self._answered < self.recovery.resume_after:
            controller = self._controller
            controller.status = Status.FAILED
            controller.why = (
                f"braking until {self.recovery.resume_after} ticks in a row have an answer: {self._answered} so far"
            )
            return self._note(self._bounded(Status.FAILED, "damped", moment, None))
        solved_again = self.failures and command.status.ok
        self._note(command, f"solved again after {self.failures} failures" if solved_again else "")
        self.good, self.failures = command, 0
        return command

    # ---- fallback levels
    def _weaker(self, status: Status) -> _Weaker | None:
        """The values that the last solver left in memory, if they meet all constraints."""
        controller = self._controller
        solver = controller.answering
        level = solver.shortfall
        if not level and status is Status.INACCURATE:
            level = NOT_CERTIFIED
        value = controller.plan.problem.value
        if not level or not solver.certificate.primal <= TOLERANCE or not (np.abs(value) < _HUGE).all():
            return None
        return _Weaker(level, status, solver, value.copy())

    def _other_solver(self, status: Status) -> Status:
        controller = self._controller
        mode = controller.mode
        if mode.second is None:
            name = "clarabel" if controller.solver.takes_rows else "pdas"
            plan = mode.plan
            mode.second = plan.opened(controller.hierarchy, by_name(name))
        answer = controller.solve_with(mode.second)
        return status if answer is Status.FAILED else answer

    def _relaxed(self, start: float) -> Certificate | None:
        """Solve with the rows of the first class relaxed, then of the first two, and so on."""
        plan = self._controller.plan
        qp = plan.qp
        share = _SHARE / float(np.abs(qp.H.diagonal()).max())
        items: list[int] = []
        classes = dict(_classes(plan, qp))
        for kind in self.recovery.relax:
            if not classes[kind] or not self._in_time(start):
                continue
            items += classes[kind]
            for solver in map(by_name, _OF_RELAXED):  # what one takes for infeasible the other may solve
                found: list[Solution] = []
                solve = partial(self._solve_relaxed, solver, items, share, found)
                try:
                    solved = solve()
                except InvalidProblem:
                    return None
                if solved:
                    if plan.stopping is not None:
                        bounds, least = plan.joint_bound_rows, found[-1]
                        asked = np.array(bounds)
                        is_safe = plan.stopping.keep(plan, self._controller.state, solve)
                        for bound, was in zip(bounds, asked, strict=True):
                            bound[:] = was  # the reports name the limits of the tick, not those for braking
                        if not is_safe:  # narrower bounds had to be relaxed more, for nothing
                            self._accept(least, found)
                    self._controller.why = _said_relaxed(
                        plan, self._controller.state, sorted(items), found[-1].x[: plan.problem.n]
                    )
                    return found[-1].certificate
        return None

    def _solve_relaxed(self, solver: Solver, items: list[int], share: float, found: list[Solution]) -> bool:
        """Solve the plan's problem with these rows relaxed; an answer goes into the plan's memory and to ``found``.

        A second problem follows where a far target pulls hard, so that violations are least also then, and where exact
        tasks are relaxed: what is left of them damps the joints, as what is left of tasks does.
        """
        plan, model = self._controller.plan, self._controller.model
        qp, n = relaxed(plan.qp, items, share=share), plan.problem.n
        session = solver.open(qp.shape)
        if not self._accept(session.solve(qp), found):
            return False
        x = found[-1].x
        pull, most = np.abs(qp.H[:n] @ x + qp.g[:n]).max(), _SHARE * max(1.0, np.abs(x[n:]).max())
        weight, rate = plan.damping.of_exact.now()
        if pull > most:
            qp.H[:n] *= most / pull
            qp.g[:n] *= most / pull
        if weight.any():
            joints = np.arange(model.nb, model.nv)
            qp.H[joints, joints] += weight
            if plan.level.order == 2:
                qp.g[joints] += weight * rate * self._controller.state.v_joints
        if pull > most or weight.any():
            self._accept(session.solve(qp), found)
        return True

    def _accept(self, solution: Solution, found: list[Solution]) -> bool:
        """Take an answer to a relaxed problem, if it is one."""
        if not solution.status.ok or not np.abs(solution.x).max() < _HUGE:
            return False
        found.append(solution)
        self._write(solution.x[: self._controller.plan.problem.n])
        return True

    def _closed_form(self) -> bool:
        """minimise the cost under A x = b, one linear system; then joints and torques are cut to their bounds.

        Only where nothing has to be cut and no cone is broken on legs, and on joints of which only some have limits on
        motion and only some on torque. A robot that pushes itself off with forces that the ground cannot carry falls,
        and a cut acceleration does not bound the torques of others: there the last command is better.
        """
        plan = self._controller.plan
        qp, p, n = plan.qp, plan.problem, plan.qp.n
        zero = np.zeros((qp.n_eq, qp.n_eq))
        try:
            x = np.linalg.solve(np.block([[qp.H, qp.A.T], [qp.A, zero]]), np.concatenate([-qp.g, qp.b]))[:n]
        except np.linalg.LinAlgError:
            return False
        if not np.abs(qp.A @ x - qp.b).max(initial=0.0) < _PRECISE:
            return False
        bounds = (plan.joint_bound_rows, plan.torque_range) if plan.level.dynamics else (plan.joint_bound_rows,)
        if plan.model.nb or not any(np.isfinite(pair).all() for pair in bounds):
            value = qp.C @ x
            outside = np.concatenate([qp.cl - value, value - qp.cu, qp.lb - x, x - qp.ub])
            if not outside.max(initial=0.0) < _PRECISE:
                return False
        self._write(np.clip(x, qp.lb, qp.ub))
        return bool((np.abs(p.value) < _HUGE).all())

    def _write(self, x: Vec) -> None:
        """An answer of the standard form into the problem's memory, where a solver would leave it; torques are cut."""
        plan = self._controller.plan
        p = plan.problem
        np.divide(x, p.scale, out=p.x)
        np.dot(p.G[: p.n_rows], p.x1, out=p.value[p.first_row : p.first_row + p.n_rows])
        if plan.level.dynamics:
            torques = p.value[p.item(plan.layout.torque_row) :][: plan.model.nj]
            np.clip(torques, *plan.torque_range, out=torques)

    def _in_time(self, start: float) -> bool:
        budget = self.recovery.budget
        return budget is None or perf_counter() - start < budget

    # ---- commands
    def _certified(self, status: Status, level: str, moment: Vec, proof: Proof) -> Command:
        self._controller.status = status
        return self.resume(self._controller.decode(moment, status, level, proof), moment)

    def _fail(self, status: Status, moment: Vec) -> Command:
        """Hold, or brake."""
        controller = self._controller
        self.failures += 1
        self._answered = 0
        controller.status = status
        held = self.good if self.failures <= self.recovery.hold_ticks else None
        return self._note(self._bounded(status, "damped" if held is None else "hold", moment, held))

    def _bounded(self, status: Status, name: str, moment: Vec, held: Command | None) -> Command:
        controller = self._controller
        state, level, plan = controller.state, controller.level, controller.plan
        state.move(state.t, moment)
        if level.order == 1:
            last = state.v if controller.last is None else controller.last.v
            decided = read_only(fallback.velocity(plan, state, None if held is None else held.v, last))
            return Command(controller, status, name, _NO_PROOF, moment=moment, v=decided)
        a = read_only(fallback.acceleration(plan, state, None if held is None else held.a))
        if not level.dynamics:
            return Command(controller, status, name, _NO_PROOF, moment=moment, a=a)
        carrying = None if self.good is None else self.good.tau
        tau = read_only(fallback.torque(plan, state, a, None if held is None else held.tau, carrying))
        forces = None if held is None else held.forces
        return Command(controller, status, name, _NO_PROOF, moment=moment, a=a, tau=tau, forces=forces)

    def _expected(self) -> Vec:
        """The state that the last command was to reach; before any, the robot's reference at rest."""
        last, model = self._controller.last, self._controller.model
        if last is None or not np.isfinite(last.q).all():
            return np.concatenate([model.q0, np.zeros(model.nv)])
        return np.concatenate([last.q, last.v])

    def _note(self, command: Command, why: str = "") -> Command:
        controller = self._controller
        if not command.status.ok:
            controller.why = controller.why or command.status.value
        self.counts[command.fallback_level] += 1
        self.write_down(command, why or controller.why or command.status.value)
        return command

    def write_down(self, command: Command, why: str) -> None:
        """Keep this tick and what there is to say of it in ``log``."""
        controller = self._controller
        self.log.append(Event(controller.state.t, controller.serial, command.status, command.fallback_level, why))


def _said_relaxed(plan: Plan, state: RobotState, items: list[int], x: Vec) -> str:
    """What was relaxed most, at most three rows, of which constraint and by how much.

    Rows of contacts that depend on one another, as of legs whose joints turn about parallel axes, contradict each other
    in a state that is off by a little: that is said, too.
    """
    qp = plan.qp
    said, value = [], np.concatenate([qp.matrix @ x, x])[items]
    lower, upper = (np.concatenate(pair)[items] for pair in ((qp.lower, qp.lb), (qp.upper, qp.ub)))
    slack = value - np.clip(value, lower, upper)
    for k in np.argsort(-np.abs(slack), kind="stable")[:3]:
        row, place = qp.rows[items[k]], items[k] - qp.n_eq
        row = row if place < 0 else plan.bounded_row(place, state, upper=slack[k] > 0.0)
        if abs(slack[k]) > MET:
            said.append(f"{row.owner} {row.label}".strip() + f" by {abs(slack[k]):.3g} {row.unit}")
    J = plan.problem.G[plan.layout.contact_row : plan.layout.n_rows, : plan.model.nv]
    rank = int(np.linalg.matrix_rank(J)) if any(one.startswith("contact[") for one in said) else len(J)
    depend = f"; the contacts hold {len(J)} directions, of which {rank} are independent"
    return "relaxed: " + ", ".join(said) + depend * (rank < len(J)) if said else ""


def _classes(plan: Plan, qp: QP) -> Iterator[tuple[str, list[int]]]:
    """Indices into ``qp.rows`` of what may be relaxed."""
    layout, model = plan.layout, plan.model
    owners: list[tuple[str, set[str]]] = [
        ("constraints", {block.name for block in (*layout.exact, *layout.constraints)}),
        ("barriers", {block.name for block in layout.barriers}),
        ("contacts", {f"contact[{contact.short_name}]" for contact in plan.stack.contacts}),
    ]
    m = len(qp.lower)
    yield "force rates", [m + i for i in plan.pressed() if np.isfinite(qp.lb[i])]
    for kind, names in owners:
        yield kind, [i for i in range(m) if qp.rows[i].owner in names]
    yield "joint limits", [*range(m + model.nb, m + model.nv)]
