"""What a recorder writes down of a tick: its row, and of the controller what says how to read the rows."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, final

import numpy as np

from wbc import checks
from wbc.control.answer import active, distances, shares, units
from wbc.control.command import Command
from wbc.control.explain import reproducer
from wbc.errors import InvalidInput
from wbc.models.planar import PlanarRobot
from wbc.qp.problem import QP
from wbc.stack.contact import Contact
from wbc.stack.kernel_rows import CENTRE, kernel_rows_of
from wbc.stack.objective import Objective
from wbc.types import Status, Vec

if TYPE_CHECKING:
    from wbc.control.controller import Controller
    from wbc.models.model import RobotModel

#: The number of active rows that are recorded in a tick, those with the largest multipliers; ``active`` counts all.
RECORDED_ROWS = 16
#: Columns, and beginnings of columns, that a recorder writes at some level.
COLUMNS = (
    "t", "status", "tick_us", "q", "v", "v_cmd", "a", "tau", "certificate", "iterations", "fallback", "active",
    "active.", "f.", "error.", "residual.", "cost.", "distance.", "margin.", "about.", "signal.",
)  # fmt: skip
_CODES = {status: i for i, status in enumerate(Status)}


def outcome(t: float, command: Command, microseconds: float) -> dict[str, Any]:
    """The columns that every tick has: ``t`` [s], ``status`` (its place in :class:`Status`), ``tick_us`` [µs]."""
    return {"t": t, "status": _CODES[command.status], "tick_us": microseconds}


@final
class Ticks:
    """The rows of one controller, tick by tick.

    ``failure`` says when and why the first tick without an answer had none, ``failed`` is its QP; both None before.
    Signals of a component that fail in the first tick are recorded in none. The first tick fixes the columns: of a
    stack that replaced the first, only what has these names and sizes is recorded.
    """

    def __init__(self, controller: Controller) -> None:
        self.controller, self.stack = controller, controller.stack
        self.failure: dict[str, Any] | None = None
        self.failed: QP | None = None
        self._order, self._dynamics = controller.level.order, controller.level.dynamics
        #: With all contacts: a task on a contact's force is not in the plan while the contact is open.
        self._sizes = {name: len(said.split(", ")) for name, said in units(controller.plans.whole.plan.problem).items()}
        #: Components whose signals could not be recorded in some tick, and why the first time.
        self.silent: dict[str, str] = {}
        self._shapes: dict[str, dict[str, tuple[int, ...]]] = {}
        self._columns: dict[str, tuple[int, ...]] = {}
        #: Every row that was active so far, with its side: what the numbers of the column ``active.row`` mean.
        self.active_rows: dict[tuple[str, str, str, str], int] = {}
        #: Every fallback level that made a command so far: what the numbers of the column ``fallback`` mean.
        self.fallback_levels = {"solved": 0}

    def row(self, t: float, q: Vec, v: Vec, command: Command, microseconds: float) -> dict[str, Any]:
        """What the controller was told (q (nq,), v (nv,)) and decided in its last tick, by column."""
        controller, proof = self.controller, command.certificate
        row = outcome(t, command, microseconds) | {
            "q": q,
            "v": v,
            "v_cmd": command.v,
            "certificate": np.array([proof.primal, proof.dual, proof.gap]),
            "iterations": controller.iterations,
            "fallback": self.fallback_levels.setdefault(command.fallback_level, len(self.fallback_levels)),
            "active": controller.active_count,
        }
        if self._order == 2:
            row["a"] = command.a
        if self._dynamics:
            row["tau"] = command.tau
            row |= {f"f.{name}": wrench for name, wrench in command.f.items()}
        row |= {f"error.{name}": error for name, error in controller.plan.errors().items()}
        row |= self._shares() | self._active(row["active"])
        far = distances(controller.plan.problem, proof.bounds)
        row |= {f"distance.{name}": far.get(name, np.nan) for name in self._sizes}
        for name, (barrier, margin) in controller.plan.margins().items():
            row[f"margin.{name}"] = margin
            if barrier.codes is not None:
                row[f"about.{name}"] = barrier.codes.copy()
        row |= self._signals()
        if not self._columns:
            self._columns = {name: np.shape(value) for name, value in row.items()}
        elif controller.stack is not self.stack:
            row = {name: value for name, value in row.items() if np.shape(value) == self._columns.get(name)}
        return row

    def refuse(self, more: Mapping[str, Any]) -> None:
        """Refuse columns of a user that cannot stand in a row beside these.

        Raises:
            InvalidInput: the name of another column; not a number or (k,); what a plant knows, in another size.
        """
        model = self.controller.model
        sizes = {"plant.q": model.nq, "plant.v": model.nv, "plant.a": model.nv, "plant.tau": model.nj}
        for name, value in more.items():
            if name in COLUMNS or name.startswith(tuple(one for one in COLUMNS if one[-1] == ".")):
                raise InvalidInput(f"column {name!r} is one that a recorder writes; give yours another name")
            try:
                shape = checks.floats(value).shape
            except Exception as cause:  # a conversion may raise whatever it likes
                raise InvalidInput(f"column {name!r} must hold numbers, not {checks.shown(value)}") from cause
            size = sizes.get(name)
            if len(shape) > 1 or (size is not None and shape != (size,)):
                allowed = "a value is a number or (k,)" if size is None else f"it must have ({size},)"
                raise InvalidInput(f"column {name!r} has shape {shape}; {allowed}")

    def _signals(self) -> dict[str, Vec]:
        """What components say of themselves; nothing of one that fails, since what was decided goes to the robot."""
        found: dict[str, Vec] = {}
        for component in self.controller.components:
            try:
                said = {name: np.array(signal, dtype=np.float64) for name, signal in component.signals().items()}
                shapes = {name: signal.shape for name, signal in said.items()}
                # A column is a number or a vector, and the first tick fixes its size.
                columns = {name: shape for name, shape in shapes.items() if len(shape) < 2}
                columns = self._shapes.setdefault(component.name, columns)
                if not shapes.items() <= columns.items():
                    raise InvalidInput(f"the shapes are {shapes}; the columns of the record are {columns}")
            except Exception as cause:
                self._shapes.setdefault(component.name, {})
                self.silent.setdefault(component.name, f"{type(cause).__name__}: {cause}")
            else:
                found |= {f"signal.{component.name}.{name}": signal for name, signal in said.items()}
        return found

    def _shares(self) -> dict[str, Any]:
        """The residual of every task by unit, and what it costs; NaN where it is not in the plan or has no answer."""
        found: dict[str, Any] = {}
        for name, size in self._sizes.items():
            found[f"residual.{name}"], found[f"cost.{name}"] = np.full(size, np.nan), np.nan
        for share in shares(self.controller) if self.controller.status.ok else ():
            name, sizes = share.name, np.array([*share.sizes.values()])
            if self._sizes.get(name) == len(sizes):  # a stack that replaced the first may call another task the same
                found[f"residual.{name}"], found[f"cost.{name}"] = sizes, share.cost
        return found

    def _active(self, count: int) -> dict[str, Vec]:
        """The dearest active rows, as numbers of :attr:`active_rows`, with their bounds and multipliers."""
        kept = np.full((3, RECORDED_ROWS), np.nan)
        if count:
            for k, one in enumerate(active(self.controller)[:RECORDED_ROWS]):
                key = one.row.owner, one.row.label, one.row.unit, "upper" if one.upper else "lower"
                kept[:, k] = self.active_rows.setdefault(key, len(self.active_rows)), one.bound, one.multiplier
        return dict(zip(("active.row", "active.bound", "active.multiplier"), kept, strict=True))

    def found(self) -> dict[str, Any]:
        """Metadata that only the ticks so far tell: the first failure, active rows and fallback levels."""
        keys = ("owner", "label", "unit", "side")
        rows = [dict(zip(keys, row, strict=True)) for row in self.active_rows]
        found = {"failure": self.failure, "active_rows": rows, "fallback_levels": [*self.fallback_levels]}
        return found | ({"silent": self.silent} if self.silent else {})

    def watch(self, t: float) -> None:
        """Keep why the tick at ``t`` [s] had no answer, if it is the first one that had none."""
        controller = self.controller
        if self.failure is None and not controller.status.ok:
            self.failure = {"t": t, "why": controller.explain()}
            self.failed = reproducer(controller) if controller.has_problem else None


def about(controller: Controller) -> dict[str, Any]:
    """Metadata that a controller's rows are read with: names, units, limits, what tasks and contacts there are."""
    model, stack = controller.model, controller.plans.whole.plan.stack
    objectives: dict[str, Objective] = {task.name: task for task in stack.tasks}
    objectives |= {block.name: block.says for block in controller.plan.layout.exact}
    unit = units(controller.plans.whole.plan.problem)
    return about_robot(model) | {
        "level": controller.level.name,
        "hierarchy": str(controller.hierarchy),
        "solver": controller.solver.name,
        "dt": controller.dt,
        "statuses": [status.name for status in Status],
        "tasks": {name: _task(task) for name, task in objectives.items()},
        "distances": unit,
        "residuals": unit,
        "contacts": {c.name: _contact(c) for c in stack.contacts if not c.bilateral},
        "stack": str(stack),
    }


