"""Formulation: at which level a stack is solved, and so what the unknowns are."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, final

from wbc import checks
from wbc.models.model import RobotModel
from wbc.stack.stack import Stack

if TYPE_CHECKING:
    from wbc.stack.plan import Plan


@dataclass(frozen=True, kw_only=True)
class Formulation(ABC):
    """A level.

    ``regularisation`` ½ ε ‖x‖² is on every unknown, and printed, never hidden. ``lm_damping`` λ >= 0 is the factor of
    the Levenberg-Marquardt damping of joints that grows with the part of the errors that cannot be reduced, and that
    leads to rest where a target is out of reach (:class:`~wbc.stack.damping.ResidualDamping`), under ``Weighted``; 0
    for none.
    """

    regularisation: float = 1e-8
    lm_damping: float = 0.05

    #: Differentiation order of the unknown: 1 velocities, 2 accelerations.
    order: ClassVar[int]
    #: Whether torques and contact forces exist at this level.
    dynamics: ClassVar[bool]
    #: What the level is called in messages.
    name: ClassVar[str]

    def __post_init__(self) -> None:
        checks.number("regularisation", self.regularisation, low=0.0, strict=True)
        checks.number("lm_damping", self.lm_damping, low=0.0)

    @property
    @abstractmethod
    def carries(self) -> frozenset[str]:
        """Quantities that laws and linear tasks may be written on at this level."""

    @property
    def bounds(self) -> frozenset[str]:
        """Quantities of a joint that may be limited. Where velocities are decided, an acceleration is the change from
        the measured one."""
        return self.carries | {"position", "acceleration", "jerk"}

    @final
    def compile(self, model: RobotModel, stack: Stack, *, dt: float, like: Plan | None = None) -> Plan:
        """Decide names, sizes, views and constant rows; see :class:`~wbc.stack.plan.Plan`.

        ``like``: the plan of all contacts, whose memory a plan of fewer contacts shares.

        Raises:
            NotSupported: a task or law this level cannot carry, by name.
            UnknownFrame, InvalidInput: an argument the model contradicts.
            Infeasible: rows that contradict each other in every state, by name.
        """
        from wbc.stack.contradiction import refuse_contradictions
        from wbc.stack.plan import Plan

        plan = Plan(model, stack, self, dt, like)
        if like is None:  # fewer contacts contradict no more, and share memory with a plan that may be at work
            refuse_contradictions(plan)
        return plan


@final
@dataclass(frozen=True, kw_only=True)
class VelocityLevel(Formulation):
    """Unknown v (nv,). Kinematic tasks as J v = ẏ_ref + rate · e; contacts do not move; no forces."""

    order: ClassVar[int] = 1
    dynamics: ClassVar[bool] = False
    name: ClassVar[str] = "velocity level"

    @property
    def carries(self) -> frozenset[str]:
        return frozenset({"velocity"})


@final
@dataclass(frozen=True, kw_only=True)
class AccelerationLevel(Formulation):
    """Unknown a (nv,). Kinematic tasks as J a = ÿ_ref + kd ė + kp e − J̇ v; no dynamics, no forces."""

    order: ClassVar[int] = 2
    dynamics: ClassVar[bool] = False
    name: ClassVar[str] = "acceleration level"

    @property
    def carries(self) -> frozenset[str]:
        return frozenset({"velocity", "acceleration"})


@final
@dataclass(frozen=True, kw_only=True)
class InverseDynamics(Formulation):
    """Unknowns a (nv,) and the contact forces f (nf,). Torques are never unknowns: τ = S (M a + h − Jᵀ f) is a row.

    The six rows of a floating base, M_b a + h_b − J_bᵀ f = 0, determine the base acceleration and are eliminated by
    the default solver. Source: Herzog et al., Autonomous Robots 2016; Del Prete et al., RA-L 2018.
    """

    order: ClassVar[int] = 2
    dynamics: ClassVar[bool] = True
    name: ClassVar[str] = "inverse dynamics"

    @property
    def carries(self) -> frozenset[str]:
        return frozenset({"velocity", "acceleration", "torque", "force"})
