"""The report of a sweep: how often it went well, how the figures are spread, what it depends on, which "
"runs were worst."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from wbc.report import style
from wbc.report.document import Cell, Figure, Item, Report, Section, Table, Text, Tile, percent
from wbc.types import Vec

Result = dict[str, Any]

#: Two-sided 95 % of a normal distribution.
_Z = 1.959964
_BINS = 6
_WORST = 10
_COLUMNS = 3


def summary(header: dict[str, Any], results: Sequence[Result]) -> Report:
    """The report of all results; the same results give the same bits."""
    good = sum(r["ok"] for r in results)
    low, high = interval(good, len(results))
    failed = Counter(reason for r in results for reason in reasons(r))
    most = f" Most often: {failed.most_common(1)[0][0]}." if failed else ""
    text = (
        f"{good} of {len(results)} runs of {header['scenario']} went well ({percent(good / len(results))}; 95 % "
        f"interval {percent(low)} to {percent(high)}).{most} Drawn or set: {header['sweep']}."
    )
    figures = [*_figures(results)]
    sections = [
        Section("How often", list(_how_often(results))),
        Section("Distributions", [_quantiles(figures), *_histograms(figures)]),
        Section("What it depends on", list(_dependence(results))),
        Section("Worst runs", list(_worst(results, figures))),
        Section("Settings", [_settings(header)]),
        Section("Limits of this sweep", [Text(sentence) for sentence in _limits(header, results)]),
    ]
    tiles = [
        Tile("runs", str(len(results))), Tile("went well", percent(good / len(results))),
        Tile("95 % interval", f"{percent(low)} to {percent(high)}"),
    ]  # fmt: skip
    return Report(
        f"Sweep · {header['scenario']}", text, None, [section for section in sections if section.items], tiles
    )


def interval(good: int, count: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a share.

    Wilson: Probable inference, the law of succession, and statistical inference, JASA 22, 1927.

    Example:
        >>> from wbc.sweep.summary import interval
        >>> [round(x, 3) for x in interval(10, 10)]
        [0.722, 1.0]
    """
    share, z2 = good / count, _Z**2
    centre = (share + z2 / (2 * count)) / (1 + z2 / count)
    half = _Z / (1 + z2 / count) * (share * (1 - share) / count + z2 / (4 * count**2)) ** 0.5
    return centre - half if good else 0.0, centre + half if good < count else 1.0


def reasons(result: Result) -> list[str]:
    """Why a run did not go well; nothing where it did."""
    if result["ok"]:
        return []
    if result["error"] is not None:
        return [f"error: {str(result['error']).splitlines()[0]}"]
    return [f"not met: {text}" for text in result["failed"]] or ["the scenario's own verdict"]


def _how_often(results: Sequence[Result]) -> Iterator[Item]:
    rows: list[list[Cell]] = [_share("all", "", results)]
    for what in ("solver", "hierarchy"):
        names = sorted({str(r.get(what)) for r in results if what in r})
        if len(names) > 1:
            rows += [_share(what, name, [r for r in results if str(r.get(what)) == name]) for name in names]
    for key in _choices(results):
        values = sorted({str(r["parameters"][key]) for r in results if "parameters" in r})
        rows += [_share(key, v, [r for r in results if str(r.get("parameters", {}).get(key)) == v]) for v in values]
    columns = ("of", "value", "runs", "went well", "share", "95 % from", "to")
    yield Table(columns, rows, "Runs that met every demand of the scenario; Wilson's interval.")
    failed = Counter(reason for r in results for reason in reasons(r))
    if failed:
        counted: list[list[Cell]] = [[reason, n, percent(n / len(results))] for reason, n in failed.most_common()]
        yield Table(("why not", "runs", "of all"), counted, "A run may miss several demands.")


def _share(what: str, name: str, results: Sequence[Result]) -> list[Cell]:
    good = sum(r["ok"] for r in results)
    low, high = interval(good, len(results))
    return [what, name, len(results), good, percent(good / len(results)), percent(low), percent(high)]


def _choices(results: Sequence[Result]) -> list[str]:
    """Parameters that differ and take few values."""
    found = []
    for key in _parameters(results):
        values = {str(r["parameters"][key]) for r in results if "parameters" in r}
        numbers = all(isinstance(r["parameters"][key], float) for r in results if "parameters" in r)
        if 1 < len(values) <= _BINS and not numbers:
            found.append(key)
    return found


def _parameters(results: Sequence[Result]) -> list[str]:
    return list(dict.fromkeys(key for r in results for key in r.get("parameters", {})))


# ---- distributions
def _figures(results: Sequence[Result]) -> Iterator[tuple[str, Vec]]:
    """Everything that a run measures, as (name with unit, one number a run, NaN where there is none)."""
    flat = [dict(_flat(result)) for result in results]
    for name in dict.fromkeys(name for one in flat for name in one):
        values = np.array([_number(one.get(name)) for one in flat])
        if np.isfinite(values).any():
            yield name, values


def _flat(result: Result) -> Iterator[tuple[str, Any]]:
    for task, rms in (result.get("tracking") or {}).items():
        yield f"{task}, rms", rms
    for kind, (worst, unit) in (result.get("violations") or {}).items():
        yield f"{kind} beyond its limit [{unit}]", worst
    for name, value in (result.get("figures") or {}).items():
        yield name, None if isinstance(value, bool) else value
    for name, value in zip(("tick, median [µs]", "tick, p99 [µs]"), result.get("tick_us") or (), strict=False):
        yield name, value


def _number(value: Any) -> float:
    return float(value) if isinstance(value, int | float) else np.nan


