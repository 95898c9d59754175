"""Level: the quantity that the QP decides (velocities, accelerations or torques), and its settings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from wbc import checks


@dataclass(frozen=True, kw_only=True)
class Level:
    """Which quantities are the unknowns.

    ``regularisation`` ½ ε ‖x‖² is on every unknown, and printed, never hidden. ``lm_damping`` λ >= 0 is the factor of
    the Levenberg-Marquardt damping of joints that grows with the part of the errors that cannot be reduced, and that
    leads to rest where a target is out of reach (:class:`~wbc.stack.damping.ResidualDamping`), level by level where
    levels are ranked; 0 for none.
    """

    regularisation: float = 1e-8
    lm_damping: float = 0.05

    #: Differentiation order of the unknown: 1 velocities, 2 accelerations.
    order: ClassVar[int]
    #: Whether torques and contact forces exist at this level.
    dynamics: ClassVar[bool]
    #: What the level is called in messages.
    name: ClassVar[str]
    #: Quantities that constraints and linear tasks may be written on.
    carries: ClassVar[frozenset[str]]

    def __post_init__(self) -> None:
        checks.number("regularisation", self.regularisation, low=0.0, strict=True)
        checks.number("lm_damping", self.lm_damping, low=0.0)

    @property
    def bounds(self) -> frozenset[str]:
        """Quantities of a joint that may be limited. Where velocities are decided, an acceleration is the change from
        the measured one."""
        return self.carries | {"position", "acceleration", "jerk"}
