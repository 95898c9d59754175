"""What a tick decided, in words and units."""

from __future__ import annotations

from math import nan

import numpy as np

from wbc.control.distance import distances, units
from wbc.control.ladder import WEAKER
from wbc.control.solving import Solving
from wbc.errors import InvalidProblem
from wbc.qp.conflict import Conflict, conflict
from wbc.qp.problem import QP
from wbc.stack.task import Objective
from wbc.tolerances import NEAR
from wbc.types import Status, Vec

_SAID = {
    "not certified": "an answer within all constraints, its distance from the optimum unproved",
    "not optimised": "the levels that the budget reached; those below are where these leave them",
    "weighted fallback": "one weighted sum of all levels",
    "relaxed": "the constraints are relaxed as little as possible",
    "closed form": "the closed form, cut to the limits",
    "hold": "the last certified command is held",
    "damped": "the robot brakes",
}


def explain(controller: Solving) -> str:
    """Text of :meth:`Controller.explain`.

    Every task: the error it sees, the residual ‖wanted − got‖ of its rows and its share of the cost ½ Σ wᵢ rᵢ².
    Every active row: on which side it holds, and the multiplier, the cost per unit of its bound.
    """
    if controller.ticks == 0:
        return "no tick yet"
    head = f"tick {controller.ticks} at t = {controller.state.t:.3f} s: {controller.status}"
    if not controller.status.ok:
        lines = [head, *_failure(controller)]
        if controller.last is not None and controller.last.rung in WEAKER:
            lines += [*_levels(controller), *_tasks(controller)]
        return "\n".join(lines)
    lines = [f"{head} ({controller.form} form, {controller.iterations} iterations)"]
    lines += [*_levels(controller), *_tasks(controller), *_active_rows(controller), *_regularisation(controller)]
    return "\n".join(lines)


def _failure(controller: Solving) -> list[str]:
    """Why there is no answer, which rows cannot hold together, and what was commanded instead."""
    found = conflict_of(controller)
    why = controller.why or controller.status.value
    if found is None and controller.status is Status.INFEASIBLE:
        why = "no point was found, but no rows contradict each other by more than rounding; look at the scaling"
    lines = [f"  {why}"] if found is None else [f"  {found}"]
    if found is not None and controller.last is not None and controller.last.rung == "relaxed":
        lines.append(f"  {controller.why}")
    if controller.last is not None:
        lines.append(f"  instead: {_SAID.get(controller.last.rung, controller.last.rung)}, within its limits")
    return lines


