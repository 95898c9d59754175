"""reach: one-shot inverse kinematics, from as many starts as it takes, or the reason why there is no answer."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np

from wbc import checks
from wbc.arguments import tells_arguments
from wbc.control.controller import Controller
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel
from wbc.stack.block import says_of
from wbc.stack.constraint import Barrier, Constraints, JointInterval, Quantity, bounds_of
from wbc.stack.formulation import VelocityLevel
from wbc.stack.hierarchy import Strict, Weighted
from wbc.stack.member import bound
from wbc.stack.stack import Stack
from wbc.stack.task import Objective, Task
from wbc.tolerances import MET
from wbc.types import Index, Status, Vec

#: A step is a tick of this length [s] in which tasks have to remove all of their error.
_DT = 1e-2
#: What a joint moves in a step at most [rad, m]: beyond it a linearised task says little. A slide without limits, as of
#: a planar base, carries the robot as it is; one with limits goes a share of its range at most, where that is more.
_STEP, _OF_RANGE = 0.5, 0.25
#: Steps shorter than this [rad, m] lead nowhere any more, nor do that many steps after the best one.
_SHORT = 1e-5
_PATIENCE = 10


@final
@dataclass(frozen=True, eq=False)
class Reached:
    """What :func:`reach` found. ``ok``: all tasks of the first level are met, within all constraints.

    ``q`` (nq,) is the best configuration found; where tasks cannot be met, the one within all constraints with the
    least Σ w e² of the errors of the first level. ``errors`` has the error of each task there (dim,) in the task's
    units, and ``reason`` says why it is not ok, or "". ``attempts`` starts were tried, with ``steps`` steps in all.
    """

    q: Vec
    ok: bool
    errors: Mapping[str, Vec]
    reason: str
    attempts: int
    steps: int

    def __repr__(self) -> str:
        found = "reached" if self.ok else self.reason
        return f"Reached({found}; {self.attempts} attempts, {self.steps} steps)"


@final
class _Limits(JointInterval):
    """Bounds on joints' positions, or on what they move in a step."""

    def __init__(self, name: str, quantity: Quantity, lower: Vec, upper: Vec) -> None:
        super().__init__(name=name)
        self.quantity, self._bounds = quantity, (lower, upper)  # type: ignore[misc]

    def bounds(self, model: RobotModel) -> tuple[Vec, Vec]:
        return self._bounds[0].copy(), self._bounds[1].copy()


