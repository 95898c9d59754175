"""What a tick decided, in words and units."""

from __future__ import annotations

from collections.abc import Mapping
from math import nan

import numpy as np

from wbc.control.answer import active, distances, norms, shares, units
from wbc.control.recovery import WEAKER
from wbc.control.solving import Solving
from wbc.errors import InvalidProblem
from wbc.qp.conflict import Conflict, conflict
from wbc.qp.lexicographic.parts import GIVEN_UP
from wbc.qp.problem import QP
from wbc.tolerances import MET
from wbc.types import Status

_SAID = {
    "not certified": "an answer within all constraints, its distance from the optimum unproved",
    "not optimised": "the levels that the budget reached; those below are where these leave them",
    "weighted fallback": "one weighted sum of all levels",
    "relaxed": "the constraints are relaxed as little as possible; torques, friction and dynamics hold",
    "closed form": "the closed form, cut to the limits",
    "hold": "the last certified command is held, cut to the limits",
    "damped": "the robot brakes",
}


def explain(controller: Solving) -> str:
    """Text of :meth:`Controller.explain`.

    Every task: the error it sees, the residual ‖wanted − got‖ of its rows and its share of the cost ½ Σ wᵢ rᵢ².
    Every active row: on which side it holds, and the multiplier, the cost per unit of its bound.
    """
    head = f"tick {controller.ticks} at t = {controller.state.t:.3f} s: {controller.status}"
    if not controller.status.ok:
        lines = [head, *_failure(controller)]
        if controller.last is not None and controller.last.fallback_level in WEAKER:
            lines += [*_levels(controller), *_tasks(controller)]
        return "\n".join(lines)
    lines = [f"{head} in {controller.iterations} iteration{'s' * (controller.iterations != 1)}"]
    lines += [*_levels(controller), *_tasks(controller), *_active_rows(controller), *_regularisation(controller)]
    return "\n".join(lines)


def _failure(controller: Solving) -> list[str]:
    """Why there is no answer, which rows cannot hold together, and what was commanded instead."""
    found = conflict_of(controller)
    why = controller.why
    if found is None and controller.status is Status.INFEASIBLE:
        why = "no point was found, but no rows contradict each other by more than rounding; look at the scaling"
    lines = [f"  {why}"] if found is None else _conflict(found)
    if found is not None and why != controller.status.value:  # what was relaxed, or why nothing was
        lines.append(f"  {why}")
    if controller.last is not None:
        level = controller.last.fallback_level
        lines.append(f"  instead: {_SAID.get(level, level)}")
    return lines


def _conflict(found: Conflict) -> list[str]:
    """A heading, and one line for each change that resolves the conflict."""
    if len(found.gives) == 1:
        return [f"  {found}"]
    heading = f"  {len(found.gives)} rows cannot hold together; one of these changes is enough:"
    return [heading, *(f"    {give}" for give in found.gives)]


def conflict_of(controller: Solving) -> Conflict | None:
    """The rows of the last tick that cannot hold together, each bound called by the constraint that set it.

    Looked for whatever the solver said of a problem that it did not solve: some stop at an iteration limit.
    """
    if controller.status.ok or not controller.has_problem:
        return None
    plan, qp = controller.plan, controller.qp
    try:
        found = conflict(qp)
    except InvalidProblem:  # a row that is not a number; ``why`` names it
        return None
    if found is None:
        return None
    rows = [
        plan.bounded_row(item - qp.n_eq, controller.state, upper=give.amount > 0) if item >= qp.n_eq else give.row
        for item, give in zip(found.items, found.gives, strict=True)
    ]
    return found.renamed(rows)


def reproducer(controller: Solving) -> QP:
    """The last tick's QP, the rows in conflict called as :func:`conflict_of` calls them."""
    qp, found = controller.qp, conflict_of(controller)
    if found is None:
        return qp
    names = list(qp.rows)
    for item, row in zip(found.items, found.rows, strict=True):
        names[item] = row
    return QP(qp.H, qp.g, A=qp.A, b=qp.b, C=qp.C, cl=qp.cl, cu=qp.cu, lb=qp.lb, ub=qp.ub, rows=names)


def _levels(controller: Solving) -> list[str]:
    """What ranks above what, and how each came out."""
    ranked = [f"  {i}. {outcome}" for i, outcome in enumerate(controller.levels, start=1)]
    return ["levels:", *ranked] if ranked else []


def _tasks(controller: Solving) -> list[str]:
    errors, p = controller.plan.errors(), controller.plan.problem
    found = shares(controller)
    total = sum(share.cost for share in found) or 1.0
    far = {} if controller.last is None else distances(p, controller.last.certificate.bounds)
    unit = units(p)
    members = {task.name: task for task in controller.plan.stack.tasks}
    lines = ["tasks:"]
    for name, sizes, cost in found:
        seen = ""
        if name in errors:
            error = norms([members[name].unit(i) for i in range(len(errors[name]))], errors[name])
            seen = f"error {_said(error)}, "
        line = f"  {name}: {seen}residual {_said(sizes)}, {100.0 * cost / total:.1f} % of the cost"
        if far.get(name, nan) >= 0.0:  # NaN: not proved
            bounds = [f"{far[name]:.1g} {one}".rstrip() for one in unit[name].split(", ")]
            line += f"; at most {', '.join(bounds)} from its optimum"
        lines.append(line)
    return lines


def _active_rows(controller: Solving) -> list[str]:
    tasks = controller.plan.problem.tasks
    asked = {task.name: float(np.abs(task.wanted + task.drift).max(initial=MET)) for task in tasks}
    lines = []
    for row, upper, bound, multiplier, held in active(controller):
        if row.label == GIVEN_UP and row.owner in asked:
            largest = asked[row.owner]
            line = f"  {row.owner}: {100.0 * bound / largest:.3g} % of what its gains ask for is given up; "
            line += f"multiplier {multiplier * largest:.3g} per 100 %"
        else:
            line = f"  {row} at its {'upper' if upper else 'lower'} bound {f'{bound:.4g} {row.unit}'.rstrip()}; "
            line += f"multiplier {multiplier:.3g} per {row.unit or 'unit'}"
        lines.append(line + (", held for a level above" if held else ""))
    return ["active rows:", *lines] if lines else ["active rows: none"]


def _regularisation(controller: Solving) -> list[str]:
    lines = [f"regularisation: {controller.level.regularisation:g} on every unknown"]
    if controller.plan.damping.is_on:
        damping = controller.plan.damping.largest
        lines.append(f"damping of the joints, because tasks were not met a tick ago: up to {damping:.3g}")
    return lines


def _said(sizes: Mapping[str, float]) -> str:
    """Norms by unit, as in ``0.2 m, 1.3 rad``."""
    return ", ".join(f"{norm:.3g} {unit}".rstrip() for unit, norm in sizes.items())
