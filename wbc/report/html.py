"""A report as one HTML page that needs nothing else: pictures, style and all in the file itself."""

from __future__ import annotations

import base64
import re
from pathlib import Path
from typing import Any

from wbc.errors import NotSupported
from wbc.report.document import Bar, Cell, Figure, Page, Report, Table, Text, formatted

#: A text of so many characters stays on one line of its cell.
SHORT = 16
TEMPLATE = Path(__file__).with_name("page.html.jinja")


def html(report: Report) -> str:
    """The text of ``report.html``. Pages of their own (the replay) are linked by name and shown in a frame.

    Raises:
        NotSupported: jinja2 is not installed.
    """
    try:
        import jinja2
    except ImportError as cause:
        raise NotSupported("the HTML report needs jinja2; pip install 'wbc-qp[report]'") from cause
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters.update(anchor=_anchor, kind=_kind, cell=formatted, look=_look, source=_source)
    environment.tests["bar"] = lambda cell: isinstance(cell, Bar)
    return environment.from_string(TEMPLATE.read_text(encoding="utf-8")).render(report=report)


def _kind(item: Text | Table | Figure | Page) -> str:
    return type(item).__name__.lower()


def _anchor(title: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")


def _look(cell: Cell, numeric: bool) -> str:
    """The class of a table cell."""
    if isinstance(cell, Bar):
        return "bar"
    if isinstance(cell, bool):
        return "good" if cell else "bad"
    return "number" if numeric else "text" if len(formatted(cell)) > SHORT else "short"


def _source(figure: Figure) -> Any:
    """The picture itself as a data address."""
    kind = {"svg": "image/svg+xml", "png": "image/png"}[figure.kind]
    return f"data:{kind};base64,{base64.b64encode(figure.data).decode('ascii')}"
