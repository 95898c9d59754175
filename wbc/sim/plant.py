"""Plant: what a command is done to. An exact integrator, rigid-body dynamics without contacts, or physics."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, final

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.errors import InvalidInput, NotSupported, SimulationError
from wbc.models.model import RobotModel
from wbc.models.poses import configuration
from wbc.stack.contact import Contact
from wbc.types import Vec, read_only


class Drive(Protocol):
    """The part of a command that a plant reads. It keeps its arrays, so a command may be delivered late."""

    @property
    def tau(self) -> Vec:
        """Joint torques (nj,) [N m, N]."""

    @property
    def a(self) -> Vec:
        """Accelerations (nv,) [rad/s², m/s²]."""

    @property
    def v(self) -> Vec:
        """Velocities (nv,) [rad/s, m/s]."""

    @property
    def q(self) -> Vec:
        """Configuration (nq,) at the end of the tick."""


@final
@dataclass(frozen=True, eq=False)
class Delivered:
    """What reaches the actuators, where it is not a controller's command: a :class:`Drive`."""

    tau: Vec
    a: Vec
    v: Vec
    q: Vec


class Plant(metaclass=TellsArguments):
    """A robot that moves: a true state (t, q, v), and ``step``, which lets it move for ``dt`` seconds.

    ``q`` and ``v`` are ordered as :mod:`wbc.types` says and are read-only; every step makes new ones. Time is
    start + k dt, so it does not drift. A plant begins at rest in the q0 of its model. ``takes`` is what of a command
    moves it: "velocity", "acceleration", "torque" or "position", which every level decides.
    """

    takes: str = "torque"

    def __init__(self, model: RobotModel, dt: float) -> None:
        self.model = checks.instance("model", model, RobotModel, "a robot from wbc.load(...)")
        self.dt = checks.number("dt", dt, low=0.0, strict=True)
        self._start, self._steps = 0.0, 0
        self._q = read_only(model.q0.copy())
        self._v = read_only(np.zeros(model.nv))
        self._pushed = np.zeros(3)

    @property
    def t(self) -> float:
        """Time [s]."""
        return self._start + self._steps * self.dt

    @property
    def q(self) -> Vec:
        """True configuration (nq,)."""
        return self._q

    @property
    def v(self) -> Vec:
        """True velocity (nv,)."""
        return self._v

    @property
    def pushed(self) -> Vec:
        """Sum (3,) of the forces that act in the next step [N], world axes."""
        return self._pushed

    @property
    def fallen(self) -> bool:
        """True if a floating-base robot has fallen or is falling; always False for a fixed base."""
        return False

    def missing(self, contacts: Iterable[Contact]) -> list[str]:
        """Names of the ``contacts`` that nothing of this plant can touch; none where a plant makes no forces itself."""
        del contacts
        return []

    def reset(self, q: Vec, v: Vec | None = None, *, t: float = 0.0) -> None:
        """Start again at configuration q (nq,), velocity v (nv,) (default: at rest), time t [s].

        Raises:
            InvalidInput: wrong shape, not finite, or a quaternion that is not of length 1 within 1e-6.
        """
        q = configuration(self.model, "q", q)
        v = np.zeros(self.model.nv) if v is None else checks.array("v", v, (self.model.nv,))
        self._start, self._steps = checks.number("t", t), 0
        self._pushed = np.zeros(3)
        self._place(q, v)
        self._q, self._v = read_only(q), read_only(v)

    def step(self, command: Drive) -> None:
        """Apply ``command`` for dt seconds. Pushes act during this one step.

        Raises:
            SimulationError: a command that is not finite, or a state that is not after the step.
        """
        self._q, self._v = (read_only(x) for x in self._advance(command))
        self._steps += 1
        self._pushed = np.zeros(3)
        if not (np.isfinite(self._q).all() and np.isfinite(self._v).all()):
            raise SimulationError(f"the plant diverged at t = {self.t:.4f} s: its state is not finite")

    def push(self, frame: str, force: Vec) -> None:
        """Let ``force`` (3,) [N, world axes] act on a link during the next step, at its centre of mass; forces add up.

        Raises:
            NotSupported: a plant without forces.
            UnknownFrame: no such frame.
        """
        raise NotSupported(f"{type(self).__name__} knows no forces, so nothing can push {frame!r}")

    def push_joints(self, tau: Vec) -> None:
        """Let torques ``tau`` (nj,) [N m, N] from outside act on the joints during the next step, whatever motors can.

        Raises:
            NotSupported: a plant without forces.
        """
        raise NotSupported(f"{type(self).__name__} knows no forces, so nothing can push its joints")

    def add_mass(self, frame: str, mass: float) -> None:
        """Fix a point mass [kg] to the origin of ``frame`` from now until the next ``reset``.

        Raises:
            NotSupported: a plant whose masses cannot change.
            UnknownFrame: no such frame.
        """
        raise NotSupported(f"{type(self).__name__} cannot change its masses, so none can be put on {frame!r}")

    def truth(self) -> Mapping[str, Vec | float]:
        """Truths about the last step that no sensor measures, by column name: numbers or arrays (k,), the same in every
        step, and none that a record has, such as ``q`` or ``plant.q``."""
        return {}

    def settings(self) -> dict[str, Any]:
        """Everything that decides how the plant moves, for a report."""
        return {"plant": type(self).__name__, "dt": self.dt}

    @abstractmethod
    def _place(self, q: Vec, v: Vec) -> None:
        """Put the robot there; the arguments have been checked."""

    @abstractmethod
    def _advance(self, command: Drive) -> tuple[Vec, Vec]:
        """(q, v) after dt seconds, in new arrays."""

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.model.name}, t={self.t:.4f})"


