"""check_task: what holds for every task."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, cast, final

import numpy as np
from numpy.typing import NDArray

from wbc import checks
from wbc.arguments import tells_arguments
from wbc.models.model import RobotModel
from wbc.stack.member import bound
from wbc.stack.task import LinearRows, LinearTask, Objective, Task, TaskRows
from wbc.testing.differences import (
    STEP,
    along,
    in_time,
    rotation_blocks,
    row_sizes,
    turned_by_robot,
    turned_by_target,
    velocity_names,
)
from wbc.testing.failure import accepted, differs, require, worst
from wbc.testing.filling import Arrays, Filling
from wbc.testing.robots import Moment, moments, on_robots
from wbc.types import Mat, Vec

_QUANTITIES = {"torque", "acceleration", "force"}


@tells_arguments
def check_task(
    task: Objective,
    model: RobotModel | None = None,
    states: Iterable[Moment] | None = None,
    *,
    contact_dim: int = 6,
) -> None:
    """Check a task on ``model``, or on those of our arm, quadruped and humanoid that it can be prepared for.

    Of every task: sizes, units, weights; filled twice, same bits, whatever was filled between; nothing left unwritten,
    nothing written beside. Of a kinematic task, by differences: J = −∂e/∂q, drift = J̇ v, rate_ref = ∂e/∂t,
    acc_ref = its derivative, and ed = rate_ref − J v if written. Where a moving target and a moving robot do not simply
    add up (a target seen from the robot), acc_ref − drift = d(rate_ref − J v)/dt while both move. Rows in "rad" in
    threes may be rotation vectors log(R_target Rᵀ); rows whose e is always zero and whose kp is zero ask for
    velocities only.

    ``states``: moments (t, q, v), by default random ones. ``contact_dim``: size of the wrench of a task on "force".

    Raises:
        CheckFailed: which rule, which row, and the two numbers that differ.
        MemberFailed: a method of the task raised.

    Example:
        >>> from wbc.tasks import CenterOfMass
        >>> from wbc.testing import check_task
        >>> check_task(CenterOfMass(target=[0.0, 0.0, 0.5]))
    """
    checks.instance("task", task, Objective, "a task")
    given = None if states is None else checks.moments("states", states)

    def check(own: Any, robot: RobotModel) -> None:
        when = moments(robot) if given is None else given
        _check_description(own)
        if isinstance(own, Task):
            one, twin = _KinematicCheck(own, robot), _KinematicCheck(cast(Task, bound(task, robot)), robot)
            one.run(when, twin)
        elif isinstance(own, LinearTask):
            _check_linear(own, robot, when, contact_dim)
        else:
            require(False, f"{task.name} is neither a Task nor a LinearTask")

    on_robots(task, model, check)


def _check_description(task: Objective) -> None:
    accepted(checks.rows, task.name, task)
    name, dim = task.name, task.dim
    require(isinstance(name, str) and name, "a task must have a name")
    weights = task.weights()
    require(weights.shape == (dim,), f"{name}.weights() must have shape ({dim},), not {weights.shape}")
    require((weights >= 0.0).all(), f"{name}.weights() are {weights}; each must be a number >= 0")
    for row in range(dim):
        label, unit = task.label(row), task.unit(row)
        require(isinstance(label, str) and isinstance(unit, str), f"{name}: label and unit of row {row} must be text")


def _check_linear(task: LinearTask, model: RobotModel, when: list[Moment], contact_dim: int) -> None:
    require(task.on in _QUANTITIES, f"{task.name}.on is {task.on!r}; it must be one of {sorted(_QUANTITIES)}")
    size = {"torque": model.nj, "acceleration": model.nv, "force": contact_dim}[task.on]
    filling, twin = (
        Filling(one.name, model, one.fill, LinearRows, {"A": (one.dim, size), "b": (one.dim,)})
        for one in (task, bound(task, model))
    )
    filling.check_purity(twin, when)


@final
class _KinematicCheck:
    """One kinematic task on one robot."""

    def __init__(self, task: Task, model: RobotModel) -> None:
        self.task, self.model = task, model
        dim, vectors = task.dim, ("e", "drift", "rate_ref", "acc_ref", "ed")
        shapes: dict[str, tuple[int, ...]] = {array: (dim,) for array in vectors}
        zero = {"rate_ref", "acc_ref"}
        if task.on_joints:
            require(dim == model.nj, f"{task.name} is on_joints, so dim must be {model.nj} on {model.name}, not {dim}")
            zero.add("drift")
        else:
            shapes["J"] = (dim, model.nv)
        self.filling = Filling(
            task.name, model, task.fill, TaskRows, shapes, zero=frozenset(zero), optional=frozenset({"ed"})
        )
        units = [task.unit(row) for row in range(dim)]
        self.blocks = [] if task.on_joints else rotation_blocks(units)

    def run(self, when: list[Moment], twin: _KinematicCheck) -> None:
        """All checks at all moments; ``twin`` checks a copy of the task."""
        for gains in self.task.gains():
            require(gains.shape == (self.task.dim,), f"{self.task.name}.gains() must be of ({self.task.dim},) each")
        self.filling.check_purity(twin.filling, when)
        filled = [self.filling.at(moment) for moment in when]
        self.size = row_sizes([(self._jacobian(rows), rows["e"]) for rows in filled])
        has_error = np.any([rows["e"] != 0.0 for rows in filled], axis=0) | (self.task.gains()[0] > 0.0)
        for moment, rows in zip(when, filled, strict=True):
            self._check_jacobian(moment, rows, has_error)
            self._check_drift(moment, rows)
            self._check_reference(moment, rows, has_error)
            self._check_error_rate(moment, rows)

    def _e(self, moment: Moment) -> Vec:
        return self.filling.at(moment)["e"]

    def _jacobian(self, rows: Arrays) -> Mat:
        return np.eye(self.model.nv)[self.model.nb :] if self.task.on_joints else rows["J"]

    def _check_jacobian(self, moment: Moment, rows: Arrays, has_error: NDArray[np.bool_]) -> None:
        def derivative(read: Callable[[Moment], Vec]) -> Mat:
            return np.column_stack([along(read, self.model, moment, axis) for axis in np.eye(self.model.nv)])

        J = self._jacobian(rows)
        found = self._or_as_rotation(-derivative(self._e), J, lambda turned: -derivative(turned), rows, turned_by_robot)
        at = worst(found[has_error], J[has_error], self.size[has_error])
        if at is not None:
            row = int(np.flatnonzero(has_error)[at[0]])
            column = velocity_names(self.model)[at[1]]
            what, wrote = f"J for {column!r}", J[row, at[1]]
            raise differs(self._row(row), what=what, wrote=wrote, by="-de/dq", found=found[row, at[1]])

    def _check_drift(self, moment: Moment, rows: Arrays) -> None:
        v = moment[2]
        found = along(lambda m: self._jacobian(self.filling.at(m)) @ v, self.model, moment, v)
        at = worst(found, rows["drift"], self.size)
        if at is not None and worst(self._error_drift(moment), rows["acc_ref"] - rows["drift"], self.size) is not None:
            wrote, by = rows["drift"][at], "d(J v)/dt at a = 0"
            raise differs(self._row(at[0]), what="drift", wrote=wrote, by=by, found=found[at])

    def _error_drift(self, moment: Moment) -> Vec:
        """d(rate_ref − J v)/dt at a = 0 while robot and target both move: where what they do does not simply add up,
        a task has the difference in its drift."""
        t, q, v = moment

        def rate(s: float) -> Vec:
            rows = self.filling.at((t + s, self.model.integrate(q, s * v), v))
            return rows["rate_ref"] - self._jacobian(rows) @ v

        return (rate(STEP) - rate(-STEP)) / (2.0 * STEP)

    def _check_reference(self, moment: Moment, rows: Arrays, has_error: NDArray[np.bool_]) -> None:
        rate, second = rows["rate_ref"], rows["acc_ref"]
        found = self._or_as_rotation(
            in_time(self._e, moment), rate, lambda turned: in_time(turned, moment), rows, turned_by_target
        )
        at = worst(found[has_error], rate[has_error], self.size[has_error])
        if at is not None:
            row = int(np.flatnonzero(has_error)[at[0]])
            hint = "; a target that moves must give (value, rate, acceleration)" if rate[row] == 0.0 else ""
            wrote, by = rate[row], "de/dt of the target"
            raise differs(self._row(row), what="rate_ref", wrote=wrote, by=by, found=found[row], hint=hint)
        found = in_time(lambda m: self.filling.at(m)["rate_ref"], moment)
        at = worst(found, second, self.size)
        if at is not None:
            raise differs(self._row(at[0]), what="acc_ref", wrote=second[at], by="d rate_ref/dt", found=found[at])

    def _check_error_rate(self, moment: Moment, rows: Arrays) -> None:
        ed = rows["ed"]
        if np.isnan(ed).all():
            return
        require(not np.isnan(ed).any(), f"{self.task.name}.fill wrote only a part of out.ed; write all of it or none")
        expected = rows["rate_ref"] - self._jacobian(rows) @ moment[2]
        at = worst(ed, expected, self.size)
        if at is not None:
            raise differs(self._row(at[0]), what="ed", wrote=ed[at], by="rate_ref - J v", found=expected[at])

    def _or_as_rotation(
        self,
        plain: Mat,
        claimed: Mat,
        derivative: Callable[[Callable[[Moment], Vec]], Mat],
        rows: Arrays,
        turned: Callable[[Vec, Vec], Vec],
    ) -> Mat:
        """``plain`` differences of e, but those of the rotation it stands for where that is what the task claims."""
        for block in self.blocks:
            if worst(plain[block], claimed[block], self.size[block]) is None:
                continue
            start = rows["e"][block]
            plain[block] = derivative(lambda m, s=start, b=block: turned(s, self._e(m)[b]))  # type: ignore[misc]
        return plain

    def _row(self, row: int) -> str:
        label = self.task.label(row)
        return f"{self.task.name} on {self.model.name}, row {row}" + (f" ({label})" if label else "")
