"""What the figures and tables of a comparison have in common."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from wbc.report import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def look(k: int) -> dict[str, Any]:
    """A colour, and from the seventh curve on another kind of line."""
    return {"color": style.CYCLE[k % len(style.CYCLE)], "linestyle": ("-", "--", ":")[k // len(style.CYCLE) % 3]}


def side_legend(axes: Axes) -> None:
    """The legend beside the axes, one name a line."""
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0))


def slug(name: str) -> str:
    """A name for a file."""
    return re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")
