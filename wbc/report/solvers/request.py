"""The request of a comparison: which problems and scenarios, which solvers, how often, how long."""

from __future__ import annotations

import importlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, is_dataclass
from typing import Any, final

from wbc import checks
from wbc.errors import InvalidInput
from wbc.qp.solver import Solver
from wbc.qp.solvers import SOLVERS, Guarded
from wbc.sim.plant import whole
from wbc.sim.scenario import check_consent

_NOT_SENT = (
    "solver {!r} cannot be sent to a process of its own ({}); make it a dataclass with plain settings, in a module "
    "that can be imported"
)

#: The tolerance classes: what a solver's name stands for in this library, and three that are asked of everybody.
CLASSES: Mapping[str, float | None] = {"default": None, "1e-3": 1e-3, "1e-6": 1e-6, "1e-9": 1e-9}


@final
@dataclass(frozen=True)
class ScenarioRequest:
    """A scenario as a user names it, with all its parameters and settings."""

    text: str
    name: str
    parameters: Mapping[str, Any]
    settings: Mapping[str, Any]


@final
@dataclass(frozen=True)
class Request:
    """Everything that decides what is measured; ``files`` are the problem sets' files by set name.

    ``rounds``: how often each solve is timed, interleaved with those of the other solvers; the least counts.
    ``limit``: seconds a solve may take, ``patience``: seconds a whole scenario may take.
    """

    solvers: Sequence[Solver]
    scenarios: Sequence[ScenarioRequest] = ()
    files: Mapping[str, str] = field(default_factory=dict)
    classes: Mapping[str, float | None] = field(default_factory=lambda: dict(CLASSES))
    rounds: int = 3
    limit: float = 5.0
    patience: float = 600.0
    ticks: int = 200
    loop: bool = True
    torture: bool = False
    growth: bool = False

    def __post_init__(self) -> None:
        whole("rounds", self.rounds)
        whole("ticks", self.ticks)
        checks.number("limit", self.limit, low=0.0, strict=True)
        checks.number("patience", self.patience, low=0.0, strict=True)
        for name, tolerance in checks.instance("classes", self.classes, Mapping, "tolerances by name").items():
            if tolerance is not None:
                checks.number(f"classes[{name!r}]", tolerance, low=0.0, strict=True)

    def to_json(self) -> dict[str, Any]:
        """The request as JSON values; solvers as :func:`encoded` writes them.

        Raises:
            InvalidInput: a solver that another process could not make.
        """
        solvers = [encoded(solver) for solver in self.solvers]
        others = {key: value for key, value in vars(self).items() if key not in ("solvers", "scenarios")}
        found: dict[str, Any] = json.loads(
            json.dumps({**others, "solvers": solvers, "scenarios": [asdict(s) for s in self.scenarios]})
        )
        return found

    @classmethod
    def from_json(cls, data: Any, *, trusted: Sequence[str | Solver] = ()) -> Request:
        """The request that :meth:`to_json` wrote. No class or file that it names is imported or executed unless the
        user names it in ``trusted``: a scenario as ``file.py:name`` or ``module:name``, a solver of one's own as an
        object.

        Raises:
            InvalidInput: other fields, or code that ``trusted`` does not name.
        """
        classes = {class_name(type(solver)): type(solver) for solver in (*SOLVERS, Guarded(SOLVERS[0]))}
        classes |= {class_name(type(solver)): type(solver) for solver in trusted if isinstance(solver, Solver)}
        try:
            solvers = [decoded(one, classes) for one in data["solvers"]]
            scenarios = [ScenarioRequest(**one) for one in data["scenarios"]]
            request = cls(**{**data, "solvers": solvers, "scenarios": scenarios})
        except (TypeError, KeyError, AttributeError, ValueError) as cause:
            raise InvalidInput(f"the file does not hold the request of a comparison: {cause}") from cause
        for scenario in request.scenarios:
            check_consent(scenario.text, trusted)
        return request


def encoded(solver: Solver) -> dict[str, Any]:
    """A solver as JSON values: its class by module and name, its settings, its tolerance.

    Raises:
        InvalidInput: a class that another process cannot import, or settings that JSON cannot hold.
    """
    kind = type(solver)
    own: list[str] = [one.name for one in fields(solver) if one.init] if is_dataclass(solver) else []
    values = {name: getattr(solver, name) for name in own}
    settings = {name: encoded(value) if isinstance(value, Solver) else value for name, value in values.items()}
    data = {"class": class_name(kind), "settings": settings, "tolerance": solver.tolerance}
    try:
        there = received(json.loads(json.dumps(data, allow_nan=False)))
    except (TypeError, ValueError, ImportError, AttributeError) as cause:
        raise InvalidInput(_NOT_SENT.format(solver.name, cause)) from cause
    if type(there) is not kind or (own and there != solver):
        raise InvalidInput(_NOT_SENT.format(solver.name, "it would be another one there"))
    return data


def decoded(data: Mapping[str, Any], classes: Mapping[str, type[Solver]]) -> Solver:
    """The solver that :func:`encoded` wrote, of one of ``classes`` (by :func:`class_name`).

    Raises:
        InvalidInput: another class.
    """
    kind = classes.get(data["class"])
    if kind is None:
        raise InvalidInput(f"the file names the solver class {data['class']}, which is not one of this library's")
    settings = {
        name: decoded(value, classes) if isinstance(value, Mapping) and "class" in value else value
        for name, value in data["settings"].items()
    }
    solver = kind(**settings)
    return solver if solver.tolerance == data["tolerance"] else solver.at(data["tolerance"])


def imported_class(data: Mapping[str, Any]) -> type[Solver]:
    """Import the class that a message from the user's own process names. Never for a file.

    Raises:
        ImportError, AttributeError: there is no such class.
        InvalidInput: it is no solver.
    """
    module, _, name = data["class"].partition(":")
    found: Any = importlib.import_module(module)
    for part in name.split("."):
        found = getattr(found, part)
    if not (isinstance(found, type) and issubclass(found, Solver)):
        raise InvalidInput(f"{data['class']} is no solver")
    return found


def received(data: Mapping[str, Any]) -> Solver:
    """The solver of a message from the user's own process: its classes are imported. Never for a file."""
    inner = [value for value in data["settings"].values() if isinstance(value, Mapping) and "class" in value]
    return decoded(data, {one["class"]: imported_class(one) for one in (data, *inner)})


def class_name(kind: type) -> str:
    """``module:name``."""
    return f"{kind.__module__}:{kind.__qualname__}"
