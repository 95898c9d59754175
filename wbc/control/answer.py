"""What the answer of a tick says of every task and every active row, in numbers: explained in words, and recorded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import hypot, nan
from typing import NamedTuple, final

import numpy as np

from wbc.control.solving import Solving
from wbc.qp.problem import Row
from wbc.qp.rows import RowProblem, RowTask
from wbc.tolerances import NEAR, SAME
from wbc.types import Vec


@final
class Share(NamedTuple):
    """A task in the answer: by unit of its rows the norm of their residual, wanted − got, and what they cost,
    ½ Σ wᵢ rᵢ²."""

    name: str
    sizes: Mapping[str, float]
    cost: float


@final
class Active(NamedTuple):
    """A row at its ``upper`` or lower ``bound``, and its multiplier ≥ 0, the cost per unit of the bound.

    ``held``: a level above holds it there, which pulls as well as it pushes.
    """

    row: Row
    upper: bool
    bound: float
    multiplier: float
    held: bool


def shares(controller: Solving) -> list[Share]:
    """Every task of the last answer, level after level."""
    p = controller.plan.problem
    rows, found = p.G @ p.x1, []
    for task in p.tasks:
        if task.rows is not None:
            residual = rows[task.rows]
        else:
            residual = p.x[task.unknowns] * p.scale[task.unknowns] - task.wanted
        cost = 0.5 * float((task.weights * residual**2).sum())
        found.append(Share(task.name, norms(p.units_of(task), residual), cost))
    return found


def active(controller: Solving) -> list[Active]:
    """Every active row of the last answer, the dearest first; none where there is no answer."""
    if not controller.status.ok:
        return []
    _, z, z_box = controller.answering.multipliers()
    pushing = np.concatenate([z, z_box])
    largest = np.abs(pushing).max(initial=0.0)
    rows = np.flatnonzero(np.abs(pushing) > max(SAME, NEAR * largest))
    plan, p = controller.plan, controller.answering.answered
    value, lower, upper = _bounded(controller)
    found = []
    for i in rows[np.argsort(-np.abs(pushing[rows]))].tolist():
        pushes_down = bool(pushing[i] > 0)
        # What a level above holds may pull, too: the side is where it is.
        up = pushes_down if lower[i] == upper[i] else bool(upper[i] - value[i] < value[i] - lower[i])
        unknown = i - len(z)
        row = p.rows[p.range.start + i] if unknown < 0 else p.rows[p.n_rows + unknown]
        if i < plan.layout.n_range or 0 <= unknown < controller.answering.shared:
            place = i if unknown < 0 else plan.layout.n_range + unknown
            row = plan.bounded_row(place, controller.state, upper=up)
        bound = float(upper[i] if up else lower[i])
        found.append(Active(row, up, bound, abs(float(pushing[i])), up != pushes_down))
    return found


def norms(units: Sequence[str], values: Vec) -> dict[str, float]:
    """The Euclidean norm of the values (dim,) of each unit that rows have."""
    pairs = [*zip(values.tolist(), units, strict=True)]
    return {unit: hypot(*(x for x, own in pairs if own == unit)) for unit in dict.fromkeys(units)}


def units(problem: RowProblem) -> dict[str, str]:
    """The unit of each task's rows, as in ``"m/s²"``; more than one are listed."""
    return {task.name: problem.unit_of(task) for task in problem.tasks}


def distances(problem: RowProblem, bounds: Mapping[str, float]) -> dict[str, float]:
    """A bound on |Sᵢ (x̂ − x̃)| for the rows Sᵢ of each task [unit of the rows]; NaN where nothing is proved.

    A task that may be done in part, J x + drift = s t, is decided as a direction and then as a share: the bounds on
    both are added. The bound on a share is one on ‖t‖∞ s, in the task's unit.

    Args:
        problem: the rows of the plan that was solved.
        bounds: ``certificate.bounds`` of the command.

    Example:
        >>> import wbc
        >>> from wbc.tasks import Posture
        >>> from wbc.control.answer import distances
        >>> robot = wbc.load("arm")
        >>> controller = wbc.Controller(robot, wbc.Stack([Posture(robot.q0)]), level=wbc.VelocityLevel())
        >>> command = controller.tick(0.0, robot.q0, 0 * robot.q0)
        >>> distances(controller.plan.problem, command.certificate.bounds)["Posture"] < 1e-9
        True
    """
    return {task.name: _distance(task, bounds) for task in problem.tasks}


def _distance(task: RowTask, bounds: Mapping[str, float]) -> float:
    if task.name in bounds:
        return bounds[task.name]
    direction, share = f"direction of {task.name}", f"share of {task.name}"
    return bounds[direction] + bounds[share] if direction in bounds and share in bounds else nan


def _bounded(controller: Solving) -> tuple[Vec, Vec, Vec]:
    """Values, lower and upper bounds of the range rows and unknowns of the answer, in the units of its standard form.

    The bounds are as they were set: in the standard form constant parts of rows are moved into them, and what a level
    above holds has one value there.
    """
    p, source = controller.answering.answered, controller.plan.problem
    value = np.concatenate([p.value[p.item(p.range.start) : p.item(p.range.stop)], p.x * p.scale])
    (low, high), shared = source.range_bounds(), controller.answering.shared
    lower = np.concatenate([low, (source.lb * source.scale)[:shared], p.lb[shared:]])
    upper = np.concatenate([high, (source.ub * source.scale)[:shared], p.ub[shared:]])
    return value, lower, upper
