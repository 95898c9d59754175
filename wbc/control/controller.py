"""Controller: from a state to a command, at every tick, whatever happens.

    state → components.before → plan.fill → solve → certificate → command → components.after

A tick raises only for programming errors (a wrong type or shape). Numbers that are not finite and solves that fail give
a bounded command all the same, from the next rung of a short ladder:

    solved   certified by the solver asked for, or by DAQP where that one failed
    hold     the last certified command, for at most ``hold_ticks`` ticks
    damped   brake: τ = g − D v within the torque limits; v or a that slows down at the velocity and acceleration levels
"""

from __future__ import annotations

from math import isfinite
from typing import Any, final

import numpy as np

from wbc import checks
from wbc.control.command import Command, Forces
from wbc.errors import InvalidInput, NotSupported
from wbc.models.model import RobotModel
from wbc.qp.certificate import Certificate
from wbc.qp.problem import QP
from wbc.qp.rows import RowSolver, solution_of
from wbc.qp.solver import Solution, Solver
from wbc.qp.solvers import by_name
from wbc.stack.formulation import Formulation
from wbc.stack.hierarchy import Hierarchy, Weighted
from wbc.stack.stack import Stack
from wbc.types import Status, Vec

_NO_PROOF = Certificate(float("inf"), float("inf"), float("inf"))
_BRAKE_TIME = 0.05  # [s] time constant with which a damped stop takes the velocity out


