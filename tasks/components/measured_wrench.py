"""MeasuredWrench: adds a measured external force to the dynamics."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, final

import numpy as np

from wbc.models.model import RobotModel, RobotState
from wbc.stack.component import Component
from wbc.stack.overrides import Overrides
from wbc.stack.target import Target
from wbc.stack.tracking import wrench_target
from wbc.types import Vec

if TYPE_CHECKING:
    from wbc.stack.plan_view import PlanView


@final
class MeasuredWrench(Component):
    """The environment acts on ``frame``'s origin with a force [N] or a wrench [N, N m], world axes: a known term of
    the dynamics, M a + h = Sᵀ τ + Jᵀ F. The torques take it into account, so that tasks are met.

    ``wrench``: (3,), the force alone, or (6,), force before moment; or a function of time giving it. It may be assigned
    between ticks. A reading that is not finite is ignored, and the one before it is kept. Signal: ``wrench`` (6,).

    Raises:
        InvalidInput: a wrench of another shape, or not finite when given. UnknownFrame: when a stack is compiled.

    Example:
        >>> from wbc.tasks import MeasuredWrench
        >>> sensor = MeasuredWrench("tool", wrench=[0.0, 0.0, -5.0])
        >>> sensor.wrench = [0.0, 0.0, -5.2, 0.0, 0.1, 0.0]  # what it reads now
    """

    def __init__(self, frame: str, *, wrench: Any = (0.0, 0.0, 0.0), name: str | None = None) -> None:
        self.frame = frame
        super().__init__(name=f"MeasuredWrench[{frame}]" if name is None else name)
        self._now = np.zeros(6)
        self.wrench = wrench

    @property
    def wrench(self) -> Any:
        """What was given."""
        return self._given

    @wrench.setter
    def wrench(self, value: Any) -> None:
        self._reading = Target(f"{self.name}.wrench", value, 6, wrench_target)
        self._given = value

    def prepare(self, model: RobotModel) -> None:
        model.check_frame(self.frame)

    def reset(self, state: RobotState) -> None:
        self._now[:] = 0.0

    def before(self, state: RobotState, last: object, plan: PlanView) -> Overrides:
        reading = self._reading.at(state.t).value
        if np.isfinite(reading).all():
            self._now[:] = reading
        return Overrides(bias=-(self._now @ state.frame(self.frame).jacobian()))

    def signals(self) -> dict[str, Vec]:
        return {"wrench": self._now}
