"""Formulation: the level at which a stack is solved, which decides the unknowns of the QP."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, final

from wbc.arguments import TellsArguments
from wbc.errors import NotSupported
from wbc.models.model import RobotModel, RobotState
from wbc.stack.component import Component
from wbc.stack.hierarchy import Hierarchy, Weighted
from wbc.stack.level import Level
from wbc.stack.stack import Stack

if TYPE_CHECKING:
    from wbc.stack.plan import Plan


@dataclass(frozen=True, kw_only=True)
class Formulation(Level, metaclass=TellsArguments):
    """A level that makes plans of stacks."""

    @final
    def compile(
        self, model: RobotModel, stack: Stack, *, dt: float, hierarchy: Hierarchy | None = None,
        like: Plan | None = None, prepared: Sequence[Component] = (), state: RobotState | None = None,
    ) -> Plan:  # fmt: skip
        """Decide names, sizes, views and constant rows; see :class:`~wbc.stack.plan.Plan`.

        ``hierarchy``, by default ``Weighted()``, says what the levels mean: those above others are damped by
        themselves. ``like``: the plan of all contacts, whose memory a plan of fewer contacts shares. Components that
        are ``prepared`` go on as they are. ``state``, by default a new one, is what the plan is tried on and bound
        to.

        Raises:
            NotSupported: a task or constraint this level cannot carry, by name; dynamics of a robot that has none.
            UnknownFrame, InvalidInput: an argument the model contradicts.
            Infeasible: rows that contradict each other in every state, by name.
        """
        from wbc.stack.plan import Plan, refuse_contradictions

        if self.dynamics and model.weightless:
            raise NotSupported(
                f"{model.name}: no inertia moves with {', '.join(model.weightless)}, so there are no torques to find; "
                "use VelocityLevel(), or give the links mass or fix the joints in the robot's description"
            )
        for component in stack.components if like is None else ():
            if not any(component is one for one in prepared):
                component.prepare(model)
        state = model.state(drifts=self.order > 1) if state is None else state
        plan = Plan(model, stack, self, dt, state, hierarchy=hierarchy or Weighted(), like=like)
        if like is None:  # fewer contacts contradict no more, and share memory with a plan that may be at work
            refuse_contradictions(plan, state)
        return plan


@final
@dataclass(frozen=True, kw_only=True)
class VelocityLevel(Formulation):
    """Unknown v (nv,). Kinematic tasks as J v = ẏ_ref + rate · e; contacts do not move; no forces."""

    order: ClassVar[int] = 1
    dynamics: ClassVar[bool] = False
    name: ClassVar[str] = "velocity level"
    carries: ClassVar[frozenset[str]] = frozenset({"velocity"})


@final
@dataclass(frozen=True, kw_only=True)
class AccelerationLevel(Formulation):
    """Unknown a (nv,). Kinematic tasks as J a = ÿ_ref + kd ė + kp e − J̇ v; no dynamics, no forces."""

    order: ClassVar[int] = 2
    dynamics: ClassVar[bool] = False
    name: ClassVar[str] = "acceleration level"
    carries: ClassVar[frozenset[str]] = frozenset({"velocity", "acceleration"})


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
    carries: ClassVar[frozenset[str]] = frozenset({"velocity", "acceleration", "torque", "force"})
