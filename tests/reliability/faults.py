"""A solver that misbehaves when it is told to, and stacks to try it on."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any, ClassVar, final

import numpy as np

import tasks as T
import wbc
from tests.stack.conftest import feet
from wbc.models.model import RobotModel
from wbc.qp.problem import QP, Shape
from wbc.qp.solver import Answer, Session, Solver
from wbc.qp.solvers.daqp_ import Daqp
from wbc.types import Status

#: What can go wrong in a back end.
FAULTS = ("infeasible", "iterations", "nan", "inf", "wrong", "zero", "short", "unproved", "raises", "late")
SLOW = 0.003  # seconds


class Breakdown(Exception):
    """What a back end throws."""


@final
@dataclass
class Script:
    """The fault of the next solve; "" for none."""

    fault: str = ""


@final
@dataclass(frozen=True)
class Saboteur(Solver):
    """DAQP, but for the faults in its script."""

    name: ClassVar[str] = "saboteur"
    script: Script = field(default_factory=Script, compare=False)

    def open(self, shape: Shape) -> Session:
        return _Sabotaged(self, shape)


class _Sabotaged(Session):
    def __init__(self, solver: Saboteur, shape: Shape) -> None:
        super().__init__(solver, shape)
        self._script, self._inner = solver.script, Daqp().open(shape)

    def _solve(self, qp: QP) -> Answer:
        fault = self._script.fault
        if fault == "raises":
            raise Breakdown("the back end broke down")
        if fault in ("infeasible", "iterations"):
            return Answer.none(qp.shape, Status.INFEASIBLE if fault == "infeasible" else Status.MAX_ITERATIONS)
        if fault == "late":
            time.sleep(SLOW)
        answer = self._inner._solve(qp)
        lies = {"nan": np.nan, "inf": np.inf, "wrong": 1e3, "zero": 0.0}
        if fault in lies:
            answer = Answer(Status.SOLVED, np.full(qp.n, lies[fault]), answer.y, answer.z, answer.z_box)
        if fault == "short":
            answer = Answer(Status.SOLVED, answer.x[:-1], answer.y, answer.z, answer.z_box)
        if fault == "unproved":
            another = qp.copy()
            another.g[:] = 0.0  # within all constraints, and the best of another cost
            answer = self._inner._solve(another)
        return answer


A_MAX, V_MAX = 20.0, 2.0


def limited(robot: RobotModel, level: Any, *, extra: tuple[Any, ...] = ()) -> wbc.Stack:
    """A stack with limits on everything, and a target that can be moved."""
    limits: list[Any] = [T.JointPositionLimits(), T.JointVelocityLimits(V_MAX), T.JointAccelerationLimits(A_MAX)]
    if level.dynamics:
        limits.append(T.TorqueLimits())
    if robot.nb:
        tasks: list[Any] = [T.CenterOfMass(target=robot.state().com.copy(), kp=50.0), T.Posture(robot.q0, kp=20.0)]
        contacts = feet(robot) if level.dynamics else []  # type: ignore[arg-type]
    else:
        tasks, contacts = [T.Position("tool", target=[0.4, 0.2, 0.5], kp=50.0), T.Posture(robot.q0, weight=1e-2)], []
    return wbc.Stack(tasks, contacts=contacts, subject_to=[*limits, *extra])


def sabotaged(robot: RobotModel, level: Any, *, other: bool = True, **settings: Any) -> tuple[wbc.Controller, Script]:
    """A controller on a saboteur; with ``other`` False the solver that would be asked next has the same faults."""
    saboteur = Saboteur()
    stack = settings.pop("stack", None) or limited(robot, level)
    control = wbc.Controller(robot, stack, level=level, solver=saboteur, **settings)
    if not other:
        control.mode.second = wbc.Weighted().open(control.plan.problem, saboteur)
    return control, saboteur.script


def excess(control: wbc.Controller, command: wbc.Command) -> float:
    """By how much a command exceeds what the limits leave in its tick, in their units; inf where it is not a number."""
    plan, model = control.plan, control.model
    decided = command.v if control.level.order == 1 else command.a
    values = [decided[model.nb :]]
    without = command.fallback_level in (
        "hold",
        "damped",
    )  # then the problem may be of another state than the one believed
    believed = plan.joint_bounds(control.state) if without else None
    bounds = [believed or (plan.problem.lb[model.nb : model.nv], plan.problem.ub[model.nb : model.nv])]
    if control.level.dynamics:
        values.append(command.tau)
        bounds.append(plan.torque_bounds)
    worst = 0.0
    for value, (low, high) in zip(values, bounds, strict=True):
        if not np.isfinite(value).all():
            return float("inf")
        worst = max(worst, float(np.maximum(value - high, low - value).max()))
    return worst if np.isfinite(decided).all() and np.isfinite(command.q).all() else float("inf")