@tells_arguments
def reach(
    robot: RobotModel, tasks: Sequence[Objective] | Sequence[Sequence[Objective]], *,
    subject_to: Iterable[Any] | None = None, start: Any = None, attempts: int = 30, seed: int = 0,
    steps: int = 100, tolerance: float = 1e-5,
) -> Reached:  # fmt: skip
    """Find a configuration that meets the tasks of the first level; lower levels choose among such configurations.

    Gauss-Newton steps, min ½ Σ w ‖J δ − e‖² under the constraints, each joint moved by 0.5 rad at most, a slide by 0.5
    m or a quarter of its range, until the errors are within ``tolerance``. Where the steps end elsewhere, it starts
    again from joint positions drawn within the limits. Gains and rates of tasks and constraints do not matter, nor do
    limits on velocities, accelerations and jerks, which a configuration has not. Rows of weight 0 ask for nothing.
    Targets should not move.

    Args:
        robot: from :func:`wbc.load`.
        tasks: a list of tasks that must all be met, or levels of them, of which the first must.
        subject_to: constraints beside the tasks; default: the position limits of the joints. [] for none.
        start: first configuration (nq,); default ``robot.q0``. The base starts there in every attempt.
        attempts: starts at most.
        seed: of the draws.
        steps: of each attempt, at most.
        tolerance: largest error of a task, also of one that is a constraint (``exactly``) [its unit].

    Raises:
        InvalidInput: an argument that makes no sense; a first level without a task, or with one that has no error, such
            as a regularisation or a velocity (kp = 0).
        NotSupported: a member that velocities cannot carry, such as limits on torques.

    Example:
        >>> import wbc
        >>> from wbc.tasks import Position, Posture
        >>> robot = wbc.load("arm")
        >>> found = wbc.reach(robot, [[Position("tool", target=[0.4, 0.2, 0.5])], [Posture(robot.q0)]])
        >>> found.ok, float(abs(found.errors["Position[tool]"]).max()) < 1e-5
        (True, True)
        >>> wbc.reach(robot, [Position("tool", target=[4.0, 0.0, 0.5])], attempts=3).reason.partition(" m ")[0]
        'Position[tool] stays 3.02'
    """
    attempts = int(checks.number("attempts", attempts, low=1))
    steps = int(checks.number("steps", steps, low=1))
    tolerance = checks.number("tolerance", tolerance, low=0.0, strict=True)
    levels = Stack(tasks).levels
    robot = checks.instance("robot", robot, RobotModel, "a robot from wbc.load(...)")
    if not levels or not levels[0]:
        raise InvalidInput("tasks has no task in its first level; there must be one to be met")
    for task in levels[0]:
        if not isinstance(task, Task) or not bound(task, robot).gains()[0].any():
            about = f"{task.name} has kp = 0, so it" if isinstance(task, Task) else task.name
            raise InvalidInput(f"{about} has no error that could be met; put it in a lower level")
    seed = checks.seed("seed", seed)
    limits: list[Any] = [_Limits("position limits", "position", robot.limits.q_min, robot.limits.q_max)]
    if subject_to is not None:
        limits = checks.items("subject_to", subject_to, "limits and constraints")
        limits = [one for limit in limits for one in _of_a_configuration(limit, robot)]
    search = _Search(robot, levels, limits, tolerance, damped=len(levels) > 1)
    first = search.checked(robot.q0 if start is None else start)
    rng = np.random.default_rng(seed)
    best, used = None, 0
    for attempt in range(attempts):
        q = first.copy()
        if attempt:
            q[robot.nq - robot.nj :] = robot.random_configuration(rng)[robot.nq - robot.nj :]
        found = search.descend(q, steps)
        used += found.steps
        best = found if best is None else min(best, found)
        if best.missed <= 1.0:
            break
    assert best is not None, "there is an attempt"
    if best.missed > 1.0 and len(levels) == 1:  # the point nearest by, where steps without damping do not come to rest
        found = _Search(robot, levels, limits, tolerance, damped=True).descend(best.q, steps)
        used += found.steps
        best = min(best, found)
    reason = "" if best.missed <= 1.0 else best.says
    if reason:
        free = [limit.name for limit in limits if search.without(limit).descend(best.q, steps).missed <= 1.0]
        reason += f"; it can be met without {' or without '.join(free)}" if free else ""
    return Reached(best.q, not reason, best.errors, reason, attempt + 1, used)


def _of_a_configuration(limit: Any, robot: RobotModel) -> list[Any]:
    """What a constraint asks of a configuration, all of it in one step."""
    if isinstance(limit, Constraints):
        parts = limit.constraints(VelocityLevel().bounds)
        return [one for part in parts for one in _of_a_configuration(part, robot)]
    if isinstance(limit, JointInterval) and limit.quantity == "position":
        return [_Limits(limit.name, "position", *bounds_of(bound(limit, robot), robot))]
    if isinstance(limit, JointInterval) and limit.quantity != "torque":
        return []
    if getattr(says_of(limit), "on", "") == "velocity":
        return []
    return [_quick(limit)]


def _quick(member: Any) -> Any:
    """The task or constraint that asks for all of its error in one step."""
    member = copy(member)
    if isinstance(member, Task | Barrier):
        member.rate = 1.0 / _DT
    if isinstance(task := getattr(member, "__dict__", {}).get("task"), Task):  # what it is made of
        member.__dict__["task"] = _quick(task)
    return member


@final
@dataclass(frozen=True, eq=False)
class _Found:
    """Where steps ended: what is missed, in tolerances, and in words; what of it are constraints; Σ w e² of tasks."""

    q: Vec
    errors: Mapping[str, Vec]
    missed: float
    says: str
    broken: float = np.inf
    cost: float = np.inf
    steps: int = 0

    def __lt__(self, other: _Found) -> bool:
        """Whether this is better: first what is met, then what breaks constraints less, then what costs less."""
        one, two = ((f.missed > 1.0, max(f.broken, 1.0), f.cost) for f in (self, other))
        return one < two


