"""SlotineLi: track a motion of the joints without knowing the masses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, final

import numpy as np

from tasks.torque import Torque
from wbc import checks
from wbc.errors import InvalidInput, NotSupported
from wbc.methods import ParameterUpdate
from wbc.models.model import RobotModel, RobotState
from wbc.models.planar import PlanarRobot
from wbc.stack.component import Component
from wbc.stack.task import Target
from wbc.stack.tracking import joints_target
from wbc.types import Vec

if TYPE_CHECKING:
    from wbc.stack.plan import Plan


@final
class SlotineLi(Component):
    """Adaptive control of a robot whose dynamics are linear in unknown coefficients a (p,), M q̈ + c + g = Y a.

        e = q_d − q,  v_r = v_d + Λ e,  a_r = a_d + Λ ė,  s = v_r − v,   Λ = K_D⁻¹ K_P
        τ_SL = Y(q, v, v_r, a_r) â + K_P e + K_D ė,        â̇ = Γ Yᵀ s

    It gives the stack the wish τ = τ_SL through its task :attr:`torque`, which belongs among the stack's tasks; with no
    limit active the command is τ_SL. No acceleration is measured and no M̂ inverted, so â may start at zero. e and ė go
    to zero for every smooth bounded q_d, while â need not go to a: only what q_d excites is identified. Of the model,
    the regressor Y alone is used; whatever its masses are, they say nothing here.

    V = ½ sᵀ M s + eᵀ K_P e + ½ (a − â)ᵀ Γ⁻¹ (a − â) falls along every motion, V̇ = −ėᵀ K_D ė − eᵀ K_P Λ e, while no
    limit is active; what a limit takes away from τ_SL acts as a disturbance.

    Args:
        target: the motion: joint positions (nj,), or a function of time giving (positions, velocities, accelerations).
        kp, kd: diagonals of K_P [N/m, N m/rad] and K_D, a number or (nj,).
        gain: Γ, a number, (p,) or symmetric positive definite (p, p).
        a_hat: â at the start, a number or (p,).
        physical: keep â among the coefficients that masses can have, by a quadratic program in the metric Γ⁻¹.
        truth: a (p,), for the signal V alone.
        weight: of the torque task; so high that the regularisation of a level cannot be seen.

    Signals: ``a_hat`` (p,), ``s`` (nj,), ``V`` (NaN without ``truth``), ``tau`` (nj,), which is τ_SL.
    Source: J.-J. E. Slotine, W. Li, Int. J. Robotics Research 1987.

    Raises:
        InvalidInput: sizes or signs; NotSupported: a model without a regressor, or with ``physical`` one that has no
            linear description of what is possible. All when a stack is compiled.

    Example:
        >>> import wbc
        >>> from tasks import SlotineLi
        >>> from wbc.models import Planar4P
        >>> adaptive = SlotineLi([0.1, 0.2, 0.0, 0.0], kp=50.0, kd=20.0, gain=2.0)
        >>> stack = wbc.Stack([adaptive.torque], components=[adaptive])
        >>> robot = Planar4P()
        >>> command = wbc.Controller(robot, stack, level=wbc.InverseDynamics()).tick(0.0, robot.q0, 0 * robot.q0)
        >>> command.tau.round(6).tolist()
        [5.0, 10.0, 0.0, 0.0]
    """

    def __init__(
        self, target: Any, *, kp: Any, kd: Any, gain: Any, a_hat: Any = 0.0, physical: bool = False, truth: Any = None,
        weight: float = 1e6, name: str | None = None,
    ) -> None:  # fmt: skip
        super().__init__(name=name)
        self.target, self.physical = target, physical
        self._given = {"kp": kp, "kd": kd, "gain": gain, "a_hat": a_hat, "truth": truth}
        self._tau: Vec | float = 0.0
        #: The task that asks for τ_SL.
        self.torque = Torque(lambda t: self._tau, weight=weight, name=f"{self.name} torque")

    def prepare(self, model: RobotModel) -> None:
        if not isinstance(model, PlanarRobot):
            raise NotSupported(f"{self.name} needs a model with a regressor, a planar robot; {model.name} has none")
        self._model, n, p = model, model.nj, len(model.coefficients)
        self._kp, self._kd = self._diagonal("kp", n), self._diagonal("kd", n)
        self._ratio = self._kp / self._kd
        gain = np.asarray(self._given["gain"], dtype=np.float64)
        self._gain = checks.array(f"{self.name}.gain", gain, (p,) * gain.ndim) if gain.ndim else gain
        self._start = self._vector("a_hat", p)
        self._truth = None if self._given["truth"] is None else self._vector("truth", p)
        self._possible: tuple[Any, Any] = model.possible_coefficients() if self.physical else (None, None)
        self._reference = Target(f"{self.name}.target", self.target, n, joints_target(model, n))
        self._adapted(np.zeros((n, p)), np.zeros(n), self._start)  # refuses a gain or a start that makes no sense
        self._a_hat, self._s, self._V = self._start.copy(), np.zeros(n), np.nan

    def reset(self, state: RobotState) -> None:
        self._a_hat = self._start.copy()

    def before(self, state: RobotState, last: object, plan: Plan) -> None:
        wanted = self._reference.at(state.t)
        e, e_rate = wanted.value - state.q, wanted.rate - state.v
        v_r, a_r = wanted.rate + self._ratio * e, wanted.second + self._ratio * e_rate
        self._s = v_r - state.v
        self._Y = self._model.regressor(state.q, state.v, v_r, a_r)
        self._tau = self._Y @ self._a_hat + self._kp * e + self._kd * e_rate
        self._dt = plan.dt
        self._V = self._lyapunov(state, e)

    def after(self, state: RobotState, command: object) -> None:
        if np.isfinite(self._tau).all():
            self._a_hat = self._adapted(self._Y, self._s, self._a_hat).step(self._dt)

    @property
    def a_hat(self) -> Vec:
        """What the coefficients are thought to be now (p,); a copy."""
        return self._a_hat.copy()

    def signals(self) -> dict[str, Vec | float]:
        return {"a_hat": self._a_hat, "s": self._s, "V": self._V, "tau": self._tau}

    def _adapted(self, Y: Any, s: Vec, a_hat: Vec) -> ParameterUpdate:
        return ParameterUpdate(Y, s, gain=self._gain, a_hat=a_hat, C=self._possible[0], d=self._possible[1])

    def _lyapunov(self, state: RobotState, e: Vec) -> float:
        if self._truth is None:
            return float("nan")
        off, rest = self._truth - self._a_hat, np.zeros_like(e)
        # M s of the true robot: what the regressor gives for an acceleration s, less gravity.
        regressor = self._model.regressor
        Y_inertia = regressor(state.q, rest, rest, self._s) - regressor(state.q, rest, rest, rest)
        scaled = np.linalg.solve(self._gain, off) if self._gain.ndim == 2 else off / self._gain
        return float(0.5 * self._s @ Y_inertia @ self._truth + e @ (self._kp * e) + 0.5 * off @ scaled)

    def _vector(self, what: str, size: int) -> Vec:
        value = self._given[what]
        return checks.array(f"{self.name}.{what}", np.full(size, value) if np.ndim(value) == 0 else value, (size,))

    def _diagonal(self, what: str, size: int) -> Vec:
        values = self._vector(what, size)
        for i, value in enumerate(values):
            if value <= 0.0:
                raise InvalidInput(f"{self.name}.{what}[{i}] is {value:g}; it must be > 0")
        return values
