"""Figures that scenarios hand over to their report."""

from __future__ import annotations

from io import BytesIO
from typing import TYPE_CHECKING

from wbc.report.document import Figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing


def picture(drawing: Drawing, name: str, caption: str) -> Figure:
    """A drawing of matplotlib as a figure of a report; the same drawing gives the same bytes."""
    from matplotlib import rc_context

    memory = BytesIO()
    with rc_context({"svg.hashsalt": "wbc"}):
        drawing.savefig(memory, format="svg", metadata={"Date": None, "Creator": None})
    return Figure(name, caption, memory.getvalue())