@final
class IntegratorPlant(Plant):
    """A robot that does exactly what it is told: no forces, no contacts.

        velocity        v' = command.v          q' = q ⊕ dt v'
        acceleration    v' = v + dt command.a   q' = q ⊕ dt (v + dt command.a / 2)

    Both are exact when the command is constant over the step (fixed base; on a floating base q' is exact to O(dt³)).

    Raises:
        InvalidInput: a level that is neither of the two.

    Example:
        >>> import wbc
        >>> from wbc.sim.plant import IntegratorPlant
        >>> plant = IntegratorPlant(wbc.load("arm"), dt=1e-3, level="velocity")
        >>> plant.reset(plant.model.q0)
    """

    def __init__(self, model: RobotModel, *, dt: float = 1e-3, level: str = "acceleration") -> None:
        super().__init__(model, dt)
        self.level = self.takes = checks.one_of("level", level, ("velocity", "acceleration"))

    def _place(self, q: Vec, v: Vec) -> None:
        """An integrator has no other memory than q and v."""

    def _advance(self, command: Drive) -> tuple[Vec, Vec]:
        if self.level == "velocity":
            v = finite("command.v", command.v, self.t)
            return self.model.integrate(self._q, self.dt * v), v.copy()
        a = finite("command.a", command.a, self.t)
        step = self.dt * self._v + 0.5 * self.dt**2 * a
        return self.model.integrate(self._q, step), self._v + self.dt * a

    def settings(self) -> dict[str, Any]:
        return {**super().settings(), "level": self.level}


@final
class ForwardDynamicsPlant(Plant):
    """Rigid-body dynamics without contacts, from the model's own M and h: for arms and for robots in free flight.

        M a = Sᵀ tau − h        v' = v + dt a        q' = q ⊕ dt (v + v')/2

    integrated with ``substeps`` equal steps, torques held constant. Torque limits, joint stops, friction and pushes
    do not exist here.

    Example:
        >>> import wbc
        >>> from wbc.sim.plant import ForwardDynamicsPlant
        >>> plant = ForwardDynamicsPlant(wbc.load("arm"), dt=1e-3)
    """

    def __init__(self, model: RobotModel, *, dt: float = 1e-3, substeps: int = 1) -> None:
        super().__init__(model, dt)
        self.substeps = whole("substeps", substeps)
        self._state = model.state()
        self._outside = np.zeros(model.nj)

    def _place(self, q: Vec, v: Vec) -> None:
        self._outside[:] = 0.0

    def push_joints(self, tau: Vec) -> None:
        self._outside += checks.array("tau", tau, (self.model.nj,))

    def _advance(self, command: Drive) -> tuple[Vec, Vec]:
        model, state, h = self.model, self._state, self.dt / self.substeps
        q, v = self._q, self._v
        torque = np.zeros(model.nv)
        torque[model.nb :] = finite("command.tau", command.tau, self.t) + self._outside
        self._outside[:] = 0.0
        for _ in range(self.substeps):
            state.update(self.t, q, v)
            a = cho_solve(cho_factor(state.M), torque - state.h)
            q, v = model.integrate(q, h * v + 0.5 * h**2 * a), v + h * a
        return q, v

    def settings(self) -> dict[str, Any]:
        return {**super().settings(), "substeps": self.substeps}


def whole(name: str, value: Any) -> int:
    """``value`` as a whole number of at least 1.

    Raises:
        InvalidInput: anything else.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not 1 <= value < 2**31:
        raise InvalidInput(f"{name} is {value!r}; it must be a whole number, at least 1 and less than 2^31")
    return int(value)


def finite(name: str, values: Vec, t: float) -> Vec:
    """``values`` themselves.

    Raises:
        SimulationError: one of them is not finite.
    """
    if not np.isfinite(values).all():
        i = int(np.argmin(np.isfinite(values)))
        raise SimulationError(f"{name}[{i}] is {values[i]} at t = {t:.4f} s; a plant moves on finite numbers only")
    return values
