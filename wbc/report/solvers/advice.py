"""Advice: which solver at which tolerance, for which reason; every number in it stands in the tables below it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from wbc.report.document import percent
from wbc.report.solvers.data import Data
from wbc.report.solvers.statistics import (
    PERIOD,
    TARGET,
    Measure,
    best_classes,
    geometric_mean,
    main_mode,
    measures,
    percentiles,
    ratio,
)
from wbc.report.style import short


@final
@dataclass(frozen=True)
class Advice:
    """For one set of problems: the measure to use, None where no solver is of use, and the sentence that says why."""

    name: str
    use: Measure | None
    sentence: str

    @property
    def at(self) -> str:
        """The class in words."""
        if self.use is None:
            return ""
        return "its default settings" if self.use.asked == "default" else f"tolerance {self.use.asked}"


def advice(data: Data, about: Data) -> Advice:
    """What to use for one set.

    Wanted are answers certified to 1e-6. Of the solvers that may work here (a controller refuses offline ones, and a
    closed loop that failed with one rules it out) those that solve most are kept, and of these the fastest, by the
    geometric mean of its times, is advised.
    """
    name, mode = about["name"], main_mode(about)
    found = [m for m in measures(data, name, mode) if _admissible(data, about, m)]
    if not found:
        return Advice(name, None, "no solver may be used here.")
    classes = best_classes(found)
    most = max(m.share(TARGET) for m in classes)
    if most == 0.0:
        return Advice(name, None, f"no solver reached {short(TARGET)} on any of {found[0].count} problems.")
    good = [m for m in classes if m.share(TARGET) == most]
    use = min(good, key=lambda m: geometric_mean(m.times(TARGET)) or np.inf)
    return Advice(name, use, _sentence(about, use, [m for m in classes if m is not use]))


def overall(advices: list[Advice]) -> str:
    """What to use, at which tolerance, because of what; sets with the same advice share a sentence."""
    by_use: dict[str, list[Advice]] = {}
    for one in advices:
        if one.use is not None:
            by_use.setdefault(f"Use {one.use.solver} at {one.at}", []).append(one)
    if not by_use:
        return "No solver can be advised here; the tables say what went wrong."
    if len(advices) == 1:
        ((use, (one,)),) = by_use.items()
        return f"{use} for {one.name}, because {one.sentence}"
    return " ".join(
        f"{use} for {_and([o.name for o in ones])}, because {_shared(ones)}." for use, ones in by_use.items()
    )


def _shared(advices: list[Advice]) -> str:
    """What sets with the same advice have in common."""
    uses = [one.use for one in advices if one.use is not None]
    solved, count = sum(round(use.share(TARGET) * use.count) for use in uses), sum(use.count for use in uses)
    share = f"all {count}" if solved == count else f"{solved} of {count}"
    return f"it solved {share} problems to {short(TARGET)} and was the fastest of those that solved as many"


def _admissible(data: Data, about: Data, m: Measure) -> bool:
    if about["kind"] != "sequence":
        return True
    if next(s for s in data["solvers"] if s["name"] == m.solver)["offline"]:
        return False
    loops = [x for x in data["loops"] if (x["scenario"], x["solver"], x["class"]) == (about["name"], m.solver, m.asked)]
    best = any(x.get("ok") for x in data["loops"] if x["scenario"] == about["name"])
    return not best or not loops or bool(loops[0].get("ok"))


def _sentence(about: Data, use: Measure, others: list[Measure]) -> str:
    p50, p99, top = percentiles(use.times(TARGET))
    assert p50 is not None and p99 is not None and top is not None, "it solved at least one problem"
    share = use.share(TARGET)
    solved = f"all {use.count}" if share == 1.0 else f"{round(share * use.count)} of {use.count}"
    how = "warm from tick to tick" if use.mode == "warm" else "cold"
    words = [
        f"{use.solver} solved {solved} problems to {short(TARGET)} ({how}), median {_us(p50)}, 99 % within {_us(p99)}"
    ]
    words += _next_best(use, others)
    lies = int(np.sum(use.says_solved & ~use.holds(TARGET)))
    if lies:
        words.append(f"{lies} answers that it calls solved are not that good")
    if about["kind"] == "sequence":
        words.append(
            f"its slowest solve takes {percent(top / PERIOD)} of a 1 ms period"
            if top <= PERIOD else f"but its slowest solve, {_us(top)}, misses a 1 ms period"
        )  # fmt: skip
    return "; ".join(words) + "."


def _next_best(use: Measure, others: list[Measure]) -> list[str]:
    """How the one that comes next compares: fewer solved, or slower on what both solved."""
    if not others:
        return []
    second = max(others, key=lambda m: (m.share(TARGET), -(geometric_mean(m.times(TARGET)) or np.inf)))
    times, common = ratio(second.times(TARGET), use.times(TARGET))
    if second.share(TARGET) < use.share(TARGET):
        return [f"no other solved as many: next is {second.name} with {percent(second.share(TARGET))}"]
    if times is None:
        return []
    return [f"next is {second.name}, which takes {times:.2f} times as long on the {common} problems that both solved"]


def _us(value: float) -> str:
    return f"{value:.0f} µs" if value < 9950 else f"{value / 1e3:.0f} ms"


def _and(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
