"""What a report is before anybody writes it down: sections of text, tables, figures and pages.

Nothing here knows HTML or Markdown; :mod:`wbc.report.html` and :mod:`wbc.report.markdown` own the two formats.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

Cell = str | bool | int | float | None


@final
@dataclass(frozen=True)
class Text:
    """One paragraph."""

    text: str


@final
@dataclass(frozen=True)
class Table:
    """Named columns (units in the name) and rows of cells. ``folded``: long, shown only when asked for."""

    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    caption: str = ""
    folded: bool = False


@final
@dataclass(frozen=True)
class Figure:
    """A picture: ``kind`` "svg" or "png", ``data`` its bytes, ``name`` a file name without suffix."""

    name: str
    caption: str
    data: bytes
    kind: str = "svg"


@final
@dataclass(frozen=True)
class Page:
    """A self-contained page of its own, written to ``name`` beside the report and shown in a frame."""

    name: str
    caption: str
    html: str


Item = Text | Table | Figure | Page


@final
@dataclass(frozen=True)
class Section:
    """A heading and what stands under it."""

    title: str
    items: Sequence[Item]


@final
@dataclass(frozen=True)
class Report:
    """``summary`` says in one sentence what happened; ``highlights`` (what, value) are the few figures to see first."""

    title: str
    summary: str
    ok: bool
    sections: Sequence[Section]
    highlights: Sequence[tuple[str, str]] = ()

    @property
    def pages(self) -> list[Page]:
        """Every page, in order."""
        return [item for section in self.sections for item in section.items if isinstance(item, Page)]

    @property
    def figures(self) -> list[Figure]:
        """Every figure, in order."""
        return [item for section in self.sections for item in section.items if isinstance(item, Figure)]


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
    if isinstance(cell, str):
        return cell
    if isinstance(cell, (int, np.integer)):
        return f"{cell:,}".replace(",", " ")
    return number(float(cell))


def number(value: float) -> str:
    """Four significant digits without noise; infinity is "none" (no limit), NaN a dash."""
    if np.isnan(value):
        return "–"
    if np.isinf(value):
        return "none"
    if value == 0:
        return "0"
    if 1e-3 <= abs(value) < 1e5:
        return f"{value:.4g}"
    return f"{value:.3g}"
