"""CenterOfPressure: tracks the centre of pressure of a contact."""

from __future__ import annotations

from typing import Any, Self, final

from wbc.errors import InvalidInput
from wbc.models.model import RobotModel, RobotState
from wbc.stack.kernel_members import KernelLinearTask
from wbc.stack.kernel_rows import KernelRows
from wbc.stack.target import vector_target
from wbc.stack.task import LinearRows
from wbc.stack.tracking import Tracking

from .trajectories import Sinusoid


@final
class CenterOfPressure(Tracking, KernelLinearTask):
    """m_y + p_x f_z = 0 and m_x − p_y f_z = 0 for the wrench of one sole: its force acts at p = ``target`` (2,) [m].

    p is in the axes of the sole, from its centre; the rows are moments about p [N m], so that a foot with little load
    weighs little. ``contact``: its name or frame. Of all contacts together: :class:`~tasks.ZeroMomentPoint`.
    Source: Sardain, Bessonnet, IEEE Trans. Systems, Man, and Cybernetics 2004.

    Raises:
        InvalidInput: a target of another shape; when a stack is compiled, a contact without moments.
        UnknownName: no such contact, when a stack is compiled.

    Example:
        >>> from wbc.tasks import CenterOfPressure
        >>> CenterOfPressure("left_sole", target=[0.03, 0.0], weight=1e-3)
        CenterOfPressure[left_sole](weight=0.001)
    """

    on, dim, units, labels, convert = "force", 2, "N m", "xy", staticmethod(vector_target(2))
    read_once = frozenset({"contact"})

    def __init__(self, contact: str, *, target: Any = (0.0, 0.0), weight: Any = 1.0, name: str | None = None) -> None:
        self.contact = self.subject = contact
        super().__init__(weight=weight, name=name)
        self.target = target

    def kernel_rows(self) -> KernelRows:
        return KernelRows.tracking(self, "wbc.tasks.compiled.force:centre_of_pressure")

    def fill(self, state: RobotState, out: LinearRows) -> None:
        if out.A.shape[1] != 6:
            raise InvalidInput(f"{self.name} is about a wrench; a contact of {out.A.shape[1]} numbers has no moments")
        super().fill(state, out)

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        frame = model.frame_names[-1]
        return [cls(frame), cls(frame, target=Sinusoid([0.0, 0.0], amplitude=0.02, frequency=0.5))]
