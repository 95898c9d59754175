"""Filled: what the rows of a plan say that were filled last."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import inf

import numpy as np

from wbc.errors import InvalidInput
from wbc.models.model import RobotState
from wbc.qp.problem import Row
from wbc.qp.rows import RowProblem
from wbc.stack.block import Block, RowBlock
from wbc.stack.compiled.fill_kernel import ROW_SPOILT
from wbc.stack.constraint import Barrier, JointInterval, TorqueBySpeed
from wbc.stack.layout import Layout
from wbc.stack.motion import MotionRows
from wbc.stack.overrides import Overrides
from wbc.stack.plan_view import PlanView
from wbc.stack.tracking import Tracking
from wbc.tolerances import MODERATE
from wbc.types import Index, Mat, Vec


class Filled(PlanView):
    """The rows of a plan, where they stand, and what they say in words."""

    __slots__ = (
        "_normal", "_spoilt", "barriers", "joint_bound_rows", "layout", "motion", "problem", "shares", "torque_range",
    )  # fmt: skip

    layout: Layout
    problem: RowProblem
    motion: MotionRows
    #: Bounds (lower, upper) on what is decided of the joints, (nj,) each: a part of the problem.
    joint_bound_rows: tuple[Vec, Vec]
    #: Of each task on the joints, and of their damping: its share of each joint's cost.
    shares: Mat
    #: What the last fill left that is no number: a sum of ROW_SPOILT and BOUND_SPOILT.
    _spoilt: int
    #: Those that have h >= 0, also the soft ones.
    barriers: list[RowBlock]
    _normal: Index
    #: ``torque_bounds`` as they were filled last: where they move with the speed, for the speed of that state.
    torque_range: tuple[Vec, Vec]

    def refuse_not_finite(self) -> None:
        """A level that is left out because of NaN must not look like an answer.

        Raises:
            InvalidInput: what was filled last is not finite, or too large, by the name of the row.
        """
        if not self._spoilt & ROW_SPOILT:
            return
        layout, size = self.layout, np.abs(self.problem.G[: self.layout.n_rows]).sum(axis=1)
        bad = ~(size < MODERATE)
        if bad[layout.motion_row :].any():  # a contact's Jacobian is in the torques too: name the cause
            bad[: layout.motion_row] = False
        if bad.any():
            row = int(np.argmax(bad))
            blocks = (block for block in (*layout.motions, *layout.others) if row in range(layout.n_rows)[block.rows])
            raise _spoilt(next(blocks, None), str(self.problem.rows[row]), float(size[row]))
        for block in layout.joints:
            wanted = np.abs(self.motion.wanted[block.motion])
            if not (wanted < MODERATE).all():
                row = int(np.argmin(wanted < MODERATE))
                raise _spoilt(block, f"{block.name}: {block.member.label(row)}", float(wanted[row]))

    def errors(self) -> Mapping[str, Vec]:
        """Error e of each kinematic task (dim,), a copy."""
        tasks = (*self.layout.kinematic, *self.layout.joints, *self.layout.exact)
        return {block.name: block.says.own_rows(self.motion.e[block.motion]).copy() for block in tasks}

    def margins(self) -> Mapping[str, tuple[Barrier, Vec]]:
        """Each barrier and its h (dim,), a copy, in the state that was filled last."""
        return {block.says.name: (block.says, block.out.h.copy()) for block in self.barriers}

    def pressed(self) -> list[int]:
        """The unknowns that are normal forces."""
        return [int(i) for i in self._normal] if self.level.dynamics else []

    def joint_bounds(self, state: RobotState) -> tuple[Vec, Vec]:
        """What the limits leave each joint in this state, (nj,) each: velocities or accelerations, as the level has it.

        The problem keeps its own.
        """
        lower, upper = np.array(self.joint_bound_rows)
        self.intervals.write(self.level.order, state.q_joints, state.v_joints, lower, upper)
        return lower, upper

    def unlimited_joints(self, lower: Vec, upper: Vec) -> list[str]:
        """Names of the joints that have neither these bounds on their motion (nj,) nor a limit of torque.

        Where one bounds a and the other τ = M a + h of each joint, both are bounded for all, as every block of M on
        its diagonal has an inverse. A problem that is relaxed, or simpler, has no such bound for the others.
        """
        limited = np.isfinite(lower) & np.isfinite(upper)
        if self.level.dynamics:
            limited |= np.isfinite(self.torque_range).all(axis=0)
        return [self.model.joint_names[joint] for joint in np.flatnonzero(~limited)]

    def bounded_row(self, place: int, state: RobotState, *, upper: bool) -> Row:
        """A range row, or behind them all an unknown, called by who gives it the bound that it has in this state."""
        p, nb, nj = self.problem, self.model.nb, self.model.nj
        first = self.layout.n_range
        row = p.rows[p.range.start + place] if place < first else p.rows[p.n_rows + place - first]
        quantity, joint = "", place if place < first else place - first - nb
        if place >= first and 0 <= joint < nj:
            bound = self.joint_bound_rows[1 if upper else 0].item(joint)
            quantity = self.intervals.cause(joint, bound, upper=upper)
        elif place < nj and self.level.dynamics:
            quantity = "torque"
        if quantity:
            limits, said = self.layout.joint_limits, self.applied.said
            name = _owner(quantity, joint, limits, said, upper=upper, v=state.v_joints)
            return row._replace(owner=name or row.owner)
        for block in self.barriers:
            at = p.range.start + place
            if block.rows.start <= at < block.rows.stop and block.says.codes is not None:
                return row._replace(label=str(block.says.about(at - block.rows.start)))
        return row


def _spoilt(block: Block | None, row: str, size: float) -> InvalidInput:
    """Why a row of this size cannot be decided; ``block``: whose it is, if it is of one."""
    if block is not None and isinstance(block.says, Tracking) and not block.says.is_target_finite:
        return InvalidInput(f"target of {row} is not finite")
    return InvalidInput(f"{row} is {'too large' if size < np.inf else 'not finite'}")


def _owner(
    quantity: str, joint: int, limits: Sequence[tuple[JointInterval, Vec, Vec]],
    said: Sequence[tuple[str, Overrides]], *, upper: bool, v: Vec,
) -> str:  # fmt: skip
    """The name of the constraint, or of the component, with the narrowest bound on a quantity of a joint; of equal
    bounds the first. "" where nothing limits the quantity.

    Args:
        quantity: "torque", "position", "velocity", "acceleration" or "jerk".
        joint: its index.
        limits: the constraints of the stack, with their bounds (nj,).
        said: the overrides of this tick, by the names of their components.
        upper: the side.
        v: velocities (nj,) of the joints, which limits of torque by speed depend on.
    """
    side = 1 if upper else 0
    sign = 1.0 if upper else -1.0
    bounds: list[tuple[float, str]] = []
    lifted = any(joint in overrides.lifted.get(quantity, ()) for _, overrides in said)
    for limit, *bound in limits:
        if limit.quantity == quantity:
            if isinstance(limit, TorqueBySpeed):
                bound = [one.copy() for one in bound]
                limit.narrow(v, *bound)
            bounds.append((inf if lifted else sign * bound[side].item(joint), limit.name))
    if quantity == "torque":
        # What a weak motor gives at the ends of its range.
        widest = min((bound for bound, _ in bounds), default=inf)
        for name, overrides in said:
            if joint in overrides.motors:
                motor = overrides.motors[joint]
                share, offset = motor if isinstance(motor, tuple | list) else (motor, 0.0)
                bounds.append(((share * widest if share > 0.0 else 0.0) - sign * offset, name))
    for name, overrides in said:
        given = getattr(overrides, quantity, None)
        if given is not None:
            bounds.append((sign * float(np.broadcast_to(given[side], v.shape)[joint]), name))
    return min(bounds, key=lambda one: one[0], default=(inf, ""))[1]
