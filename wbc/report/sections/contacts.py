"""Contact forces in their cones."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from wbc.report import measure, style
from wbc.report.document import Figure, Section, Table
from wbc.sim.scenario import ScenarioResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from wbc.control.recorder import Run

COMMANDED, TRUE = style.BLUE, style.ORANGE


def section(result: ScenarioResult) -> Section | None:
    """For each contact: normal force, tangential ratio against friction, centre of pressure in the sole; and slip."""
    run = result.run
    names = [name for name in run.meta.get("contacts", {}) if f"f.{name}" in run or f"plant.f.{name}" in run]
    if not names or not run.rows:
        return None
    rows = [_row(run, name) for name in names]
    columns = ("contact", "friction", "ratio, commanded", "ratio, true", "f_z min [N]", "f_z max [N]",
               "CoP margin [mm]", "slip [mm]")  # fmt: skip
    note = (
        "Ratio: tangential over normal force at worst, to be compared with the friction coefficient the controller "
        "counts on. CoP margin: smallest distance of the true centre of pressure to the edge of the sole. Slip: "
        "largest way of the material point of contact. A dash: not measured."
    )
    return Section("Contact forces in their cones", [_figure(run, names), Table(columns, rows, note)])


def _figure(run: Run, names: list[str]) -> Figure:
    soles = any(run.meta["contacts"][name].get("half_size") for name in names)
    columns, widths = (3, (1.25, 1.25, 1.0)) if soles else (2, (1.0, 1.0))
    with style.Canvas(len(names), columns, height=0.4 + (2.0 if soles else 1.6) * len(names), widths=widths) as canvas:
        for i, name in enumerate(names):
            normal, ratio, *rest = canvas.axes[columns * i : columns * (i + 1)]
            _curves(normal, run, name, "normal")
            style.over_time(normal, run, name, "normal force [N]")
            low, high = min(0.0, normal.get_ylim()[0]), normal.get_ylim()[1]
            normal.set_ylim(low, high + 0.06 * (high - low))  # a constant force is not the frame of the picture
            _curves(ratio, run, name, "ratio")
            style.over_time(ratio, run, "", "tangential / normal")
            style.legend(ratio)
            _friction(ratio, run.meta["contacts"][name].get("friction"))
            for axes in rest:
                _cop(axes, run, name)
            for axes in (normal, ratio) if i < len(names) - 1 else ():
                axes.set_xlabel("")
        caption = (
            "Normal force, tangential over normal force against the friction coefficient"
            + (", and the path of the centre of pressure inside the sole. " if soles else ". ")
            + "Blue: commanded; orange: what the plant measured."
        )
        return canvas.figure("contacts", caption)


def _curves(axes: Axes, run: Run, name: str, quantity: Literal["normal", "ratio"]) -> None:
    for true, colour, label in ((True, TRUE, "true"), (False, COMMANDED, "commanded")):
        track = measure.contact_track(run, name, true=true)
        if track is not None:
            values = track.normal if quantity == "normal" else track.ratio
            style.curve(axes, measure.times(run), values, color=colour, label=label, linewidth=0.9)


def _friction(axes: Axes, friction: float | None) -> None:
    if friction is not None:
        style.bound(axes, float(friction), f"friction {float(friction):g}")
        axes.set_ylim(0, max(1.25 * float(friction), 1.05 * axes.get_ylim()[1]))


def _cop(axes: Axes, run: Run, name: str) -> None:
    half = run.meta["contacts"][name].get("half_size")
    if not half:
        axes.set_visible(False)
        return
    x, y = (1e3 * float(size) for size in half)
    axes.fill(
        [x, x, -x, -x], [y, -y, -y, y], facecolor=style.PAPER, edgecolor=style.RED, linewidth=0.9, linestyle=(0, (4, 3))
    )
    for true, colour in ((True, TRUE), (False, COMMANDED)):
        track = measure.contact_track(run, name, true=true)
        if track is not None and track.cop is not None:
            step = max(1, len(track.cop) // 1500)
            axes.plot(*(1e3 * track.cop[::step]).T, color=colour, linewidth=0.8)
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlim(-1.15 * x, 1.15 * x)
    axes.set_ylim(-1.3 * y, 1.3 * y)
    axes.set_title("")
    axes.set_xlabel("CoP x [mm]")
    axes.set_ylabel("CoP y [mm]")


def _row(run: Run, name: str) -> tuple[Any, ...]:
    contact = run.meta["contacts"][name]
    commanded, true = (measure.contact_track(run, name, true=which) for which in (False, True))
    track = true or commanded
    assert track is not None, "only contacts with a recorded force get here"
    margin = None
    if track.cop is not None:
        gap = np.asarray(contact["half_size"], dtype=float) - np.abs(track.cop)
        margin = 1e3 * float(np.nanmin(gap, initial=np.inf))
    slip = measure.slip(run, name)
    worst = [None if part is None else float(np.nanmax(part.ratio, initial=0.0)) for part in (commanded, true)]
    return (name, contact.get("friction"), *worst, float(track.normal.min()), float(track.normal.max()), margin,
            None if slip is None else 1e3 * slip)  # fmt: skip
