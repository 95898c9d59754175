"""Constraint: an equality or inequality that every solution meets, above all weights and levels of the stack.

There are four kinds:

* :class:`JointInterval`     bounds on each joint's position, velocity, acceleration, jerk or torque; the plan composes
                             them into one interval per joint that is never empty
* :class:`Barrier`           h(q) >= 0, kept by a control barrier function at every level
* :class:`LinearConstraint`  lo <= A y <= hi on velocities, accelerations, torques or one contact's wrench
* ``task.exactly()``         any task as an equality (:class:`~wbc.stack.task.Exactly`)

:class:`Constraints` are several of them under one name. The first three may also be objectives: ``constraint.softly()``
(:class:`Softly`) stands among the tasks.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar, Literal, final

from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel, RobotState
from wbc.stack.member import EFFORTS, Member, setting
from wbc.stack.objective import Objective
from wbc.stack.task_rows import FilledRows
from wbc.types import Index, Mat, Vec

Quantity = Literal["position", "velocity", "acceleration", "jerk", "torque"]


class Constraint(Member):
    """A constraint with a name. ``subject`` (a frame, a contact) makes the default name."""

    #: Weight of the constraint's slack, above every level; None: it has none and holds exactly. See :class:`Barrier`.
    slack: float | None = None
    read_once = frozenset({"slack"})

    def __init__(self, *, name: str | None = None) -> None:
        self._name = None if name is None else checks.text("name", name)

    def label(self, row: int) -> str:
        return str(row) if getattr(self, "dim", 1) > 1 else ""

    def softly(self, *, weight: Any = 1.0, name: str | None = None) -> Softly:
        """The same constraint as an objective for the tasks of a stack: it may be violated at a cost."""
        return Softly(self, weight=weight, name=name)


class Constraints(Constraint):
    """Several constraints that stand in a stack as one."""

    @abstractmethod
    def constraints(self, carried: frozenset[str]) -> Sequence[Constraint]:
        """The constraints, on a level where the quantities ``carried`` of a joint may be limited."""


class JointInterval(Constraint):
    """Bounds on one quantity of every joint, (nj,) each; they belong to the settings, not to the state. They are read
    when a stack is compiled: from then on no setting may be assigned."""

    quantity: ClassVar[Quantity]
    #: Deceleration [rad/s², m/s²] a constraint on positions counts on; None leaves it to the composition.
    braking: float | None = None

    @abstractmethod
    def bounds(self, model: RobotModel) -> tuple[Vec, Vec]:
        """Lower and upper bound (nj,) each, ±inf where there is none.

        Raises:
            InvalidInput: a limit that makes no sense, by joint name.
        """

    def _assign(self, name: str, value: Any) -> None:
        if name in self._settings - self.read_once and self.__dict__.get("_ties"):
            raise InvalidInput(
                f"{self.name}.{name}: a controller has read the bounds; give controller.replace a stack with another "
                f"{type(self).__name__}, or narrow them by a component"
            )
        super()._assign(name, value)


def bounds_of(limit: JointInterval, model: RobotModel) -> Mat:
    """Lower and upper bounds (2, nj) of a limit, a copy.

    Raises:
        InvalidInput: they are no numbers for each joint, by the limit's name.
    """
    return checks.array(f"{limit.name}.bounds()", limit.bounds(model), (2, model.nj), finite=False)


class TorqueBySpeed(JointInterval):
    """Bounds on each joint's torque that move with its velocity."""

    quantity: ClassVar[Quantity] = "torque"

    @abstractmethod
    def narrow(self, v: Vec, lower: Vec, upper: Vec) -> None:
        """Narrow torque bounds (nj,) in place for joint velocities v (nj,); 0 stays inside."""


class BarrierRows(FilledRows):
    """Where a barrier writes: h (dim,), its Jacobian J = ∂h/∂q (dim, nv), and where h depends on time also by itself
    rate = ∂h/∂t (dim,), zero unless written; drift (dim,) is d²h/dt² at a = 0, which is J̇ v for most."""

    __slots__ = ("J", "drift", "h", "rate")

    J: Mat
    h: Vec
    drift: Vec
    rate: Vec


