"""HalfSpaceLimit: keeps a frame on one side of a plane."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Self, final

from wbc import checks
from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelBarrier
from wbc.stack.kernel_rows import KernelRows

from .directions import unit


@final
class HalfSpaceLimit(KernelBarrier):
    """h = n·p − offset >= 0 [m]: the origin p of a frame on the side of a plane that its normal n points to.

    ``normal`` (3,) in the world, of any length but zero (it is normalised); ``offset`` [m] along it.

    Raises:
        InvalidInput: a normal of length zero, numbers that are not finite. UnknownFrame: when a stack is compiled.

    Example:
        >>> from wbc.tasks import HalfSpaceLimit
        >>> HalfSpaceLimit("tool", normal=[0, 0, 1], offset=0.05)  # never below 5 cm
        HalfSpaceLimit[tool]
    """

    dim, units = 1, "m"
    checked: ClassVar[Mapping[str, Any]] = {"normal": unit, "offset": checks.number}

    def __init__(
        self, frame: str, *, normal: Any, offset: float, rate: float = 10.0, slack: float | None = 1e6,
        name: str | None = None,
    ) -> None:  # fmt: skip
        self.frame = self.subject = frame
        super().__init__(rate=rate, slack=slack, name=name)
        self.normal = normal
        self.offset = offset

    def prepare(self, model: RobotModel) -> None:
        model.check_frame(self.frame)

    def kernel_rows(self) -> KernelRows:
        return KernelRows("wbc.tasks.compiled.limit:half_spaces", (self.frame,), [*self.normal, self.offset])

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        return [cls(model.frame_names[-1], normal=[1.0, 2.0, -1.0], offset=0.1)]
