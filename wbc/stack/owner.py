"""Whose bound holds a joint: of all that limit one quantity, the constraint or component with the narrowest bound."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

import numpy as np

from wbc.stack.constraint import JointInterval, TorqueBySpeed
from wbc.stack.overrides import Overrides
from wbc.types import Vec


def owner(
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
