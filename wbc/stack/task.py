"""Task: a wish. It says where it is, not what to do about it; the level it is used at lowers it."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from copy import copy
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel, RobotState
from wbc.stack.frame_rows import FrameRows, JointRows
from wbc.stack.member import Member
from wbc.types import Mat, Vec

if TYPE_CHECKING:
    from wbc.stack.reaction import Reaction
    from wbc.stack.within import Within


class TaskRows:
    """Where a kinematic task writes: views into the plan's own memory, ``dim`` rows.

    e (dim,)          error, target − actual; of a pose ``linear`` is e[:3] and ``angular`` e[3:]
    J (dim, nv)       Jacobian of the actual value
    drift (dim,)      J̇ v; read at the acceleration level only
    rate_ref (dim,)   velocity of the target, zero unless written
    acc_ref (dim,)    acceleration of the target, zero unless written
    ed (dim,)         rate of the error; left alone it is rate_ref − J v, which the plan computes for all tasks at once

    Assign with ``out.e[:] = …``: the arrays stay, their contents change.
    """

    __slots__ = ("J", "_e", "acc_ref", "angular", "drift", "ed", "linear", "rate_ref")

    J: Mat
    linear: Vec
    angular: Vec
    ed: Vec
    drift: Vec
    rate_ref: Vec
    acc_ref: Vec

    @property
    def e(self) -> Vec:
        """The error."""
        return self._e

    @e.setter
    def e(self, e: Vec) -> None:
        self._e, self.linear, self.angular = e, e[:3], e[3:]


class LinearRows:
    """Where a linear task writes: A (dim, size of its quantity) and b (dim,), wished A y = b."""

    __slots__ = ("A", "b")

    A: Mat
    b: Vec


class Objective(Member):
    """Anything that can stand among the tasks of a stack: a name, a weight, a switch.

    ``weight`` is a scalar or one number per row and multiplies the squared error: the cost is
    ½ Σ wᵢ rᵢ². ``weight`` and ``active`` may be assigned between ticks; sizes may not change.
    """

    dim: int
    units: str | tuple[str, ...]
    #: What rows are called in reports.
    labels: Sequence[str] = ()
    # Defaults at class level, so that a subclass which forgets super().__init__ still works.
    _name: str | None = None
    _weight: float | Vec = 1.0
    _active: bool = True
    #: Whether it may be done in part, all its rows alike; see :meth:`Task.scaled`.
    is_scaled: bool = False

    def __init__(self, *, name: str | None = None, weight: Any = 1.0) -> None:
        self._name = name
        self.weight = weight

    @property
    def name(self) -> str:
        """Given, or the class and what it acts on."""
        given = "" if self._name is None else checks.text("name", self._name)
        return given or self._default_name()

    def _default_name(self) -> str:
        subject = checks.text(f"the subject of {type(self).__name__}", getattr(self, "subject", ""))
        return f"{type(self).__name__}[{subject}]" if subject else type(self).__name__

    @property
    def weight(self) -> float | Vec:
        """Weight of the squared error, scalar or (dim,)."""
        return self._weight

    @weight.setter
    def weight(self, value: Any) -> None:
        if checks.ndim(value) == 0:
            self._weight = checks.number(f"{self.name}.weight", value, low=0.0)
        else:
            weights = checks.array(f"{self.name}.weight", value, (getattr(self, "dim", None),))
            if (weights < 0).any():
                i = int(np.argmax(weights < 0))
                raise InvalidInput(f"{self.name}.weight[{i}] is {weights[i]:g}; a weight is >= 0")
            weights.flags.writeable = False  # assign to change it: writing into it would go unseen
            self._weight = weights

    @property
    def active(self) -> bool:
        """Whether the task counts among the wishes; as a law (``exactly``) it holds whatever this says."""
        return self._active

    @active.setter
    def active(self, value: bool) -> None:
        self._active = bool(value)

    def weights(self) -> Vec:
        """The weight of each row (dim,), zero when inactive."""
        weights = self._rows("weight", self._weight)
        return weights if self._active else np.zeros(self.dim)

    def _rows(self, what: str, value: float | Vec) -> Vec:
        """``value`` for each row (dim,), a copy. A vector given before ``dim`` was known is checked here."""
        if checks.ndim(value) == 0:
            return np.full(self.dim, value)
        return checks.array(f"{self.name}.{what}", value, (self.dim,))

    def unit(self, row: int) -> str:
        """Unit of one row of the error."""
        return self.units if isinstance(self.units, str) else self.units[row]

    def label(self, row: int) -> str:
        """What one row is called in reports."""
        return self.labels[row] if self.labels else ""

    def prepare(self, model: RobotModel) -> None:
        """Called once on each plan's own copy of the task: check arguments against the model, fix ``dim``.

        What depends on the model is written here and nowhere else, so that one task serves plans of several robots.
        """

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        """Instances that make sense on ``model``, for the contract tests; to be written where arguments are needed."""
        del model
        return [cls()]

    def __repr__(self) -> str:
        return f"{self.name}(weight={self._weight}{', scaled' if self.is_scaled else ''})"


class Task(Objective):
    """A kinematic task: error e, Jacobian J, drift J̇ v and the target's rate and acceleration.

    Velocity level:      J v = ẏ_ref + rate · e
    Acceleration level:  J a = ÿ_ref + kd ė + kp e − J̇ v

    kp [1/s²] and kd [1/s] (default critical, 2 √kp) act at the acceleration level, rate [1/s] (default
    kp / kd; 1/dt reaches the target in one tick) at the velocity level; scalar or per row. One object
    therefore serves all levels. Subclasses set ``dim`` and ``units`` in ``__init__`` and write one method, ``fill``.
    """

    #: True for tasks whose Jacobian is the identity on the joints, (nj,) rows: they write e, rate_ref, acc_ref only.
    on_joints: ClassVar[bool] = False
    _kp: float | Vec = 100.0
    _kd: float | Vec | None = None
    _rate: float | Vec | None = None

    def __init__(
        self, *, kp: Any = 100.0, kd: Any = None, rate: Any = None, weight: Any = 1.0, name: str | None = None
    ) -> None:
        super().__init__(name=name, weight=weight)
        self._kp = self._gain("kp", kp)
        self._kd = None if kd is None else self._gain("kd", kd)
        self._rate = None if rate is None else self._gain("rate", rate)

    @property
    def kp(self) -> float | Vec:
        """Gain on the error [1/s²]; may be assigned between ticks, as may ``kd`` and ``rate``."""
        return self._kp

    @kp.setter
    def kp(self, value: Any) -> None:
        self._kp = self._gain("kp", value)

    @property
    def kd(self) -> float | Vec | None:
        """Gain on the error's rate [1/s]; None: critical, 2 √kp."""
        return self._kd

    @kd.setter
    def kd(self, value: Any) -> None:
        self._kd = None if value is None else self._gain("kd", value)

    @property
    def rate(self) -> float | Vec | None:
        """Gain at the velocity level [1/s]; None: kp / kd."""
        return self._rate

    @rate.setter
    def rate(self, value: Any) -> None:
        self._rate = None if value is None else self._gain("rate", value)

    def _gain(self, what: str, value: Any) -> float | Vec:
        if checks.ndim(value) == 0:
            return checks.number(f"{self.name}.{what}", value, low=0.0)
        gains = checks.array(f"{self.name}.{what}", value, (getattr(self, "dim", None),))
        if (gains < 0).any():
            raise InvalidInput(f"{self.name}.{what}[{int(np.argmax(gains < 0))}] is negative")
        gains.flags.writeable = False
        return gains

    def gains(self) -> tuple[Vec, Vec, Vec]:
        """kp, kd and rate of each row, (dim,) each; a rate is infinite where kp > 0 and kd = 0 and none was given."""
        kp = self._rows("kp", self._kp)
        kd = 2.0 * np.sqrt(kp) if self._kd is None else self._rows("kd", self._kd)
        if self._rate is not None:
            rate = self._rows("rate", self._rate)
        else:
            rate = np.divide(kp, kd, out=np.where(kp > 0, np.inf, 0.0), where=kd > 0)
        return kp, kd, rate

    @abstractmethod
    def fill(self, state: RobotState, out: TaskRows) -> None:
        """Write e and J (and drift, rate_ref, acc_ref) for this state. Pure: filled twice, same bits."""

    def compiled_rows(self) -> FrameRows | JointRows | None:
        """What compiled code may write in the place of ``fill``; None: it calls ``fill``."""
        return None

    def exactly(self, *, name: str | None = None) -> Exactly:
        """The same task as a law: its rows hold exactly, above every weight."""
        return Exactly(self, name=name)

    def with_reaction(self, *, force_weight: float = 0.0, name: str | None = None) -> Reaction:
        """The same task as a part of the mechanism, for ``contacts``: its rows hold exactly, by a force that the
        dynamics know and ``command.f`` gives. See :class:`~wbc.stack.reaction.Reaction`."""
        from wbc.stack.reaction import Reaction

        return Reaction(self, force_weight=force_weight, name=name)

    def within(
        self, lower: Any, upper: Any = None, *, rate: float = 10.0, slack: float | None = None, name: str | None = None
    ) -> Within:
        """The same task as an interval: lower <= e <= upper, scalar or (dim,), in the units of e; one number: ±that.

        A control barrier function at every level, for ``subject_to``; ``rate`` and ``slack`` as
        :class:`~wbc.stack.constraint.Barrier` has them, infinite bounds are none. See
        :class:`~wbc.stack.within.Within`.
        """
        from wbc.stack.within import Within

        return Within(self, lower, upper, rate=rate, slack=slack, name=name)

    def scaled(self) -> Self:
        """The same task done as a whole or in part, never sideways: a copy with ``is_scaled``.

        With t what the gains ask for, J x + drift = s t for one s in [0, 1] as near to 1 as can be: where limits bite
        the direction is kept and the size gives way. The drift J̇ v is never scaled, it is there whatever is asked.
        Keeping the direction stands above the wishes of its level, (1 − s) t is weighed as any residual. Source:
        Flacco, De Luca, Khatib, IEEE T-RO 31(3), 2015.
        """
        same = copy(self)
        same.is_scaled = True
        return same


