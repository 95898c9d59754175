"""How every figure looks: one palette, one size of text, one width; and curves thinned without losing their peaks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from io import BytesIO
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from wbc.errors import NotSupported
from wbc.report.document import Figure
from wbc.report.measure import pushes, seconds
from wbc.report.packed import kept
from wbc.types import Vec

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from wbc.control.recorder import Run

INK, FAINT, PAPER = "#1f2a37", "#9aa5b1", "#eef1f4"
BLUE, ORANGE, GREEN, RED, PURPLE, TEAL = "#2b6cb0", "#dd7a1f", "#2f8f5b", "#c53d3d", "#7a5bb5", "#1f9aa0"
CYCLE = (BLUE, ORANGE, GREEN, PURPLE, TEAL, "#8c6d46")
WIDTH = 8.4
POINTS = 1200

_STYLE: Any = {  # matplotlib's own names
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titlepad": 6,
    "axes.labelsize": 8.5,
    "axes.labelcolor": INK,
    "axes.edgecolor": FAINT,
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e3e7eb",
    "grid.linewidth": 0.6,
    "text.color": INK,
    "text.parse_math": False,
    "xtick.color": INK,
    "ytick.color": INK,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "xtick.major.size": 3,
    "ytick.major.size": 3,
    "lines.linewidth": 1.1,
    "lines.solid_capstyle": "round",
    "legend.fontsize": 8,
    "legend.frameon": False,
    "legend.handlelength": 1.4,
    "legend.borderaxespad": 0.2,
    "svg.fonttype": "path",
    "svg.hashsalt": "wbc",
    "path.simplify_threshold": 0.25,
}


class Canvas:
    """A figure being drawn: a grid of axes in the report's style, then SVG or PNG bytes.

    No pyplot and no display: the figure belongs to nobody else. Use it as a context manager, since text takes
    its style when it is made::

        with Canvas(rows=2, columns=1, height=3.0) as canvas:
            canvas.axes[0].plot(t, y)
            figure = canvas.figure("tracking", "What is seen")
    """

    def __init__(
        self, rows: int = 1, columns: int = 1, *, height: float, width: float = WIDTH, widths: Sequence[float] = ()
    ) -> None:
        self._grid = (rows, columns)
        self._size = (width, height)
        self._widths = widths

    def __enter__(self) -> Canvas:
        try:
            from matplotlib import rc_context
            from matplotlib.backends.backend_agg import FigureCanvasAgg
            from matplotlib.figure import Figure as Drawing
        except ImportError as cause:
            raise NotSupported("figures need matplotlib; pip install 'wbc-qp[report]'") from cause

        self._context = rc_context(_STYLE)
        self._context.__enter__()
        self.drawing = Drawing(figsize=self._size, layout="constrained", facecolor="white")
        FigureCanvasAgg(self.drawing)
        ratios = {"width_ratios": list(self._widths)} if self._widths else {}
        rows, columns = self._grid
        grid = self.drawing.subplots(rows, columns, squeeze=False, gridspec_kw=ratios)
        self.axes: list[Axes] = list(grid.ravel())
        return self

    def __exit__(self, *error: object) -> None:
        self._context.__exit__(None, None, None)

    def figure(self, name: str, caption: str, *, kind: str = "svg", dpi: int = 130) -> Figure:
        """The drawing as a report figure; the same drawing gives the same bytes."""
        memory = BytesIO()
        nothing = {"svg": {"Date": None, "Creator": None}, "png": {"Software": None}}
        self.drawing.savefig(memory, format=kind, dpi=dpi, metadata=nothing[kind])
        return Figure(name, caption, memory.getvalue(), kind)


def curve(axes: Axes, t: Vec, y: Vec, **style: Any) -> None:
    """Plot y (N,) over t (N,), thinned without losing its peaks."""
    rows = kept(np.asarray(y, dtype=float)[:, None], POINTS)
    axes.plot(t[rows], y[rows], **style)


def legend(axes: Axes) -> None:
    """The legend on the line of the title, so that it never lies on a curve."""
    axes.legend(loc="lower right", bbox_to_anchor=(1.01, 0.985), ncols=6, columnspacing=1.0, handletextpad=0.5)


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
        >>> from wbc.report.style import short
        >>> [short(x) for x in (1e-6, 0.001, 0.1, 20.0, 1e5)]
        ['1e-6', '1e-3', '0.1', '20', '1e5']
    """
    if 1e-2 <= value < 1e4:
        return f"{value:g}"
    mantissa, _, exponent = f"{value:e}".partition("e")
    return f"{float(mantissa):g}e{int(exponent)}"


def over_time(axes: Axes, run: Run, title: str, label: str) -> None:
    """A time axis from 0 to the end of the run, its pushes shaded."""
    shade(axes, pushes(run))
    axes.set_xlim(0.0, max(seconds(run), 1e-9))
    axes.set_xlabel("time [s]")
    axes.set_ylabel(label)
    axes.set_title(title)


def shade(axes: Axes, intervals: Iterable[tuple[float, float]]) -> None:
    """Mark intervals of time behind the curves."""
    for start, end in intervals:
        axes.axvspan(start, end, color="#f3d9b1", alpha=0.7, linewidth=0, zorder=0)


def bound(axes: Axes, value: float, text: str = "", *, vertical: bool = False) -> None:
    """A dashed red line where a limit is, with its name at the end of the line."""
    line = axes.axvline if vertical else axes.axhline
    line(value, color=RED, linewidth=0.9, linestyle=(0, (4, 3)), zorder=1)
    if text and vertical:
        axes.annotate(text, (value, 1), xycoords=("data", "axes fraction"), xytext=(-3, -3), textcoords="offset points",
                      ha="right", va="top", fontsize=7.5, color=RED)  # fmt: skip
    elif text:
        axes.annotate(text, (1, value), xycoords=("axes fraction", "data"), xytext=(-2, 3), textcoords="offset points",
                      ha="right", va="bottom", fontsize=7.5, color=RED)  # fmt: skip


def readable(unit: str) -> tuple[float, str]:
    """A factor and a unit in which small errors are read easily: m in mm, rad in mrad."""
    return (1e3, f"m{unit}") if unit in ("m", "rad", "m/s", "rad/s") else (1.0, unit)