def conflict_of(controller: Solving) -> Conflict | None:
    """The rows of the last tick that cannot hold together, each bound called by the constraint that set it.

    Looked for whatever the solver said of a problem that it did not solve: some stop at an iteration limit.
    """
    if controller.status.ok:
        return None
    plan, qp = controller.plan, controller.qp
    try:
        found = conflict(qp)
    except InvalidProblem:  # a row that is not a number; ``why`` names it
        return None
    if found is None:
        return None
    first = len(qp.lower)
    rows = [
        give.row if item < first else give.row._replace(owner=plan.bound_owner(item - first, upper=give.amount > 0))
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
    plan, p = controller.plan, controller.plan.problem
    layout, errors = plan.layout, plan.errors()
    rows = p.G @ p.x1
    found: list[tuple[Objective, Vec, Vec]] = []
    tasks = (*layout.linear, *layout.kinematic)
    for task, first in zip(tasks, (*layout.linear_rows, *layout.kinematic_rows), strict=True):
        residual = rows[first : first + task.dim]
        weights = p.weights[first - p.soft.start : first - p.soft.start + task.dim]
        found.append((task, residual, weights))
    joints = p.x[controller.model.nb : controller.model.nv]
    behind = layout.n_rows - layout.motion_row
    nj = controller.model.nj
    for i, joint_task in enumerate(layout.on_joints):
        wanted = plan.motion.wanted[behind + i * nj : behind + (i + 1) * nj]
        found.append((joint_task, joints - wanted, joint_task.weights()))
    for soft, column in zip(layout.soft_constraints, layout.slack_columns, strict=True):
        gives = slice(column, column + soft.dim)
        found.append((soft, p.x[gives] * p.scale[gives], soft.weights()))
    costs = [0.5 * float((weights * residual**2).sum()) for _, residual, weights in found]
    total = sum(costs) or 1.0
    suffix = "/s" if controller.level.order == 1 else "/s²"
    far = {} if controller.last is None else distances(p, controller.last.certificate.bounds)
    unit = units(p)
    lines = ["tasks:"]
    for (member, residual, _), cost in zip(found, costs, strict=True):
        error = errors.get(member.name)
        ending = "" if error is None else suffix
        seen = "" if error is None else f"error {_sizes(member, error)}, "
        share = 100.0 * cost / total
        line = f"  {member.name}: {seen}residual {_sizes(member, residual, ending)}, {share:.1f} % of the cost"
        if far.get(member.name, nan) >= 0.0:  # NaN: not proved
            bounds = [f"{far[member.name]:.1g} {one}".rstrip() for one in unit[member.name].split(", ")]
            line += f"; at most {', '.join(bounds)} from its optimum"
        lines.append(line)
    return lines


def _active_rows(controller: Solving) -> list[str]:
    solution, qp = controller.solution(), controller.qp
    pushing = np.concatenate([solution.z, solution.z_box])
    names = qp.rows[qp.n_eq :]
    value, lower, upper = _bounded(controller)
    active = np.flatnonzero(np.abs(pushing) > NEAR * max(1e-3, np.abs(pushing).max(initial=0.0)))
    if not len(active):
        return ["active rows: none"]
    lines = ["active rows:"]
    for i in active[np.argsort(-np.abs(pushing[active]))]:
        row, pushes_down = names[i], bool(pushing[i] > 0)
        # What a level above holds may pull, too: the side is where it is.
        up = pushes_down if lower[i] == upper[i] else bool(upper[i] - value[i] < value[i] - lower[i])
        if len(qp.cl) <= i < len(qp.cl) + controller.plan.problem.n:
            row = row._replace(owner=controller.plan.bound_owner(int(i) - len(qp.cl), upper=up))
        elif about := controller.plan.about(controller.plan.problem.range.start + int(i)):
            row = row._replace(label=about)
        bound = upper[i] if up else lower[i]
        lines.append(
            f"  {row} at its {'upper' if up else 'lower'} bound {bound:.4g} {row.unit}; "
            f"multiplier {abs(pushing[i]):.3g} per {row.unit or 'unit'}"
            + ("" if up == pushes_down else ", held for a level above")
        )
    return lines


def _bounded(controller: Solving) -> tuple[Vec, Vec, Vec]:
    """Values, lower and upper bounds of the range rows and unknowns of the answer, in the units of its standard form.

    The bounds are as they were set: in the standard form constant parts of rows are moved into them, and what a level
    above holds has one value there.
    """
    p, source = controller.answered, controller.plan.problem
    value = np.concatenate([p.value[p.item(p.range.start) : p.item(p.range.stop)], p.x * p.scale])
    low, high = source.range_bounds()
    lower = np.concatenate([low, source.lb * source.scale, p.lb[source.n :]])
    upper = np.concatenate([high, source.ub * source.scale, p.ub[source.n :]])
    return value, lower, upper


def _regularisation(controller: Solving) -> list[str]:
    lines = [f"regularisation: {controller.level.regularisation:g} on every unknown"]
    if controller.plan.damping.is_on:
        damping = controller.plan.damping.largest
        lines.append(f"damping of the joints, for what was left of the tasks a tick ago: up to {damping:.3g}")
    return lines


def _sizes(member: Objective, values: Vec, ending: str = "") -> str:
    """The norm of the rows of each unit, as in ``0.2 m, 1.3 rad``."""
    units = [member.unit(i) for i in range(member.dim)]
    norms = {unit: np.linalg.norm([x for x, own in zip(values, units, strict=True) if own == unit]) for unit in units}
    return ", ".join(f"{norm:.3g} {unit}{ending}".rstrip() for unit, norm in norms.items())