@final
class Controller:
    """Runs a stack on a robot.

    Args:
        robot: from :func:`wbc.load`.
        stack: what to do.
        level: ``VelocityLevel()``, ``AccelerationLevel()`` or ``InverseDynamics()``.
        hierarchy: ``Weighted()``.
        solver: a solver's name or its settings.
        dt: time between ticks [s].
        hold_ticks: how many failed ticks in a row may repeat the last certified command before braking.

    Raises:
        NotSupported: a member the level cannot carry, or a solver that cannot keep limits at this rate.
        InvalidInput, UnknownFrame, UnknownSolver: an argument that makes no sense, by name.

    Example:
        >>> import wbc
        >>> from tasks import JointVelocityLimits, Position
        >>> robot = wbc.load("arm")
        >>> reach = Position("tool", target=[0.4, 0.2, 0.5])
        >>> stack = wbc.Stack([reach], subject_to=[JointVelocityLimits()])
        >>> controller = wbc.Controller(robot, stack, level=wbc.VelocityLevel(), dt=1e-3)
        >>> command = controller.tick(0.0, robot.q0, robot.q0 * 0)
        >>> command.status.name
        'SOLVED'
    """

    def __init__(
        self,
        robot: RobotModel,
        stack: Stack,
        *,
        level: Formulation,
        hierarchy: Hierarchy | None = None,
        solver: str | Solver = "pdas",
        dt: float = 1e-3,
        hold_ticks: int = 10,
    ) -> None:
        for name, value, kind in (("robot", robot, RobotModel), ("stack", stack, Stack), ("level", level, Formulation)):
            if not isinstance(value, kind):
                raise InvalidInput(f"{name} must be a {kind.__name__}, not {value!r}")
        self.model, self.stack, self.level = robot, stack, level
        self.dt = checks.number("dt", dt, low=0.0, strict=True)
        self.hold_ticks = hold_ticks
        self.hierarchy = Weighted() if hierarchy is None else hierarchy
        self.solver = by_name(solver)
        if self.solver.offline:
            raise NotSupported(
                f"solver {self.solver.name!r} cannot keep limits to 1e-6 in a control loop; it is for offline use"
            )
        self.plan = level.compile(robot, stack, dt=self.dt)
        self._solver = self.hierarchy.open(self.plan.problem, self.solver)
        self._second: RowSolver | None = None
        self._answered = self._solver
        self.state = robot.state()
        self.components = stack.components
        self.reset()

    def reset(self) -> None:
        """Forget everything: contacts are made anew at the next tick, components start again."""
        self.ticks = 0
        self.last: Command | None = None
        self.status = Status.FAILED
        self._good: Command | None = None
        self._failures = 0
        self._started = False
        self._solver.reset()

    # ---- the tick
    def tick(self, t: float, q: Vec, v: Vec) -> Command:
        """Decide the command for time t [s], configuration q (nq,) and velocity v (nv,).

        Raises:
            InvalidInput: q or v has another shape, or is not numbers.
        """
        q, v = self._copied("q", q, self.model.nq), self._copied("v", v, self.model.nv)
        self.ticks += 1
        if not isfinite(q.dot(q) + v.dot(v) + t):
            return self._fall_back(Status.INVALID_STATE, q, v)
        state, plan = self.state, self.plan
        state.update(t, q, v)
        if not self._started:
            self._start()
        if self.components:
            plan.extra_bias[:] = 0.0
            for component in self.components:
                component.before(state, self.last, plan)
        plan.fill(state)
        self.status = status = self._solve()
        if status is Status.SOLVED:
            command = self._decode(q, v)
        else:
            command = self._fall_back(status, q, v)
        for component in self.components:
            component.after(state, command)
        self.last = command
        return command

    @staticmethod
    def _copied(name: str, value: Any, size: int) -> Vec:
        vector = np.array(value, dtype=np.float64)
        if vector.shape != (size,):
            raise InvalidInput(f"{name} must have shape ({size},), not {vector.shape}")
        return vector

    def _start(self) -> None:
        self.plan.start(self.state)
        for component in self.components:
            component.reset(self.state)
        self._started = True

    def _solve(self) -> Status:
        """The solver asked for; where it fails, DAQP."""
        self._answered = self._solver
        status = self._solver.solve()
        if status.ok or self.solver.name == "daqp":
            return status
        if self._second is None:
            self._second = Weighted().open(self.plan.problem, by_name("daqp"))
        second = self._second.solve()
        if second.ok:
            self._answered = self._second
        return second

    def _decode(self, q: Vec, v: Vec) -> Command:
        p, model = self.plan.problem, self.model
        value = p.value.copy()
        nv, proof = model.nv, self._answered.certificate
        if self.level.order == 1:
            command = Command(self, Status.SOLVED, "solved", proof, q=q, v_before=v, v=value[:nv])
        elif not self.level.dynamics:
            command = Command(self, Status.SOLVED, "solved", proof, q=q, v_before=v, a=value[:nv])
        else:
            first = p.first_row + model.nb
            command = Command(
                self, Status.SOLVED, "solved", proof, q=q, v_before=v,
                a=value[:nv], tau=value[first : first + model.nj], forces=value[nv : p.n],
            )  # fmt: skip
        self._good, self._failures = command, 0
        return command

    # ---- when it went wrong
    def _fall_back(self, status: Status, q: Vec, v: Vec) -> Command:
        self.status = status
        self._failures += 1
        if self._good is not None and self._failures <= self.hold_ticks:
            good = self._good
            # Bounds may have been lowered since: a joint that was declared dead must not be driven from memory.
            tau = np.clip(good.tau, *self.plan.torque_bounds) if self.level.dynamics else None
            return Command(
                self, status, "hold", _NO_PROOF, q=good._q_before, v_before=good._v_before,
                v=good._v, a=good._a, tau=tau, forces=good._forces,
            )  # fmt: skip
        return self._brake(status, q, v)

    def _brake(self, status: Status, q: Vec, v: Vec) -> Command:
        """Slow down within the limits, from what is still known of the state."""
        known = bool(np.isfinite(v).all() and np.isfinite(q).all())
        q, v = (q, v) if known else (self.state.q.copy(), np.zeros(self.model.nv))
        if self.level.order == 1:
            slower = v * max(0.0, 1.0 - self.dt / _BRAKE_TIME)
            return Command(self, status, "damped", _NO_PROOF, q=q, v_before=v, v=slower)
        a = -v / _BRAKE_TIME
        if not self.level.dynamics:
            return Command(self, status, "damped", _NO_PROOF, q=q, v_before=v, a=a)
        if known:
            self.state.update(self.state.t, q, v)
        return Command(self, status, "damped", _NO_PROOF, q=q, v_before=v, a=a, tau=self._damped_torque(v))

    def _damped_torque(self, v: Vec) -> Vec:
        """τ_ref − D v, D = diag(M)/T. τ_ref is gravity on a fixed base, the last certified torque on legs."""
        nb, good = self.model.nb, self._good
        reference = self.state.g if nb == 0 or good is None or good._tau is None else np.r_[np.zeros(nb), good._tau]
        damping = self.state.M.diagonal()[nb:] / _BRAKE_TIME
        low, high = self.plan.torque_bounds
        torque: Vec = np.clip(reference[nb:] - damping * v[nb:], low, high)
        return torque

    # ---- what others read
    @property
    def qp(self) -> QP:
        """The last tick's QP in standard form."""
        return self.plan.qp

    @property
    def active_count(self) -> int:
        """How many limits, cones and bounds the last answer touches."""
        return self._answered.active_count

    @property
    def iterations(self) -> int:
        """Iterations of the last solve."""
        return self._answered.iterations

    @property
    def counts(self) -> Any:
        """First guesses right, repaired, given up, over all ticks."""
        return self._solver.counts

    @property
    def form(self) -> str:
        """How the QP is solved: "dual", "box" or "standard"."""
        return self._solver.form

    def solution(self) -> Solution:
        """Solution of :attr:`qp` with its multipliers and the certificate recomputed from the data."""
        return solution_of(self._answered, self.plan.qp, self.status)

    def split_forces(self, forces: Vec | None) -> Forces:
        """Scaled force unknowns (nf,) as wrenches by contact name."""
        contacts, layout = self.stack.contacts, self.plan.layout
        physical = None if forces is None else forces * self.plan.problem.scale[self.model.nv :]
        wrenches, start = {}, 0
        for contact in contacts:
            part = slice(start, start + contact.dim)
            wrenches[contact.name] = np.full(contact.dim, np.nan) if physical is None else physical[part].copy()
            start += contact.dim
        return Forces(wrenches, {c.frame: c.name for c in layout.contacts})

    def explain(self) -> str:
        """The last tick in words and units: tasks with residual and share of the cost, active rows with multipliers."""
        from wbc.control.explain import explain

        return explain(self)
