"""Command: what a tick decided, with its status and its proof."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol, final

import numpy as np

from wbc.errors import UnknownContact, WbcError
from wbc.qp.certificate import Certificate
from wbc.types import Status, Vec, read_only

if TYPE_CHECKING:
    from wbc.models.model import RobotModel
    from wbc.qp.rows import Outcome, RowSolver
    from wbc.qp.solver import Solution


#: A certificate, or what makes it when it is read.
Proof = Certificate | Callable[[], Certificate]

_WITHOUT_LEVELS = frozenset(("relaxed", "closed form", "hold", "damped"))


class UnknownForce(UnknownContact, KeyError):
    """No such contact among those whose force a command has."""

    __str__ = Exception.__str__  # KeyError would put the sentence in quotes


@final
class Forces(dict[str, Vec]):
    """Contact wrenches by the contact's name, or by its frame where no other contact has the same; force before moment,
    axes of the surface (z normal)."""

    def __init__(self, wrenches: dict[str, Vec], frames: dict[str, str]) -> None:
        super().__init__(wrenches)
        self._frames = frames

    def __missing__(self, key: str) -> Vec:
        if key in self._frames:
            return self[self._frames[key]]
        raise UnknownForce(key, [*self, *self._frames])

    def __contains__(self, key: object) -> bool:
        return super().__contains__(key) or key in self._frames

    def get(self, key: str, default: Any = None) -> Any:
        """The wrench of a contact or frame, or ``default``."""
        return self[key] if key in self else default


class Owner(Protocol):
    """The controller of a command: what is still to be computed is computed by it."""

    model: RobotModel
    serial: int
    is_new: bool
    answering: RowSolver

    @property
    def dt(self) -> float:
        """Time between ticks [s]."""

    @property
    def split_forces(self) -> Callable[[Vec | None], Forces]:
        """Makes contact forces (nf,) wrenches by contact name."""

    def solution(self) -> Solution:
        """Of the last tick's QP."""


