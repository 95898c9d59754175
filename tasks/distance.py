"""Distance: tracks the distance of a frame to another frame, or to a point of the world."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Self, final

from wbc import checks
from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelTask
from wbc.stack.kernel_rows import KernelRows
from wbc.stack.target import vector_target
from wbc.stack.tracking import Tracking
from wbc.types import Vec

from .relative import check_frames
from .trajectories import Sinusoid


def _place(name: str, value: Any) -> str | Vec:
    return value if isinstance(value, str) else checks.array(name, value, (3,))


@final
class Distance(Tracking, KernelTask):
    """e = r_target − r [m], r = |p − p_to|: one row, J = n · (J_p − J_to), n = (p − p_to) / r.

    The drift is n · (p̈ − p̈_to) + |(I − n nᵀ)(ṗ − ṗ_to)|² / r. Nearer than 1 mm, where a direction changes at once, r is
    1 mm in that fraction; in one point n is the world's x, so that a robot can leave it.

    ``to``: the other frame's name, or a point (3,) of the world; ``target`` [m] > 0, or a function of time giving it or
    (distance, rate, acceleration), (1,) each.

    Raises:
        InvalidInput: a point of another shape, a target <= 0; the same frame twice. UnknownFrame: when a stack is
            compiled.

    Example:
        >>> from wbc.tasks import Distance
        >>> Distance("left_hand", to="right_hand", target=0.4).name
        'Distance[left_hand to right_hand]'
    """

    dim, units = 1, "m"
    checked: ClassVar[Mapping[str, Any]] = {"to": _place}

    def __init__(
        self, frame: str, *, to: Any, target: Any, kp: Any = 100.0, kd: Any = None, rate: Any = None,
        weight: Any = 1.0, name: str | None = None,
    ) -> None:  # fmt: skip
        self.frame = frame
        self.subject = f"{frame} to {to}" if isinstance(to, str) else frame
        super().__init__(kp=kp, kd=kd, rate=rate, weight=weight, name=name)
        self.to: str | Vec = to
        self.target = target

    @staticmethod
    def convert(name: str, value: Any, strict: bool) -> Vec:
        """A distance, as a number or (1,); positive when assigned."""
        distance = _distance(name, [value] if checks.ndim(value) == 0 else value, strict)
        if strict:
            checks.number(name, distance[0], low=0.0, strict=True)
        return distance

    def prepare(self, model: RobotModel) -> None:
        model.check_frame(self.frame)
        if isinstance(self.to, str):
            check_frames(model, self.name, self.frame, self.to)

    def kernel_rows(self) -> KernelRows:
        if isinstance(self.to, str):
            return KernelRows.tracking(self, "wbc.tasks.compiled.frame:distance", self.frame, self.to)
        return KernelRows.tracking(self, "wbc.tasks.compiled.frame:distance", self.frame, numbers=self.to)

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        first, last = model.frame_names[len(model.frame_names) // 4], model.frame_names[-1]
        moving = Sinusoid([0.4], amplitude=0.2, frequency=0.7)
        return [cls(last, to=first, target=moving), cls(last, to=[0.5, 0.2, 1.0], target=0.3)]


_distance = vector_target(1)
