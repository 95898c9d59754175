"""The report of a sweep: how often it went well, how near each demand was, what it depends on, the worst runs."""

from __future__ import annotations

import shlex
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np

from wbc.report.document import (
    Address,
    Bound,
    Cell,
    Curve,
    Item,
    Marked,
    Plot,
    Report,
    Section,
    Table,
    Text,
    Tile,
    number,
    percent,
)
from wbc.report.folder import HTML
from wbc.report.sections.settings import figure_name, measured
from wbc.sim.scenario import Check
from wbc.sweep.plan import SEED
from wbc.types import Vec

Result = dict[str, Any]

_BINS, _BARS, _WORST = 6, 30, 10
#: Figures that differ by less than this share of their size are the same, and demands that vary by less than that
#: share of their bound are not drawn.
_SAME, _VISIBLE = 1e-6, 1e-3


@final
@dataclass(frozen=True)
class Demand:
    """A demand of the scenario and what came out in each run: ``values`` and ``bounds`` (N,), NaN where a run did not
    end, and whether it was met, None there."""

    text: str
    relation: str
    unit: str
    values: Vec
    bounds: Vec
    held: Sequence[bool | None]

    @property
    def met(self) -> list[bool]:
        """Whether it was met in each run that ended."""
        return [held for held in self.held if held is not None]

    @property
    def bound(self) -> float | None:
        """The bound of every run; None where runs have different ones."""
        own = np.unique(self.bounds[np.isfinite(self.bounds)])
        return float(own[0]) if len(own) == 1 else None

    @property
    def varies(self) -> bool:
        """Whether runs differ by more than a thousandth of the bound."""
        finite = self.values[np.isfinite(self.values)]
        largest = float(np.abs(np.nan_to_num([*finite, *self.bounds])).max(initial=0.0))
        return bool(finite.size and np.ptp(finite) > _VISIBLE * largest)


def summary(header: dict[str, Any], results: Sequence[Result], folder: Path | None = None) -> Report:
    """The report of all results; the same results give the same bits. Runs with a page in ``folder`` lead to it."""
    good = sum(r["ok"] for r in results)
    low, high = interval(good, len(results))
    failed = Counter(reason for r in results for reason in reasons(r))
    most = f" Most often not met: {failed.most_common(1)[0][0]}." if failed else ""
    text = (
        f"{good} of {len(results)} runs of {header['scenario']} went well ({percent(good / len(results))}; 95 % "
        f"interval {percent(low)} to {percent(high)}).{most} Drawn or set: {header['sweep']}."
    )
    found = demands(results)
    sections = [
        Section("How often", list(_how_often(results))),
        Section("Demands", list(_demands(found))),
        Section("What it depends on", list(_dependence(results, found))),
        Section("Worst runs", list(_worst(header, results, folder))),
        Section("Settings", [_settings(header)]),
        Section("Limits of this sweep", [Text(sentence) for sentence in _limits(header, results)]),
    ]
    if found:
        sections[1] = Section("Demands", [*sections[1].items, _others(results)])
    tiles = [
        Tile("runs", str(len(results))),
        Tile("went well", percent(good / len(results)), "good" if good == len(results) else "bad"),
        Tile("95 % interval", f"{percent(low)} to {percent(high)}"),
    ]
    return Report(
        f"Sweep · {header['scenario']}", text, None, [section for section in sections if section.items], tiles
    )


def figures(header: dict[str, Any], results: Sequence[Result]) -> dict[str, Any]:
    """The report in JSON's types: what ``wbc sweep --json`` prints."""
    good = sum(r["ok"] for r in results)
    return {
        "scenario": header["scenario"],
        "runs": len(results),
        "good": good,
        "share": good / len(results),
        "interval": list(interval(good, len(results))),
        "reasons": dict(Counter(reason for r in results for reason in reasons(r)).most_common()),
        "demands": [
            {"demand": one.text, "relation": one.relation, "bound": one.bound, "unit": one.unit, "met": sum(one.met),
             **{name: _or_none(q) for name, q in zip(("least", "median", "largest"), _spread(one.values), strict=True)}}
            for one in demands(results)
        ],
        "worst": [r["run"] for r in _ordered(results)[:_WORST] if not r["ok"]],
    }  # fmt: skip


