"""What a comparison is asked: which problems and scenarios, which solvers, how often, how long."""

from __future__ import annotations

import base64
import json
import pickle
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, final

from wbc.errors import InvalidInput
from wbc.qp.solver import Solver

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
    """Everything that decides what is measured; ``files`` are the problem sets' files by set name, ``ranked`` those of
    hierarchies.

    ``rounds``: how often each solve is timed, interleaved with those of the other solvers; the least counts.
    ``limit``: seconds a solve may take, ``patience``: seconds a whole scenario may take.
    """

    solvers: Sequence[Solver]
    scenarios: Sequence[ScenarioRequest] = ()
    files: Mapping[str, str] = field(default_factory=dict)
    ranked: Mapping[str, str] = field(default_factory=dict)
    classes: Mapping[str, float | None] = field(default_factory=lambda: dict(CLASSES))
    rounds: int = 3
    limit: float = 5.0
    patience: float = 600.0
    ticks: int = 200
    seed: int = 0
    loop: bool = True
    torture: bool = True
    growth: bool = True

    def to_json(self) -> dict[str, Any]:
        """In json's types; solvers packed.

        Raises:
            InvalidInput: a solver that another process could not make.
        """
        solvers = [packed(solver) for solver in self.solvers]
        others = {key: value for key, value in vars(self).items() if key not in ("solvers", "scenarios")}
        found: dict[str, Any] = json.loads(
            json.dumps({**others, "solvers": solvers, "scenarios": [asdict(s) for s in self.scenarios]})
        )
        return found

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Request:
        """What :meth:`to_json` gave; the file of a comparison of one's own, since solvers are unpickled."""
        solvers = [unpacked(text) for text in data["solvers"]]
        scenarios = [ScenarioRequest(**one) for one in data["scenarios"]]
        return cls(**{**data, "solvers": solvers, "scenarios": scenarios})


def packed(solver: Solver) -> str:
    """A solver as text that another process can read.

    Raises:
        InvalidInput: its class cannot be imported there.
    """
    try:
        text = base64.b64encode(pickle.dumps(solver)).decode("ascii")
        unpacked(text)
    except Exception as cause:
        raise InvalidInput(
            f"solver {solver.name!r} cannot be sent to a process of its own ({cause}); define its class in a module "
            "that can be imported"
        ) from cause
    return text


def unpacked(text: str) -> Solver:
    """What :func:`packed` wrote. It is unpickled: only from a file or a process of one's own."""
    solver: Solver = pickle.loads(base64.b64decode(text))
    return solver
