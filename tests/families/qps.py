"""Random families of QPs, and an oracle for the verdicts of ``wbc.solve``.

    python -m tests.families.qps --count 50000 --seed 1 --solver pdas daqp

prints for each family how many problems were solved, proven infeasible, proven unbounded or given up, and how many
verdicts were wrong; the exit code is 1 if any was. The oracle is HiGHS for feasibility and recession, Clarabel called
directly for the cost, and nonnegative least squares for the point where H is positive definite. What is compared is
computed here, in plain numpy.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import clarabel
import numpy as np
from scipy.optimize import linprog, lsq_linear
from scipy.sparse import csc_matrix

import wbc
from tests.families.progress import Answered, command_of_problems
from wbc.qp import QP, Solution
from wbc.qp.solvers import by_name

inf = np.inf
Array = np.ndarray
Draw = Callable[[np.random.Generator], dict[str, Any]]

#: What counts as met, in the unit of a row.
MET = 1e-6
#: How far x may be from the optimum, beside its size, and the cost from the least, beside its terms.
DISTANCE, COST = 1e-4, 1e-6


# ---- families


def _numbers(rng: np.random.Generator, shape: Any, *, integer: bool) -> Array:
    return rng.integers(-3, 4, shape).astype(float) if integer else rng.standard_normal(shape)


def _draw(
    rng: np.random.Generator, *, integer: bool = False, rank: int | None = None, n: int | None = None,
    n_eq: int | None = None, n_in: int | None = None, curvature: float = 0.0, feasible: bool = True,
) -> dict[str, Any]:  # fmt: skip
    """A problem that a drawn point meets, with bounds that are near it, at it, or absent."""
    n = int(rng.integers(1, 9)) if n is None else n
    n_eq = int(rng.integers(0, n)) if n_eq is None else n_eq
    n_in = int(rng.integers(0, 2 * n + 3)) if n_in is None else n_in
    rank = int(rng.integers(0, n + 1)) if rank is None else rank
    J = _numbers(rng, (rank, n), integer=integer)
    A, C, point = (_numbers(rng, shape, integer=integer) for shape in ((n_eq, n), (n_in, n), n))
    room = rng.integers(0, 4, (4, n_in + n)).astype(float) if integer else rng.exponential(1.0, (4, n_in + n))
    room[rng.uniform(size=room.shape) < 0.4] = inf
    room[rng.uniform(size=room.shape) < 0.1] = 0.0
    at = np.concatenate([C @ point, point])
    low, high = at - room[0], at + room[1]
    b = A @ point
    if not feasible:
        for _ in range(int(rng.integers(1, 3))):
            if n_eq and rng.uniform() < 0.3:
                b[int(rng.integers(n_eq))] += float(rng.choice([-1.0, 1.0]))
            else:
                i = int(rng.integers(n_in + n))
                low[i] = high[i] = at[i] + float(rng.choice([-2.0, 2.0]))
    return {
        "H": J.T @ J + curvature * np.eye(n), "g": _numbers(rng, n, integer=integer), "A": A, "b": b, "C": C,
        "cl": low[:n_in], "cu": high[:n_in], "lb": low[n_in:], "ub": high[n_in:],
    }  # fmt: skip


def convex(rng: np.random.Generator) -> dict[str, Any]:
    return _draw(rng, curvature=float(rng.choice([1e-3, 0.1, 1.0])))


def semidefinite(rng: np.random.Generator) -> dict[str, Any]:
    return _draw(rng)


def integers(rng: np.random.Generator) -> dict[str, Any]:
    return _draw(rng, integer=True)


def convex_integers(rng: np.random.Generator) -> dict[str, Any]:
    return _draw(rng, integer=True, curvature=1.0)


def linear(rng: np.random.Generator) -> dict[str, Any]:
    return _draw(rng, rank=0, integer=bool(rng.integers(2)))


def ties(rng: np.random.Generator) -> dict[str, Any]:
    """Few distinct numbers everywhere, so that many rows are reached at once."""
    p = _draw(rng, integer=True, rank=int(rng.integers(0, 3)))
    for name in ("cl", "cu", "lb", "ub"):
        p[name] = np.sign(p[name]) * np.where(np.isfinite(p[name]), 1.0, inf) * np.ones_like(p[name])
        p[name][np.isnan(p[name])] = 0.0
    swap = p["cl"] > p["cu"]
    p["cl"][swap], p["cu"][swap] = p["cu"][swap], p["cl"][swap]
    swap = p["lb"] > p["ub"]
    p["lb"][swap], p["ub"][swap] = p["ub"][swap], p["lb"][swap]
    for low, high in (("cl", "cu"), ("lb", "ub")):
        p[low][p[low] == inf], p[high][p[high] == -inf] = -inf, inf
    return p


def duplicates(rng: np.random.Generator) -> dict[str, Any]:
    p = _draw(rng, integer=bool(rng.integers(2)))
    if len(p["A"]):
        again = rng.integers(0, len(p["A"]), 2)
        factor = rng.choice([1.0, -1.0, 2.0], 2)
        p["A"], p["b"] = np.vstack([p["A"], factor[:, None] * p["A"][again]]), np.append(p["b"], factor * p["b"][again])
    if len(p["C"]):
        again = rng.integers(0, len(p["C"]), 3)
        for name in ("C", "cl", "cu"):
            p[name] = np.concatenate([p[name], p[name][again]])
    return p


def near_parallel(rng: np.random.Generator) -> dict[str, Any]:
    p = _draw(rng)
    for i in range(1, len(p["C"]), 2):
        p["C"][i] = p["C"][i - 1] + 10.0 ** rng.uniform(-8, -3) * rng.standard_normal(len(p["g"]))
    return p


def zero_rows(rng: np.random.Generator) -> dict[str, Any]:
    p = _draw(rng, integer=bool(rng.integers(2)))
    p["C"][rng.uniform(size=len(p["C"])) < 0.4] = 0.0
    zero = rng.uniform(size=len(p["A"])) < 0.3
    p["A"][zero], p["b"][zero] = 0.0, 0.0
    return p


def scaled_rows(rng: np.random.Generator) -> dict[str, Any]:
    p = _draw(rng, curvature=float(rng.choice([0.0, 0.1])))
    a, c = 10.0 ** rng.uniform(-4, 4, len(p["A"])), 10.0 ** rng.uniform(-4, 4, len(p["C"]))
    p["A"], p["b"] = a[:, None] * p["A"], a * p["b"]
    p["C"], p["cl"], p["cu"] = c[:, None] * p["C"], c * p["cl"], c * p["cu"]
    return p


def scaled_variables(rng: np.random.Generator) -> dict[str, Any]:
    p = _draw(rng, curvature=float(rng.choice([0.0, 0.1])))
    t = 10.0 ** rng.uniform(-4, 4, len(p["g"]))
    p["H"], p["g"] = p["H"] * np.outer(t, t), p["g"] * t
    p["A"], p["C"], p["lb"], p["ub"] = p["A"] * t, p["C"] * t, p["lb"] / t, p["ub"] / t
    return p


def scaled_cost(rng: np.random.Generator) -> dict[str, Any]:
    p = _draw(rng, curvature=float(rng.choice([0.0, 0.1])))
    k = 10.0 ** float(rng.choice([-6, -3, 3, 6]))
    p["H"], p["g"] = k * p["H"], k * p["g"]
    return p


def light_parts(rng: np.random.Generator) -> dict[str, Any]:
    """Tasks whose weights are six decades apart."""
    p = _draw(rng, rank=0, n=int(rng.integers(2, 9)))
    n = len(p["g"])
    p["H"], p["g"] = np.zeros((n, n)), np.zeros(n)
    for weight in 10.0 ** rng.uniform(-3, 3, 3):
        m = int(rng.integers(1, n + 1))
        J, target = rng.standard_normal((m, n)), rng.standard_normal(m)
        p["H"], p["g"] = p["H"] + weight * J.T @ J, p["g"] - weight * J.T @ target
    return p


def degenerate(rng: np.random.Generator) -> dict[str, Any]:
    """More rows in one point than there are directions, and the cost leads there."""
    n = int(rng.integers(2, 7))
    p = _draw(rng, n=n, n_eq=0, n_in=3 * n, curvature=float(rng.choice([0.0, 1.0])))
    point = rng.integers(-2, 3, n).astype(float)
    p["C"] = rng.integers(-2, 3, (3 * n, n)).astype(float)
    p["cl"], p["cu"] = np.full(3 * n, -inf), p["C"] @ point
    p["lb"], p["ub"] = np.full(n, -inf), np.full(n, inf)
    p["g"] = -p["H"] @ point - rng.exponential(1.0, 3 * n) @ p["C"]
    return p


def infeasible(rng: np.random.Generator) -> dict[str, Any]:
    return _draw(rng, integer=bool(rng.integers(2)), feasible=False, curvature=float(rng.choice([0.0, 1.0])))


def unbounded(rng: np.random.Generator) -> dict[str, Any]:
    p = _draw(rng, integer=bool(rng.integers(2)), rank=int(rng.integers(0, 2)), n_in=int(rng.integers(0, 3)), n_eq=0)
    loose = rng.uniform(size=len(p["g"])) < 0.7
    p["lb"][loose], p["ub"][loose] = -inf, inf
    return p


def equalities(rng: np.random.Generator) -> dict[str, Any]:
    n = int(rng.integers(1, 9))
    p = _draw(rng, n=n, n_in=0, n_eq=int(rng.integers(1, n + 1)))
    p["lb"], p["ub"] = np.full(n, -inf), np.full(n, inf)
    return p


def bounds(rng: np.random.Generator) -> dict[str, Any]:
    return _draw(rng, n_eq=0, n_in=0, integer=bool(rng.integers(2)))


def empty(rng: np.random.Generator) -> dict[str, Any]:
    """No row and no bound; the slope is in the range of H, or there is no cost at all."""
    n = int(rng.integers(1, 9))
    p = _draw(rng, n=n, n_eq=0, n_in=0)
    p["g"] = p["H"] @ rng.standard_normal(n)
    p["lb"], p["ub"] = np.full(n, -inf), np.full(n, inf)
    return p


FAMILIES: tuple[Draw, ...] = (
    convex, semidefinite, integers, convex_integers, linear, ties, duplicates, near_parallel, zero_rows, scaled_rows,
    scaled_variables, scaled_cost, light_parts, degenerate, infeasible, unbounded, equalities, bounds, empty,
)  # fmt: skip


def problem(family: Draw, seed: int, index: int) -> dict[str, Any]:
    """The problem of this family and number; one number is one problem for ever."""
    return family(np.random.default_rng([seed, index, zlib.crc32(family.__name__.encode())]))


# ---- the oracle


class Truth(NamedTuple):
    """The least violation any point has, whether the cost falls for ever, Clarabel's point and the exact one."""

    violation: float
    unbounded: bool
    x: Array | None
    exact: Array | None


