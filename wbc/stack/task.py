"""Task: an objective. It says where it is, not what to do about it; the level it is used at lowers it."""

from __future__ import annotations

from abc import abstractmethod
from copy import copy
from typing import Any, ClassVar, Self, final

import numpy as np

from wbc.models.model import RobotModel, RobotState
from wbc.stack.by_name import ByName
from wbc.stack.constraint import ConstraintRows, LinearConstraint
from wbc.stack.member import Member
from wbc.stack.objective import Objective
from wbc.stack.reaction import Reaction
from wbc.stack.task_rows import TaskRows
from wbc.stack.within import Within
from wbc.types import Mat, Vec

__all__ = ["Exactly", "LinearExactly", "LinearRows", "LinearTask", "Objective", "Task", "TaskRows", "force_of"]


class LinearRows:
    """Where a linear task writes: A (dim, size of its quantity) and b (dim,), for A y = b."""

    __slots__ = ("A", "b")

    A: Mat
    b: Vec


class Task(Objective):
    """A kinematic task: error e, Jacobian J, drift J̇ v and the target's rate and acceleration.

    Velocity level:      J v = ẏ_ref + rate · e
    Acceleration level:  J a = ÿ_ref + kd ė + kp e − J̇ v

    kp [1/s²] and kd [1/s] (default critical, 2 √kp) act at the acceleration level, rate [1/s] (default
    kp / kd; 1/dt reaches the target in one tick) at the velocity level; given as ``weight`` is. One object
    therefore serves all levels. Subclasses set ``dim`` and ``units`` in ``__init__`` and write one method, ``fill``.
    """

    #: True for tasks whose Jacobian is the identity on the joints, (nj,) rows: they write e, rate_ref, acc_ref only.
    on_joints: ClassVar[bool] = False
    _kp: float | Vec | ByName = 100.0
    _kd: float | Vec | ByName | None = None
    _rate: float | Vec | ByName | None = None

    def __init__(
        self, *, kp: Any = 100.0, kd: Any = None, rate: Any = None, weight: Any = 1.0, name: str | None = None
    ) -> None:
        super().__init__(name=name, weight=weight)
        self._kp = self._numbers("kp", kp)
        self._kd = None if kd is None else self._numbers("kd", kd)
        self._rate = None if rate is None else self._numbers("rate", rate)

    @property
    def kp(self) -> float | Vec | ByName:
        """Gain on the error [1/s²]; may be assigned between ticks, as may ``kd`` and ``rate``."""
        return self._kp

    @kp.setter
    def kp(self, value: Any) -> None:
        self._kp = self._numbers("kp", value)

    @property
    def kd(self) -> float | Vec | ByName | None:
        """Gain on the error's rate [1/s]; None: critical, 2 √kp."""
        return self._kd

    @kd.setter
    def kd(self, value: Any) -> None:
        self._kd = None if value is None else self._numbers("kd", value)

    @property
    def rate(self) -> float | Vec | ByName | None:
        """Gain at the velocity level [1/s]; None: kp / kd."""
        return self._rate

    @rate.setter
    def rate(self, value: Any) -> None:
        self._rate = None if value is None else self._numbers("rate", value)

    def gains(self) -> tuple[Vec, Vec, Vec]:
        """kp, kd and rate of each row, (dim,) each; a rate is infinite where kp > 0 and kd = 0 and none was given."""
        kp = self._rows("kp", self._kp)
        kd = self._or("kd", self._kd, 2.0 * np.sqrt(kp))
        rate = np.divide(kp, kd, out=np.where(kp > 0, np.inf, 0.0), where=kd > 0)
        return kp, kd, self._or("rate", self._rate, rate)

    def _or(self, what: str, value: float | Vec | ByName | None, otherwise: Vec) -> Vec:
        """A gain of each row (dim,), ``otherwise`` of those for which none was given."""
        if value is None:
            return otherwise
        rows = self._rows(what, value)
        return np.where(np.isnan(rows), otherwise, rows)

    @abstractmethod
    def fill(self, state: RobotState, out: TaskRows) -> None:
        """Write e and J (and drift, rate_ref, acc_ref) for this state. Pure: filled twice, same bits."""

    def _as_constraint(self) -> Task:
        """The rows that hold where the task is a constraint."""
        return self

    def exactly(self, *, name: str | None = None) -> Exactly:
        """The same task as a constraint: its rows hold exactly, above every weight."""
        return Exactly(self._as_constraint(), name=name)

    def with_reaction(self, *, force_weight: float = 0.0, name: str | None = None) -> Reaction:
        """The same task as a part of the mechanism, for ``contacts``: its rows hold exactly, by a force that the
        dynamics know and ``command.f`` gives. See :class:`~wbc.stack.reaction.Reaction`."""
        return Reaction(self._as_constraint(), force_weight=force_weight, name=name)

    def within(
        self, lower: Any, upper: Any = None, *, rate: float = 10.0, slack: float | None = None, name: str | None = None
    ) -> Within:
        """The same task as an interval: lower <= e <= upper, scalar or (dim,), in the units of e; one number: ±that.

        A control barrier function at every level, for ``subject_to``; ``rate`` and ``slack`` as
        :class:`~wbc.stack.constraint.Barrier` has them, infinite bounds are none. See
        :class:`~wbc.stack.within.Within`.
        """
        return Within(self._as_constraint(), lower, upper, rate=rate, slack=slack, name=name)

    def scaled(self) -> Self:
        """The same task done as a whole or in part, never sideways: a copy with ``is_scaled``.

        With t what the gains ask for, J x + drift = s t for one s in [0, 1] as near to 1 as can be: where limits bite
        the direction is kept and the size is reduced. The drift J̇ v is never scaled, it is there whatever is asked.
        Keeping the direction stands above the other tasks of its level, (1 − s) t is weighed as any residual. Source:
        Flacco, De Luca, Khatib, IEEE T-RO 31(3), 2015.
        """
        same = copy(self)
        same.is_scaled = True
        return same


