"""LocalPosition: tracks the position of a frame along its own axes: a drill that is free along its axis."""

from __future__ import annotations

from typing import Self, final

from wbc.models.model import RobotModel

from .position import _AlongAxes
from .trajectories import Sinusoid


@final
class LocalPosition(_AlongAxes):
    """e = Rᵀ (p_target − p) [m]: one row for each of ``axes`` of the frame itself, by default all three.

    With one or two axes, or other weights for each, the rest of the way to the target is free or matters less, and
    turns with the frame: as masks and costs of TSID, Pink and mink do. :class:`~tasks.Position` has world axes.
    J v = ν + ω × e, ν and ω being the frame's velocities in its own axes.

    ``target`` (3,): a point of the world, or a function of time giving it or (position, velocity, acceleration).

    Raises:
        InvalidInput: axes that are not some of "xyz" in this order, a target of another shape.
        UnknownFrame: when a stack is compiled.

    Example:
        >>> from wbc.tasks import LocalPosition
        >>> LocalPosition("tool", target=[0.4, 0.0, 0.5], axes="xy").dim  # anywhere on a line along the tool's z
        2
    """

    target_dim = 3
    _kernel = "wbc.tasks.compiled.frame:own_position"

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        motion = Sinusoid([0.3, 0.0, 0.5], amplitude=0.1, frequency=[0.5, 0.7, 0.9])
        frame = model.frame_names[-1]
        return [cls(frame, target=[0.3, 0.0, 0.5]), cls(frame, target=motion), cls(frame, target=motion, axes="xz")]