def _sides(p: dict[str, Any]) -> tuple[Array, Array, Array]:
    n = len(p["g"])
    rows = np.vstack([p["A"], p["C"], np.eye(n)])
    return rows, np.concatenate([p["b"], p["cl"], p["lb"]]), np.concatenate([p["b"], p["cu"], p["ub"]])


def truth(p: dict[str, Any]) -> Truth:
    rows, low, high = _sides(p)
    n = len(p["g"])
    size = np.maximum(np.abs(rows).max(axis=1), 1e-300)
    up, down = np.isfinite(high), np.isfinite(low)
    # The least violation in the rows' own units; HiGHS gets rows of size one.
    G = np.vstack(
        [np.column_stack([rows[up], -np.ones(up.sum())]), np.column_stack([-rows[down], -np.ones(down.sum())])]
    )
    h = np.concatenate([high[up], -low[down]])
    violation = 0.0
    if len(G):
        found = linprog(np.eye(n + 1)[n], A_ub=G, b_ub=h, bounds=[(None, None)] * n + [(0, None)], method="highs")
        violation = float(found.fun) if found.status == 0 else np.nan
    # The steepest recession direction within a box, in units in which H has a unit diagonal.
    t = 1.0 / np.sqrt(np.where(np.diag(p["H"]) > 0.0, np.diag(p["H"]), 1.0))
    scale = float(np.abs(p["g"] * t).max(initial=0.0))
    falls = known = False
    if scale > 0.0:
        R = rows * t / size[:, None]
        eq = up & down
        found = linprog(
            p["g"] * t / scale, A_eq=np.vstack([p["H"] * np.outer(t, t), R[eq]]), b_eq=np.zeros(n + eq.sum()),
            A_ub=np.vstack([R[up & ~eq], -R[down & ~eq]]), b_ub=np.zeros((up ^ down).sum()),
            bounds=[(-1.0, 1.0)] * n, method="highs",
        )  # fmt: skip
        falls = found.status == 0 and found.fun < -1e-6
        if falls:  # by the solver's tolerance, which rows that are parallel to seven digits pass in either way
            d = found.x / np.abs(found.x).max()
            bent = np.abs(np.concatenate([p["H"] * np.outer(t, t) @ d, R[eq] @ d])).max(initial=0.0)
            known = max(bent, (R[up] @ d).max(initial=0.0), (-R[down] @ d).max(initial=0.0)) <= 1e-10
    x = None if falls or not violation <= 1e-8 else _clarabel(p, rows, low, high)
    return Truth(violation, bool(falls and known), x, None if x is None else _exact(p, rows, low, high))


