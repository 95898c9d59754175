"""What a report is before anybody writes it down: sections of text, tables, figures, plots and scenes.

Nothing here knows HTML or Markdown; :mod:`wbc.report.html` and :mod:`wbc.report.markdown` own the two formats.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple, final

import numpy as np

from wbc.report.why import Why
from wbc.types import Mat, Vec


@final
@dataclass(frozen=True)
class Bar:
    """A cell with a bar from ``start`` to ``end`` in shares of its width, a line at ``mark``, and ``text`` beside it.

    ``ok`` False: drawn as a failure.
    """

    start: float
    end: float
    text: str
    mark: float | None = None
    ok: bool = True


@final
@dataclass(frozen=True)
class Link:
    """A cell that leads to the plot of that name at the time ``at`` [s]."""

    text: str
    plot: str
    at: float


@final
@dataclass(frozen=True)
class Marked:
    """A cell in the colour of ``mood``, "good", "doubtful" or "bad"."""

    text: str
    mood: str


@final
@dataclass(frozen=True)
class Address:
    """A cell that leads to another page, ``href`` relative to this one."""

    text: str
    href: str


@final
@dataclass(frozen=True)
class Figure:
    """A picture: ``kind`` "svg" or "png", ``data`` its bytes, ``name`` a file name without suffix. In a cell it is
    drawn small."""

    name: str
    caption: str
    data: bytes
    kind: str = "svg"


Cell = str | bool | int | float | Bar | Link | Marked | Address | Figure | None


@final
@dataclass(frozen=True)
class Text:
    """One paragraph."""

    text: str


@final
@dataclass(frozen=True)
class Table:
    """Named columns (units in the name) and rows of cells. ``folded``: collapsed until opened; ``sorts``: by a click on
    a heading."""

    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    caption: str = ""
    folded: bool = False
    sorts: bool = False

    @property
    def numeric(self) -> list[bool]:
        """For each column whether it holds numbers alone, to be set to the right."""
        return [all(_is_number(row[i]) for row in self.rows) for i in range(len(self.columns))]


TIME = "time [s]"


@final
@dataclass(frozen=True, eq=False)
class Curve:
    """A line of a plot: ``values`` (N,), NaN where there is none; ``shown`` False: only when chosen in the legend.

    ``run``: the place of its run among those that are compared, which is its colour; curves of one run differ by
    ``dash``, 0 for a whole line. ``x`` (N,): what it is drawn over where that is not the plot's.
    """

    label: str
    values: Vec
    shown: bool = True
    faint: bool = False
    run: int | None = None
    dash: int = 0
    x: Vec | None = None


@final
class Bound(NamedTuple):
    """A named line across a plot, where the values are ``value``, or ``along`` "x" what they are drawn over. Without a
    ``label`` it belongs to the bound before it."""

    value: float
    label: str
    along: str = "y"


@final
class Strip(NamedTuple):
    """A line of a plot that says when something was so: ``intervals`` (start, end) [s]; ``run``: as of a curve."""

    label: str
    intervals: Sequence[tuple[float, float]]
    run: int | None = None


@final
@dataclass(frozen=True, eq=False)
class Plot:
    """Curves, or strips, over ``x`` (N,): over the time of the run, with the cursor of the page, or something else.

    ``log`` names the axes that are logarithmic, "", "x", "y" or "xy"; ``zero``: the axis reaches down to zero;
    ``bars``: a histogram; ``steps``: curves stay as they are until the next x; ``dots``: every value has a dot, and
    ``lines`` False: no lines between them. Plots of the same ``scale`` have one range of values.
    """

    name: str
    title: str
    unit: str
    x: Vec
    curves: Sequence[Curve] = ()
    bounds: Sequence[Bound] = ()
    strips: Sequence[Strip] = ()
    caption: str = ""
    over: str = TIME
    log: str = ""
    zero: bool = False
    bars: bool = False
    steps: bool = False
    dots: bool = False
    lines: bool = True
    scale: str = ""
    wide: bool = False


@final
@dataclass(frozen=True, eq=False)
class Map:
    """A path in the plane, x and y (N,) at times t (N,), inside ``outlines`` {what: corners (k, 2)}, drawn to scale."""

    name: str
    title: str
    unit: str
    t: Vec
    x: Vec
    y: Vec
    outlines: Sequence[tuple[str, Mat]] = ()


@final
@dataclass(frozen=True, eq=False)
class Scene:
    """The motion in space, in the form that ``assets/scene.js`` reads (:mod:`wbc.report.replay` makes it).

    ``ghosts``: other runs' motion at the same time, seen through.
    """

    name: str
    caption: str
    content: Mapping[str, Any]
    ghosts: Sequence[Mapping[str, Any]] = ()


Item = Text | Table | Figure | Plot | Map | Scene


@final
@dataclass(frozen=True)
class Section:
    """A heading and what stands under it."""

    title: str
    items: Sequence[Item]


@final
class Event(NamedTuple):
    """What happened from ``start`` to ``end`` [s]; ``kind`` is push, fault, contact or failed; ``plot`` shows it."""

    start: float
    end: float
    label: str
    kind: str
    plot: str = ""


@final
@dataclass(frozen=True)
class Clock:
    """The time of a run, from 0 to ``seconds`` [s] in steps of ``dt`` [s], and what happened when."""

    seconds: float
    dt: float
    events: Sequence[Event] = ()


@final
class Tile(NamedTuple):
    """One of the few figures to see first; ``mood`` "good", "doubtful" or "bad" colours it."""

    what: str
    value: str
    mood: str = ""


@final
@dataclass(frozen=True)
class Report:
    """``summary`` says in one sentence what happened; ``highlights`` are the few figures to see first.

    ``ok`` is the verdict, None where there is nothing to pass or fail. ``clock`` is the time of all its plots, and
    ``scene`` stands beside them, with why at the cursor: of each run in ``whys``, by its name, "" of the only one.
    ``names`` have one colour each on the whole page: curves of that label, and cells.
    """

    title: str
    summary: str
    ok: bool | None
    sections: Sequence[Section]
    highlights: Sequence[Tile] = ()
    clock: Clock | None = None
    scene: Scene | None = None
    whys: Mapping[str, Why] = field(default_factory=dict)
    names: Sequence[str] = ()

    @property
    def items(self) -> list[Item]:
        """Every item, in order."""
        return [item for section in self.sections for item in section.items]

    @property
    def figures(self) -> list[Figure]:
        """Every figure, in order."""
        return [item for item in self.items if isinstance(item, Figure)]


def formatted(cell: Cell) -> str:
    """A cell as text: four significant digits, "yes" and "no", a dash for nothing.

    Example:
        >>> from wbc.report.document import formatted
        >>> [formatted(c) for c in (0.00123456, 12345, True, None, float("inf"))]
        ['0.001235', '12 345', 'yes', '–', 'none']
    """
    if cell is None:
        return "–"
    if isinstance(cell, (bool, np.bool_)):
        return "yes" if cell else "no"
    if isinstance(cell, Bar | Link | Marked | Address):
        return cell.text
    if isinstance(cell, Figure):
        return ""
    if isinstance(cell, str):
        return cell
    if isinstance(cell, (int, np.integer)):
        return f"{cell:,}".replace(",", " ")
    return number(float(cell))


def rounded(value: float) -> str:
    """A number without its fraction; three digits of one that is longer than a column.

    Example:
        >>> from wbc.report.document import rounded
        >>> [rounded(x) for x in (99.6, 12345.6, 4.5e31, float("inf"))]
        ['100', '12346', '4.5e+31', 'inf']
    """
    return f"{value:.0f}" if abs(value) < 1e9 else f"{value:.3g}"


def percent(share: float) -> str:
    """A share as text: 0.123 is "12.3 %".

    Example:
        >>> from wbc.report.document import percent
        >>> [percent(x) for x in (0.0, 1e-9, 0.00012, 0.1234, 0.9999, 1.0, 14.2)]
        ['0 %', '< 0.01 %', '0.012 %', '12.3 %', '99.99 %', '100 %', '1420 %']
    """
    value = 100.0 * share
    if np.isnan(value):
        return "–"
    if 0.0 < value < 0.01:
        return "< 0.01 %"
    if 99.0 < value < 100.0:
        return f"{np.floor(1e3 * value) / 1e3:g} %"  # nearly all is not all
    return f"{rounded(value)} %" if abs(value) >= 100.0 else f"{value:.3g} %"


def _is_number(cell: Cell) -> bool:
    if isinstance(cell, Marked):
        return cell.text.isdigit()
    return cell is None or (isinstance(cell, (int, float)) and not isinstance(cell, bool))


def number(value: float) -> str:
    """Four significant digits without noise; infinity is "none" (no limit), NaN a dash."""
    if np.isnan(value):
        return "–"
    if np.isinf(value):
        return "none"
    if value == 0:
        return "0"
    if abs(value) >= 1e4:
        return f"{value:,.0f}".replace(",", " ") if abs(value) < 1e9 else f"{value:.3g}"
    if abs(value) >= 1e-3:
        return f"{value:.4g}"
    return f"{value:.3g}".replace("e-0", "e-")


def short(value: float) -> str:
    """A number as one writes it: 1e-6, not 1e-06.

    Example:
        >>> from wbc.report.document import short
        >>> [short(x) for x in (1e-6, 0.001, 0.1, 20.0, 1e5)]
        ['1e-6', '1e-3', '0.1', '20', '1e5']
    """
    if 1e-2 <= value < 1e4:
        return f"{value:g}"
    mantissa, _, exponent = f"{value:e}".partition("e")
    return f"{float(mantissa):g}e{int(exponent)}"


def neutral(cell: Cell) -> Cell:
    """A setting or a figure: where it is a yes or a no, neither is good or bad."""
    return formatted(cell) if isinstance(cell, bool) else cell


def plural(count: int, noun: str) -> str:
    """A count and its noun: "1 problem", "2 problems"."""
    return f"{count} {noun}{'s' * (count != 1)}"


def readable(unit: str) -> tuple[float, str]:
    """A factor and a unit in which small errors are read easily: m in mm, rad in mrad."""
    return (1e3, f"m{unit}") if unit in ("m", "rad", "m/s", "rad/s") else (1.0, unit)
