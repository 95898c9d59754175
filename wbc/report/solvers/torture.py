"""Torture: problems that no solver should have to see, with and without the checks that stand before a back end."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from wbc.errors import WbcError
from wbc.qp.certificate import certificate
from wbc.qp.problem import QP, Row, Shape
from wbc.qp.solver import Answer, Solver

N, N_EQ, N_IN = 20, 5, 12


@final
@dataclass(frozen=True)
class Case:
    """``make`` gives the problem, written into memory without any check; ``wanted`` is the only right end: "solved",
    "infeasible" or "refused"."""

    name: str
    wanted: str
    make: Callable[[], QP]


def _base(**changes: Callable[[Any], Any]) -> QP:
    """A sound problem; each change gets one of its arrays and gives another."""
    rng = np.random.default_rng(0)
    J, inside = rng.standard_normal((N, N)), 0.1 * rng.standard_normal(N)
    A, C = rng.standard_normal((N_EQ, N)), rng.standard_normal((N_IN, N))
    part = {
        "H": J.T @ J + 1e-3 * np.eye(N), "g": rng.standard_normal(N), "A": A, "b": A @ inside,
        "C": C, "cl": np.full(N_IN, -np.inf), "cu": C @ inside + 0.2, "lb": inside - 1.0, "ub": inside + 1.0,
    }  # fmt: skip
    for name, change in changes.items():
        part[name] = np.asarray(change(part[name]), dtype=np.float64)
    qp = QP.empty(Shape(len(part["g"]), len(part["b"]), len(part["cu"])), _names(part))
    qp.H[:], qp.g[:], qp.lb[:], qp.ub[:] = part["H"], part["g"], part["lb"], part["ub"]
    qp.matrix[:] = np.concatenate([part["A"], part["C"]])
    qp.lower[:], qp.upper[:] = np.concatenate([part["b"], part["cl"]]), np.concatenate([part["b"], part["cu"]])
    return qp


def _names(part: Mapping[str, Any]) -> list[Row]:
    counts = {"A": len(part["b"]), "C": len(part["cu"]), "x": len(part["g"])}
    return [Row(f"{name}[{i}]") for name, count in counts.items() for i in range(count)]


def _with(index: Any, value: float) -> Callable[[Any], Any]:
    def change(array: Any) -> Any:
        array = array.copy()
        array[index] = value
        return array

    return change


def _again(count: int, add: float = 0.0) -> Callable[[Any], Any]:
    """The first ``count`` rows once more, shifted by ``add``."""
    return lambda array: np.concatenate([array, array[:count] + add])


def _low_rank(H: Any) -> Any:
    values, vectors = np.linalg.eigh(H)
    values[: N // 2] = 0.0
    return (vectors * values) @ vectors.T


def _scaled(H: Any) -> Any:
    scales = 10.0 ** np.random.default_rng(1).uniform(-3, 3, N)
    return H * np.outer(scales, scales)


def _short() -> QP:
    qp = _base()
    object.__setattr__(qp, "g", qp.g[: N - 3].copy())
    return qp


_TIMES_4: dict[str, Callable[[Any], Any]] = {
    name: lambda rows: np.concatenate([rows] * 4) for name in ("C", "cl", "cu")
}

CASES: Mapping[str, Case] = {
    case.name: case
    for case in (
        Case("plain", "solved", _base),
        Case("equalities twice", "solved", lambda: _base(A=_again(2), b=_again(2))),
        Case("rows four times", "solved", lambda: _base(**_TIMES_4)),
        Case("variable held by its bounds", "solved", lambda: _base(lb=_with(3, 0.05), ub=_with(3, 0.05))),
        Case("no bounds", "solved", lambda: _base(lb=lambda v: v - np.inf, ub=lambda v: v + np.inf)),
        Case("half the rank", "solved", lambda: _base(H=_low_rank)),
        Case("no curvature (linear program)", "solved", lambda: _base(H=np.zeros_like)),
        Case("cost in millionths", "solved", lambda: _base(H=lambda H: 1e6 * H, g=lambda g: 1e6 * g)),
        Case(
            "rows in other units", "solved",
            lambda: _base(A=lambda A: 1e3 * A, b=lambda b: 1e3 * b, C=lambda C: 1e-3 * C, cu=lambda c: 1e-3 * c),
        ),
        Case("curvatures 1e12 apart", "solved", lambda: _base(H=_scaled)),
        Case("equality twice, other side", "infeasible", lambda: _base(A=_again(1), b=_again(1, 1.0))),
        Case("rows against each other", "infeasible", lambda: _base(cl=_with(0, 90.0), cu=_with(0, 91.0))),
        Case("bounds crossed", "refused", lambda: _base(lb=_with(3, 9.0))),
        Case("NaN in the cost", "refused", lambda: _base(g=_with(2, np.nan))),
        Case("NaN in a row", "refused", lambda: _base(C=_with(2, np.nan))),
        Case("infinity in the cost", "refused", lambda: _base(g=_with(2, np.inf))),
        Case("H not symmetric", "refused", lambda: _base(H=lambda H: H + np.triu(np.ones((N, N)), 1))),
        Case("vector too short", "refused", _short),
    )
}  # fmt: skip


def tortured(solver: Solver, case: str, *, guarded: bool) -> dict[str, Any]:
    """How a solver takes a case. ``guarded``: behind the library's checks; else the back end alone.

    ``word`` is its own word in lower case, ``right`` whether that is the right end, or at least no wrong claim.
    """
    wanted, qp = CASES[case].wanted, CASES[case].make()
    session = solver.open(Shape(N, qp.n_eq, len(qp.lower) - qp.n_eq))
    try:
        if guarded:
            status = session.solve(qp).status
            word = status.name.lower()
            claims = status.ok
        else:
            answer = session.unguarded(qp)
            word, claims = answer.status.name.lower(), answer.status.ok
            if claims and not _true(qp, answer, wanted):
                return {"word": "wrong: says solved", "right": False}
    except WbcError:
        return {"word": "refused", "right": wanted == "refused"}
    except Exception as error:  # a back end's own, of any kind: it is the finding
        return {"word": f"raises {type(error).__name__}", "right": not guarded and wanted != "solved"}
    if guarded:
        return {"word": word, "right": word == wanted}
    return {"word": word, "right": claims if wanted == "solved" else not claims}


def _true(qp: QP, answer: Answer, wanted: str) -> bool:
    """Whether an answer that is called solved is one, to a thousandth."""
    if wanted != "solved":
        return False
    return certificate(qp, answer.x, answer.y, answer.z, answer.z_box).within(1e-3)