class Exactly(Member):
    """A task turned into a law (an equality); made by ``task.exactly()``, used in ``subject_to``."""

    def __init__(self, task: Task, *, name: str | None = None) -> None:
        if task.on_joints and name is None:
            name = f"{task.name} exactly"
        self.task = task
        self._name = name

    @property
    def name(self) -> str:
        """Name of the law."""
        return self._name or f"{self.task.name} exactly"

    def prepare(self, model: RobotModel) -> None:
        self.task.prepare(model)

    def __repr__(self) -> str:
        return self.name


class LinearTask(Objective):
    """A wish A y = b on a quantity y: joint torques (``"torque"``, nj), accelerations (``"acceleration"``, nv) or the
    wrench of one contact (``"force"``, its ``dim``), or of several, one behind the other. ``fill`` writes out.A, out.b.

    A weighted norm ½ |y − y₀|²_Q is one, with A = Lᵀ, b = Lᵀ y₀, Q = L Lᵀ.
    """

    on: ClassVar[str]
    #: For ``on = "force"``: the name or frame of the contact, or of several.
    contact: str | tuple[str, ...] = ""

    def exactly(self, *, name: str | None = None) -> Any:
        """The same task as a law: A y = b holds exactly, above every weight."""
        from wbc.stack.constraint import exactly

        return exactly(self, name=name or f"{self.name} exactly")

    @abstractmethod
    def fill(self, state: RobotState, out: LinearRows) -> None:
        """Write A (dim, size) and b (dim,) for this state. Pure."""


def force_of(member: Any) -> tuple[str, ...]:
    """Names or frames of the contacts whose force a task or law is about; none for most."""
    member = getattr(member, "law", member)  # a soft law is about what its law is about
    if getattr(member, "on", None) != "force":
        return ()
    contact: str | tuple[str, ...] = member.contact
    return (contact,) if isinstance(contact, str) else contact
