"""What the figures and tables of a comparison have in common."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any, Literal

from wbc.report import style

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def look(k: int) -> dict[str, Any]:
    """A colour, and from the seventh curve on another kind of line."""
    return {"color": style.CYCLE[k % len(style.CYCLE)], "linestyle": ("-", "--", ":")[k // len(style.CYCLE) % 3]}


def side_legend(axes: Axes) -> None:
    """The legend beside the axes, one name a line."""
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0))


def logarithmic(axes: Axes, which: Literal["x", "y", "both"]) -> None:
    """Logarithmic axes with powers of ten as one writes them, and nothing written between them."""
    from matplotlib.ticker import NullFormatter

    for letter, axis, scale in (("x", axes.xaxis, axes.set_xscale), ("y", axes.yaxis, axes.set_yscale)):
        if which in (letter, "both"):
            scale("log")
            axis.set_major_formatter(lambda x, _: short(x))
            axis.set_minor_formatter(NullFormatter())


def short(value: float) -> str:
    """A number as one writes it: 1e-6, not 1e-06.

    Example:
        >>> from wbc.report.solvers.drawing import short
        >>> [short(x) for x in (1e-6, 0.001, 0.1, 20.0, 1e5)]
        ['1e-6', '1e-3', '0.1', '20', '1e5']
    """
    if 1e-2 <= value < 1e4:
        return f"{value:g}"
    mantissa, _, exponent = f"{value:e}".partition("e")
    return f"{float(mantissa):g}e{int(exponent)}"


def slug(name: str) -> str:
    """A name for a file."""
    return re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")
