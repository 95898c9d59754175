"""Advice: which solver at which tolerance, for which reason, and how sure that is; withheld where the machine was
disturbed. Every number in it stands in the tables below it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from wbc.report.document import Cell, Marked, percent, plural, short
from wbc.report.solvers.data import Data
from wbc.report.solvers.statistics import (
    TARGET,
    Measure,
    best_classes,
    between_rounds,
    geometric_mean,
    main_mode,
    measures,
    percentiles,
    period_of,
    ratio,
    ratio_of_rounds,
)

#: Rounds of a quiet machine differ by less than this factor.
QUIET = 1.25


@final
@dataclass(frozen=True)
class Advice:
    """For one set of problems: the fastest of the measures that solve most, None where no solver is of use; what comes
    next; and the sentence that says why."""

    name: str
    use: Measure | None
    next: Measure | None
    sentence: str

    @property
    def at(self) -> str:
        """The class in words."""
        if self.use is None:
            return ""
        return "its default settings" if self.use.asked == "default" else f"tolerance {self.use.asked}"

    @property
    def sure(self) -> Cell:
        """How sure it is that no other that solves as many is faster: what the rounds say."""
        if self.use is None or self.next is None:
            return ""
        if self.next.share(TARGET) < self.use.share(TARGET):
            return "solves most"
        ratios = ratio_of_rounds(self.next, self.use)
        if len(ratios) < 2:
            return Marked("timed once", "doubtful")
        faster = sum(one > 1.0 for one in ratios)
        if faster < len(ratios):
            return Marked(f"faster in {faster} of {len(ratios)} rounds", "doubtful")
        return f"in each of {len(ratios)} rounds, {min(ratios):.2f} to {max(ratios):.2f} times"


def disturbances(data: Data) -> list[str]:
    """What says that the times are not the solvers' alone; nothing on a quiet machine.

    More processes wanted to run than there are cores, before or after; or rounds differ by more than a quarter, in the
    median of all measures.
    """
    found, where = [], data["surroundings"]
    cores = where["machine"].get("cores") or 1
    for when, loads in (("began", where["load"]), ("ended", where["load_after"])):
        if loads and loads[0] > cores:
            found.append(f"load {loads[0]:g} on {cores} cores when it {when}")
    spread = rounds_spread(data)
    if spread is not None and spread > QUIET:
        found.append(f"rounds differ by a factor of {spread:.2f}")
    return found


def rounds_spread(data: Data) -> float | None:
    """The median over all measures of slowest round over fastest; None with one round."""
    sets = [about for about in data["sets"] if about["kind"] != "growth"]
    found = [between_rounds(m) for about in sets for m in measures(data, about["name"], main_mode(about))]
    known = [one for one in found if one is not None]
    return float(np.median(known)) if known else None


def advice(data: Data, about: Data) -> Advice:
    """What to use for one set.

    Wanted are answers certified to 1e-6. Of the solvers that may work here (a controller refuses offline ones, and a
    closed loop that failed with one rules it out) those that solve most are kept, and of these the fastest, by the
    geometric mean of its times, is advised.
    """
    name, mode = about["name"], main_mode(about)
    found = [m for m in measures(data, name, mode) if _admissible(data, about, m)]
    if not found:
        return Advice(name, None, None, "no solver may be used here.")
    ranked = sorted(best_classes(found), key=lambda m: (-m.share(TARGET), geometric_mean(m.times(TARGET)) or np.inf))
    use, following = ranked[0], next(iter(ranked[1:]), None)
    if use.share(TARGET) == 0.0:
        return Advice(name, None, None, f"no solver reached {short(TARGET)} on any of {found[0].count} problems.")
    return Advice(name, use, following, _sentence(about, use, following))


def overall(data: Data, advices: list[Advice]) -> str:
    """What to use, at which tolerance, because of what, and how sure that is; sets with the same advice share a
    sentence."""
    by_use: dict[str, list[Advice]] = {}
    for one in advices:
        if one.use is not None:
            by_use.setdefault(f"{one.use.solver} at {one.at}", []).append(one)
    if not by_use:
        return "No solver can be advised here; the tables say what went wrong."
    disturbed = disturbances(data)
    if disturbed:
        fastest = "; ".join(f"{use} on {_and([o.name for o in ones])}" for use, ones in by_use.items())
        return (
            f"No solver is recommended: other work disturbed the times ({', '.join(disturbed)}). Measure again on an "
            f"idle machine. Which problems were solved, and how accurately, is valid. The fastest in this measurement: "
            f"{fastest}."
        )
    if len(advices) == 1:
        ((use, (one,)),) = by_use.items()
        return f"Use {use} for {one.name}, because {one.sentence}{_sureness([one])}"
    return " ".join(
        f"Use {use} for {_and([o.name for o in ones])}, because {_shared(ones)}.{_sureness(ones)}"
        for use, ones in by_use.items()
    )


def _sureness(advices: list[Advice]) -> str:
    """What is to be known before one relies on it."""
    doubts = [one for one in advices if isinstance(one.sure, Marked)]
    if not doubts:
        return ""
    if any(one.sure == Marked("timed once", "doubtful") for one in doubts):
        return " Each solve was timed once; --rounds 3 shows how far the times spread."
    told = [f"on {one.name} {one.next.solver} is as fast" for one in doubts if one.next is not None]
    return f" The rounds do not agree: {_and(told)}."


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


def _sentence(about: Data, use: Measure, following: Measure | None) -> str:
    p50, p99, top = percentiles(use.times(TARGET))
    assert p50 is not None and p99 is not None and top is not None, "it solved at least one problem"
    share = use.share(TARGET)
    part = f"{round(share * use.count)} of " if share < 1.0 else "all " * (use.count > 1)
    how = "warm from tick to tick" if use.mode == "warm" else "cold"
    words = [
        f"{use.solver} solved {part}{plural(use.count, 'problem')} to {short(TARGET)} ({how}), median {_us(p50)}, "
        f"99 % within {_us(p99)}"
    ]
    if following is not None:
        times, common = ratio(following.times(TARGET), use.times(TARGET))
        if following.share(TARGET) < share:
            words.append(f"no other solved as many: next is {following.solver} with {percent(following.share(TARGET))}")
        elif times is not None:
            words.append(
                f"next is {following.solver}, which takes {times:.2f} times as long on the {plural(common, 'problem')} "
                "that both solved"
            )
    lies = int(np.sum(use.says_solved & ~use.holds(TARGET)))
    if lies:
        words.append(f"{lies} answers that it calls solved are not that good")
    mended = int(np.sum(use.holds(TARGET) & ~use.by_itself(TARGET)))
    if mended:
        words.append(f"{mended} of its own solutions were not that good before the library refined them")
    if about["kind"] == "sequence":
        period = period_of(about)
        part = f"takes {percent(top / period)} of" if top <= period else f"takes {_us(top)} and misses"
        words.append(f"the slowest solve of {use.solver} {part} a period of {1e-3 * period:g} ms")
    return "; ".join(words) + "."


def _us(value: float) -> str:
    return f"{value:.0f} µs" if value < 9950 else f"{value / 1e3:.0f} ms"


def _and(words: list[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"
