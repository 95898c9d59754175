"""The picture of a projected gradient step of two joints, in the plane of their velocities."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from wbc.errors import NotSupported
from wbc.methods.gradient_step import Projection, Step
from wbc.methods.shared import factors
from wbc.tolerances import ROUNDING
from wbc.types import Vec

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK, FAINT, PAPER = "#1f2a37", "#9aa5b1", "#eef3f8"
BLUE, ORANGE, SAND, GREEN, RED = "#2b6cb0", "#dd7a1f", "#f0b268", "#2f8f5b", "#c53d3d"
WIDTH = 7.6

STYLE: Any = {  # matplotlib's own names
    "font.size": 9,
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "axes.edgecolor": FAINT,
    "axes.linewidth": 0.7,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "svg.hashsalt": "wbc",
}


def draw(v_task: Vec, v_null: Vec, limits: tuple[Vec, Vec], origin: Projection | None, result: Step) -> Figure:
    """Box, task line, v_task, gradient and its projection, the feasible steps and the result.

    Raises:
        NotSupported: n is not 2, or matplotlib is not installed.
    """
    if v_task.size != 2:
        raise NotSupported(f"only a step of 2 joints has a plane to be drawn in; this one has {v_task.size}")
    try:
        from matplotlib import rc_context
        from matplotlib.figure import Figure
        from matplotlib.layout_engine import ConstrainedLayoutEngine
    except ImportError as cause:
        raise NotSupported("figures need matplotlib; from a clone of wbc: pip install '.[report]'") from cause
    with rc_context(STYLE):
        figure = Figure(layout=ConstrainedLayoutEngine(w_pad=0.12, h_pad=0.08), facecolor="white")
        plane = _Plane(v_task, v_null, limits, origin, result, axes=figure.subplots())
        figure.set_size_inches(WIDTH, plane.height(WIDTH - 3.0))
        plane.draw()
    return figure


class _Plane:
    """One step on one pair of axes."""

    def __init__(
        self, v_task: Vec, v_null: Vec, limits: tuple[Vec, Vec], origin: Projection | None, result: Step, *, axes: Axes
    ) -> None:
        self.v_task, self.v_null, self.origin, self.result, self.axes = v_task, v_null, origin, result, axes
        self.v_min, self.v_max = limits
        self.gradient = v_null if origin is None else origin.gradient
        self.low, self.high = self._view()
        self.reach = float((self.high - self.low).max())
        # The gradient has a unit of its own: only its direction is to scale with the velocities.
        length = float(np.linalg.norm(self.gradient))
        self.shrink = 0.26 * self.reach / length if length > 0.0 else 0.0

    def height(self, width: float) -> float:
        """Of the figure, for axes of this width whose units are as long in both directions [inch]."""
        across, up = self.high - self.low
        return float(np.clip(width * up / across, 2.2, 7.5)) + 0.8

    def _view(self) -> tuple[Vec, Vec]:
        """What to show: the origin, the finite limits, v_task and the result, and a margin."""
        points = np.array([np.zeros(2), self.v_task, self.v_min, self.v_max, self.result.v])
        points = np.where(np.isfinite(points), points, 0.0)
        low, high = points.min(axis=0), points.max(axis=0)
        margin = 0.22 * (float((high - low).max()) or 1.0)
        return low - margin, high + margin

    def draw(self) -> None:
        """Everything, back to front."""
        self._box()
        self._task_line()
        self._gradient()
        self._velocities()
        axes = self.axes
        axes.set(xlim=(self.low[0], self.high[0]), ylim=(self.low[1], self.high[1]), aspect="equal")
        axes.set(xlabel="velocity of joint 1", ylabel="velocity of joint 2")
        axes.spines[["top", "right"]].set_visible(False)
        axes.axhline(0.0, color=FAINT, linewidth=0.6, zorder=1)
        axes.axvline(0.0, color=FAINT, linewidth=0.6, zorder=1)
        axes.set_title(self._title(), loc="left", fontsize=10, fontweight="bold")
        axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), fontsize=8.5, handlelength=1.8, labelspacing=0.9)

    def _title(self) -> str:
        if not self.result.feasible:
            return "No step is feasible"
        stopped = " and ".join(f"joint {i + 1}" for i in self.result.active)
        reason = f"{stopped} at its limit" if stopped else "as far as allowed"
        return f"α* = {self.result.alpha:.4g}: {reason}"

    def _box(self) -> None:
        from matplotlib.patches import Rectangle

        low = np.where(np.isfinite(self.v_min), self.v_min, self.low - self.reach)
        high = np.where(np.isfinite(self.v_max), self.v_max, self.high + self.reach)
        corner = float(low[0]), float(low[1])
        size = float(high[0] - low[0]), float(high[1] - low[1])
        self.axes.add_patch(Rectangle(corner, *size, facecolor=PAPER, edgecolor="none", zorder=0))
        self.axes.add_patch(
            Rectangle(corner, *size, fill=False, edgecolor=RED, linewidth=1.0, linestyle=(0, (4, 3)), zorder=2,
                      label="velocity limits")
        )  # fmt: skip

    def _task_line(self) -> None:
        """All velocities that do the task, and the part of them that steps inside the limits reach."""
        direction = self._along()
        if direction is not None:
            ends = self.v_task + np.outer([-3.0 * self.reach, 3.0 * self.reach], direction)
            self.axes.plot(*ends.T, color=BLUE, linewidth=1.1, zorder=3, label="task, J v = ṙ")
            through_zero = (ends - self.v_task).T
            self.axes.plot(
                *through_zero, color=FAINT, linewidth=0.9, linestyle=(0, (1, 2)), label="null space, J v = 0"
            )
        if self.result.feasible:
            outside = 3.0 * self.reach / (float(np.linalg.norm(self.v_null)) or 1.0)
            low, high = (min(end, outside) for end in self.result.interval)
            ends = self.v_task + np.outer([low, high], self.v_null)
            self.axes.plot(
                *ends.T,
                color=GREEN,
                linewidth=5.0,
                alpha=0.28,
                solid_capstyle="round",
                zorder=3,
                label="feasible steps",
            )

    def _along(self) -> Vec | None:
        """Direction of the task line; ``None`` where the task leaves the whole plane, or one point."""
        if self.origin is not None:
            rows = factors(self.origin.J).V
            return np.array([-rows[0, 1], rows[0, 0]]) if len(rows) == 1 else None
        length = float(np.linalg.norm(self.v_null))
        return self.v_null / length if length > 0.0 else None

    def _gradient(self) -> None:
        """The gradient and the perpendicular down to its projection on the null space, the task line through zero."""
        zero, top, foot = np.zeros(2), self.shrink * self.gradient, self.shrink * self.v_null
        if self.origin is not None:
            self._arrow(zero, top, ORANGE, "gradient ∇H, its direction")
            self.axes.plot(*np.array([top, foot]).T, color=ORANGE, linewidth=0.9, linestyle=(0, (2, 2)), zorder=4)
        self._arrow(zero, foot, SAND, "its projection (I − J#J) ∇H")

    def _velocities(self) -> None:
        origin, start, result = np.zeros(2), self.v_task, self.result
        self._arrow(origin, start, BLUE, "v_task = J# ṙ, of least norm")
        self._point(start, BLUE, "v_task")
        if result.feasible:
            self._arrow(start, result.v, GREEN, "α* times the projection")
            self._arrow(origin, result.v, INK, "result v(α*)", width=1.0)
            self._point(result.v, GREEN, "v(α*)")

    def _arrow(self, start: Vec, end: Vec, colour: str, label: str, width: float = 1.8) -> None:
        from matplotlib.patches import FancyArrowPatch

        if np.linalg.norm(end - start) > ROUNDING * self.reach:
            self.axes.add_patch(
                FancyArrowPatch(tuple(start), tuple(end), arrowstyle="-|>", mutation_scale=10, color=colour,
                                linewidth=width, shrinkA=0.0, shrinkB=0.0, zorder=5)
            )  # fmt: skip
        self.axes.plot([], [], color=colour, linewidth=width, label=label)

    def _point(self, at: Vec, colour: str, text: str) -> None:
        self.axes.plot(*at, "o", color=colour, markersize=5.5, markeredgecolor="white", markeredgewidth=0.8, zorder=6)
        self.axes.annotate(text, tuple(at), xytext=(7, 7), textcoords="offset points", fontsize=8.5, color=colour)
