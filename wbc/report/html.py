"""A report as one HTML page that needs nothing else: plots, pictures, script, style and all in the file itself."""

from __future__ import annotations

import base64
import gzip
import json
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np

from wbc import checks
from wbc.files import slug
from wbc.report.document import Address, Bar, Cell, Figure, Link, Map, Marked, Plot, Report, Table, formatted
from wbc.report.packed import data, scenes

ASSETS = Path(__file__).with_name("assets")
#: A text of so many characters stays on one line of its cell.
SHORT = 16
#: A table of more columns does not fit the width of a phone, which shows each row as a block instead.
COLUMNS = 3
#: What marks of the clock are called.
KINDS = {"push": "push", "fault": "disturbance or fault", "contact": "change of contact", "failed": "demand not met"}


def html(report: Report) -> str:
    """The text of ``report.html``.

    Raises:
        NotSupported: jinja2 is not installed.
    """
    checks.packages("the HTML report", "jinja2", extra="report")
    import jinja2

    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    plots = [item for item in report.items if isinstance(item, Plot)]
    names = {plot.name for plot in plots}
    environment.filters.update(
        anchor=slug,
        cards=lambda table: len(table.columns) > COLUMNS,
        kind=lambda item: type(item).__name__.lower(),
        cell=formatted,
        look=_look,
        source=_source,
        path=_path,
        view=_view,
        corners=_corners,
    )
    environment.tests.update(
        bar=lambda cell: isinstance(cell, Bar),
        address=lambda cell: isinstance(cell, Address),
        picture=lambda cell: isinstance(cell, Figure),
        link=lambda cell: isinstance(cell, Link) and cell.plot in names,
    )
    environment.globals |= {"names": [*report.names], "kinds": KINDS}
    content = data(report)
    order = [*plots, *(item for item in report.items if isinstance(item, Map)), *scenes(report)]
    places = {id(item): sum(type(one) is type(item) for one in order[:i]) for i, item in enumerate(order)}
    libraries = ["uPlot", *(["three"] if content and content["scenes"] else [])]
    sorts = any(isinstance(item, Table) and item.sorts for item in report.items)
    own = ["scene.js", "page.js"] if content and content["scenes"] else ["page.js"]
    return environment.from_string((ASSETS / "page.html.jinja").read_text(encoding="utf-8")).render(
        report=report,
        styles=[_asset(name) for name in ("uPlot.min.css", "page.css")],
        notices=[(name, _asset(f"{name}.LICENSE")) for name in libraries] if content else [],
        scripts=[_asset(name) for name in (*(f"{name}.min.js" for name in libraries), *own)] if content else [],
        sort=_asset("sort.js") if sorts else "",
        data=None if content is None else _packed(content),
        place=lambda item: places[id(item)],
    )


def _asset(name: str) -> str:
    return (ASSETS / name).read_text(encoding="utf-8")


def _packed(content: Any) -> str:
    """JSON, compressed, as text that cannot end the element it stands in; the same content gives the same text."""
    plain = json.dumps(content, ensure_ascii=False, allow_nan=False, separators=(",", ":")).encode()
    return base64.b64encode(gzip.compress(plain, mtime=0)).decode("ascii")


def _look(cell: Cell, numeric: bool) -> str:
    """The class of a table cell."""
    if isinstance(cell, Bar):
        return "bar"
    if isinstance(cell, bool):
        return "good" if cell else "bad"
    if formatted(cell) == formatted(None):
        return "nothing number" if numeric else "nothing"
    if isinstance(cell, Marked):
        return f"{cell.mood} {'number' if numeric else 'short' if len(cell.text) <= SHORT else 'text'}"
    return "number" if numeric else "text" if len(formatted(cell)) > SHORT else "short"


def _source(figure: Figure) -> Any:
    """The picture itself as a data address."""
    kind = {"svg": "image/svg+xml", "png": "image/png"}[figure.kind]
    return f"data:{kind};base64,{base64.b64encode(figure.data).decode('ascii')}"


def _corners(corners: Any) -> str:
    return " ".join(f"{x:.5g},{-y:.5g}" for x, y in corners)


def _path(item: Map) -> str:
    """The way of a map as an SVG path, north up; at most some two thousand points of it."""
    step = max(1, len(item.x) // 2000)
    points = zip(item.x[::step], item.y[::step], strict=True)
    return "M" + " ".join(f"{x:.5g},{-y:.5g}" for x, y in points if isfinite(x) and isfinite(y))


def _view(item: Map) -> tuple[float, float, float, float]:
    """Left, top, width and height of what a map shows."""
    xs, ys = [*item.x[np.isfinite(item.x)]], [*item.y[np.isfinite(item.y)]]
    for _, corners in item.outlines:
        xs, ys = [*xs, *corners[:, 0]], [*ys, *corners[:, 1]]
    if not xs:
        return (0.0, 0.0, 1.0, 1.0)
    width, height = max(xs) - min(xs), max(ys) - min(ys)
    room = 0.06 * max(width, height, 1e-6)
    return (min(xs) - room, -max(ys) - room, width + 2 * room, height + 2 * room)
