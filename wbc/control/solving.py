"""Solving: who answers the problem of a tick, and what the answer says."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from wbc.control.command import Command, Forces, Proof
from wbc.errors import InvalidInput, NotSupported
from wbc.models.model import RobotModel, RobotState
from wbc.qp.problem import QP
from wbc.qp.rows import Outcome, RowSolver, solution_of
from wbc.qp.solver import Solution, Solver
from wbc.stack.component import Component
from wbc.stack.contact import keys
from wbc.stack.formulation import Formulation
from wbc.stack.hierarchy import Hierarchy
from wbc.stack.plans import Mode, Plans
from wbc.stack.stack import Stack
from wbc.types import Status, Vec, read_only


class Solving:
    """The plans of a stack, the plan and the solver of this tick, and the command that their answer means.

    A controller is one that ticks; its fallback levels ask further solvers here. There are no attributes but these, so
    that a slip in an assignment is told; what is settled when a controller is made cannot be assigned.
    """

    __slots__ = (
        "_dt", "_hierarchy", "_level", "_solver", "_stack", "answering", "has_problem", "is_new", "last", "mode",
        "model", "plan", "plans", "serial", "split_forces", "state", "status", "ticks", "why",
    )  # fmt: skip

    #: How the last tick ended, why it is not simply solved, and its command.
    status: Status
    why: str
    last: Command | None
    #: Since the last reset.
    ticks: int
    #: Counts all ticks ever made; ``ticks`` starts again with ``reset``.
    serial: int
    #: Whether there was no tick since the stack was made or replaced, or everything forgotten.
    is_new: bool
    #: Whether there was one in the last tick, else what is in memory is that of a tick before: its state was invalid,
    #: or a member failed.
    has_problem: bool
    #: The solver that was used last: the solution of the tick is in its memory.
    answering: RowSolver
    #: Makes contact forces (nf,) wrenches by contact name.
    split_forces: Callable[[Vec | None], Forces]

    def __init__(
        self, robot: RobotModel, stack: Stack, level: Formulation, *, hierarchy: Hierarchy, solver: Solver, dt: float
    ) -> None:
        self.model, self._level, self._dt = robot, level, dt
        self._hierarchy, self._solver = hierarchy, solver
        self.state = self.compile(stack)
        self.serial, self.is_new, self.has_problem = 0, True, True

    def compile(self, stack: Stack, prepared: Sequence[Component] = ()) -> RobotState:
        """Make plans and solvers of a stack; where that raises, those before stay. Components ``prepared`` go on.

        Returns the state at q0 that they are filled from.

        Raises:
            WbcError: something in the stack makes no sense for this robot and level.
        """
        if not (stack.tasks or stack.subject_to or stack.contacts or stack.components):
            raise InvalidInput("the stack is empty: write wbc.Stack([...]) with tasks, such as Posture(robot.q0)")
        state = self.model.state(drifts=self._level.order > 1)
        plans = Plans(
            state, stack, self._level, hierarchy=self._hierarchy, solver=self._solver, dt=self._dt, prepared=prepared
        )
        self.plans, self._stack = plans, stack
        for component in stack.components:
            component.serves = plans.whole.plan
        contacts = plans.whole.plan.stack.contacts
        self.split_forces = partial(_split, {c.name: c.dim for c in contacts}, dict(keys(contacts)))
        return state

    @property
    def dt(self) -> float:
        """Time between ticks [s]; it is fixed when a controller is made.

        Raises:
            NotSupported: an assignment.
        """
        return self._dt

    @dt.setter
    def dt(self, value: Any) -> None:
        raise NotSupported(f"controller.dt is fixed at {self._dt:g} s, as plans depend on it; make another controller")

    @property
    def stack(self) -> Stack:
        """What to do.

        Raises:
            NotSupported: an assignment.
        """
        return self._stack

    @stack.setter
    def stack(self, value: Any) -> None:
        raise NotSupported("controller.stack is compiled; write controller.replace(stack)")

    @property
    def level(self) -> Formulation:
        """What is decided: velocities, accelerations or torques; it is fixed when a controller is made."""
        return self._level

    @property
    def hierarchy(self) -> Hierarchy:
        """What the levels of the stack mean; it is fixed when a controller is made."""
        return self._hierarchy

    @property
    def solver(self) -> Solver:
        """The solver; it is fixed when a controller is made."""
        return self._solver

    def use(self, mode: Mode) -> None:
        """Decide with the plan and the solver of this set of contacts from now on."""
        self.mode, self.plan, self.answering = mode, mode.plan, mode.solver

    def solve_with(self, solver: RowSolver) -> Status:
        """Solve the problem as it is filled, so that the motors can stop afterwards. A solver that raises has failed,
        and ``why`` says how."""
        self.answering = solver
        if self._solves() and self.plan.stopping is not None:
            self.plan.stopping.keep(self.plan, self.state, self._solves)
        return self.status

    def _solves(self) -> bool:
        try:
            self.status = self.answering.solve()
            self.why = self.why or self.answering.fault
        except Exception as cause:  # a back end may raise anything, and a robot still needs a command
            self.why = f"solver {self._solver.name!r} raised {type(cause).__name__}: {cause}"
            self.status = Status.FAILED
        return self.status is Status.SOLVED

    def decode(
        self, moment: Vec, status: Status = Status.SOLVED, fallback_level: str = "solved", proof: Proof | None = None
    ) -> Command:
        """The command that the answer in the plan's memory means, decided in ``moment`` (nq + nv,), q and v."""
        plan, proof = self.plan, self.answering.proof if proof is None else proof
        parts, value = plan.layout, read_only(plan.problem.value.copy())
        motion = value[parts.motion_items]
        if self._level.order == 1:
            return Command(self, status, fallback_level, proof, moment, motion)
        if not self._level.dynamics:
            return Command(self, status, fallback_level, proof, moment, None, motion)
        tau = plan.applied.actuators.command(value[parts.torque_items])
        forces = self.mode.all_forces, value, plan.force_scale
        return Command(self, status, fallback_level, proof, moment, None, motion, tau, forces)

    # ---- what others read
    @property
    def qp(self) -> QP:
        """The last tick's QP in standard form, a copy; ``plan.qp`` is the same in memory that the next call reuses.

        Of a strict hierarchy it is the last level's, with what those above came to as equalities.
        """
        return self.answering.standard_form()

    @property
    def active_count(self) -> int:
        """How many limits, cones and bounds the last answer touches."""
        return self.answering.active_count

    @property
    def iterations(self) -> int:
        """Iterations of the last solve."""
        return self.answering.iterations

    @property
    def levels(self) -> tuple[Outcome, ...]:
        """How the levels came out in the last answer; () under ``Weighted``, which has none."""
        return self.answering.report()

    @property
    def counts(self) -> Any:
        """First guesses right, repaired, given up, over all ticks."""
        return self.mode.solver.counts

    @property
    def form(self) -> str:
        """How the QP is solved: "rows" or "variables" by the core, "standard" by another solver, "levels" if ranked."""
        return self.mode.solver.form

    def solution(self) -> Solution:
        """Solution of :attr:`qp` with its multipliers and the certificate recomputed from the data."""
        return solution_of(self.answering, self.answering.standard_form(), self.status)


def _split(sizes: Mapping[str, int], frames: dict[str, str], forces: Vec | None) -> Forces:
    wrenches, start = {}, 0
    for name, dim in sizes.items():
        wrenches[name] = read_only(np.full(dim, np.nan) if forces is None else forces[start : start + dim])
        start += dim
    return Forces(wrenches, frames)
