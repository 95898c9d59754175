"""MomentumObserver: estimates the torques that motors fail to deliver, without torque sensors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, final

import numpy as np
from numpy.typing import NDArray

from wbc import checks
from wbc.errors import InvalidInput, NotSupported
from wbc.methods import MomentumResidual
from wbc.models.model import RobotModel, RobotState
from wbc.stack.component import Component
from wbc.types import Mat, Vec

from .load import Load, LoadRegressor

if TYPE_CHECKING:
    from wbc.stack.plan_view import PlanView

#: Wrenches (6,) on the robot by frame, force before moment about the frame's origin, world axes.
Wrenches = Callable[[], Mapping[str, Vec]]
#: Speed over which Coulomb friction turns its sign [rad/s, m/s].
SIGN_SPEED = 0.01


@final
class MomentumObserver(Component):
    """A residual r (nj,) [N m, N] that follows the missing torque τ_f of each joint, M a + h + Sᵀ τ_f = Sᵀ τ + Jᵀ f.

        ṙ = K (τ_f − r),  r(0) = 0:    r = K (∫ (τ − β − r) dt − (p − p(0))),  p = M v,  β = g − Cᵀ v − Jᵀ f

    It needs neither accelerations nor torque sensors nor M⁻¹. In each tick β is the mean of both ends of the last
    interval, τ the torque that the command sent for it gives (``plan.actuators``), less what other components know of
    (``plan.extra_bias``); p(0) is the momentum at the first tick. A force on the robot is seen as Jᵀ f = −τ_f unless it
    is known so. The interval is what really passed by ``t``; where that is more than half a period off, as after missed
    ticks, the observer starts again.

    On a floating base the residual is of the joints relative to a base that floats, w_j − M_jb M_bb⁻¹ w_b for the
    missing forces w: a fault of an actuator appears in its own joint as before, and the measured velocity of the base
    and its noise appear in none. :attr:`push` is the missing force on the base, as a wrench.

    Args:
        gain: K [1/s], scalar or (nj,).
        threshold: [N m, N], scalar or (nj,); may be assigned. The alarm of joint i is raised once |r_i| > threshold_i
            for ``persistence`` ticks in a row and falls when |r_i| <= ``release`` threshold_i.
        wrenches: measured wrenches of the last interval at feet or hands: a function giving {frame: wrench (6,)},
            force before moment about the frame's origin, world axes; may be assigned. A frame counts from the tick
            after the one in which it appears. A stack with contacts needs it: without the contacts' wrenches left and
            right hips cannot be told apart.
        base_gain: K of the base's rows [1/s], default as the smallest of ``gain``.
        viscous, coulomb: friction that the joints are known to have, viscous v + coulomb sign(v), scalar or (nj,).

    Signals: ``residual`` (nj,), ``alarm`` (nj,) of 0 and 1; on a floating base ``push`` (6,).
    Source: De Luca, Mattone, ICRA 2003; Haddadin, De Luca, Albu-Schäffer, IEEE T-RO 2017.

    Raises:
        InvalidInput: a gain, threshold, friction or number of ticks out of range, or of another size.
        NotSupported: a level without torques, when a controller is made; contacts whose wrenches are not measured cost
            the tick its answer (``controller.why``).

    Example:
        >>> import wbc
        >>> from wbc.tasks import MomentumObserver, Posture
        >>> robot = wbc.load("arm")
        >>> observer = MomentumObserver(gain=50.0, threshold=2.0)
        >>> stack = wbc.Stack([Posture(robot.q0)], components=[observer])
        >>> controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics())
        >>> command = controller.tick(0.0, robot.q0, 0 * robot.q0)
        >>> observer.residual.tolist(), bool(observer.alarm.any())
        ([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], False)
    """

    def __init__(
        self, *, gain: Any, threshold: Any = np.inf, wrenches: Wrenches | None = None, persistence: int = 1,
        release: float = 1.0, base_gain: float | None = None, viscous: Any = 0.0, coulomb: Any = 0.0,
        name: str | None = None,
    ) -> None:  # fmt: skip
        super().__init__(name=name)
        self._gain_given = _positive(f"{self.name}.gain", gain, finite=True)
        self.threshold = threshold
        self.wrenches = wrenches
        self.persistence = int(checks.number(f"{self.name}.persistence", persistence, low=1))
        self.release = checks.number(f"{self.name}.release", release, low=0.0, high=1.0)
        lowest = float(self._gain_given.min()) if base_gain is None else base_gain
        self.base_gain = checks.number(f"{self.name}.base_gain", lowest, low=0.0, strict=True)
        self._friction_given = viscous, coulomb

    @property
    def threshold(self) -> Vec:
        """(nj,) once a stack is compiled [N m, N]."""
        return self._threshold

    @threshold.setter
    def threshold(self, value: Any) -> None:
        self._threshold = _positive(f"{self.name}.threshold", value, finite=False)
        if hasattr(self, "_model"):
            self._threshold = _each(f"{self.name}.threshold", self._threshold, self._model.nj)

    def prepare(self, model: RobotModel) -> None:
        self._model, nj = model, model.nj
        self.gain = _each(f"{self.name}.gain", self._gain_given, nj)
        self.threshold = self._threshold
        self._viscous, self._coulomb = (
            checks.gains(f"{self.name}.{what}", value, nj)
            for what, value in zip(("viscous", "coulomb"), self._friction_given, strict=True)
        )
        self._rubs = bool(self._viscous.any() or self._coulomb.any())
        self._r, self._missing = np.zeros(model.nv), np.zeros(model.nv)
        self._alarm, self._ticks_above = np.zeros(nj, dtype=np.bool_), np.zeros(nj, dtype=int)
        self._command, self._known = np.zeros(nj), np.zeros(nj)
        self._sent, self._beta = np.zeros(model.nv), np.zeros(model.nv)
        self._rows = np.eye(model.nv) if model.nb else None
        self._t = 0.0
        #: The last interval [s]; 0 where the observer started.
        self.dt = 0.0
        self._carried: dict[str, tuple[LoadRegressor, Vec]] = {}

    def reset(self, state: RobotState) -> None:
        self._r[:], self._alarm[:], self._ticks_above[:] = 0.0, False, 0
        self._observer: MomentumResidual | None = None
        self._carried.clear()

    # ---- the tick
    def before(self, state: RobotState, last: object, plan: PlanView) -> None:
        p, beta = state.M @ state.v, self._beta_of(state)
        if self._observer is None:
            self._refuse(plan)
        passed = 0.0 if self._observer is None else state.t - self._t
        self.dt = passed if abs(passed - plan.dt) <= 0.5 * plan.dt else 0.0
        inertial = [(regressor.step(state, self.dt), load) for regressor, load in self._carried.values()]
        if self._observer is None or self.dt == 0.0:
            gain = np.concatenate([np.full(self._model.nb, self.base_gain), self.gain])
            self._observer = MomentumResidual(gain=gain, dt=plan.dt, scheme="exact")
            self._observer.reset(p)
            self._r[:], self._missing[:] = 0.0, 0.0
        else:
            known = self._sent + self._measured_force()
            for Y, load in inertial:
                if Y is not None:
                    known -= Y @ load
            rows, mean = self._relative_to_base(state), 0.5 * (self._beta + beta)
            self._r[:] = self._observer.update(p, mean, known, rows, dt=self.dt)
            self._missing[:] = self._observer.missing
        self._judge()
        self._t, self._beta, self._plan = state.t, beta, plan
        frames = {} if self.wrenches is None else self.wrenches()
        self._jacobians = {frame: np.array(state.frame(frame).jacobian()) for frame in frames}

    def after(self, state: RobotState, command: Any) -> None:
        # Here, not in ``before``: by now every component has said what it knows.
        delivered = self._plan.actuators.torque(command.tau)
        self._command, self._known = command.tau, command.tau - delivered
        self._sent = -self._plan.extra_bias
        self._sent[self._model.nb :] += delivered

    def check(self, plan: PlanView) -> None:
        if not plan.level.dynamics:
            raise NotSupported(f"{self.name} observes torques, which the {plan.level.name} does not decide")
        self._plan = plan

    def _refuse(self, plan: PlanView) -> None:
        if plan.stack.contacts and self.wrenches is None:
            raise NotSupported(
                f"{self.name} needs the wrenches that the contacts measure: give it wrenches=function, {{frame: (6,)}}"
            )

    def _beta_of(self, state: RobotState) -> Vec:
        beta: Vec = state.g - state.v @ state.coriolis
        if self._rubs:
            v = state.v_joints
            beta[self._model.nb :] += self._viscous * v + self._coulomb * np.tanh(v / SIGN_SPEED)
        return beta

    def _measured_force(self) -> Vec:
        """Jᵀ f (nv,) of the last interval, J as it was when the interval began."""
        force = np.zeros(self._model.nv)
        if self.wrenches is not None:
            for frame, wrench in self.wrenches().items():
                if frame in self._jacobians and np.isfinite(wrench).all():
                    force += wrench @ self._jacobians[frame]
        return force

    def _relative_to_base(self, state: RobotState) -> Mat | None:
        nb = self._model.nb
        if self._rows is not None:
            M = state.M
            self._rows[nb:, :nb] = -np.linalg.solve(M[:nb, :nb], M[:nb, nb:]).T
        return self._rows

    def _judge(self) -> None:
        size = np.abs(self._r[self._model.nb :])
        self._ticks_above[:] = np.where(size > self.threshold, self._ticks_above + 1, 0)
        self._alarm[:] = (self._ticks_above >= self.persistence) | (
            self._alarm & (size > self.release * self.threshold)
        )

    # ---- what others read
    @property
    def residual(self) -> Vec:
        """r (nj,) [N m, N]: what is missing of the torques; a copy."""
        return self._r[self._model.nb :].copy()

    @property
    def missing(self) -> Vec:
        """What was missing in the last interval (nj,) [N m, N], before the lag: noisy, and on time; a copy."""
        return self._missing[self._model.nb :].copy()

    @property
    def command(self) -> Vec:
        """What was sent for the last interval (nj,) [N m, N]."""
        return self._command

    @property
    def known(self) -> Vec:
        """What was known to be missing of it (nj,) [N m, N]: by that much more is missing than :attr:`missing` says."""
        return self._known

    @property
    def push(self) -> Vec:
        """Wrench (6,) [N, N m] in the base's axes that pushes the base beyond what is known; (0,) on a fixed base."""
        return -self._r[: self._model.nb]

    @property
    def rows(self) -> Mat | None:
        """T (nv, nv) by which missing forces are made those of joints on a base that floats; None on a fixed one."""
        return self._rows

    def carry(self, load: Load, state: RobotState) -> None:
        """What this load's inertia takes from this state on is missing no longer; :class:`Carry` adds its weight."""
        regressor = LoadRegressor(load.frame, weight=False)
        regressor.step(state, 0.0)
        self._carried[load.frame] = regressor, load.parameters

    @property
    def alarm(self) -> NDArray[np.bool_]:
        """Which joints are missing torque (nj,); a copy."""
        return self._alarm.copy()

    def restart(self, joint: int) -> None:
        """Forget what joint ``joint`` has shown so far: its residual starts at zero again.

        Raises:
            InvalidInput: there is no such joint.
        """
        nb = self._model.nb
        if not 0 <= joint < self._model.nj:
            raise InvalidInput(f"joint is {joint}; there are joints 0 to {self._model.nj - 1}")
        if self._observer is not None:
            self._observer.restart(nb + joint)
        self._r[nb + joint], self._alarm[joint], self._ticks_above[joint] = 0.0, False, 0

    def signals(self) -> dict[str, Vec]:
        signals = {"residual": self._r[self._model.nb :], "alarm": self._alarm.astype(np.float64)}
        return signals | {"push": self.push} if self._model.nb else signals


def _positive(name: str, value: Any, *, finite: bool) -> Vec:
    numbers = checks.one_or_more(name, value, finite=finite)
    for i, number in np.ndenumerate(numbers):
        if not number > 0.0:
            raise InvalidInput(f"{name}{list(i) if i else ''} is {number:g}; it must be > 0")
    return numbers


def _each(name: str, value: Vec, nj: int) -> Vec:
    return checks.array(name, np.full(nj, value) if value.ndim == 0 else value, (nj,), finite=False)
