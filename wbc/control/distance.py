"""How far each task can be from its optimum, in the task's unit: what a certificate says, task by task."""

from __future__ import annotations

from collections.abc import Mapping
from math import nan, sqrt

from wbc.qp.rows import RowProblem, RowTask


def distances(problem: RowProblem, bounds: Mapping[str, float]) -> dict[str, float]:
    """A bound on |Sᵢ (x̂ − x̃)| for the rows Sᵢ of each task [unit of the rows]; NaN where nothing is proved.

    A task that may be done in part, J x + drift = s t, is decided as a direction and then as a share: the bounds on
    both are added. The bound on a share is one on √(Σ wᵢ tᵢ²) s, so that over √wᵢ it is in the unit of tᵢ.

    Args:
        problem: the rows of the plan that was solved.
        bounds: ``certificate.bounds`` of the command.

    Example:
        >>> import wbc
        >>> from tasks import Posture
        >>> from wbc.control.distance import distances
        >>> robot = wbc.load("arm")
        >>> controller = wbc.Controller(robot, wbc.Stack([Posture(robot.q0)]), level=wbc.VelocityLevel())
        >>> command = controller.tick(0.0, robot.q0, 0 * robot.q0)
        >>> distances(controller.plan.problem, command.certificate.bounds)["Posture"] < 1e-9
        True
    """
    return {task.name: _distance(task, bounds) for level in problem.levels for task in level}


def units(problem: RowProblem) -> dict[str, str]:
    """The unit of each task's rows, as in ``"m/s²"``; more than one are listed."""
    found = {}
    for task in (task for level in problem.levels for task in level):
        at = task.rows or task.unknowns
        assert at is not None
        first = at.start if task.rows else problem.n_rows + at.start
        found[task.name] = ", ".join(dict.fromkeys(row.unit for row in problem.rows[first : first + task.dim]))
    return found


def _distance(task: RowTask, bounds: Mapping[str, float]) -> float:
    if task.name in bounds:
        return bounds[task.name]
    direction, share = f"direction of {task.name}", f"share of {task.name}"
    if direction not in bounds or share not in bounds:
        return nan
    lightest = min((float(weight) for weight in task.weights if weight > 0.0), default=nan)
    return bounds[direction] + bounds[share] / sqrt(lightest)
