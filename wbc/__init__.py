"""A QP-first whole-body control framework: stacks of tasks, limits, contacts and components, solved and certified.

Names are loaded when they are first used, so that ``import wbc`` costs nothing.

Example:
    >>> import wbc
    >>> wbc.load("arm").nj
    7
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from wbc import errors as errors
    from wbc import methods as methods
    from wbc import models as models
    from wbc import motion as motion
    from wbc import tasks as tasks
    from wbc import testing as testing
    from wbc.control.command import Command as Command
    from wbc.control.controller import Controller as Controller
    from wbc.control.many import run_many as run_many
    from wbc.control.rate import Rate as Rate
    from wbc.control.reach import reach as reach
    from wbc.control.recorder import Recorder as Recorder
    from wbc.control.recorder import Run as Run
    from wbc.control.recovery import Recovery as Recovery
    from wbc.control.setpoint import Setpoint as Setpoint
    from wbc.control.watchdog import Watchdog as Watchdog
    from wbc.models import load as load
    from wbc.motion import retarget as retarget
    from wbc.qp import QP as QP
    from wbc.qp import Certificate as Certificate
    from wbc.qp import Row as Row
    from wbc.qp import Solution as Solution
    from wbc.qp import solve as solve
    from wbc.qp import solvers as _solvers
    from wbc.qp.lexicographic import lexicographic as lexicographic
    from wbc.stack.component import Component as Component
    from wbc.stack.component import Schedule as Schedule
    from wbc.stack.constraint import Barrier as Barrier
    from wbc.stack.constraint import Constraint as Constraint
    from wbc.stack.constraint import LinearConstraint as LinearConstraint
    from wbc.stack.contact import Contact as Contact
    from wbc.stack.formulation import AccelerationLevel as AccelerationLevel
    from wbc.stack.formulation import InverseDynamics as InverseDynamics
    from wbc.stack.formulation import VelocityLevel as VelocityLevel
    from wbc.stack.hierarchy import Scaled as Scaled
    from wbc.stack.hierarchy import Strict as Strict
    from wbc.stack.hierarchy import Weighted as Weighted
    from wbc.stack.overrides import Motor as Motor
    from wbc.stack.overrides import Overrides as Overrides
    from wbc.stack.stack import Stack as Stack
    from wbc.stack.task import LinearTask as LinearTask
    from wbc.stack.task import Task as Task
    from wbc.types import Status as Status

    solvers = _solvers.usable

_HOME = {
    "AccelerationLevel": "wbc.stack.formulation",
    "Barrier": "wbc.stack.constraint",
    "Certificate": "wbc.qp",
    "Command": "wbc.control.command",
    "Component": "wbc.stack.component",
    "Constraint": "wbc.stack.constraint",
    "Contact": "wbc.stack.contact",
    "Controller": "wbc.control.controller",
    "InverseDynamics": "wbc.stack.formulation",
    "LinearConstraint": "wbc.stack.constraint",
    "LinearTask": "wbc.stack.task",
    "Motor": "wbc.stack.overrides",
    "Overrides": "wbc.stack.overrides",
    "QP": "wbc.qp",
    "Rate": "wbc.control.rate",
    "Recorder": "wbc.control.recorder",
    "Recovery": "wbc.control.recovery",
    "Row": "wbc.qp",
    "Run": "wbc.control.recorder",
    "Schedule": "wbc.stack.component",
    "Setpoint": "wbc.control.setpoint",
    "Solution": "wbc.qp",
    "Stack": "wbc.stack.stack",
    "Status": "wbc.types",
    "Task": "wbc.stack.task",
    "VelocityLevel": "wbc.stack.formulation",
    "Watchdog": "wbc.control.watchdog",
    "Scaled": "wbc.stack.hierarchy",
    "Strict": "wbc.stack.hierarchy",
    "Weighted": "wbc.stack.hierarchy",
    "lexicographic": "wbc.qp.lexicographic",
    "load": "wbc.models",
    "reach": "wbc.control.reach",
    "retarget": "wbc.motion",
    "run_many": "wbc.control.many",
    "solve": "wbc.qp",
}
_PACKAGES = (
    "control", "errors", "export", "live", "methods", "models", "motion", "qp", "report", "robots", "sim", "stack",
    "sweep", "tasks", "testing",
)  # fmt: skip


def __getattr__(name: str) -> Any:
    if name in _PACKAGES:
        return import_module(f"wbc.{name}")
    if name == "solvers":
        return import_module("wbc.qp.solvers").usable
    if name in _HOME:
        value = getattr(import_module(_HOME[name]), name)
        globals()[name] = value
        return value
    raise AttributeError(
        f"module 'wbc' has no attribute {name!r}; tasks, limits, contacts and components are in wbc.tasks"
    )


def __dir__() -> list[str]:
    return sorted({*globals(), *_HOME, *_PACKAGES, "solvers"})
