"""Hierarchies from files: levels of rows, the first above all others, solved lexicographically by the core."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any, final

import numpy as np

from wbc.errors import InvalidInput, InvalidProblem, WbcError
from wbc.npz import read_npz
from wbc.qp.lexicographic import lexicographic
from wbc.report.solvers.measure import plain
from wbc.types import Mat, Vec

#: How often it is timed; the least counts.
TRIES = 3
#: A level counts as reached within this share of its optimum, or this much above zero.
RELATIVE, ABSOLUTE = 1e-6, 1e-9


@final
@dataclass(frozen=True, eq=False)
class Ranked:
    """Levels (A (m, n), lo (m,), hi (m,)), and a solution (n,) somebody knows, if any."""

    levels: Sequence[tuple[Mat, Vec, Vec]]
    known: Vec | None


def is_ranked(path: Path) -> bool:
    """Whether an .npz holds levels ``A0, l0, u0, A1, …``."""
    try:
        return {"A0", "l0", "u0"} <= set(read_npz(path))
    except InvalidInput:
        return False


def read_ranked(path: Path) -> Ranked:
    """The hierarchy in a file: ``Ak, lk, uk`` for each level k from 0, and ``solution`` where one is known.

    Raises:
        InvalidProblem: shapes that do not fit, or numbers that are none.
    """
    file = read_npz(path)
    count = sum(name.startswith("A") and name[1:].isdigit() for name in file)
    try:
        levels = [(file[f"A{k}"], file[f"l{k}"], file[f"u{k}"]) for k in range(count)]
    except KeyError as cause:
        raise InvalidProblem(f"{path}: a level is not complete: {cause}") from None
    known = file.get("solution")
    for k, (A, lower, upper) in enumerate(levels):
        if A.ndim != 2 or A.shape[1] != levels[0][0].shape[1] or lower.shape != upper.shape or len(lower) != len(A):
            raise InvalidProblem(f"{path}: the shapes of level {k} do not fit")
    return Ranked(levels, known)


def missed(levels: Sequence[tuple[Mat, Vec, Vec]], x: Vec) -> list[float]:
    """½ ‖v‖² of each level, v the distance of A x from [lo, hi]."""
    found = []
    for A, lower, upper in levels:
        at = A @ x
        found.append(0.5 * float(np.sum(np.maximum(0.0, np.maximum(at - upper, lower - at)) ** 2)))
    return found


def ranked(path: Path) -> dict[str, Any]:
    """Solve a hierarchy: the status, ½ ‖v‖² of each level, the least time [µs], and what the known solution misses."""
    problem = read_ranked(path)
    known = None if problem.known is None else [plain(v) for v in missed(problem.levels, problem.known)]
    best = np.inf
    try:
        for _ in range(TRIES):
            start = perf_counter()
            answer = lexicographic(problem.levels)
            best = min(best, perf_counter() - start)
    except WbcError as refusal:
        return {"status": "REFUSED", "error": str(refusal), "known": known}
    levels = [plain(v) for v in missed(problem.levels, answer.x)] if np.isfinite(answer.x).all() else None
    return {"status": answer.status.name, "levels": levels, "us": plain(1e6 * best), "known": known}


def reached(levels: Sequence[float], best: Sequence[float]) -> int:
    """How many levels, from the first, come as low as ``best`` before one does not.

    Example:
        >>> from wbc.report.solvers.ranked import reached
        >>> reached([0.0, 2.0, 1.0], [0.0, 2.0, 0.5])
        2
    """
    for k, (own, least) in enumerate(zip(levels, best, strict=True)):
        if own > least * (1.0 + RELATIVE) + ABSOLUTE:
            return k
    return len(levels)
