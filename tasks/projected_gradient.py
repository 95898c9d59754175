"""ProjectedGradient: gradient projection: increases a criterion with the redundant joints."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Self, final

from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel, RobotState
from wbc.stack.task import TaskRows

from .criteria.clearance import Clearance
from .criteria.criterion import Criterion
from .criteria.manipulability import Manipulability
from .criteria.mid_range import MidRange
from .joint_task import JointTask


@final
class ProjectedGradient(JointTask):
    """Climb H(q): one row a joint. Below exact tasks it is the projected gradient method within all limits.

    Velocity level:      v_joints = gain ∇H
    Acceleration level:  a_joints = kd (gain ∇H − v_joints), the same with a lag of 1/kd [s]

    With J v = ẏ as a constraint the optimum of ½ w |v − gain ∇H|² is v = J# ẏ + gain (I − J# J) ∇H while no bound is
    active, and the nearest feasible velocity when one is. ``gain`` [joint unit / s per unit of ∇H] may be negative:
    descend. The regularisation of a level pulls v towards zero by the share ε / (w + ε). ``joints``, weight and gain:
    by name or pattern too, see :class:`~tasks.joint_task.JointTask`.
    Source: Rosen's gradient projection; for robots Liégeois, IEEE Trans. Systems, Man, and Cybernetics 1977.

    Raises:
        InvalidInput: a criterion that is none, a gain that is not finite; when a stack is compiled, what the criterion
            refuses.

    Example:
        >>> from wbc.tasks import Manipulability, ProjectedGradient
        >>> ProjectedGradient(Manipulability("tool"), gain=2.0, weight=1e-2)
        ProjectedGradient[manipulability of tool](weight=0.01)
    """

    _kd = 10.0
    read_once = frozenset({"criterion"})
    checked: ClassVar[Mapping[str, Any]] = {"gain": checks.number}

    def __init__(
        self, criterion: Criterion, *, joints: Sequence[str] | None = None, gain: float = 1.0, kd: Any = 10.0,
        weight: Any = 1.0, name: str | None = None,
    ) -> None:  # fmt: skip
        if not isinstance(criterion, Criterion):
            raise InvalidInput(f"ProjectedGradient.criterion must be a Criterion, not {criterion!r}")
        self.criterion, self.subject = criterion, criterion.name
        super().__init__(joints=joints, kp=0.0, kd=kd, weight=weight, name=name)
        self.gain = gain

    def prepare(self, model: RobotModel) -> None:
        super().prepare(model)
        self.criterion.prepare(model)

    def fill(self, state: RobotState, out: TaskRows) -> None:
        out.e[:] = 0.0
        out.rate_ref[:] = self.gain * self.criterion.gradient(state)

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        frame = model.frame_names[-1]
        return [
            cls(MidRange(), gain=5.0), cls(Manipulability(frame), kd=20.0),
            cls(Manipulability(frame, rows=["x", "rz"])),
            cls(Clearance(frame, point=[0.1, 0.2, 0.3], reach=2.0)),
            cls(Clearance(frame, plane=([0.0, 1.0, 1.0], 0.2), reach=2.0), gain=-1.0),
        ]  # fmt: skip