@final
class Command:
    """One tick's answer: torques, accelerations, velocities, contact wrenches, next configuration.

    tau (nj,) [N m], a (nv,), v (nv,) and q (nq,) reached at the end of the tick, f by contact. Values that the level
    does not decide are NaN. ``status.ok``: the problem of the tick was solved, and a certificate proves it.
    ``fallback_level`` says where the command comes from: "solved" or "other solver" where the status is ok; else "not
    certified", "not optimised", "weighted fallback", "relaxed", "closed form", "hold" or "damped"
    (:mod:`wbc.control.recovery`). ``certificate`` says by how much limits are exceeded and, in ``certificate.bounds``,
    how far each task can be from its optimum [unit of the task]. ``levels`` is the result of each level of a strict
    hierarchy, with its own certificate (:class:`~wbc.qp.rows.Outcome`). Arrays are the command's own, stay valid, and
    are read-only.
    """

    __slots__ = (
        "_a", "_before", "_certificate", "_controller", "_f", "_forces", "_levels", "_q", "_serial", "_solution",
        "_split_forces", "_tau", "_v", "fallback_level", "status",
    )  # fmt: skip

    # ``v``, ``a`` and ``tau`` come as arrays that cannot be written: this runs in every tick.
    def __init__(  # noqa: PLR0917 - passing keywords takes half as long again as all that is done here
        self,
        controller: Owner,
        status: Status,
        fallback_level: str,
        certificate: Proof,
        moment: Vec,
        v: Vec | None = None,
        a: Vec | None = None,
        tau: Vec | None = None,
        forces: Vec | tuple[Callable[[Vec, Vec], Vec], Vec, Vec] | None = None,
    ) -> None:
        self._controller: Owner | None = controller
        self._split_forces = controller.split_forces
        self._serial = controller.serial
        self.status, self.fallback_level, self._certificate = status, fallback_level, certificate
        self._levels: tuple[Outcome, ...] | Callable[[], tuple[Outcome, ...]] = controller.answering.report
        #: q and v (nq + nv,) of the tick. Bytes: they are rarely read, and an array takes twice as long to copy.
        self._before = moment.tobytes()
        self._v, self._a, self._tau, self._forces = v, a, tau, forces
        self._q: Vec | None = None
        self._f: Forces | None = None
        self._solution: Solution | None = None

    def __getstate__(self) -> tuple[None, dict[str, Any]]:
        """The values alone: a copy, or a pickle, is apart from the controller."""
        made = ("certificate", "levels", "tau", "a", "v", "q", "f", "forces")
        kept = ("_before", "_solution", "fallback_level", "status")
        values = {f"_{name}": getattr(self, name) for name in made} | {name: getattr(self, name) for name in kept}
        return None, values | {"_controller": None, "_serial": -1}

    @property
    def _owner(self) -> Owner:
        """The controller; a copy has none, and everything but a solution.

        Raises:
            WbcError: this is a copy.
        """
        if self._controller is None:
            raise WbcError("a command that was copied or unpickled has no solution; read command.solution before")
        return self._controller

    @property
    def certificate(self) -> Certificate:
        """By how much limits are exceeded, and how far each task can be from its optimum."""
        if not isinstance(self._certificate, Certificate):
            self._certificate = self._certificate()
        return self._certificate

    @property
    def levels(self) -> tuple[Outcome, ...]:
        """The result of each level; empty under ``Weighted``, or if no hierarchy solver made this command."""
        if not isinstance(self._levels, tuple):
            self._levels = () if self.fallback_level in _WITHOUT_LEVELS else self._levels()
        return self._levels

    @property
    def tau(self) -> Vec:
        """Joint torques (nj,) [N m; N on prismatic joints]; NaN at levels without dynamics."""
        if self._tau is None:
            self._tau = read_only(np.full(self._owner.model.nj, np.nan))
        return self._tau

    @property
    def a(self) -> Vec:
        """Acceleration (nv,); NaN at the velocity level."""
        # Not kept where there is none: ``q`` tells by it whether accelerations were decided.
        return read_only(np.full(self._owner.model.nv, np.nan)) if self._a is None else self._a

    @property
    def v(self) -> Vec:
        """Velocity (nv,) at the end of the tick: commanded, or v + a dt."""
        if self._v is None:
            owner = self._owner
            self._v = read_only(np.frombuffer(self._before, offset=8 * owner.model.nq) + owner.dt * self.a)
        return self._v

    @property
    def q(self) -> Vec:
        """Configuration (nq,) at the end of the tick: q ⊕ dt (v + ½ a dt), or q ⊕ dt v at the velocity level."""
        if self._q is None:
            model, dt = self._owner.model, self._owner.dt
            q, v = np.split(np.frombuffer(self._before), [model.nq])
            mean = self.v if self._a is None else v + 0.5 * dt * self._a
            self._q = read_only(model.integrate(q, dt * mean))
        return self._q

    @property
    def forces(self) -> Vec | None:
        """All contact forces (nf,) in the order of the stack's contacts; None where the level decides none."""
        if isinstance(self._forces, tuple):  # brought to newtons when they are read
            in_newtons, value, scale = self._forces
            self._forces = in_newtons(value, scale)
        return self._forces

    @property
    def f(self) -> Forces:
        """Wrench of each contact, by its name or frame; NaN where none was decided."""
        if self._f is None:
            self._f = self._split_forces(self.forces)
        return self._f

    @property
    def solution(self) -> Solution:
        """The QP's solution with multipliers and the full certificate; made on request.

        Raises:
            WbcError: the controller has ticked since, or has another stack; read it before.
        """
        if self._solution is None:
            if self._owner.serial != self._serial or self._owner.is_new:
                raise WbcError("the controller went on or began anew; read command.solution before the next tick")
            self._solution = self._owner.solution()
        return self._solution

    def __repr__(self) -> str:
        return f"Command({self.status}, {self.fallback_level}, {self.certificate})"
