"""Figures read from the data. Times are of solved problems alone; nothing here can come out negative or NaN."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import exp
from typing import Any, final

import numpy as np

from wbc.report.solvers.data import Data
from wbc.types import Mat, Vec

#: The certificate that this library asks of an answer.
TARGET = 1e-6
#: How a solve of a problem without a solution ends, by a proof.
PROVEN = frozenset({"INFEASIBLE", "UNBOUNDED"})


@final
@dataclass(frozen=True)
class Measure:
    """One solver at one class on one set in one mode: columns as arrays, NaN where there is nothing.

    ``rounds`` (R, N) are the total times of each round, ``total`` the least of them; ``bounds`` says for each task how
    far it can be from its optimum. ``own`` is the tolerance at which the back end's own answer is certified.
    """

    set: str
    solver: str
    asked: str
    mode: str
    status: Sequence[str]
    total: Vec
    build: Vec
    solve: Vec
    rounds: Mat
    primal: Vec
    dual: Vec
    gap: Vec
    own: Vec
    changed: Vec
    violation: Mapping[str, Vec]
    bounds: Mapping[str, Vec]
    lost: int

    @property
    def count(self) -> int:
        """Problems."""
        return len(self.status)

    @property
    def achieved(self) -> Vec:
        """The tolerance at which each certificate holds, infinite where there is no answer."""
        worst = np.maximum(np.maximum(self.primal, self.dual), self.gap)
        return np.where(np.isfinite(worst), worst, np.inf)

    def holds(self, tolerance: float) -> Any:
        """For each problem whether its answer is good to ``tolerance``."""
        return self.achieved <= tolerance

    def share(self, tolerance: float) -> float:
        """Share of problems answered to ``tolerance``."""
        return float(np.mean(self.holds(tolerance)))

    def by_itself(self, tolerance: float) -> Any:
        """For each problem whether the back end's own answer, before it is refined, is good to ``tolerance``."""
        return self.own <= tolerance

    @property
    def says_solved(self) -> Any:
        """For each problem whether the back end calls it solved or nearly solved, or the certificate does."""
        return np.array([word in ("SOLVED", "INACCURATE") for word in self.status])

    def times(self, tolerance: float) -> Vec:
        """Total time of each problem [µs], infinite where the answer is not that good."""
        return np.where(self.holds(tolerance) & np.isfinite(self.total), self.total, np.inf)


def measures(data: Data, name: str, mode: str) -> list[Measure]:
    """All measures of a set in a mode, over the problems that have a solution, if any has one. A warm start begins
    with the second problem of a stretch."""
    about = next(s for s in data["sets"] if s["name"] == name)
    firsts = {start for start, _ in about["stretches"]} if mode == "warm" else set()
    counted = [i for i in range(len(about["labels"])) if i not in firsts]
    keep = [i for i in counted if i not in insoluble(data, name)] or counted
    found = []
    for entry in data["measures"]:
        if entry["set"] == name and entry["mode"] == mode:
            found.append(_measure(entry, keep))
    return found


def insoluble(data: Data, name: str) -> list[int]:
    """The problems of a set that are proven to have no solution, also at the coarsest tolerance."""
    coarsest = max(data["classes"], key=lambda asked: tolerance_of(data, asked))
    own = [m["status"] for m in data["measures"] if (m["set"], m["class"]) == (name, coarsest)]
    return [i for i, words in enumerate(zip(*own, strict=True)) if not PROVEN.isdisjoint(words)]


def _measure(entry: Data, keep: Sequence[int]) -> Measure:
    def column(values: Sequence[float | None]) -> Vec:
        return np.array([np.nan if values[i] is None else values[i] for i in keep], dtype=np.float64)

    return Measure(
        entry["set"], entry["solver"], entry["class"], entry["mode"], [entry["status"][i] for i in keep],
        column(entry["total_us"]), column(entry["build_us"]), column(entry["solve_us"]),
        np.stack([column(times) for times in entry["rounds_us"]]),
        column(entry["primal"]), column(entry["dual"]), column(entry["gap"]), column(entry["own"]),
        column(entry["changed"]),
        {unit: column(values) for unit, values in entry["violation"].items()},
        {task: column(values) for task, values in entry["bounds"].items()}, sum(int(i) in keep for i in entry["lost"]),
    )  # fmt: skip


def main_mode(about: Data) -> str:
    """Warm where problems follow one another, else cold."""
    return "cold" if about["kind"] == "files" else "warm"