class Exactly(Member):
    """A task turned into a constraint (an equality); made by ``task.exactly()``, used in ``subject_to``."""

    def __init__(self, task: Task, *, name: str | None = None) -> None:
        if task.on_joints and name is None:
            name = f"{task.name} exactly"
        self.task = task
        self._name = name

    @property
    def name(self) -> str:
        """Name of the constraint."""
        return self._name or f"{self.task.name} exactly"

    def prepare(self, model: RobotModel) -> None:
        self.task.prepare(model)

    def __repr__(self) -> str:
        return self.name


class LinearTask(Objective):
    """A task A y = b on a quantity y: joint torques (``"torque"``, nj), accelerations (``"acceleration"``, nv) or the
    wrench of one contact (``"force"``, its ``dim``), or of several, one behind the other. ``fill`` writes out.A, out.b.

    A weighted norm ½ |y − y₀|²_Q is one, with A = Lᵀ, b = Lᵀ y₀, Q = L Lᵀ.
    """

    on: ClassVar[str]
    #: For ``on = "force"``: the name or frame of the contact, or of several.
    contact: str | tuple[str, ...] = ""

    def exactly(self, *, name: str | None = None) -> LinearConstraint:
        """The same task as a constraint: A y = b holds exactly, above every weight."""
        return LinearExactly(self, name or f"{self.name} exactly")

    @abstractmethod
    def fill(self, state: RobotState, out: LinearRows) -> None:
        """Write A (dim, size) and b (dim,) for this state. Pure."""


@final
class LinearExactly(LinearConstraint):
    """A linear task turned into a constraint: lo = hi = b."""

    def __init__(self, task: LinearTask, name: str) -> None:
        super().__init__(name=name)
        self.task = task
        self.contact = task.contact

    @property
    def on(self) -> Any:  # type: ignore[override]
        """What the task is about."""
        return self.task.on

    def prepare(self, model: RobotModel) -> None:
        self.task.prepare(model)
        self.dim, self._rows = self.task.dim, LinearRows()
        self.units = tuple(self.task.unit(i) for i in range(self.dim))

    def fill(self, state: RobotState, out: ConstraintRows) -> None:
        self._rows.A, self._rows.b = out.A, out.lo
        self.task.fill(state, self._rows)
        out.hi[:] = out.lo


def force_of(member: Any) -> tuple[str, ...]:
    """Names or frames of the contacts whose force a task or constraint is about; none for most."""
    member = getattr(member, "constraint", member)  # a soft constraint is about what its constraint is about
    if getattr(member, "on", None) != "force":
        return ()
    contact: str | tuple[str, ...] = member.contact
    return (contact,) if isinstance(contact, str) else contact