def _clarabel(p: dict[str, Any], rows: Array, low: Array, high: Array) -> Array | None:
    """Its point, in variables of unit curvature, rows of unit length and a cost of size one, where that is solved."""
    n = len(p["g"])
    t = 1.0 / np.sqrt(np.where(np.diag(p["H"]) > 0.0, np.diag(p["H"]), 1.0))
    H, g, original = p["H"] * np.outer(t, t), p["g"] * t, (rows, low, high)
    rows = rows * t
    length = np.linalg.norm(rows, axis=1)
    length[length == 0.0] = 1.0
    rows, low, high = rows / length[:, None], low / length, high / length
    unit = max(float(np.abs(H).max(initial=0.0)), float(np.abs(g).max(initial=0.0))) or 1.0
    same = low == high
    up, down = np.isfinite(high) & ~same, np.isfinite(low) & ~same
    G, h = np.vstack([rows[same], rows[up], -rows[down]]), np.concatenate([high[same], high[up], -low[down]])
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.presolve_enable, settings.max_threads = False, False, 1
    settings.tol_feas = settings.tol_gap_abs = settings.tol_gap_rel = 1e-10
    cones = [clarabel.ZeroConeT(int(same.sum())), clarabel.NonnegativeConeT(len(h) - int(same.sum()))]
    found = clarabel.DefaultSolver(
        csc_matrix(np.triu(H / unit)), g / unit, csc_matrix(G.reshape(-1, n)), h, cones, settings
    ).solve()
    x, (rows, low, high) = t * np.array(found.x), original
    if str(found.status) != "Solved" or np.maximum(rows @ x - high, low - rows @ x).max() > 1e-7:
        return None
    return x


