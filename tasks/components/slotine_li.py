"""SlotineLi: adaptive control: tracks a joint motion without knowing the masses."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput, NotSupported
from wbc.models.model import RobotModel, RobotState
from wbc.stack.component import Component
from wbc.stack.overrides import Overrides
from wbc.types import Mat, Vec

from ..torque import Torque
from .adaptive_law import InertialLaw, law_of, spread
from .excitation import Excitation
from .prediction import Prediction
from .reference import JointReference, TaskReference

if TYPE_CHECKING:
    from wbc.stack.plan_view import PlanView


@final
class SlotineLi(Component):
    """Adaptive control of a robot whose dynamics are linear in unknown coefficients a (p,), M q̈ + c + g = Y a.

        e = q_d − q,  v_r = v_d + Λ e,  a_r = a_d + Λ ė,  s = v_r − v,   Λ = K_D⁻¹ K_P
        τ_SL = Y(q, v, v_r, a_r) â + K_P e + K_D ė,        â̇ = Γ Yᵀ s

    It gives the stack the task τ = τ_SL through its task :attr:`torque`, which belongs among the stack's tasks; with no
    limit active the command is τ_SL. No acceleration is measured and no M̂ inverted, so â may start at zero. e and ė go
    to zero for every smooth bounded q_d, while â need not converge to a: only the coefficients that q_d excites are
    identified.

    Planar robots have few coefficients, and nothing but their regressor is used of the model. An arm from a URDF, on a
    fixed base, has ten numbers a link (:class:`wbc.models.inertial_regressor.InertialRegressor`) that start as the
    model has them. They are projected onto physically possible bodies, exactly in the metric of which ``gain`` is a
    multiple. :attr:`base_parameters` are their combinations that affect torques.

    The Lyapunov function V of docs/methods.md falls along every motion while no limit is active; if a limit changes
    τ_SL, the difference acts as a disturbance.

    Args:
        target: the motion: joint positions (nj,), or a function of time giving (positions, velocities, accelerations).
            With ``frame``: a pose, or a function of time giving (pose, twist, acceleration) as
            :class:`~tasks.frame.Frame` takes it; v_r = J⁺ (ẋ_d + Λ e) with Λ = ``rate`` [1/s], and joints that are
            spare go back to ``model.q0``; K_P e then is left out, τ_SL = Y â + K_D s.
        kp, kd: diagonals of K_P [N/m, N m/rad] and K_D, a number or (nj,).
        gain: Γ, a number, (p,) or symmetric positive definite (p, p); of an arm a number.
        a_hat: â at the start, a number or (p,); default 0 on planar robots, the model's on arms.
        physical: on planar robots, keep â among the coefficients that masses can have, by a QP in the metric Γ⁻¹.
        truth: a (p,), for the signal V alone.
        links: names or patterns of the joints whose links are adapted, default all; a payload is in the last.
        friction_gain: adapts viscous and Coulomb friction of each joint, if positive.
        composite: κ [1/N² m²]: the prediction error ε = τ_F − W â of torques filtered with ``filter`` [1/s] also
            adapts, â̇ = Γ (Yᵀ s + κ Wᵀ ε); no acceleration is needed for it.
        leakage: σ [1/s]: â is drawn back to its start, â̇ −= σ (â − â(0)); bounded under any disturbance.
        dead_zone: [rad/s, m/s]: below this |s| nothing is adapted, as noise alone would do it.
        window: of the excitation [s]; with it the signal ``excitation`` is the smallest eigenvalue of the mean of YᵀY
            over about that time, of the independent columns: 0, and something cannot be identified.
        estimate_floor: [kg m², kg]: where positive, the plan computes with M̂ and ĥ instead of the model's, so that
            limits and other tasks know the payload; in ticks in which an eigenvalue of M̂ is below it, with the model's.
        weight: of the torque task; so high that the regularisation of a level cannot be seen.

    :attr:`frozen` may be set: while it is, â stays as it is.

    Signals: ``a_hat`` (p,), ``s`` (nj,), ``V`` (NaN without ``truth``), ``tau`` (nj,), which is τ_SL; on arms
    ``smallest``, the smallest eigenvalue of a pseudo-inertia [kg], ``excitation`` and ``estimate_used``, 0 or 1.
    Source: J.-J. E. Slotine, W. Li, Int. J. Robotics Research 1987; Wensing, Kim, Slotine, IEEE RA-L 2018.

    Raises:
        InvalidInput: when a stack is compiled: sizes or signs; its task without it among the components, or it without
            its task among the tasks.
        NotSupported: then too, a model without a regressor, or with ``physical`` one that has no linear description
            of the possible coefficients.

    Example:
        >>> import wbc
        >>> from wbc.tasks import SlotineLi
        >>> from wbc.models import Planar4P
        >>> adaptive = SlotineLi([0.1, 0.2, 0.0, 0.0], kp=50.0, kd=20.0, gain=2.0)
        >>> stack = wbc.Stack([adaptive.torque], components=[adaptive])
        >>> robot = Planar4P()
        >>> command = wbc.Controller(robot, stack, level=wbc.InverseDynamics()).tick(0.0, robot.q0, 0 * robot.q0)
        >>> command.tau.round(6).tolist()
        [5.0, 10.0, 0.0, 0.0]
    """

    def __init__(
        self, target: Any, *, kp: Any, kd: Any, gain: Any, a_hat: Any = None, physical: bool = False, truth: Any = None,
        frame: str | None = None, rate: float = 10.0, links: Sequence[str] | None = None, friction_gain: float = 0.0,
        composite: float = 0.0, filter: float = 20.0, leakage: float = 0.0, dead_zone: float = 0.0,
        window: float = 0.0, estimate_floor: float = 0.0, length: float = 0.3, floor: float = 1e-6,
        weight: float = 1e6, name: str | None = None,
    ) -> None:  # fmt: skip
        super().__init__(name=name)
        self.target, self.frame = target, frame
        self.physical = checks.truth(f"{self.name}.physical", physical)
        self._given = {"kp": kp, "kd": kd, "gain": gain, "a_hat": a_hat, "truth": truth}
        numbers = {
            "friction_gain": friction_gain, "composite": composite, "leakage": leakage, "dead_zone": dead_zone,
            "window": window, "estimate_floor": estimate_floor,
        }  # fmt: skip
        self._numbers = {what: checks.number(f"{self.name}.{what}", x, low=0.0) for what, x in numbers.items()}
        positive = {"rate": rate, "filter": filter, "length": length, "floor": floor}
        self._numbers |= {
            what: checks.number(f"{self.name}.{what}", x, low=0.0, strict=True) for what, x in positive.items()
        }
        self._links = links
        #: Whether â stays as it is.
        self.frozen = False
        #: The task that asks for τ_SL, which is its target in each tick.
        self.torque = Torque(0.0, weight=weight, name=f"{self.name} torque")
        self.torque.set_by = self

    def prepare(self, model: RobotModel) -> None:
        number, n = self._numbers, model.nj
        self._law = law_of(
            self.name, model, physical=self.physical, gain=self._given["gain"], start=self._given["a_hat"],
            links=self._links, friction_gain=number["friction_gain"], length=number["length"], floor=number["floor"],
        )  # fmt: skip
        inertial = self._law if isinstance(self._law, InertialLaw) else None
        if inertial is None and (number["composite"] or number["window"] or number["estimate_floor"] or self.frame):
            raise NotSupported(
                f"{self.name}: composite, window, estimate_floor and frame are for robots from URDFs; "
                f"{model.name} is planar"
            )
        self._arm = inertial
        self._kp, self._kd = self._diagonal("kp", n), self._diagonal("kd", n)
        p = len(self._law.start)
        truth = self._given["truth"]
        self._truth = None if truth is None else spread(f"{self.name}.truth", truth, p)
        if self.frame is None:
            self._reference: JointReference | TaskReference = JointReference(
                f"{self.name}.target", self.target, model, self._kp / self._kd
            )
        else:
            self._reference = TaskReference(f"{self.name}.target", self.target, model, self.frame, number["rate"])
        self._excitation = Excitation(inertial, number["window"]) if inertial and number["window"] else None
        self._prediction = Prediction(inertial, number["filter"]) if inertial and number["composite"] else None
        self._s, self._tau, self._V, self._used = np.zeros(n), np.zeros(n), np.nan, False
        #: The regressor of a tick whose state is not learnt from yet.
        self._Y: Mat | None = None

    def reset(self, state: RobotState) -> None:
        self._law.reset()
        self._Y = None
        for memory in (self._excitation, self._prediction):
            if memory is not None:
                memory.reset()

    def check(self, plan: PlanView) -> None:
        if not any(task.name == self.torque.name for task in plan.stack.tasks):
            raise InvalidInput(f"{self.name}.torque is not among the stack's tasks: it asks for the torques")

    def before(self, state: RobotState, last: object, plan: PlanView) -> Overrides:
        e, e_rate, v_r, a_r = self._reference.at(state)
        self._s = v_r - state.v
        self._Y = Y = self._law.regressor(state.q, state.v, v_r, a_r)
        feedback = self._kd * self._s if e is None else self._kp * e + self._kd * e_rate
        self._tau = Y @ self._law.a_hat + self._law.rotors * a_r + feedback
        self._dt = plan.dt
        self._V = self._lyapunov(state, e)
        asked = {self.torque.name: {"target": self._tau}}
        if self._arm is None or not self._numbers["estimate_floor"]:
            return Overrides(tasks=asked)
        bias, inertia = self._estimate(state, self._arm)
        self._used = inertia is not None
        return Overrides(tasks=asked, bias=bias, inertia=inertia)

    def after(self, state: RobotState, command: Any) -> None:
        Y, self._Y = self._Y, None
        if Y is None or not np.isfinite(self._tau).all():
            if self._prediction is not None:  # its filters have not seen this tick
                self._prediction.reset()
            return
        gradient = Y.T @ self._s
        if self._excitation is not None:
            self._excitation.add(Y, self._dt)
        if self._prediction is not None:
            W, off = self._prediction.error(state, command.tau, self._law.a_hat, self._dt)
            gradient[: W.shape[1]] += self._numbers["composite"] * (W.T @ off)
        if self.frozen or np.linalg.norm(self._s) < self._numbers["dead_zone"]:
            return
        if self._numbers["leakage"]:
            # Back along the straight line to the start: both ends are possible, and so is what lies between.
            fraction = min(self._numbers["leakage"] * self._dt, 1.0)
            self._law.a_hat = self._law.a_hat + fraction * (self._law.start - self._law.a_hat)
        self._law.step(gradient, self._dt)

    def _estimate(self, state: RobotState, arm: InertialLaw) -> tuple[Vec | None, Mat | None]:
        """ĥ − h and M̂ − M, if M̂ is positive definite with the floor. Friction is no part of h."""
        off = arm.a_hat[: arm.p_links] - arm.inertial.parameters
        more = arm.inertial.inertia(state.q, off)
        if not np.linalg.eigvalsh(state.M + more)[0] >= self._numbers["estimate_floor"]:
            return None, None
        return arm.inertial(state.q, state.v, state.v, np.zeros_like(state.v)) @ off, more

    # ---- what others read
    @property
    def a_hat(self) -> Vec:
        """What the coefficients are thought to be now (p,); a copy."""
        return self._law.a_hat.copy()

    @property
    def parameter_names(self) -> Sequence[str]:
        """What each of them is."""
        return self._law.names

    @property
    def base_parameters(self) -> Vec:
        """What of the adapted links' parameters shows in torques (b,).

        Raises:
            NotSupported: on planar robots, all of whose coefficients show.
        """
        if self._arm is None:
            raise NotSupported(f"{self.name}: all coefficients of a planar robot are base parameters already: a_hat")
        result: Vec = self._arm.grouping @ self._arm.a_hat[self._arm.adapted]
        return result

    def signals(self) -> dict[str, Vec | float]:
        found: dict[str, Vec | float] = {"a_hat": self._law.a_hat, "s": self._s, "V": self._V, "tau": self._tau}
        if self._arm is not None:
            found["smallest"] = self._arm.smallest
            found["excitation"] = np.nan if self._excitation is None else self._excitation.smallest
            found["estimate_used"] = float(self._used)
        return found

    def _lyapunov(self, state: RobotState, e: Vec | None) -> float:
        if self._truth is None:
            return float("nan")
        off, rest = self._truth - self._law.a_hat, np.zeros_like(self._s)
        # M s of the true robot: what the regressor gives for an acceleration s, less gravity.
        regressor = self._law.regressor
        Y_inertia = regressor(state.q, rest, rest, self._s) - regressor(state.q, rest, rest, rest)
        stretched = 0.0 if e is None else float(e @ (self._kp * e))
        M_s = Y_inertia @ self._truth + self._law.rotors * self._s
        return float(0.5 * self._s @ M_s) + stretched + 0.5 * self._law.squared(off)

    def _diagonal(self, what: str, size: int) -> Vec:
        values = spread(f"{self.name}.{what}", self._given[what], size)
        for i, value in enumerate(values):
            if value <= 0.0:
                raise InvalidInput(f"{self.name}.{what}[{i}] is {value:g}; it must be > 0")
        return values