def _quantiles(figures: Sequence[tuple[str, Vec]]) -> Table:
    rows: list[list[Cell]] = []
    for name, values in figures:
        finite = values[np.isfinite(values)]
        rows.append([name, len(finite), *(float(q) for q in np.percentile(finite, [0, 5, 50, 95, 100]))])
    return Table(("figure", "runs", "least", "5 %", "median", "95 %", "largest"), rows, "Over all runs that gave them.")


def _histograms(figures: Sequence[tuple[str, Vec]]) -> Iterator[Figure]:
    spread = [(name, values[np.isfinite(values)]) for name, values in figures]
    spread = [(name, values) for name, values in spread if np.ptp(values) > 0.0]
    if not spread:
        return
    rows = -(-len(spread) // _COLUMNS)
    with style.Canvas(rows, _COLUMNS, height=0.3 + 1.7 * rows) as canvas:
        for axes, (name, values) in zip(canvas.axes, spread, strict=False):
            axes.hist(values, bins=30, color=style.BLUE, linewidth=0)
            axes.axvline(float(np.median(values)), color=style.ORANGE, linewidth=1.2)
            axes.set_title(_wrapped(name), fontsize=8)
            axes.ticklabel_format(axis="x", style="plain", useOffset=False)
            axes.locator_params(axis="x", nbins=4)
            axes.xaxis.set_major_formatter(lambda x, _: f"{x:.3g}")
        for axes in canvas.axes[len(spread) :]:
            axes.set_visible(False)
        yield canvas.figure("distributions", "Number of runs over each figure; orange: the median.")


def _wrapped(name: str) -> str:
    words, lines = name.split(" "), [""]
    for word in words:
        if len(lines[-1]) + len(word) > 26 and lines[-1]:
            lines.append("")
        lines[-1] = f"{lines[-1]} {word}".strip()
    return "\n".join(lines)


# ---- dependence
def _dependence(results: Sequence[Result]) -> Iterator[Item]:
    """Success over each number that was drawn, in bins of equally many runs."""
    with_parameters = [r for r in results if "parameters" in r]
    drawn = []
    for key in _parameters(results):
        x = np.array([_number(_as_number(r["parameters"][key])) for r in with_parameters])
        if key != "seed" and np.isfinite(x).all() and len(np.unique(x)) > _BINS:
            drawn.append((key, x))
    if not drawn:
        return
    good = np.array([bool(r["ok"]) for r in with_parameters])
    with style.Canvas(1, max(len(drawn), 2), height=2.6) as canvas:
        for axes, (key, x) in zip(canvas.axes, drawn, strict=False):
            for part in np.array_split(np.argsort(x, kind="stable"), min(_BINS, len(x))):
                low, high = interval(int(good[part].sum()), len(part))
                centre, share = float(x[part].mean()), float(good[part].mean())
                axes.plot([centre, centre], [100 * low, 100 * high], color=style.FAINT, linewidth=2.0)
                axes.plot(centre, 100 * share, marker="o", markersize=4, color=style.BLUE)
            axes.set_ylim(-4.0, 104.0)
            axes.set_xlabel(key)
        canvas.axes[0].set_ylabel("went well [%]")
        for axes in canvas.axes[len(drawn) :]:
            axes.set_visible(False)
        caption = (
            "Share of runs that went well over each parameter that was drawn, in parts of equally many runs, with its "
        )
        yield canvas.figure("dependence", caption + "95 % interval. The others vary at the same time.")


def _as_number(value: Any) -> Any:
    try:
        return float(value)
    except (TypeError, ValueError):
        return None


# ---- worst runs
def _worst(results: Sequence[Result], figures: Sequence[tuple[str, Vec]]) -> Iterator[Item]:
    bad = [r for r in results if not r["ok"]]
    if bad:
        rows: list[list[Cell]] = [
            [r["run"], "; ".join(reasons(r)), r.get("solver"), _told(r), "; ".join(r.get("disturbances", []))]
            for r in bad[:_WORST]
        ]
        caption = (
            f"The first {len(rows)} of {len(bad)} runs that did not go well; wbc sweep --repeat RUN --out FOLDER "
            "does one again."
        )
        yield Table(("run", "why", "solver", "parameters", "disturbances"), rows, caption)
    largest: list[list[Cell]] = []
    for name, values in figures:
        if np.isfinite(values).any() and np.nanmax(values) > np.nanmin(values):
            i = int(np.nanargmax(values))
            largest.append([name, float(values[i]), results[i]["run"], _told(results[i])])
    if largest:
        yield Table(
            ("figure", "largest", "in run", "parameters"), largest, "Where each figure is largest.", folded=True
        )


def _told(result: Result) -> str:
    return ", ".join(
        f"{k} = {v:.4g}" if isinstance(v, float) else f"{k} = {v}" for k, v in result.get("parameters", {}).items()
    )


def _settings(header: dict[str, Any]) -> Table:
    rows: list[list[Cell]] = [[key, str(header[key])] for key in ("scenario", "sweep", "runs", "seed", "date")]
    rows += [[key, str(value)] for key, value in header["machine"].items()]
    rows += [[key, str(value)] for key, value in header["versions"].items()]
    return Table(("", "value"), rows, "What was run, and where it was begun.", folded=True)


def _limits(header: dict[str, Any], results: Sequence[Result]) -> list[str]:
    return [
        f"{len(results)} runs drawn with seed {header['seed']}: the intervals say how far the shares may be off by "
        "chance; they say nothing of what was not varied. Everything is simulation.",
        "Runs share a machine with each other: their tick times are longer and more spread than those of a run alone.",
        "Run i depends on the settings, the seed and i alone, not on the worker that did it, nor on interruptions.",
    ]
