"""ExactPlant: rigid-body dynamics integrated so finely that what is seen is the method, not the integrator."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, final

from scipy.linalg import cho_factor, cho_solve

from wbc.errors import NotSupported
from wbc.models.model import RobotModel
from wbc.sim.plant import Drive, Plant, finite
from wbc.stack.formulation import InverseDynamics
from wbc.types import Vec


@final
class ExactPlant(Plant):
    """M(q) a + h(q, v) = τ + Jᵀ F on a fixed base, by Runge and Kutta's fourth order; τ is constant over a step.

    ``wrench`` F(t) (6,) [N, N m], world axes, acts at the origin of ``frame`` all the time.

    Raises:
        NotSupported: a floating base. UnknownFrame: no such frame.
    """

    def __init__(
        self, model: RobotModel, *, dt: float = 1e-3, frame: str = "", wrench: Callable[[float], Any] | None = None
    ) -> None:
        super().__init__(model, dt)
        if model.nb:
            raise NotSupported(f"an exact plant needs a fixed base; {model.name} has a floating one")
        if wrench is not None:
            model.check_frame(frame)
        self._state, self._frame, self._wrench = model.state(), frame, wrench

    def acceleration(self, t: float, q: Vec, v: Vec, tau: Vec) -> Vec:
        """a (nv,) at time t [s] in the state (q, v) under the torques τ (nv,)."""
        state = self._state
        state.update(t, q, v)
        force = tau - state.h
        if self._wrench is not None:
            force = force + self._wrench(t) @ state.frame(self._frame).jacobian()
        a: Vec = cho_solve(cho_factor(state.M), force)
        return a

    def _place(self, q: Vec, v: Vec) -> None:
        """The dynamics have no other memory than q and v."""

    def _advance(self, command: Drive) -> tuple[Vec, Vec]:
        tau, t, h = finite("command.tau", command.tau, self.t), self.t, self.dt
        q, v = self._q, self._v
        a1 = self.acceleration(t, q, v, tau)
        v2 = v + 0.5 * h * a1
        a2 = self.acceleration(t + 0.5 * h, q + 0.5 * h * v, v2, tau)
        v3 = v + 0.5 * h * a2
        a3 = self.acceleration(t + 0.5 * h, q + 0.5 * h * v2, v3, tau)
        v4 = v + h * a3
        a4 = self.acceleration(t + h, q + h * v3, v4, tau)
        return q + h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4), v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)

    def settings(self) -> dict[str, Any]:
        return {**super().settings(), "scheme": "Runge-Kutta 4", "wrench at": self._frame}


#: Inverse dynamics with a regularisation below all that is looked at on such a plant.
EXACT = InverseDynamics(regularisation=1e-11)
