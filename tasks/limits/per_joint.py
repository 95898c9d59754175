"""Values of a limit on joints: one number, one per joint, or some joints by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from wbc import checks
from wbc.errors import InvalidInput, UnknownJoint
from wbc.models.model import RobotModel
from wbc.stack.by_name import meant, pattern
from wbc.types import Vec

#: How many joints a message names.
SHOWN = 3


def per_joint(what: str, value: Any, model: RobotModel, default: Vec) -> Vec:
    """``value`` for each joint (nj,): a scalar, (nj,), or {joint: value}. None, and joints left out: ``default``.

    A joint is a name or a pattern, a regular expression that matches whole names; of several the last holds.

    Raises:
        UnknownJoint: with the names that are near. InvalidInput: another shape, NaN.
    """
    if value is None:
        return default.copy()
    if isinstance(value, Mapping):
        result = default.copy()
        for joint, entry in value.items():
            where = meant(what, pattern(f"a key of {what}", joint), model.joint_names, UnknownJoint)
            result[where] = checks.array(f"{what}[{joint!r}]", entry, (), finite=False)
        return result
    return checks.each(what, value, model.nj, finite=False)


def positive(what: str, values: Vec, model: RobotModel) -> Vec:
    """``values`` (nj,), all above zero (inf: no limit).

    Raises:
        InvalidInput: zero, negative or NaN, each by joint name.
    """
    wrong = {joint: value for joint, value in zip(model.joint_names, values.tolist(), strict=True) if not value > 0.0}
    if wrong:
        some = list(wrong)[:SHOWN]
        of = ", ".join(f"of joint {joint!r} is {wrong[joint]:g}" for joint in some)
        named = ", ".join(f"{joint!r}: value" for joint in some)
        if len(wrong) > len(some):
            of, named = f"{of}, and of {len(wrong) - len(some)} more", f"{named}, …"
        raise InvalidInput(
            f"{what} {of}; a limit is positive (inf: none). "
            f"Pass {what.rpartition('.')[2]}={{{named}}} to overrule the model"
        )
    return values