def _exact(p: dict[str, Any], rows: Array, low: Array, high: Array) -> Array | None:
    """The optimum by nonnegative least squares (least distance programming) where H is well conditioned."""
    H, n = p["H"], len(p["g"])
    values = np.linalg.eigvalsh(H)
    if values[0] <= 1e-8 * values[-1]:
        return None
    L = np.linalg.cholesky(H)
    centre = -np.linalg.solve(H, p["g"])
    up, down = np.isfinite(high), np.isfinite(low)
    G = np.vstack([rows[up], -rows[down]])
    h = np.concatenate([high[up], -low[down]]) - G @ centre
    if not len(G):
        return centre
    G = np.linalg.solve(L, G.T).T
    length = np.linalg.norm(G, axis=1)
    keep = length > 0.0
    if not keep.any():
        return centre
    G, h = G[keep] / length[keep, None], h[keep] / length[keep]
    size = float(np.maximum(-h, 0.0).max(initial=0.0)) or 1.0
    columns = np.vstack([-G.T, -h / size])
    push = lsq_linear(columns, np.eye(n + 1)[n], (0.0, inf), method="bvls", tol=1e-15, max_iter=50 * len(G)).x
    r = columns @ push - np.eye(n + 1)[n]
    if np.linalg.norm(r) < 1e-6:
        return None
    x = centre + np.linalg.solve(L.T, -size * r[:n] / r[n])
    return x if np.maximum(rows @ x - high, low - rows @ x).max() <= 1e-9 * (1 + np.abs(x).max()) else None