@final
class _Search:
    """Steps from one start after the other, with one controller.

    Steps that are ``damped`` come to rest where tasks cannot be met, as levels need it; without they are fewer.
    """

    def __init__(
        self, robot: RobotModel, levels: Sequence[Sequence[Objective]], limits: Sequence[Any], tolerance: float, *,
        damped: bool,
    ) -> None:  # fmt: skip
        self._robot, self._levels, self._limits, self._tolerance = robot, levels, limits, tolerance
        self._damped, level = damped, VelocityLevel() if damped else VelocityLevel(lm_damping=0.0)
        quick = [[_quick(task) for task in level] for level in levels]
        ranges = robot.limits.q_max - robot.limits.q_min
        slides = np.array([unit == "m" for unit in robot.joint_units])
        most = np.where(slides, np.fmax(_STEP, _OF_RANGE * ranges), _STEP) / _DT
        steps = _Limits("length of a step", "velocity", -most, most)
        self._controller = Controller(
            robot, Stack(quick, subject_to=[*limits, steps]), level=level,
            hierarchy=Strict() if len(levels) > 1 else Weighted(), dt=_DT,
        )  # fmt: skip
        layout = self._controller.plan.layout
        first = [task for task in self._controller.plan.stack.levels[0] if isinstance(task, Task)]
        #: Names, tasks and rows of what must be met; weights (dim,) of what is no constraint.
        self._must: list[tuple[str, Any, Index, Vec | None]] = [
            (task.name, task, np.flatnonzero(task.weights()), task.weights()) for task in first
        ]
        self._must += [(block.name, block.says, np.arange(block.dim), None) for block in layout.exact]

    def checked(self, start: Any) -> Vec:
        """A copy (nq,) of a configuration to start from.

        Raises:
            InvalidInput: it is none.
        """
        q = checks.array("start", start, (self._robot.nq,))
        measured = self._controller.measured
        if why := measured.take(0.0, q, np.zeros(self._robot.nv)):
            raise InvalidInput(f"start: {why}")
        return measured.q.copy()

    def without(self, limit: Any) -> _Search:
        """The same search without one of the limits."""
        limits = [one for one in self._limits if one is not limit]
        return _Search(self._robot, self._levels, limits, self._tolerance, damped=self._damped)

    def descend(self, q: Vec, steps: int) -> _Found:
        """Steps from q (nq,) until the tasks are met, or a step leads nowhere; of all, what misses least."""
        controller, still = self._controller, np.zeros(self._robot.nv)
        controller.reset()
        best: _Found | None = None
        last = 0
        for k in range(steps + 1):
            command = controller.tick(_DT * k, q, still)
            if command.status is Status.FAILED:  # a member cannot be evaluated here
                found = _Found(q, controller.plan.errors(), np.inf, controller.why)
            else:
                found = self._judged(q)
            if best is None or found.missed <= 1.0 or found < best:
                best, last = found, k
            met = found.missed <= 1.0 and len(self._levels) == 1
            lost = not self._damped and k - last >= _PATIENCE
            if met or lost or float(np.abs(command.v).max(initial=0.0)) * _DT < _SHORT:
                break
            q = command.q
        assert best is not None, "there is a step"
        return replace(best, steps=k)

    def _judged(self, q: Vec) -> _Found:
        """What the configuration filled last misses."""
        plan, positions = self._controller.plan, q[self._robot.nq - self._robot.nj :]
        errors = plan.errors()
        missed, says, broken, cost = 0.0, "", 0.0, 0.0
        for name, task, rows, weights in self._must:
            off = np.abs(errors[name][rows])
            worst = float(off.max(initial=0.0)) / self._tolerance
            if worst > missed:
                i, missed = int(off.argmax()), worst
                says = f"{name} stays {off[i]:.3g} {task.unit(rows[i])} off in {task.label(rows[i])}"
            if weights is None:
                broken = max(broken, worst)
            else:
                cost += float(weights[rows] @ off**2)
        rooms = {name: margins for name, (_, margins) in plan.margins().items()}
        for name, room in (rooms | {"": plan.intervals.nearest(positions)}).items():
            short = -float(room.min(initial=0.0))
            broken = max(broken, short / MET)
            if short / MET > max(missed, 1.0):
                missed = short / MET
                says = f"{name} is missed by {short:.3g}" if name else plan.intervals.recovery(positions)
        return _Found(q, errors, missed, says, broken, cost)
