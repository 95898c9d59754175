"""check_constraint: the properties of every constraint."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from wbc import checks
from wbc.arguments import tells_arguments
from wbc.models.model import RobotModel
from wbc.stack.constraint import (
    Barrier,
    BarrierRows,
    ConstraintRows,
    Constraints,
    JointInterval,
    LinearConstraint,
)
from wbc.stack.formulation import InverseDynamics
from wbc.stack.member import Member
from wbc.stack.task import Exactly
from wbc.testing.differences import along, in_time, row_sizes, velocity_names
from wbc.testing.failure import differs, require, worst
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

    Joint intervals: (nj,), no NaN, lower <= upper, zero inside but for positions. Barriers, by differences: J = ∂h/∂q,
    rate = ∂h/∂t and drift = d(J v + rate)/dt. Linear constraints: lo <= hi. All: filled twice, same bits, nothing left
    unwritten, nothing beside. Several constraints in one: each of them.
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
            dim = getattr(own, "dim", None)
            require(isinstance(dim, int) and dim > 0, f"{own.name}.dim is {dim!r}; it must be a positive integer")
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
    lower, upper = constraint.bounds(model)
    for what, bound, again in zip(("lower", "upper"), (lower, upper), constraint.bounds(model), strict=True):
        require(bound.shape == (model.nj,), f"{name}: {what} bounds must have shape ({model.nj},), not {bound.shape}")
        require(bound.tobytes() == again.tobytes(), f"{name}.bounds is not pure: {what} differs when asked twice")
    for joint, low, high in zip(model.joint_names, lower, upper, strict=True):
        require(low <= high, f"{name} on {model.name}: joint {joint!r} has lower {low:g}, upper {high:g}")
        require(
            constraint.quantity == "position" or low <= 0.0 <= high,
            f"{name} on {model.name}: joint {joint!r} must be allowed a {constraint.quantity} of 0, "
            f"not [{low:g}, {high:g}]",
        )


def _check_barrier(constraint: Barrier, model: RobotModel, when: list[Moment]) -> None:
    dim = constraint.dim
    filling = Filling(
        constraint.name, model, constraint.fill, BarrierRows,
        {"J": (dim, model.nv), "h": (dim,), "drift": (dim,), "rate": (dim,)}, zero=frozenset({"rate"}),
    )  # fmt: skip
    size = row_sizes([(rows["J"], rows["h"]) for rows in map(filling.at, when)])
    for first, second in zip(when, [*when[1:], when[0]], strict=True):
        filling.check_purity(first, second)
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


def _check_linear(constraint: LinearConstraint, model: RobotModel, when: list[Moment], contact_dim: int) -> None:
    require(
        constraint.on in _DECIDED, f"{constraint.name}.on is {constraint.on!r}; it must be one of {sorted(_DECIDED)}"
    )
    size = {"torque": model.nj, "force": contact_dim}.get(constraint.on, model.nv)
    filling = Filling(
        constraint.name, model, constraint.fill, ConstraintRows, {"A": (constraint.dim, size), "lo": (constraint.dim,),
        "hi": (constraint.dim,)}, may_be_infinite=frozenset({"lo", "hi"}),
    )  # fmt: skip
    for first, second in zip(when, [*when[1:], when[0]], strict=True):
        filling.check_purity(first, second)
        rows = filling.at(first)
        crossed = np.flatnonzero(~(rows["lo"] <= rows["hi"]))
        require(crossed.size == 0, f"{constraint.name} on {model.name}, row {crossed[:1]}: lo is above hi")