def judge(p: dict[str, Any], answer: Solution, true: Truth) -> str:
    """Why this verdict is wrong; nothing where it is right, or where nobody knows."""
    status = answer.status.name
    if (status == "SOLVED") != answer.certificate.ok:
        return "status and certificate disagree"
    if status == "INFEASIBLE":
        return "feasible" if true.violation <= MET * 1e-3 else ""
    if status == "UNBOUNDED":
        if true.violation > 2 * MET:
            return "infeasible, not unbounded"
        return "" if true.unbounded or true.x is None else "bounded"
    if status != "SOLVED":
        return ""
    rows, low, high = _sides(p)
    H, g, x = p["H"], p["g"], answer.x
    if not np.isfinite(x).all():
        return "not finite"
    violation = float(np.maximum(rows @ x - high, low - rows @ x).max(initial=0.0))
    if violation > MET * 1.001:
        return "a row is not met"  # a point that meets them all is its own proof that there is one
    if true.unbounded and true.violation <= MET:
        return "unbounded"
    if true.x is None:
        return ""
    # What bounds moved by as much as counts as met are worth, at most: their multipliers.
    moved = MET * float(np.abs(answer.y).sum() + np.abs(answer.z).sum() + np.abs(answer.z_box).sum())
    cost, least = 0.5 * x @ H @ x + g @ x, 0.5 * true.x @ H @ true.x + g @ true.x
    terms = 0.5 * true.x @ H @ true.x + np.abs(g) @ (1.0 + np.abs(true.x))
    # Where H is singular, the least cost is a difference of terms, and so negative by their rounding.
    rounding = 1e-15 * np.abs(true.x) @ np.abs(H) @ np.abs(true.x)
    if cost > least + COST * terms + moved + rounding:
        return f"cost {cost:.9g} above {least:.9g}"
    if violation > 1e-9 * (1.0 + np.abs(x).max()) and cost < least - 1e-5 * terms - 10 * moved:
        return f"cost {cost:.9g} below {least:.9g}"
    if true.exact is not None:
        off = np.abs(x - true.exact)
        least_curvature = float(np.linalg.eigvalsh(H)[0])
        if (off > 2 * DISTANCE * (1.0 + np.abs(x)) + 2 * np.sqrt(2 * moved / least_curvature)).any():
            return f"x is off by {off.max():.2g}"
    return ""


# ---- running


def cases(
    count: int, seed: int, solvers: list[str], families: tuple[Draw, ...] = FAMILIES, *, first: int = 0
) -> Iterator[Answered]:
    """``count`` problems from number ``first`` of this seed on, the families in turn, each on every solver."""
    settings = [by_name(name) for name in solvers]
    for k in range(first, first + count):
        family, index = families[k % len(families)], k // len(families)
        p = problem(family, seed, index)
        true: Truth | None = None
        qp = QP(**p)
        for solver in settings:
            answer = wbc.solve(qp, solver)
            true = truth(p) if true is None else true
            status = answer.status.name
            if status in ("FAILED", "INACCURATE", "MAX_ITERATIONS") and true.violation > 1e-9:
                status = "THIN" if true.violation <= 10 * MET else status
            yield Answered(family.__name__, index, solver.name, status, judge(p, answer, true))


HEAD = ("solved", "infeasible", "unbounded", "thin", "failed", "wrong")


if __name__ == "__main__":
    command_of_problems(cases, HEAD, __doc__, count=2000)