class Barrier(Constraint):
    """h(q, t) >= 0, a control barrier function. ``rate`` γ [1/s] says how fast h may approach zero.

    Velocity level:      ḣ >= −γ h              ḣ = J v + ∂h/∂t
    Acceleration level:  ḧ >= −2 γ ḣ − γ² h     ḧ = J a + drift   (relative degree 2, both poles at γ)

    Outside the set (h < 0) the same rows lead back at the rate γ. That may be more than torques and contacts can give,
    so with a ``slack`` weight the rows have a slack: s is taken off the right side, in 1/s or 1/s² of h's unit, at the
    cost ½ slack s². It stands above every level and task; ``slack=None`` makes the rows exact.

    Subclasses set ``dim`` and ``units`` and write ``fill``. Source: Ames et al., ECC 2019; Nguyen, Sreenath, ACC 2016.
    """

    #: Numbers (dim,) of what each row is about now, where that changes from tick to tick; recorded beside the margins.
    codes: Index | None = None
    #: What the state that was filled last has and the rows do not say, for ``controller.why``; mostly nothing.
    note: str = ""

    def reset(self) -> None:
        """Called when a controller starts: forget what rows were about."""

    def __init__(self, *, rate: float = 10.0, slack: float | None = None, name: str | None = None) -> None:
        super().__init__(name=name)
        self.rate = rate
        self.slack = None if slack is None else self._positive("slack", slack)

    def _positive(self, what: str, value: Any) -> float:
        return checks.number(f"{self.name}.{what}", value, low=0.0, strict=True)

    rate = setting("rate", "γ [1/s]: how fast h may approach zero.", _positive)

    @abstractmethod
    def fill(self, state: RobotState, out: BarrierRows) -> None:
        """Write h, J and drift (and rate) for this state. Pure."""

    def about(self, row: int) -> str:
        """The subject of a row, in the state of the last fill; for most members it is always the label."""
        return self.label(row)


class ConstraintRows(FilledRows):
    """Where a linear constraint writes: A (dim, size of its quantity), lo and hi (dim,)."""

    __slots__ = ("A", "hi", "lo")

    A: Mat
    lo: Vec
    hi: Vec


class LinearConstraint(Constraint):
    """lo <= A y <= hi for y the velocities, accelerations (nv), torques (nj) or wrenches of contacts."""

    on: ClassVar[Literal["velocity", "acceleration", "torque", "force"]]
    #: For ``on = "force"``: the name or frame of the contact, or of several, whose wrenches stand one behind the other.
    contact: str | tuple[str, ...] = ""

    @abstractmethod
    def fill(self, state: RobotState, out: ConstraintRows) -> None:
        """Write A, lo and hi for this state. Pure."""


@final
class Softly(Objective):
    """A soft constraint: ½ Σ wᵢ sᵢ² for the least s with lo <= A y + s <= hi; made by
    ``softly()``.

    The cost is zero while the constraint holds, so it does not affect the tasks beside and below it. Under
    :class:`~wbc.stack.hierarchy.Strict` it is an inequality at its level: no level below can increase its violation.

    y is what the constraint bounds in the QP. Limits on a joint's motion bound the level's unknown, so that their s is
    in rad/s (m/s) at the velocity level, and in rad/s² (m/s²) at the others; a ``LinearConstraint`` keeps its own unit.

    Source: Kanoun, Lamiraux, Wieber, IEEE T-RO 27(4), 2011.

    Example:
        >>> import wbc
        >>> from wbc.tasks import JointVelocityLimits, Position
        >>> slowly = JointVelocityLimits(0.1).softly(weight=10.0)
        >>> wbc.Stack([[slowly], [Position("tool", target=[0.4, 0.2, 0.5])]], subject_to=[JointVelocityLimits()])
        Stack
          level 1: JointVelocityLimits softly(weight=10.0)
          level 2: Position[tool](weight=1.0)
          subject to: JointVelocityLimits
    """

    read_once = frozenset({"constraint"})

    def __init__(self, constraint: Constraint, *, weight: Any = 1.0, name: str | None = None) -> None:
        self.constraint = constraint
        super().__init__(name=name or f"{constraint.name} softly", weight=weight)

    def prepare(self, model: RobotModel) -> None:
        constraint = self.constraint
        constraint.prepare(model)
        if isinstance(constraint, JointInterval):
            suffix = {"position": "", "velocity": "/s", "acceleration": "/s²", "torque": ""}[constraint.quantity]
            names = [EFFORTS[unit] if constraint.quantity == "torque" else unit + suffix for unit in model.joint_units]
            self.dim, self.units, self.labels = model.nj, tuple(names), model.joint_names
        elif isinstance(constraint, Barrier | LinearConstraint):
            self.dim, self.units = constraint.dim, constraint.units
            self.labels = [constraint.label(i) for i in range(constraint.dim)]
