"""Task: an objective. It computes an error, its Jacobian and its drift; the level makes rows of the QP of these.

Beside it stands what can be made of it: a constraint, an interval, a part of the mechanism.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from copy import copy
from typing import Any, ClassVar, Self, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel, RobotState
from wbc.stack.by_name import ByName
from wbc.stack.constraint import Barrier, BarrierRows
from wbc.stack.contact import Anchor, Contact
from wbc.stack.kernel_rows import KernelRows, kernel_rows_of
from wbc.stack.member import EFFORTS, Member, setting
from wbc.stack.objective import Objective
from wbc.stack.task_rows import FilledRows, TaskRows
from wbc.types import Index, Mat, Vec

__all__ = [
    "Exactly", "LinearRows", "LinearTask", "Objective", "Reaction", "Task", "TaskRows", "Within",
    "force_of",
]  # fmt: skip


class LinearRows(FilledRows):
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
        self.kp, self.kd, self.rate = kp, kd, rate

    def _optional(self, what: str, value: Any) -> float | Vec | ByName | None:
        return None if value is None else self._numbers(what, value)

    kp = setting("kp", "Gain on the error [1/s²].", Objective._numbers)
    kd = setting("kd", "Gain on the error's rate [1/s]; None: critical, 2 √kp.", _optional)
    rate = setting("rate", "Gain at the velocity level [1/s]; None: kp / kd.", _optional)

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

    def exactly(self, *, name: str | None = None) -> Exactly:
        """The same task as a constraint: its rows hold exactly, above every weight."""
        return Exactly(self, name=name)

    def with_reaction(self, *, force_weight: float = 0.0, name: str | None = None) -> Reaction:
        """The same task as a part of the mechanism, for ``contacts``: its rows hold exactly, by a force that the
        dynamics know and ``command.f`` gives. See :class:`Reaction`."""
        return Reaction(self, force_weight=force_weight, name=name)

    def within(
        self, lower: Any, upper: Any = None, *, rate: float = 10.0, slack: float | None = None, name: str | None = None
    ) -> Within:
        """The same task as an interval: lower <= e <= upper, scalar or (dim,), in the units of e; one number is ±.

        A control barrier function at every level, for ``subject_to``; ``rate`` and ``slack`` as
        :class:`~wbc.stack.constraint.Barrier` has them, infinite bounds are none. See
        :class:`Within`.
        """
        return Within(self, lower, upper, rate=rate, slack=slack, name=name)

    def scaled(self) -> Self:
        """A copy of the task that keeps its direction and is slowed where limits are active (``is_scaled``).

        With t the velocity or acceleration that the gains request, J x + drift = s t with one s in [0, 1], as near to 1
        as possible: where limits are active the direction is kept and the size is reduced. The drift J̇ v is not
        scaled. Keeping the direction has priority over the other tasks of its level; (1 − s) t has the weight of the
        task, as any residual. Source: Flacco, De Luca, Khatib, IEEE T-RO 31(3), 2015.
        """
        same = copy(self)
        same.__dict__["is_scaled"] = True
        return same


class Exactly(Member):
    """A task turned into a constraint (an equality); made by ``task.exactly()``, used in ``subject_to``."""

    read_once = frozenset({"task"})
    _says: Any = None

    def __init__(self, task: Task | LinearTask, *, name: str | None = None) -> None:
        self.task = task
        self._name = name or f"{task.name} exactly"

    @property
    def says(self) -> Any:
        """What writes the rows."""
        return self._says or self.task

    def prepare(self, model: RobotModel) -> None:
        self._says = self.task._as_constraint(model)


@final
class Within(Barrier):
    """lower <= e <= upper for the error e of a task, row by row; made by ``task.within(…)``.

    h = e − lower and upper − e, a row for each bound that is finite, with ḣ = ±(ẏ_ref − J v) and
    ḧ = ±(ÿ_ref − J a − J̇ v): a moving target moves the interval. For rows that are a rotation vector this is exact up
    to first order in the error. ``constraint.softly()`` makes it an objective again: a task that is content within a
    tolerance.

    Raises:
        InvalidInput: bounds that are not numbers; when a stack is compiled: bounds of another size, an empty interval,
            no finite bound, or one on a row with kp = 0, which is a velocity task and has no error.

    Example:
        >>> import wbc
        >>> from wbc.tasks import CenterOfMass
        >>> CenterOfMass(target=[0.0, 0.0, 0.8]).within(0.02)
        CenterOfMass within
    """

    read_once = frozenset({"task"})
    _says: Task

    def __init__(
        self, task: Task, lower: Any, upper: Any = None, *, rate: float = 10.0, slack: float | None = None,
        name: str | None = None,
    ) -> None:  # fmt: skip
        super().__init__(rate=rate, slack=slack, name=name or f"{task.name} within")
        self.task = task
        if upper is None:
            tolerance = checks.one_or_more(f"{self.name}.tolerance", lower, finite=False)
            lower, upper = -tolerance, tolerance
        self._given = tuple(
            checks.one_or_more(f"{self.name}.{which}", bound, finite=False)
            for which, bound in (("lower", lower), ("upper", upper))
        )

    def prepare(self, model: RobotModel) -> None:
        task = self._says = self.task._as_constraint(model)
        lower, upper = (
            checks.each(f"{self.name}.{which}", bound, task.dim, finite=False)
            for which, bound in zip(("lower", "upper"), self._given, strict=True)
        )
        if not (lower < upper).all():
            i = int(np.argmin(lower < upper))
            raise InvalidInput(f"{self.name}: row {i} is left nothing: lower {lower[i]:g}, upper {upper[i]:g}")
        below, above = np.flatnonzero(np.isfinite(lower)), np.flatnonzero(np.isfinite(upper))
        #: Of each row of the barrier: the row of the task, and whether it bounds e from below (+1) or above (−1).
        self._row: Index = np.concatenate([below, above])
        self._sign: Vec = np.repeat([1.0, -1.0], [len(below), len(above)])
        self._bound: Vec = np.concatenate([-lower[below], upper[above]])
        self.dim = len(self._row)
        if self.dim == 0:
            raise InvalidInput(f"{self.name} has no finite bound")
        velocities = np.flatnonzero(task.gains()[0][self._row] == 0.0)
        if velocities.size:
            i = int(self._row[velocities[0]])
            raise InvalidInput(
                f"{self.name}: row {i} has kp = 0, so it is a velocity task; its bounds must be infinite"
            )
        self.units = tuple(task.unit(int(i)) for i in self._row)
        self._out = out = TaskRows()
        for array in ("e", "ed", "drift", "rate_ref", "acc_ref"):
            setattr(out, array, np.zeros(task.dim))
        out.J = np.eye(model.nv)[model.nb :] if task.on_joints else np.zeros((task.dim, model.nv))

    def fill(self, state: RobotState, out: BarrierRows) -> None:
        rows, row, sign = self._out, self._row, self._sign
        rows.rate_ref[:], rows.acc_ref[:] = 0.0, 0.0
        self._says.fill(state, rows)
        out.h[:] = sign * rows.e[row] + self._bound
        out.J[:] = -sign[:, None] * rows.J[row]
        out.rate[:] = sign * rows.rate_ref[row]
        out.drift[:] = sign * (rows.acc_ref - rows.drift)[row]

    def kernel_rows(self) -> KernelRows | None:
        """Those of the task, where it has some."""
        return kernel_rows_of(self._says)

    def picked(self) -> tuple[TaskRows, Index, Vec, Vec]:
        """What the task writes, and of each row of the barrier (dim,) its row i there, and s and b of h = s eᵢ + b."""
        return self._out, self._row, self._sign, self._bound

    def label(self, row: int) -> str:
        """The row of the task, and which bound it is."""
        return f"{self._says.label(int(self._row[row]))} {'>=' if self._sign[row] > 0 else '<='}".strip()


@final
class Reaction(Contact):
    """The rows of a task as constraints that a force λ holds, M a + h = Sᵀ τ + Jᵀ λ; made by ``task.with_reaction()``.

    It stands in ``contacts``. A wheel that rolls, a gear with one motor, a brake on a joint: what the mechanism or the
    ground forbids costs no torque, where ``task.exactly()`` makes motors do it. λ is ``command.f[name]``, one number a
    row, N for metres and N m for radians, bounded by no cone; ``force_weight`` weighs ½ λ², by default nothing but the
    level's regularisation does.

    Example:
        >>> from wbc.tasks import JointCoupling
        >>> JointCoupling("elbow", to={"shoulder_pitch": -2.0}).with_reaction(name="gear")
        gear
    """

    bilateral = True
    #: Its task has gains and a target.
    read_once = frozenset({"kp", "kd", "target", "task"})
    _says: Task

    def __init__(self, task: Task, *, force_weight: float = 0.0, name: str | None = None) -> None:
        self.task = task
        # Nothing slips: friction is only asked of surfaces.
        super().__init__(task.name, friction=1.0, force_weight=force_weight, name=name or task.name)

    def prepare(self, model: RobotModel) -> None:
        self._says = self.task._as_constraint(model)
        self.dim = self._says.dim
        self._joints = np.eye(model.nv)[model.nb :] if self._says.on_joints else None

    def gains(self) -> tuple[Any, Any, Any]:
        """Those of the task."""
        return self._says.gains()

    def anchor(self, state: RobotState) -> Anchor:
        del state  # the target of the task says where
        return Anchor(np.eye(3), np.zeros(3))

    def kernel_rows(self) -> KernelRows | None:
        """Those of the task, where it has some."""
        return kernel_rows_of(self._says)

    def fill(self, state: RobotState, anchor: Anchor, out: TaskRows) -> None:
        del anchor
        if self._joints is not None:
            out.J[:], out.drift[:] = self._joints, 0.0
        self._says.fill(state, out)

    def cone(self) -> Mat:
        return np.zeros((0, self.dim))

    def cone_labels(self) -> list[tuple[str, str]]:
        return []

    def motion_units(self) -> list[str]:
        return [self._says.unit(i) for i in range(self.dim)]

    def motion_labels(self) -> Sequence[str]:
        """The task's."""
        return [self._says.label(i) for i in range(self.dim)]

    def force_labels(self) -> list[tuple[str, str]]:
        """The task's rows, in the unit whose product with theirs is an energy."""
        return [
            (label, EFFORTS.get(unit, f"J/({unit})"))
            for label, unit in zip(self.motion_labels(), self.motion_units(), strict=True)
        ]

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

    def exactly(self, *, name: str | None = None) -> Exactly:
        """The same task as a constraint: A y = b holds exactly, above every weight."""
        return Exactly(self, name=name)

    @abstractmethod
    def fill(self, state: RobotState, out: LinearRows) -> None:
        """Write A (dim, size) and b (dim,) for this state. Pure."""


def force_of(member: Any) -> tuple[str, ...]:
    """Names or frames of the contacts whose force a task or constraint is about; none for most."""
    member = getattr(member, "constraint", member)  # a soft constraint is about what its constraint is about
    member = member.task if isinstance(member, Exactly) else member
    if getattr(member, "on", None) != "force":
        return ()
    contact: str | tuple[str, ...] = member.contact
    return (contact,) if isinstance(contact, str) else contact
