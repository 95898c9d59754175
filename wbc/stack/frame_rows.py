"""FrameRows, JointRows: what a task or contact says of itself when its rows are a frame's or the joints'."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, final

import numpy as np

from wbc.types import Mat, Vec


@final
@dataclass(frozen=True, eq=False)
class FrameRows:
    """Rows of the motion of ``frame``, or of the centre of mass where it is empty: a compiled tick fills them.

    ``rows`` are some of x y z roll pitch yaw. "world": J, classical drift, and e = (p_target − p, log(R_target Rᵀ)) of
    the point that is ``offset`` (3,) away in world axes, positions in the axes of ``turn`` (3, 3); "local": the body
    twist of the point that is ``offset`` away in the frame's axes, its spatial drift, and e = log6(actual⁻¹ target).
    ``held``: of each row, whether its error counts or is 0. What ``fill`` writes is the same to 1e-9.
    """

    frame: str
    axes: Literal["world", "local"] = "world"
    rows: tuple[int, ...] = (0, 1, 2, 3, 4, 5)
    offset: Vec | None = None
    turn: Mat | None = None
    held: tuple[bool, ...] | None = None

    def table(self) -> Vec:
        """Turn, row by row, offset and, of x y z, whether the error counts: 15 numbers."""
        held = np.ones(3)
        if self.held is not None:
            held[: len(self.held)] = self.held[:3]
        turn = np.eye(3) if self.turn is None else self.turn
        offset = np.zeros(3) if self.offset is None else self.offset
        return np.concatenate([turn.ravel(), offset, held])


@final
@dataclass(frozen=True, eq=False)
class JointRows:
    """e = q_target − q of all joints, for a task that is ``on_joints``."""
