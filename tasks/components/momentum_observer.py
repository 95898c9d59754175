"""MomentumObserver: which torques do not arrive, from positions and velocities alone."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import NDArray

from wbc import checks
from wbc.errors import InvalidInput, NotSupported
from wbc.methods import MomentumResidual
from wbc.models.model import RobotModel, RobotState
from wbc.stack.component import Component
from wbc.types import Vec

if TYPE_CHECKING:
    from wbc.stack.plan import Plan


@final
class MomentumObserver(Component):
    """A residual r (nj,) [N m, N] that follows the missing torque τ_f of M a + h + τ_f = τ, joint by joint.

        ṙ = K (τ_f − r),  r(0) = 0:    r = K (∫ (τ − β − r) dt − (p − p(0))),  p = M v,  β = g − Cᵀ v

    It needs neither accelerations nor torque sensors nor M⁻¹. In each tick β is the mean of both ends of the last
    interval, τ the torque commanded for it, less what other components know of (``plan.extra_bias``); p(0) is the
    momentum at the first tick. A force on the robot is seen as Jᵀ f = −τ_f unless it is known so. After ticks that did
    not happen, at least one period late by ``t``, the observer starts again.

    ``gain`` K [1/s]: scalar or (nj,). ``threshold`` [N m, N]: scalar or (nj,), where |r_i| > threshold_i raises the
    alarm of joint i. Signals: ``residual`` (nj,), ``alarm`` (nj,) of 0 and 1.
    Source: De Luca, Mattone, ICRA 2003.

    Raises:
        InvalidInput: a gain or threshold that is not positive, or of another size.
        NotSupported: on a floating base, when a stack is compiled; a level without torques, in the first tick.

    Example:
        >>> import wbc
        >>> from tasks import MomentumObserver, Posture
        >>> robot = wbc.load("arm")
        >>> observer = MomentumObserver(gain=50.0, threshold=2.0)
        >>> stack = wbc.Stack([Posture(robot.q0)], components=[observer])
        >>> controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics())
        >>> command = controller.tick(0.0, robot.q0, 0 * robot.q0)
        >>> observer.residual.tolist(), bool(observer.alarm.any())
        ([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], False)
    """

    def __init__(self, *, gain: Any, threshold: Any = np.inf, name: str | None = None) -> None:
        super().__init__(name=name)
        self._gain_given = _positive(f"{self.name}.gain", gain, finite=True)
        self._threshold_given = _positive(f"{self.name}.threshold", threshold, finite=False)

    def prepare(self, model: RobotModel) -> None:
        if model.nb:
            raise NotSupported(f"{self.name} needs a fixed base; {model.name} has a floating one")
        self.gain, self.threshold = (
            checks.array(f"{self.name}.{what}", np.full(model.nj, value) if value.ndim == 0 else value, (model.nj,),
                         finite=False)
            for what, value in (("gain", self._gain_given), ("threshold", self._threshold_given))
        )  # fmt: skip
        self._r, self._beta, self._tau = np.zeros(model.nj), np.zeros(model.nj), np.zeros(model.nj)
        self._t = 0.0

    def reset(self, state: RobotState) -> None:
        self._r[:] = 0.0
        self._observer: MomentumResidual | None = None

    def before(self, state: RobotState, last: object, plan: Plan) -> None:
        if not plan.level.dynamics:
            raise NotSupported(f"{self.name} observes torques, which the {plan.level.name} does not decide")
        p, beta = state.M @ state.v, state.g - state.v @ state.coriolis
        if self._observer is None or abs(state.t - self._t - plan.dt) > 0.5 * plan.dt:
            self._observer = MomentumResidual(gain=self.gain, dt=plan.dt, scheme="exact")
            self._observer.reset(p)
            self._r[:] = 0.0
        else:
            self._r[:] = self._observer.update(p, 0.5 * (self._beta + beta), self._tau)
        self._t, self._beta, self._plan = state.t, beta, plan

    def after(self, state: RobotState, command: Any) -> None:
        # Here, not in ``before``: by now every component has said what it knows.
        self._tau = command.tau - self._plan.extra_bias

    @property
    def residual(self) -> Vec:
        """r (nj,) [N m, N]: what is missing of the commanded torques; a copy."""
        return self._r.copy()

    @property
    def alarm(self) -> NDArray[np.bool_]:
        """Of which joints the residual is beyond its threshold (nj,)."""
        return np.abs(self._r) > self.threshold

    def signals(self) -> dict[str, Vec]:
        return {"residual": self._r, "alarm": self.alarm.astype(np.float64)}


def _positive(name: str, value: Any, *, finite: bool) -> Vec:
    numbers = checks.array(name, value, (None,) * min(np.ndim(value), 1), finite=finite)
    for i, number in np.ndenumerate(numbers):
        if not number > 0.0:
            raise InvalidInput(f"{name}{list(i) if i else ''} is {number:g}; it must be > 0")
    return numbers
