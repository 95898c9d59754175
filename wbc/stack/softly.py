"""Softly: a law among the wishes. An inequality that may be broken, at its level and by its weight."""

from __future__ import annotations

from typing import Any, final

from wbc.models.model import RobotModel
from wbc.stack.constraint import Barrier, Constraint, JointInterval, LinearConstraint
from wbc.stack.task import Objective


@final
class Softly(Objective):
    """A law that may be broken: ½ Σ wᵢ sᵢ² for the least s with lo <= A y + s <= hi; made by ``law.softly()``.

    It costs nothing where the law holds, so it leaves the tasks beside and below it alone. Under
    :class:`~wbc.stack.hierarchy.Strict` it is an inequality at its level: what it can be kept to is never given up for
    a level below. Source: Kanoun, Lamiraux, Wieber, IEEE T-RO 27(4), 2011.

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

    def __init__(self, law: Constraint, *, weight: Any = 1.0, name: str | None = None) -> None:
        self.law = law
        super().__init__(name=name or f"{law.name} softly", weight=weight)

    def prepare(self, model: RobotModel) -> None:
        law = self.law
        law.prepare(model)
        if isinstance(law, JointInterval):
            suffix = {"position": "", "velocity": "/s", "acceleration": "/s²", "torque": ""}[law.quantity]
            effort = {"m": "N", "rad": "N m"}
            names = [effort[unit] if law.quantity == "torque" else unit + suffix for unit in model.joint_units]
            self.dim, self.units, self.labels = model.nj, tuple(names), model.joint_names
        elif isinstance(law, Barrier | LinearConstraint):
            self.dim, self.units = law.dim, law.units
            self.labels = [law.label(i) for i in range(law.dim)]
