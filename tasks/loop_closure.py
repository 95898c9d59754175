"""LoopClosure: closed kinematic loop: two frames of one robot are joined, and the force that joins them is known."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Self, final

import numpy as np

from wbc import checks
from wbc.models.model import RobotModel, RobotState
from wbc.stack.contact import Anchor
from wbc.stack.kernel_members import KernelContact
from wbc.stack.kernel_rows import KernelRows
from wbc.types import Mat

from .criteria.manipulability import ROWS
from .relative import check_frames, relative_motion


@final
class LoopClosure(KernelContact):
    """A joint that closes a loop: ``frame`` keeps its place in ``to``, held by a force between the two.

    Rows of the pose (p, R) of ``frame`` in the axes of ``to``: J a + J̇ v = kp e − kd J v (Baumgarte's term: a loop
    that has opened closes again), e = (p_anchor − p, log(R_anchor Rᵀ)); J v = rate e at the velocity level. It stands
    in ``contacts``. With ``InverseDynamics`` its reaction, the wrench of ``to`` on ``frame`` at the origin of ``frame``
    in the axes of ``to``, is ``command.f[name]``, one number a row; no cone bounds it.

    ``rows``: some of "x", "y", "z", "rx", "ry", "rz". All six are a weld (a bar in two hands), "x", "y", "z" a ball
    joint, in a planar mechanism that moves in x and z "x", "z"; more rows would be redundant there. ``target``: the
    pose of ``frame`` in ``to`` (a position where no row turns), identity for frames that coincide; default: as it is
    when the loop is first closed. Joints without motors: ``Torque(0.0, joints=[…]).exactly()``. Source: Baumgarte,
    Computer Methods in Applied Mechanics and Engineering 1972.

    Raises:
        InvalidInput: a row that does not exist or comes twice, the same frame twice. UnknownFrame: when a stack is
            compiled.

    Example:
        >>> import numpy as np
        >>> from wbc.tasks import LoopClosure
        >>> LoopClosure("crank_pin", to="rod_end", rows=["x", "z"], target=np.eye(4), kp=2500.0).wrench_axes
        (0, 2)
    """

    bilateral = True
    read_once = frozenset({"carrier"})

    def __init__(
        self, frame: str, *, to: str, rows: Sequence[str] = ("x", "y", "z"), target: Any = None, kp: float = 100.0,
        kd: float | None = None, force_weight: float = 0.0, name: str | None = None,
    ) -> None:  # fmt: skip
        rows = checks.names("LoopClosure.rows", rows, ROWS)
        self.carrier = to
        self._axes = tuple(ROWS.index(row) for row in rows)
        self.dim = len(self._axes)
        if checks.ndim(target) == 1 and len(target) == 3 and max(self._axes) < 3:
            target = Anchor(np.eye(3), target)
        # Nothing slips in a joint: friction is only asked of surfaces.
        super().__init__(frame, friction=1.0, kp=kp, kd=kd, force_weight=force_weight, target=target, name=name)

    @property
    def wrench_axes(self) -> tuple[int, ...]:
        """Which of a wrench's (fx, fy, fz, mx, my, mz) the joint gives: its rows."""
        return self._axes

    def prepare(self, model: RobotModel) -> None:
        check_frames(model, self.name, self.frame, str(self.carrier))

    def anchor(self, state: RobotState) -> Anchor:
        motion = relative_motion(state, self.frame, str(self.carrier))
        return Anchor(motion.rotation, motion.position)

    def kernel_rows(self) -> KernelRows:
        return KernelRows("wbc.tasks.compiled.frame:closure", (self.frame, str(self.carrier)), self._axes)

    def cone(self) -> Mat:
        return np.zeros((0, self.dim))

    def cone_labels(self) -> list[tuple[str, str]]:
        return []

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        first, last = model.frame_names[1], model.frame_names[-1]
        return [
            cls(last, to=first),
            cls(last, to=first, rows=["x", "y", "z", "rx"]),
            cls(last, to=first, rows=["z", "ry"]),
        ]

    def __repr__(self) -> str:
        return f"{self.name}(to={self.carrier})"
