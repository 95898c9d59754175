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
        else:
            assert solution.status in statuses or not by_name(solver).semidefinite or by_name(solver).offline, (
                f"{solution.status}, not {statuses}"
            )
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

    def refused(data: dict[str, Any]) -> Callable[[str], object]:
        return lambda solver: solve(built(data), solver)

    places = {"H": (1, 2), "g": 3, "A": (1, 4), "b": 1, "C": (2, 0)}
    for name, at in places.items():
        for value in (np.nan, np.inf):
            index = str(at)
            yield Case(f"{value} in {name}", refused(entry(name, at, value)), (name, index, str(value)))
    for name in ("cl", "cu", "lb", "ub"):
        yield Case(f"nan in {name}", refused(entry(name, 2, np.nan)), (name, "2", "nan"))
    for name in ("H", "g", "A", "C", "cl", "lb", "ub"):
        yield Case(
            f"nan written into {name}", changed_later(name, -1, np.nan), ("nan",) if name in "HgAC" else ("NaN",)
        )
    for name, short in (("g", np.zeros(5)), ("b", np.zeros(1)), ("cl", np.zeros(3)), ("cu", np.zeros(5)),
                        ("lb", np.zeros(5)), ("ub", np.zeros(7)), ("A", np.zeros((2, 5))), ("C", np.zeros((4, 7))),
                        ("H", np.zeros((5, 6)))):  # fmt: skip
        yield Case(f"{name} of shape {short.shape}", refused(changed(**{name: short})), ("shape",))
    yield Case("A without b", refused(changed(b=None)), ("A and b",))
    yield Case("bounds without rows", refused(changed(C=None)), ("C is missing",))
    yield Case("nothing at all", lambda solver: QP([], []), ("at least one variable",))
    yield Case("H of words", refused(changed(H="identity")), ("H", "identity"))
    yield Case("crossed bounds", refused(changed(lb=np.full(N, 2.0), ub=np.full(N, 1.0))), ("x[0]", "crossed", "2 > 1"))
    yield Case("crossed rows", refused(changed(cl=np.full(4, 2.0), cu=np.full(4, 1.0))), ("C[0]", "crossed"))
    yield Case("a bound of -inf above", refused(entry("ub", 3, -np.inf)), ("x[3]", "crossed"))
    yield Case(
        "a bound of inf below", refused(changed(lb=np.full(N, np.inf), ub=np.full(N, np.inf))), ("x[0]", "[inf, inf]")
    )
    skew = parts()["H"] + np.triu(np.ones((N, N)), 1)
    yield Case("H not symmetric", refused(changed(H=skew)), ("not symmetric", "H[1, 4]"))
    negative = parts()["H"] - 5.0 * np.linalg.eigvalsh(parts()["H"])[-1] * np.eye(N)
    yield Case("H not convex", refused(changed(H=negative)), ("not positive semidefinite", "eigenvalue"))
    yield Case("too few names", refused(changed(rows=[("a", "", "")])), ("rows must name",))
    yield Case(
        "another shape than the session's",
        lambda solver: by_name(solver).open(built(parts()).shape).solve(QP(np.eye(2), [0.0, 0.0])),
        ("session", "Shape"),
    )
    yield Case(
        "an unknown solver", lambda solver: solve(built(parts()), solver + "x"), ("there is no solver", "did you mean")
    )
    yield Case("a solver that is none", lambda solver: solve(built(parts()), None), ("there is no solver None",))  # type: ignore[arg-type]

    yield Case("sound", solved(parts(), Status.SOLVED))
    infeasible = (Status.INFEASIBLE,)
    yield Case(
        "an equality that is missed", solved(changed(A=np.vstack([parts()["A"][0]] * 2), b=[1.0, 2.0]), *infeasible)
    )
    yield Case(
        "an equality by a hundred", solved(changed(A=np.vstack([parts()["A"][0]] * 2), b=[1.0, 101.0]), *infeasible)
    )
    yield Case("a box that rows miss", solved(changed(C=np.ones((1, N)), cl=[100.0], cu=[200.0]), *infeasible))
    yield Case(
        "rows against each other", solved(changed(C=np.ones((2, N)), cl=[1.0, -9.0], cu=[9.0, -1.0]), *infeasible)
    )
    yield Case(
        "no bounds and H zero", solved({"H": np.zeros((N, N)), "g": np.ones(N)}, Status.UNBOUNDED, Status.FAILED)
    )
    yield Case(
        "repeated equalities",
        solved(changed(A=np.vstack([parts()["A"]] * 2), b=np.tile(parts()["b"], 2)), Status.SOLVED),
    )
    yield Case(
        "more equalities than unknowns",
        solved(changed(A=np.vstack([parts()["A"]] * 6), b=np.tile(parts()["b"], 6)), Status.SOLVED),
    )
    yield Case(
        "repeated rows",
        solved(
            changed(C=np.vstack([parts()["C"]] * 4), cl=np.tile(parts()["cl"], 4), cu=np.tile(parts()["cu"], 4)),
            Status.SOLVED,
        ),
    )
    fixed = parts()["lb"] + 1.0
    yield Case(
        "a variable that is fixed",
        solved(
            changed(
                lb=np.where(np.arange(N) == 3, fixed, parts()["lb"]),
                ub=np.where(np.arange(N) == 3, fixed, parts()["ub"]),
            ),
            Status.SOLVED,
        ),
    )
    yield Case("no bounds but inf", solved(changed(lb=np.full(N, -np.inf), ub=np.full(N, np.inf)), Status.SOLVED))
    low = parts()["H"][:, :2] @ parts()["H"][:2]
    yield Case("H of rank two", solved(changed(H=low @ low.T), Status.SOLVED))
    yield Case("H zero", solved(changed(H=np.zeros((N, N))), Status.SOLVED))
    yield Case("cost times a million", solved(changed(H=1e6 * parts()["H"], g=1e6 * parts()["g"]), Status.SOLVED))
    size = 10.0 ** np.linspace(-3, 3, N)
    awkward = (Status.SOLVED, Status.INACCURATE, Status.MAX_ITERATIONS, Status.FAILED)
    yield Case(
        "units a million apart",
        solved(
            changed(
                H=parts()["H"] * np.outer(size, size), A=parts()["A"] * size, C=parts()["C"] * size, lb=None, ub=None
            ),
            *awkward,
        ),
    )
    yield Case(
        "infeasible by 1e-7",
        solved(changed(A=np.vstack([parts()["A"][0]] * 2), b=[1.0, 1.0 + 1e-7]), *awkward, *infeasible),
    )
    yield Case("numbers of 1e90", solved(changed(g=np.full(N, 1e90)), *awkward, *infeasible))
