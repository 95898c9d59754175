"""Bad QPs: no problem is refused by name and index; an awkward one has a certified answer or an honest status."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from tests.reliability.forked import Case
from wbc.qp import QP, solve
from wbc.qp.solvers import by_name
from wbc.types import Status

N = 6


def parts() -> dict[str, Any]:
    """A problem with equalities, two-sided rows and bounds."""
    rng = np.random.default_rng(0)
    root, inside = rng.normal(size=(N, N)), 0.1 * rng.normal(size=N)
    A, C = rng.normal(size=(2, N)), rng.normal(size=(4, N))
    return {
        "H": root @ root.T + 0.1 * np.eye(N), "g": rng.normal(size=N), "A": A, "b": A @ inside, "C": C,
        "cl": C @ inside - 0.3, "cu": C @ inside + 0.3, "lb": inside - 1.0, "ub": inside + 1.0,
    }  # fmt: skip


def changed(**changes: Any) -> dict[str, Any]:
    return parts() | changes


def entry(name: str, at: Any, value: float) -> dict[str, Any]:
    data = parts()
    data[name][at] = value
    return data


def built(data: dict[str, Any]) -> QP:
    data = dict(data)
    return QP(data.pop("H"), data.pop("g"), **data)


def solved(data: dict[str, Any], *statuses: Status) -> Callable[[str], str]:
    """A certified answer, or one of these statuses; never an answer that only claims to be one."""

    def call(solver: str) -> str:
        solution = solve(built(data), solver)
        assert solution.certificate.ok == solution.status.ok, f"{solution.status} {solution.certificate}"
        if solution.status.ok:
            assert np.isfinite(solution.x).all()
            assert Status.SOLVED in statuses or not statuses, f"solved, not {statuses}"
        elif by_name(solver).semidefinite and not by_name(solver).offline:
            assert solution.status in statuses, f"{solution.status}, not {statuses}"
        return str(solution.status)

    return call


def changed_later(name: str, at: Any, value: float) -> Callable[[str], object]:
    """A sound problem whose memory was written into since."""

    def call(solver: str) -> object:
        qp = built(parts())
        getattr(qp, name)[at] = value
        return solve(qp, solver)

    return call


def cases() -> Iterator[Case]:
    """Bad inputs of this kind."""
    yield from _refused()
    yield from _answered()


def _refused() -> Iterator[Case]:
    def refused(data: dict[str, Any]) -> Callable[[str], object]:
        return lambda solver: solve(built(data), solver)

    for name, at in {"H": (1, 2), "g": 3, "A": (1, 4), "b": 1, "C": (2, 0)}.items():
        for value in (np.nan, np.inf):
            yield Case(f"{value} in {name}", refused(entry(name, at, value)), (name, str(at), str(value)))
    for name in ("cl", "cu", "lb", "ub"):
        yield Case(f"nan in {name}", refused(entry(name, 2, np.nan)), (name, "2", "nan"))
    for name in ("H", "g", "A", "C", "cl", "lb", "ub"):
        said = "nan" if name in "HgAC" else "NaN"
        yield Case(f"nan written into {name}", changed_later(name, -1, np.nan), (said,))
    wrong = {"g": 5, "b": 1, "cl": 3, "cu": 5, "lb": 5, "ub": 7, "A": (2, 5), "C": (4, 7), "H": (5, 6)}
    for name, shape in wrong.items():
        yield Case(f"{name} of shape {shape}", refused(changed(**{name: np.zeros(shape)})), ("shape",))
    H = parts()["H"]
    concave = H - 5.0 * np.linalg.eigvalsh(H)[-1] * np.eye(N)
    for name, data, says in (
        ("A without b", {"b": None}, ("A and b",)),
        ("bounds without rows", {"C": None}, ("C is missing",)),
        ("H of words", {"H": "identity"}, ("H", "identity")),
        ("crossed bounds", {"lb": np.full(N, 2.0), "ub": np.full(N, 1.0)}, ("x[0]", "crossed", "2 > 1")),
        ("crossed rows", {"cl": np.full(4, 2.0), "cu": np.full(4, 1.0)}, ("C[0]", "crossed")),
        ("a bound of -inf above", entry("ub", 3, -np.inf), ("x[3]", "crossed")),
        ("a bound of inf below", {"lb": np.full(N, np.inf), "ub": np.full(N, np.inf)}, ("x[0]", "[inf, inf]")),
        ("H not symmetric", {"H": H + np.triu(np.ones((N, N)), 1)}, ("not symmetric", "H[1, 4]")),
        ("H not convex", {"H": concave}, ("not positive semidefinite", "eigenvalue")),
        ("too few names", {"rows": [("a", "", "")]}, ("rows must name",)),
    ):  # fmt: skip
        yield Case(name, refused(parts() | data), says)
    none: Any = None
    for name, call, says in (
        ("nothing at all", lambda solver: QP([], []), ("at least one variable",)),
        ("an unknown solver", lambda solver: solve(built(parts()), solver + "x"),
         ("there is no solver", "did you mean")),
        ("a solver that is none", lambda solver: solve(built(parts()), none), ("there is no solver None",)),
        ("another shape than the session's",
         lambda solver: by_name(solver).open(built(parts()).shape).solve(QP(np.eye(2), [0.0, 0.0])),
         ("session", "Shape")),
    ):  # fmt: skip
        yield Case(name, call, says)


def _answered() -> Iterator[Case]:
    p, size = parts(), 10.0 ** np.linspace(-3, 3, N)
    H, A, C, fourth = p["H"], p["A"], p["C"], np.arange(N) == 3
    twice, low, fixed, one = np.vstack([A[0]] * 2), H[:, :2] @ H[:2], p["lb"] + 1.0, Status.SOLVED
    infeasible = (Status.INFEASIBLE,)
    awkward = (one, Status.INACCURATE, Status.MAX_ITERATIONS, Status.FAILED)
    for name, data, statuses in (
        ("sound", {}, (one,)),
        ("an equality that is missed", {"A": twice, "b": [1.0, 2.0]}, infeasible),
        ("an equality by a hundred", {"A": twice, "b": [1.0, 101.0]}, infeasible),
        ("a box that rows miss", {"C": np.ones((1, N)), "cl": [100.0], "cu": [200.0]}, infeasible),
        ("rows against each other", {"C": np.ones((2, N)), "cl": [1.0, -9.0], "cu": [9.0, -1.0]}, infeasible),
        ("repeated equalities", {"A": np.vstack([A] * 2), "b": np.tile(p["b"], 2)}, (one,)),
        ("more equalities than unknowns", {"A": np.vstack([A] * 6), "b": np.tile(p["b"], 6)}, (one,)),
        ("repeated rows", {"C": np.vstack([C] * 4), "cl": np.tile(p["cl"], 4), "cu": np.tile(p["cu"], 4)}, (one,)),
        ("a variable that is fixed",
         {"lb": np.where(fourth, fixed, p["lb"]), "ub": np.where(fourth, fixed, p["ub"])}, (one,)),
        ("no bounds but inf", {"lb": np.full(N, -np.inf), "ub": np.full(N, np.inf)}, (one,)),
        ("H of rank two", {"H": low @ low.T}, (one,)),
        ("H zero", {"H": 0.0 * H}, (one,)),
        ("cost times a million", {"H": 1e6 * H, "g": 1e6 * p["g"]}, (one,)),
        ("units a million apart",
         {"H": H * np.outer(size, size), "A": A * size, "C": C * size, "lb": None, "ub": None}, awkward),
        ("infeasible by 1e-7", {"A": twice, "b": [1.0, 1.0 + 1e-7]}, (*awkward, *infeasible)),
        ("numbers of 1e90", {"g": np.full(N, 1e90)}, (*awkward, *infeasible)),
    ):  # fmt: skip
        yield Case(name, solved(p | data, *statuses))
    endless = {"H": np.zeros((N, N)), "g": np.ones(N)}
    yield Case("no bounds and H zero", solved(endless, Status.UNBOUNDED, Status.FAILED))