def about_robot(model: RobotModel) -> dict[str, Any]:
    """Metadata that any record of a robot's motion is read with: its names, units and limits.

    A planar robot has no description in a file: the record keeps all that it is made of.
    """
    found = {
        "robot": model.name,
        "base": getattr(model, "base", "fixed"),
        "joint_names": list(model.joint_names),
        "joint_units": list(model.joint_units),
        "limits": {key: getattr(model.limits, key).tolist() for key in ("q_min", "q_max", "v_max", "tau_max")},
    }
    if isinstance(model, PlanarRobot):
        found["planar"] = {"chain": str(model.chain), "parameters": dict(model.parameters), "gravity": model.g0}
    return found


def _task(task: Objective) -> dict[str, Any]:
    rows = range(task.dim)
    found: dict[str, Any] = {"units": [task.unit(k) for k in rows], "labels": [task.label(k) for k in rows]}
    said = kernel_rows_of(task)
    if said is not None and said.leads:
        (thing,) = said.of
        found["point"] = "" if thing == CENTRE else thing  # whose place its rows in metres are about
    return found


def _contact(contact: Contact) -> dict[str, Any]:
    half_size = getattr(contact, "half_size", None)
    return {
        "kind": {3: "point", 5: "edge"}.get(contact.dim, "sole"),
        "frame": contact.frame,
        "friction": contact.friction,
        "half_size": None if half_size is None else [float(x) for x in half_size],
        "cone": np.asarray(contact.cone()).tolist(),
    }
