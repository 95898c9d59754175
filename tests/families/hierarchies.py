"""Random families of ranked least squares, and an oracle for ``wbc.lexicographic``.

    python -m tests.families.hierarchies --count 5000 --seed 1 --solver pdas daqp

prints for each family how many hierarchies were solved or given up, and how many answers were wrong: a bound that is
not met, a level with more left than the least that the levels above leave it, SOLVED without a certificate, infeasible
where only bounds are hard and none are crossed. The oracle is Clarabel called directly, level by level, with what the
levels above came to in the answer held; all comparisons are plain numpy.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from typing import NamedTuple

import clarabel
import numpy as np
from scipy.optimize import linprog
from scipy.sparse import csc_matrix

import wbc
from tests.families.progress import Answered, command_of_problems
from wbc.qp import Solution

inf = np.inf
Array = np.ndarray
Level = tuple[Array, Array, Array]

#: More left of a level than this, beside one and what is least, is not the least; so is a bound missed by MET.
MORE, MET = 1e-4, 1e-6


class Problem(NamedTuple):
    """Levels (A, lo, hi) and bounds."""

    levels: list[Level]
    lb: Array
    ub: Array


def _drawn(rng: np.random.Generator, n: int, rows: Array, integer: bool) -> Level:
    m = len(rows)
    right = rng.integers(-3, 4, m).astype(float) if integer else rng.standard_normal(m)
    width = np.where(rng.uniform(size=m) < 0.5, 0.0, rng.integers(1, 3, m) if integer else rng.exponential(1.0, m))
    lo, hi = right - width, right + width
    loose = (width > 0.0) & (rng.uniform(size=m) < 0.5)
    lower = loose & (rng.uniform(size=m) < 0.5)
    lo[lower], hi[loose & ~lower] = -inf, inf
    return rows, lo, hi


def _hierarchy(rng: np.random.Generator, make: Callable[[int, int], Array], *, integer: bool = False) -> Problem:
    n = int(rng.integers(1, 7))
    levels = [_drawn(rng, n, make(int(rng.integers(1, 5)), n), integer) for _ in range(int(rng.integers(1, 5)))]
    low, high = -rng.integers(0, 4, n).astype(float), rng.integers(0, 4, n).astype(float)
    low[rng.uniform(size=n) < 0.5], high[rng.uniform(size=n) < 0.5] = -inf, inf
    return Problem(levels, low, high)


def random(rng: np.random.Generator) -> Problem:
    return _hierarchy(rng, lambda m, n: rng.standard_normal((m, n)))


def integers(rng: np.random.Generator) -> Problem:
    return _hierarchy(rng, lambda m, n: rng.integers(-2, 3, (m, n)).astype(float), integer=True)


def low_rank(rng: np.random.Generator) -> Problem:
    return _hierarchy(rng, lambda m, n: rng.standard_normal((m, 1)) @ rng.standard_normal((1, n)))


def duplicates(rng: np.random.Generator) -> Problem:
    """Rows that stand at several levels, with other right sides."""
    pool = rng.standard_normal((3, 6))
    return _hierarchy(rng, lambda m, n: pool[rng.integers(0, 3, m), :n] * rng.choice([1.0, -1.0, 2.0], (m, 1)))


def near_duplicates(rng: np.random.Generator) -> Problem:
    """Rows that stand at several levels but for a share of 10⁻² to 10⁻¹⁰."""
    pool = rng.standard_normal((3, 6))

    def make(m: int, n: int) -> Array:
        away = 10.0 ** rng.uniform(-10.0, -2.0, (m, 1)) * rng.standard_normal((m, n))
        return pool[rng.integers(0, 3, m), :n] + away

    return _hierarchy(rng, make)


def scaled(rng: np.random.Generator) -> Problem:
    return _hierarchy(rng, lambda m, n: 10.0 ** rng.uniform(-2, 2, (m, 1)) * rng.standard_normal((m, n)))


def far_scaled(rng: np.random.Generator) -> Problem:
    return _hierarchy(rng, lambda m, n: 10.0 ** rng.uniform(-4, 4, (m, 1)) * rng.standard_normal((m, n)))


FAMILIES = (random, integers, low_rank, duplicates, near_duplicates, scaled, far_scaled)


def problem(family: Callable[[np.random.Generator], Problem], seed: int, index: int) -> Problem:
    """The hierarchy of this family and number; one number is one problem for ever."""
    return family(np.random.default_rng([seed, index, zlib.crc32(family.__name__.encode())]))


# ---- the oracle


def _beyond(level: Level, x: Array) -> Array:
    A, lo, hi = level
    return A @ x - np.clip(A @ x, lo, hi)


def _least(H: Array, rows: Array, low: Array, high: Array) -> Array | None:
    """The minimum of ½ xᵀHx within rows of unit length, where Clarabel calls it solved."""
    length = np.linalg.norm(rows, axis=1)
    length[length == 0.0] = 1.0
    rows, low, high = rows / length[:, None], low / length, high / length
    same = low == high
    up, down = np.isfinite(high) & ~same, np.isfinite(low) & ~same
    G, h = np.vstack([rows[same], rows[up], -rows[down]]), np.concatenate([high[same], high[up], -low[down]])
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.presolve_enable, settings.max_threads = False, False, 1
    settings.tol_feas = settings.tol_gap_abs = settings.tol_gap_rel = 1e-11
    cones = [clarabel.ZeroConeT(int(same.sum())), clarabel.NonnegativeConeT(len(h) - int(same.sum()))]
    found = clarabel.DefaultSolver(csc_matrix(np.triu(H)), np.zeros(len(H)), csc_matrix(G), h, cones, settings).solve()
    x = np.array(found.x)
    off = np.maximum(rows @ x - high, low - rows @ x).max(initial=0.0)
    return x if str(found.status) == "Solved" and off <= 1e-8 * (1.0 + np.abs(x).max()) else None


def _kept(x: Array, held: list[Array], lows: list[Array], highs: list[Array]) -> Array | None:
    """The point next to x that keeps what x keeps but for the tolerance of an interior point method, to rounding.

    Where rows nearly depend on one another, the tolerance is worth as much as they differ.
    """
    rows, low, high = map(np.concatenate, (held, lows, highs))
    for _ in range(3):
        at = rows @ x
        near = np.clip(at, low, high)
        tight = (np.minimum(np.abs(at - low), np.abs(at - high)) <= MET) | (at != near)
        ends = np.where(np.abs(near - low) <= np.abs(high - near), low, high)
        x = x + np.linalg.pinv(rows[tight], rcond=1e-14) @ (ends - at)[tight]
    at = rows @ x
    off = np.maximum(at - high, low - at).max(initial=0.0)
    return x if off <= 1e-13 * (1.0 + np.abs(x).max()) else None


def _gains(level: Level, x: Array, held: list[Array], lows: list[Array], highs: list[Array]) -> bool:
    """Whether this level falls from x on by more than rounding, within the rows of the levels above."""
    rows, low, high = map(np.concatenate, (held, lows, highs))
    beyond = _beyond(level, x)
    slope, least = level[0].T @ beyond, 1e-12 * (1.0 + float(beyond @ beyond))
    size, length = 1.0 + float(np.abs(x).max()), float(np.linalg.norm(slope))
    if length * size <= least:
        return False
    room, ways = np.concatenate([high - rows @ x, rows @ x - low]), np.vstack([rows, -rows])
    near = np.isfinite(room)
    found = linprog(slope / length, A_ub=ways[near], b_ub=np.maximum(room[near], 0.0), bounds=(-size, size))
    return bool(found.status == 0 and -found.fun * length > least)


def judge(p: Problem, answer: Solution, *, nearly: bool = False) -> str:
    """Why this answer is wrong; nothing where it is right, or where nobody knows.

    ``nearly``: rows nearly depend on one another. A level above may then be a little more than rounding off its least,
    and a point that keeps what it came to is no witness, because its least does not leave that point.
    """
    if (answer.status.name == "SOLVED") != answer.certificate.ok:
        return "" if answer.status.name == "INACCURATE" else "status and certificate disagree"
    if answer.status.name in ("INFEASIBLE", "UNBOUNDED"):
        return f"{answer.status}, and there is an answer"
    if answer.status.name != "SOLVED":
        return ""
    x, n = answer.x, len(p.lb)
    if not np.isfinite(x).all():
        return "not finite"
    if np.maximum(x - p.ub, p.lb - x).max() > MET:
        return "a bound is not met"
    held, low, high = [np.eye(n)], [p.lb], [p.ub]
    for k, level in enumerate([*p.levels, (np.eye(n), np.zeros(n), np.zeros(n))]):
        A, lo, hi = level
        m = len(A)
        size = max(1.0, float(np.abs(A).max()))
        H = np.diag(np.concatenate([np.zeros(n), np.ones(m)]))
        above = np.concatenate(held)
        rows = np.block([[above, np.zeros((len(above), m))], [A, -size * np.eye(m)]])
        found = _least(H, rows, np.concatenate([*low, lo]), np.concatenate([*high, hi]))
        mine = float(np.linalg.norm(_beyond(level, x)))
        if found is not None:
            least = float(np.linalg.norm(found[n:])) * size
            if nearly and mine > least:
                sure = not any(_gains(p.levels[j], x, held[: j + 1], low[: j + 1], high[: j + 1]) for j in range(k))
                better = _kept(found[:n], held, low, high) if sure else None
                least = mine if better is None else float(np.linalg.norm(_beyond(level, better)))
            if mine > least + MORE * (1.0 + least):
                return f"level {k + 1}: {mine:.9g} is left, the least is {least:.9g}"
        beyond = _beyond(level, x)
        at, off = A @ x, np.abs(beyond) > 1e-7 * np.maximum(1.0, np.abs(A @ x))
        fixed = off | (lo == hi)
        held.append(A)
        low.append(np.where(fixed, at, np.minimum(lo, at)))
        high.append(np.where(fixed, at, np.maximum(hi, at)))
    return ""


# ---- running


def cases(count: int, seed: int, solvers: list[str], *, first: int = 0) -> Iterator[Answered]:
    """``count`` hierarchies from number ``first`` of this seed on, the families in turn, each on every solver."""
    for k in range(first, first + count):
        family, index = FAMILIES[k % len(FAMILIES)], k // len(FAMILIES)
        p = problem(family, seed, index)
        for solver in solvers:
            answer = wbc.lexicographic(p.levels, lb=p.lb, ub=p.ub, solver=solver)
            yield Answered(family.__name__, index, solver, answer.status.name,
                       judge(p, answer, nearly=family is near_duplicates))  # fmt: skip


HEAD = ("solved", "inaccurate", "failed", "wrong")


if __name__ == "__main__":
    command_of_problems(cases, HEAD, __doc__, count=600)
