"""Contact forces in their cones."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

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
    columns = ("contact", "friction", "smallest f_z [N]", "largest f_z [N]", "largest ratio, commanded",
               "largest ratio, true", "CoP margin, true [mm]", "slip [mm]")  # fmt: skip
    note = (
        "Ratio: tangential over normal force, to be compared with the friction coefficient. CoP margin: smallest "
        "distance of the true centre of pressure to the edge of the sole. Slip: way of the material point of contact."
    )
    return Section("Contact forces in their cones", [_figure(run, names), Table(columns, rows, note)])


def _figure(run: Run, names: list[str]) -> Figure:
    pushes = measure.pushes(run)
    with style.Canvas(len(names), 3, height=0.5 + 2.05 * len(names), widths=(1.25, 1.25, 1)) as canvas:
        for i, name in enumerate(names):
            normal, ratio, cop = canvas.axes[3 * i : 3 * i + 3]
            _normal(normal, run, name)
            _ratio(ratio, run, name)
            _cop(cop, run, name)
            for axes in (normal, ratio):
                style.shade(axes, pushes)
                axes.set_xlim(0, max(measure.seconds(run), 1e-9))
                if i == len(names) - 1:
                    axes.set_xlabel("time [s]")
        caption = (
            "Normal force, tangential over normal force against the friction coefficient, and the path of the centre "
            "of pressure inside the sole, for each contact. Blue: commanded; orange: what the plant measured."
        )
        return canvas.figure("contacts", caption)


def _normal(axes: Axes, run: Run, name: str) -> None:
    t = measure.times(run)
    for true, colour, label in ((True, TRUE, "true"), (False, COMMANDED, "commanded")):
        track = measure.contact_track(run, name, true=true)
        if track is not None:
            style.curve(axes, t, track.normal, color=colour, label=label)
    axes.set_title(name)
    axes.set_ylabel("normal force [N]")
    axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.18 * (high - low))
    axes.legend(loc="upper right", ncols=2, reverse=True)


def _ratio(axes: Axes, run: Run, name: str) -> None:
    t, contact = measure.times(run), run.meta["contacts"][name]
    for true, colour in ((True, TRUE), (False, COMMANDED)):
        track = measure.contact_track(run, name, true=true)
        if track is not None:
            style.curve(axes, t, track.ratio, color=colour)
    axes.set_ylabel("tangential / normal")
    friction = contact.get("friction")
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
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlim(-1.15 * x, 1.15 * x)
    axes.set_ylim(-1.3 * y, 1.3 * y)
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
    largest = [None if part is None else float(np.nanmax(part.ratio, initial=0.0)) for part in (commanded, true)]
    return (name, contact.get("friction"), float(track.normal.min()), float(track.normal.max()), *largest, margin,
            None if slip is None else 1e3 * slip)  # fmt: skip