def period_of(about: Data) -> float:
    """The period of the controller whose problems they are [µs]; a millisecond where nothing says it."""
    return 1e6 * float(about["period"] or 1e-3)


def tolerance_of(data: Data, asked: str) -> float:
    """The accuracy by which a class is judged; the default class by the library's own."""
    value = data["classes"][asked]
    return TARGET if value is None else float(value)


def percentiles(times: Vec) -> tuple[float | None, float | None, float | None]:
    """Median, 99th percentile and maximum of the finite times; None where there are none."""
    finite = times[np.isfinite(times)]
    if not finite.size:
        return None, None, None
    return float(np.median(finite)), float(np.percentile(finite, 99)), float(finite.max())


def geometric_mean(times: Vec) -> float | None:
    """exp of the mean logarithm of the finite times: between their least and their largest, so never negative.

    Example:
        >>> import numpy as np
        >>> from wbc.report.solvers.statistics import geometric_mean
        >>> round(geometric_mean(np.array([1.0, 100.0, np.inf])), 9), geometric_mean(np.array([np.inf]))
        (10.0, None)
    """
    finite = times[np.isfinite(times)]
    return exp(float(np.mean(np.log(np.maximum(finite, 1e-3))))) if finite.size else None


def ratio(one: Vec, other: Vec) -> tuple[float | None, int]:
    """Geometric mean of one / other over the problems that both solved, and their number."""
    both = np.isfinite(one) & np.isfinite(other)
    if not both.any():
        return None, 0
    logs = np.log(np.maximum(one[both], 1e-3)) - np.log(np.maximum(other[both], 1e-3))
    return exp(float(logs.mean())), int(both.sum())


def best_classes(found: Sequence[Measure], tolerance: float = TARGET) -> list[Measure]:
    """For each solver the class to compare it at: solves most to ``tolerance``, then is fastest.

    The default class is kept where another saves less than a third: it is what a name stands for, and times of a
    busy machine differ by less than that for no reason.
    """
    chosen = []
    for solver in dict.fromkeys(m.solver for m in found):
        own = [m for m in found if m.solver == solver]
        most = max(m.share(tolerance) for m in own)
        good = [m for m in own if m.share(tolerance) == most]
        fastest = min(good, key=lambda m: geometric_mean(m.times(tolerance)) or np.inf)
        default = next((m for m in good if m.asked == "default"), None)
        if default is not None:
            means = geometric_mean(default.times(tolerance)), geometric_mean(fastest.times(tolerance))
            if means[0] is None or means[1] is None or means[0] <= 1.5 * means[1]:
                fastest = default
        chosen.append(fastest)
    return chosen


def profile(found: Sequence[Measure], tolerance: float = TARGET) -> Iterator[tuple[Measure, Vec]]:
    """Dolan and Moré's ratios: the time of each measure over the best of all on the same problem, infinite where it
    did not solve it. Problems that nobody solved stay infinite for everybody.

    Dolan, Moré: Benchmarking optimization software with performance profiles, Mathematical Programming 91, 2002.
    """
    times = np.stack([m.times(tolerance) for m in found])
    best = times.min(axis=0)
    for m, own in zip(found, times, strict=True):
        finite = np.isfinite(own)
        ratios = np.full(len(own), np.inf)
        ratios[finite] = own[finite] / best[finite]
        yield m, ratios


def wins(one: Vec, other: Vec) -> float | None:
    """Share of problems on which ``one`` was faster, among those that at least one of the two solved."""
    either = np.isfinite(one) | np.isfinite(other)
    return float(np.mean(one[either] < other[either])) if either.any() else None


def between_rounds(m: Measure) -> float | None:
    """How much longer the slowest round took than the fastest, over the problems that every round timed; None for one
    round."""
    logs = np.log(np.maximum(m.rounds[:, np.isfinite(m.rounds).all(axis=0)], 1e-3))
    if len(logs) < 2 or not logs.size:
        return None
    return exp(float(np.ptp(logs.mean(axis=1))))


def ratio_of_rounds(one: Measure, other: Measure, tolerance: float = TARGET) -> list[float]:
    """The geometric mean of one / other in each round, over the problems that both solved and every round timed."""
    both = one.holds(tolerance) & other.holds(tolerance)
    both &= np.isfinite(one.rounds).all(axis=0) & np.isfinite(other.rounds).all(axis=0)
    found = [ratio(a[both], b[both])[0] for a, b in zip(one.rounds, other.rounds, strict=True)]
    return [value for value in found if value is not None]
