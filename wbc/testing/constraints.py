"""check_constraint: the properties of every constraint."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from wbc import checks
from wbc.arguments import tells_arguments
from wbc.models.model import RobotModel, RobotState
from wbc.stack.block import refuse_crossed
from wbc.stack.constraint import (
    Barrier,
    BarrierRows,
    ConstraintRows,
    Constraints,
    JointInterval,
    LinearConstraint,
    bounds_of,
)
from wbc.stack.formulation import InverseDynamics
from wbc.stack.interval import refuse_bounds
from wbc.stack.member import Member, bound
from wbc.stack.task import Exactly
from wbc.testing.differences import along, in_time, row_sizes, velocity_names
from wbc.testing.failure import accepted, differs, require, worst
from wbc.testing.filling import Filling
from wbc.testing.robots import Moment, moments, on_robots
from wbc.testing.tasks import check_task
from wbc.types import Vec

_DECIDED = InverseDynamics.carries
_QUANTITIES = {"position", "velocity", "acceleration", "jerk", "torque"}


@tells_arguments
def check_constraint(
    constraint: Any, model: RobotModel | None = None, states: Iterable[Moment] | None = None, *, contact_dim: int = 6
) -> None:
    """Check a constraint on ``model``, or on those of our arm, quadruped and humanoid that it can be prepared for.

    Joint intervals: (nj,), no NaN, lower <= upper, zero inside but for positions and torques. Barriers, by differences:
    J = ∂h/∂q, rate = ∂h/∂t and drift = d(J v + rate)/dt. Linear constraints: lo <= hi. All: filled twice, same bits,
    whatever was filled between, nothing left unwritten, nothing beside. Several constraints in one: each of them.
    ``contact_dim``: size of the wrench a constraint on "force" writes on.

    Raises:
        CheckFailed: which rule, which row, and the two numbers that differ.

    Example:
        >>> from wbc.tasks import JointPositionLimits
        >>> from wbc.testing import check_constraint
        >>> check_constraint(JointPositionLimits())
    """
    if isinstance(constraint, Exactly):
        check_task(constraint.task, model, states, contact_dim=contact_dim)
        return
    checks.instance("constraint", constraint, Member, "a constraint, or task.exactly()")
    given = None if states is None else checks.moments("states", states)

    def check(own: Any, robot: RobotModel) -> None:
        when = moments(robot) if given is None else given
        if isinstance(own, Barrier | LinearConstraint):
            accepted(checks.rows, own.name, own)
        if isinstance(own, Constraints):
            for one in own.constraints(frozenset(_QUANTITIES)):
                check_constraint(one, robot, when, contact_dim=contact_dim)
        elif isinstance(own, JointInterval):
            _check_interval(own, robot)
        elif isinstance(own, Barrier):
            _check_barrier(own, robot, when)
        elif isinstance(own, LinearConstraint):
            _check_linear(own, robot, when, contact_dim)
        else:
            require(
                False, f"{constraint!r} is no JointInterval, Barrier, LinearConstraint, Constraints or task.exactly()"
            )

    on_robots(constraint, model, check)


def _check_interval(constraint: JointInterval, model: RobotModel) -> None:
    name = constraint.name
    require(
        constraint.quantity in _QUANTITIES,
        f"{name}.quantity is {constraint.quantity!r}; it must be one of {_QUANTITIES}",
    )
    bounds, again = (accepted(bounds_of, constraint, model) for _ in range(2))
    require(bounds.tobytes() == again.tobytes(), f"{name}.bounds is not pure: it differs when asked twice")
    accepted(refuse_bounds, model, name, constraint.quantity, *bounds)


def _check_barrier(constraint: Barrier, model: RobotModel, when: list[Moment]) -> None:
    dim = constraint.dim
    shapes = {"J": (dim, model.nv), "h": (dim,), "drift": (dim,), "rate": (dim,)}
    other = bound(constraint, model)
    filling, forgetful, twin = (
        Filling(constraint.name, model, write, BarrierRows, shapes, zero=frozenset({"rate"}))
        for write in (constraint.fill, _forgetting(constraint), _forgetting(other))
    )
    forgetful.check_purity(twin, when)
    size = row_sizes([(rows["J"], rows["h"]) for rows in map(filling.at, when)])
    for first in when:
        rows, v = filling.at(first), first[2]
        where = f"{constraint.name} on {model.name}, row "
        J, drift, rate = rows["J"], rows["drift"], rows["rate"]
        found = np.column_stack([along(lambda m: filling.at(m)["h"], model, first, axis) for axis in np.eye(model.nv)])
        at = worst(found, J, size)
        if at is not None:
            what = f"J for {velocity_names(model)[at[1]]!r}"
            raise differs(where + str(at[0]), what=what, wrote=J[at], by="dh/dq", found=found[at])
        found = in_time(lambda m: filling.at(m)["h"], first)
        at = worst(found, rate, size)
        if at is not None:
            raise differs(where + str(at[0]), what="rate", wrote=rate[at], by="dh/dt", found=found[at])

        def total(m: Moment, v: Vec = v) -> Vec:
            filled = filling.at(m)
            return filled["J"] @ v + filled["rate"]

        found = along(total, model, first, v) + in_time(total, first)
        at = worst(found, drift, size)
        if at is not None:
            by = "d(J v + rate)/dt at a = 0"
            raise differs(where + str(at[0]), what="drift", wrote=drift[at], by=by, found=found[at])


def _forgetting(barrier: Barrier) -> Callable[[RobotState, BarrierRows], None]:
    """Its fill as after a start: which row is about what may depend on what was filled since."""

    def write(state: RobotState, out: BarrierRows) -> None:
        barrier.reset()
        barrier.fill(state, out)

    return write


def _check_linear(constraint: LinearConstraint, model: RobotModel, when: list[Moment], contact_dim: int) -> None:
    require(
        constraint.on in _DECIDED, f"{constraint.name}.on is {constraint.on!r}; it must be one of {sorted(_DECIDED)}"
    )
    size = {"torque": model.nj, "force": contact_dim}.get(constraint.on, model.nv)
    shapes = {"A": (constraint.dim, size), "lo": (constraint.dim,), "hi": (constraint.dim,)}
    filling, twin = (
        Filling(one.name, model, one.fill, ConstraintRows, shapes, may_be_infinite=frozenset({"lo", "hi"}))
        for one in (constraint, bound(constraint, model))
    )
    filling.check_purity(twin, when)
    for moment in when:
        rows = filling.at(moment)
        accepted(refuse_crossed, constraint.name, rows["lo"], rows["hi"])
