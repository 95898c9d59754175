"""ContactForce: tracks a force and moment of a contact."""

from __future__ import annotations

from typing import Any, Self, final

from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel
from wbc.stack.kernel_members import KernelLinearTask
from wbc.stack.kernel_rows import KernelRows
from wbc.stack.target import vector_target
from wbc.stack.tracking import Tracking

from .trajectories import Sinusoid


@final
class ContactForce(Tracking, KernelLinearTask):
    """f = f_target: force [N], then moment [N m] about the contact point, in the axes of the surface (z the normal).

    ``contact``: its name or its frame. ``target``: (3,), the force alone, or (6,), the wrench of a sole; or a function
    of time giving it. Rows without weight are free: ``weight={"fz": 1e-4, "f[xy]": 0.0}`` sets a normal force alone.
    The target is not a bound; bounds are ``f_min`` and ``f_max`` of the contact.

    Raises:
        InvalidInput: a target of another shape. UnknownName: no such contact, when a stack is compiled.

    Example:
        >>> from wbc.tasks import ContactForce
        >>> ContactForce("left_sole", target=[0.0, 0.0, 400.0], weight=1e-4).dim
        3
    """

    on = "force"
    labels = ("fx", "fy", "fz", "mx", "my", "mz")
    read_once = frozenset({"contact"})

    def __init__(self, contact: str, *, target: Any, weight: Any = 1.0, name: str | None = None) -> None:
        self.contact = self.subject = contact
        value = _value_at_zero(target)
        if checks.ndim(value) != 1 or len(value) not in (3, 6):
            raise InvalidInput(f"{self.name}.target must have shape (3,) or (6,), not {checks.shown(value)}")
        self.dim = len(value)
        self.units = ("N", "N", "N", "N m", "N m", "N m")[: self.dim]
        self.convert = vector_target(self.dim)
        super().__init__(weight=weight, name=name)
        self.target = target

    def kernel_rows(self) -> KernelRows:
        return KernelRows.tracking(self, "wbc.tasks.compiled.force:target")

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        frame, wave = model.frame_names[-1], Sinusoid([0.0] * 6, amplitude=10.0, frequency=0.5)
        return [cls(frame, target=[0.0, 0.0, 50.0]), cls(frame, target=wave)]


def _value_at_zero(target: Any) -> Any:
    if not callable(target):
        return target
    value = target(0.0)
    return value[0] if isinstance(value, tuple) else value
