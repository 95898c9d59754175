"""Plans: a plan and a solver for each set of contacts that a schedule can name.

A change of contacts changes the size of the problem, so it cannot be made inside a plan: another one is used, compiled
before it is needed. All plans of a stack share what is remembered from tick to tick (where contacts were made, the
bounds that components moved), and the working set of the former plan is the first guess of the next, row by row where
both have a row of the same name.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput, UnknownContact
from wbc.models.model import RobotState
from wbc.qp.rows import RowSolver
from wbc.qp.solver import Solver
from wbc.stack.component import Component, Schedule
from wbc.stack.contact import keys
from wbc.stack.formulation import Formulation
from wbc.stack.hierarchy import Hierarchy
from wbc.stack.plan import Plan
from wbc.stack.stack import Stack
from wbc.types import Vec, read_only


@final
class Mode:
    """One set of contacts: its plan, its solver, and where its forces stand among those of all contacts."""

    __slots__ = ("_nf", "_places", "in_one_call", "is_compiled", "plan", "second", "solver")

    def __init__(self, plan: Plan, solver: RowSolver, whole: Plan) -> None:
        self.plan, self.solver = plan, solver
        starts = {block.name: block.unknowns.start for block in whole.layout.contacts}
        columns = [starts[block.name] - whole.model.nv + np.arange(block.dim) for block in plan.layout.contacts]
        #: Of each force among the (nf,) of all contacts; None where the plan has them all.
        self._places = None if plan is whole else np.concatenate([np.zeros(0, np.intp), *columns])
        self._nf = whole.layout.nf
        #: Whether a tick with this plan is compiled code and nothing else that computes; and whether it is one call.
        self.is_compiled = plan.is_compiled and solver.is_compiled
        self.in_one_call = self.is_compiled and solver.kernel[0] != 0
        plan.answered_by(solver)
        #: The solver that is tried when ``solver`` fails, made when it is needed.
        self.second: RowSolver | None = None

    def all_forces(self, value: Vec, scale: Vec) -> Vec:
        """Forces [N, N m] of all contacts (nf,) that ``value`` means, zero where there is no contact."""
        forces: Vec = value[self.plan.layout.force_items] * scale
        if self._places is not None:
            result = np.zeros(self._nf)
            result[self._places] = forces
            forces = result
        return read_only(forces)


@final
class Plans:
    """The modes of a stack, whose plans are filled from ``state``.

    ``whole`` has all contacts; the others are compiled for the sets of the stack's schedule. Components that are
    ``prepared`` go on as they are.

    ``unplanned`` counts the sets that were needed and had not been announced.

    Raises:
        InvalidInput: two schedules in one stack.
        UnknownContact: a schedule that names a contact the stack has not.
    """

    def __init__(
        self, state: RobotState, stack: Stack, level: Formulation, *, hierarchy: Hierarchy, solver: Solver, dt: float,
        prepared: Sequence[Component] = (),
    ) -> None:  # fmt: skip
        schedules = [component for component in stack.components if isinstance(component, Schedule)]
        if len(schedules) > 1:
            raise InvalidInput(f"{schedules[0].name} and {schedules[1].name} both schedule contacts; one can")
        self.schedule = schedules[0] if schedules else None
        self._state, self._level, self._hierarchy, self._solver = state, level, hierarchy, solver
        self._named = dict(keys(stack.contacts))
        self._always = frozenset(contact.name for contact in stack.contacts if contact.bilateral)
        plan = level.compile(state.model, stack, dt=dt, hierarchy=hierarchy, prepared=prepared, state=state)
        self.whole = self.present = self._mode(plan, plan)
        self._modes = {frozenset(contact.name for contact in stack.contacts): self.whole}
        self._waiting: list[frozenset[str]] = []
        self.unplanned = 0
        sets = () if self.schedule is None else self.schedule.contact_sets()
        for names in checks.items("the contact_sets() of the schedule", sets, "sets of contacts"):
            self._compile(self._set(names))

    def _set(self, names: Iterable[str]) -> frozenset[str]:
        names = frozenset(names)
        if names in self._modes:
            return names
        for name in names:
            if name not in self._named:
                raise UnknownContact(name, self._named.values(), "the schedule names it")
        return frozenset(self._named[name] for name in names) | self._always

    def _compile(self, names: frozenset[str]) -> None:
        if names not in self._modes:
            whole = self.whole.plan
            stack = whole.stack.standing_on(names)
            plan = self._level.compile(
                whole.model, stack, dt=whole.dt, hierarchy=self._hierarchy, like=whole, state=self._state
            )
            self._modes[names] = self._mode(plan, whole)

    def _mode(self, plan: Plan, whole: Plan) -> Mode:
        return Mode(plan, plan.opened(self._hierarchy, self._solver), whole)

    def choose(self, names: Iterable[str], state: RobotState) -> Mode:
        """The mode of a set of contacts; the present one, and a note, where it is not compiled.

        Raises:
            UnknownContact: a name the stack has not.
        """
        asked = self._set(names)
        mode = self._modes.get(asked)
        if mode is None:
            if asked not in self._waiting:
                self._waiting.append(asked)
                self.unplanned += 1
            return self.present
        if mode is not self.present:
            mode.plan.take_over(self.present.plan, state)
            mode.solver.start_from(self.present.solver)
            self.present = mode
        return mode

    def go_on_from(self, former: Plans) -> None:
        """Take over what the plans of another stack remember, where this one has the same: contacts where they were
        made, damping, the active set row by row."""
        plan, other = self.present.plan, former.present.plan
        for contact, anchor in zip(plan.stack.contacts, plan.anchors, strict=True):
            for one, made in zip(other.stack.contacts, other.anchors, strict=True):
                if contact.target is None and contact.name == one.name and contact.frame == one.frame:
                    anchor.move(made)
        plan.go_on_from(other)
        self.present.solver.start_from(former.present.solver)

    def compile_waiting(self) -> int:
        """Compile the sets that were needed without a plan; how many there were."""
        waiting, self._waiting = self._waiting, []
        for names in waiting:
            self._compile(names)
        return len(waiting)

    def reset(self) -> None:
        """All contacts again, and no memory in any solver."""
        self.present = self.whole
        for mode in self._modes.values():
            mode.solver.reset()
            if mode.second is not None:
                mode.second.reset()
