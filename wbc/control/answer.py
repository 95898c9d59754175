"""What the answer of a tick says of every task and every active row, in numbers: explained in words, and recorded."""

from __future__ import annotations

from typing import NamedTuple, final

import numpy as np

from wbc.control.solving import Solving
from wbc.qp.problem import Row
from wbc.stack.task import Objective
from wbc.tolerances import NEAR
from wbc.types import Vec


@final
class Share(NamedTuple):
    """A task in the answer: the residual of its rows, wanted − got, and what they cost, ½ Σ wᵢ rᵢ²."""

    task: Objective
    residual: Vec
    cost: float

    @property
    def sizes(self) -> dict[str, float]:
        """The norm of the residual of the rows of each unit of the task's error."""
        return norms(self.task, self.residual)


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
    """Every task of the last answer, in the order of the plan."""
    plan, p = controller.plan, controller.plan.problem
    layout = plan.layout
    rows = p.G @ p.x1
    found: list[tuple[Objective, Vec, Vec]] = []
    tasks = (*layout.linear, *layout.kinematic)
    for task, first in zip(tasks, (*layout.linear_rows, *layout.kinematic_rows), strict=True):
        weights = p.weights[first - p.soft.start : first - p.soft.start + task.dim]
        found.append((task, rows[first : first + task.dim], weights))
    joints = p.x[controller.model.nb : controller.model.nv]
    behind, nj = layout.n_rows - layout.motion_row, controller.model.nj
    for i, joint_task in enumerate(layout.on_joints):
        wanted = plan.motion.wanted[behind + i * nj : behind + (i + 1) * nj]
        found.append((joint_task, joints - wanted, joint_task.weights()))
    for soft, column in zip(layout.soft_constraints, layout.slack_columns, strict=True):
        gives = slice(column, column + soft.dim)
        found.append((soft, p.x[gives] * p.scale[gives], soft.weights()))
    return [Share(task, residual, 0.5 * float((w * residual**2).sum())) for task, residual, w in found]


def active(controller: Solving) -> list[Active]:
    """Every active row of the last answer, the dearest first; none where there is no answer."""
    if not controller.status.ok:
        return []
    _, z, z_box = controller.multipliers()
    pushing = np.concatenate([z, z_box])
    largest = np.abs(pushing).max(initial=0.0)
    rows = np.flatnonzero(np.abs(pushing) > NEAR * max(1e-3, largest))
    if not len(rows):
        return []
    p, value, lower, upper = controller.answered, *_bounded(controller)
    found = []
    for i in rows[np.argsort(-np.abs(pushing[rows]))].tolist():
        pushes_down = bool(pushing[i] > 0)
        # What a level above holds may pull, too: the side is where it is.
        up = pushes_down if lower[i] == upper[i] else bool(upper[i] - value[i] < value[i] - lower[i])
        unknown = i - len(z)
        row = p.rows[p.range.start + i] if unknown < 0 else p.rows[p.n_rows + unknown]
        if 0 <= unknown < controller.plan.problem.n:
            row = row._replace(owner=controller.plan.bound_owner(unknown, upper=up))
        elif about := controller.plan.about(controller.plan.problem.range.start + i):
            row = row._replace(label=about)
        bound = float(upper[i] if up else lower[i])
        found.append(Active(row, up, bound, abs(float(pushing[i])), up != pushes_down))
    return found


def norms(member: Objective, values: Vec) -> dict[str, float]:
    """The Euclidean norm of the values (dim,) of each unit that the rows of a task have."""
    units = [member.unit(i) for i in range(member.dim)]
    return {
        unit: float(np.linalg.norm([x for x, own in zip(values, units, strict=True) if own == unit])) for unit in units
    }


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