def interval(good: int, count: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a share.

    Wilson: Probable inference, the law of succession, and statistical inference, JASA 22, 1927.

    Example:
        >>> from wbc.sweep.summary import interval
        >>> [round(x, 3) for x in interval(10, 10)]
        [0.722, 1.0]
    """
    from scipy.stats import binomtest

    found = binomtest(good, count).proportion_ci(method="wilson")
    return max(float(found.low), 0.0), min(float(found.high), 1.0)


def reasons(result: Result) -> list[str]:
    """Why a run did not go well; nothing where it did."""
    if result["ok"]:
        return []
    if result["error"] is not None:
        return [f"error: {str(result['error']).splitlines()[0]}"]
    return [d["demand"] for d in result["demands"] if not d["ok"]] or ["the scenario's own verdict"]


def demands(results: Sequence[Result]) -> list[Demand]:
    """Every demand of the scenario over all runs."""
    by_text = [{d["demand"]: d for d in r.get("demands", ())} for r in results]
    found = []
    for text in dict.fromkeys(text for one in by_text for text in one):
        said = next(one[text] for one in by_text if text in one)
        said_of = [one.get(text, {}) for one in by_text]
        values, bounds = (np.array([_number(one.get(key)) for one in said_of]) for key in ("value", "bound"))
        held = [bool(one[text]["ok"]) if text in one else None for one in by_text]
        found.append(Demand(text, said["relation"], said["unit"], values, bounds, held))
    return found


# ---- how often
def _how_often(results: Sequence[Result]) -> Iterator[Item]:
    rows: list[list[Cell]] = [_share("all", "", results)]
    for what in ("solver", "hierarchy"):
        names = sorted({str(r.get(what)) for r in results if what in r})
        if len(names) > 1:
            rows += [_share(what, name, [r for r in results if str(r.get(what)) == name]) for name in names]
    for key in _choices(results):
        values = sorted({str(r["parameters"][key]) for r in results if "parameters" in r})
        rows += [_share(key, v, [r for r in results if str(r.get("parameters", {}).get(key)) == v]) for v in values]
    columns = ("of", "value", "runs", "went well", "share", "95 % interval")
    yield Table(columns, rows, "Runs that met every demand of the scenario; Wilson's interval.")
    failed = Counter(reason for r in results for reason in reasons(r))
    if failed:
        counted: list[list[Cell]] = [
            [Marked(reason, "bad"), n, percent(n / len(results))] for reason, n in failed.most_common()
        ]
        yield Table(("why not", "runs", "of all"), counted, "A run may miss several demands.")


def _share(what: str, name: str, results: Sequence[Result]) -> list[Cell]:
    good = sum(r["ok"] for r in results)
    low, high = interval(good, len(results))
    return [what, name, len(results), good, percent(good / len(results)), f"{percent(low)} to {percent(high)}"]


def _choices(results: Sequence[Result]) -> list[str]:
    """Parameters that differ and take few values."""
    found = []
    for key in _parameters(results):
        values = {str(r["parameters"][key]) for r in results if "parameters" in r}
        numbers = all(isinstance(r["parameters"][key], float) for r in results if "parameters" in r)
        if key != SEED and 1 < len(values) <= _BINS and not numbers:
            found.append(key)
    return found


def _parameters(results: Sequence[Result]) -> list[str]:
    return list(dict.fromkeys(key for r in results for key in r.get("parameters", {})))


# ---- demands, and what else was measured
def _demands(found: Sequence[Demand]) -> Iterator[Item]:
    if not found:
        return
    rows: list[list[Cell]] = []
    for one in found:
        sign = Check(one.text, 0.0, one.relation, 0.0).sign
        met = percent(float(np.mean(one.met)))
        bounds = dict.fromkeys(number(x) for x in _spread(one.bounds)[::2])
        bound = f"{sign} {' to '.join(bounds)} {one.unit}".rstrip()
        rows.append([one.text, bound, met if all(one.met) else Marked(met, "bad"), *_spread(one.values)])
    note = "Over all runs that ended. A value that is not a number meets no demand; the last three columns omit it."
    yield Table(("demand", "bound", "met", "least", "median", "largest"), rows, note)
    for k, one in enumerate(found):
        if one.varies:
            yield _histogram(f"demand-{k}", one)


def _histogram(name: str, one: Demand) -> Plot:
    """Bars of one width over the values and the bound, so that they are as wide wherever the bound is."""
    finite = one.values[np.isfinite(one.values)]
    shown = finite if one.bound is None else np.append(finite, one.bound)
    bars, edges = np.histogram(finite, min(_BARS, max(5, len(finite) // 2)), (float(shown.min()), float(shown.max())))
    curve = Curve("runs", np.append(np.where(bars > 0, bars, np.nan), np.nan))
    over = f"value [{one.unit}]" if one.unit else "value"
    bounds = [] if one.bound is None else [Bound(one.bound, "bound", "x")]
    return Plot(name, one.text, "runs", edges, [curve], bounds, over=over, bars=True, zero=True)


def _spread(values: Vec) -> list[float]:
    finite = values[np.isfinite(values)]
    return [float(q) for q in np.percentile(finite, [0, 50, 100])] if finite.size else [np.nan] * 3


def _others(results: Sequence[Result]) -> Table:
    """Everything that runs measure and that is no demand, each once: what always equals another is left out."""
    known = [one.values for one in demands(results)]
    rows: list[list[Cell]] = []
    flat = [dict(_flat(result)) for result in results]
    for name in dict.fromkeys(name for one in flat for name in one):
        values = np.array([_number(one.get(name)) for one in flat])
        if np.isfinite(values).any() and not any(np.allclose(values, other, _SAME, 0.0, True) for other in known):
            known.append(values)
            finite = values[np.isfinite(values)]
            rows.append([name, len(finite), *(float(q) for q in np.percentile(finite, [0, 5, 50, 95, 100]))])
    return Table(("figure", "runs", "least", "5 %", "median", "95 %", "largest"), rows, "What else was measured",
                 folded=True)  # fmt: skip


def _flat(result: Result) -> Iterator[tuple[str, Any]]:
    for task, rms in (result.get("tracking") or {}).items():
        yield f"{task}, rms [{result['units'].get(task, '')}]".removesuffix(" []"), rms
    for kind, (worst, unit) in (result.get("violations") or {}).items():
        yield f"{kind} beyond its limit [{unit}]", worst
    for name, value in (result.get("figures") or {}).items():
        yield figure_name(name), None if isinstance(value, bool) else value
    for name, value in zip(("tick, median [µs]", "tick, p99 [µs]"), result.get("tick_us") or (), strict=False):
        yield name, value


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) else np.nan


def _or_none(value: float) -> float | None:
    return value if np.isfinite(value) else None


# ---- dependence
def _dependence(results: Sequence[Result], found: Sequence[Demand]) -> Iterator[Item]:
    """Over each number that was drawn: how often it went well, and the demand that was missed most often."""
    axes = list(_axes(results))
    if not axes:
        return
    text = "Share of runs that went well, in parts of equally many runs, with its 95 % interval. The others vary too."
    yield Text(text)
    good = np.array([bool(r["ok"]) for r in results])
    missed = max(found, key=lambda one: len(one.met) - sum(one.met), default=None)
    for k, (name, x) in enumerate(axes):
        known = np.flatnonzero(np.isfinite(x))
        order = known[np.argsort(x[known], kind="stable")]
        parts = np.array_split(order, min(_BINS, len(order)))
        shares = [(float(good[part].mean()), *interval(int(good[part].sum()), len(part))) for part in parts]
        share, low, high = (100.0 * np.array(column) for column in zip(*shares, strict=True))
        curves = [
            Curve("went well", share),
            Curve("95 % interval, lower end", low, faint=True),
            Curve("upper end", high, faint=True),
        ]
        centres = np.array([float(x[part].mean()) for part in parts])
        yield Plot(f"share-{k}", "Went well", "%", centres, curves, over=name, zero=True, dots=True)
        if missed is not None and missed.varies:
            held = np.array([bool(one) for one in missed.held])
            met = [Curve(word, np.where(held == which, missed.values, np.nan)[order])
                   for word, which in (("met", True), ("not met", False))]  # fmt: skip
            if missed.bound is None:
                met.append(Curve("bound of the run", missed.bounds[order], faint=True))
            bounds = [] if missed.bound is None else [Bound(missed.bound, "bound")]
            yield Plot(f"value-{k}", missed.text, missed.unit, x[order], met, bounds, over=name, dots=True,
                       lines=False)  # fmt: skip


def _axes(results: Sequence[Result]) -> Iterator[tuple[str, Vec]]:
    """What was drawn, with its unit where it has one: one number a run."""
    drawn = [r.get("axes", {}) for r in results]
    for name in dict.fromkeys(name for one in drawn for name in one):
        yield from _varied(name, [one.get(name) for one in drawn])
    for key in _parameters(results):
        if key != SEED:
            yield from _varied(f"parameter {key}", [_as_number(r.get("parameters", {}).get(key)) for r in results])


def _varied(name: str, values: Sequence[Any]) -> Iterator[tuple[str, Vec]]:
    x = np.array([_number(value) for value in values])
    if len(np.unique(x[np.isfinite(x)])) > _BINS:
        yield name, x


def _as_number(value: Any) -> Any:
    try:
        return float(value)
    except (TypeError, ValueError):
        return None


# ---- worst runs
def _worst(header: dict[str, Any], results: Sequence[Result], folder: Path | None) -> Iterator[Item]:
    bad = [r for r in _ordered(results) if not r["ok"]]
    if not bad:
        return
    given = [r["parameters"] for r in results if "parameters" in r]
    drawn = [key for key in _parameters(results) if len({str(one.get(key)) for one in given}) > 1]
    rows: list[list[Cell]] = []
    for r in bad[:_WORST]:
        page = page_of(r["run"])
        there = folder is not None and (folder / page).is_file()
        replay = Address("replay", page) if there else again(header, r["run"], folder)
        rows.append([r["run"], "; ".join(_missed(r)), _told(r, drawn), replay])
    caption = (
        f"{len(rows)} of {len(bad)} runs that did not go well, the worst first: those that ended with an error, then "
        "by how far a value is beyond its bound. The command makes the page of a run, with its replay, and links it."
    )
    yield Table(("run", "not met", "drawn", "replay"), rows, caption)


def page_of(run: int) -> str:
    """The page of a run, relative to the folder of its sweep."""
    return f"run-{run}/{HTML}"


def again(header: Mapping[str, Any], run: int, folder: Path | None) -> str:
    """The command that does a run once more and makes its page."""
    scenario = str((header.get("plan") or {}).get("scenario", ""))
    named = [scenario] if ":" in scenario else []
    return shlex.join(["wbc", "sweep", *named, "--repeat", str(run), "--out", str(folder or "FOLDER")])


def _ordered(results: Sequence[Result]) -> list[Result]:
    """The worst first."""
    return sorted(results, key=lambda r: (r["ok"], r["error"] is None, -_beyond(r)))


def _beyond(result: Result) -> float:
    """How far the worst value is beyond its bound, as a share of the bound."""
    found = [0.0]
    for d in result.get("demands", ()):
        value, bound = _number(d["value"]), _number(d["bound"])
        if not d["ok"]:
            found.append(abs(value - bound) / max(abs(bound), 1e-12) if np.isfinite(value - bound) else np.inf)
    return max(found)


def _missed(result: Result) -> list[str]:
    if result["error"] is not None:
        return reasons(result)
    missed = [d for d in result["demands"] if not d["ok"]]
    return [
        f"{d['demand']}: {number(_number(d['value']))}, must be {_bound(d)} {d['unit']}".rstrip() for d in missed
    ] or reasons(result)


def _bound(demand: Mapping[str, Any]) -> str:
    check = Check(demand["demand"], 0.0, demand["relation"], _number(demand["bound"]))
    return f"{check.sign} {number(check.bound)}"


def _told(result: Result, drawn: Sequence[str]) -> str:
    found = dict(result.get("axes", {})) | {
        key: value for key, value in result.get("parameters", {}).items() if key in drawn
    }
    return ", ".join(f"{k} = {number(v) if isinstance(v, float) else v}" for k, v in found.items())


def _settings(header: dict[str, Any]) -> Table:
    asked = {key: header[key] for key in ("scenario", "sweep", "runs", "seed", "date")}
    return measured(asked, header["machine"], header["versions"], caption="What was run, and where it was begun.")


def _limits(header: dict[str, Any], results: Sequence[Result]) -> list[str]:
    return [
        f"{len(results)} runs drawn with seed {header['seed']}: the intervals say how far the shares may be off by "
        "chance; they say nothing of what was not varied. Everything is simulation.",
        "Runs share a machine with each other: their tick times are longer and more spread than those of a run alone.",
        "Run i depends on the settings, the seed and i alone, not on the worker that did it, nor on interruptions.",
    ]
