"""How smooth the motion is: jerk, shaking, and rests that nobody asked for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from wbc.report import measure, smoothness, style
from wbc.report.document import Cell, Figure, Item, Section, Table
from wbc.report.sections.use import name_joints, short_names
from wbc.report.smoothness import Moved
from wbc.sim.scenario import ScenarioResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from wbc.control.recorder import Run

#: As many curves as can be told apart.
SHOWN = 5


def section(result: ScenarioResult) -> Section | None:
    """Jerk over time, where the power of the command lies, and a table of task points and of joints."""
    joints = smoothness.joints(result.run)
    if not joints:
        return None
    points = smoothness.points(result.run, result.robot)
    items: list[Item] = [_figure(result.run, points, joints)]
    kind = _kind(joints)
    caption = (
        f"Jerk, rms of the {kind} and its share of power above 3 Hz are the command's, a freeze is the motion's: the "
        "longest time at rest while the target moves; –: no target moves."
    )
    if points:
        items.append(_table(points, "task point", caption))
    items.append(_table(joints, "joint", "Smoothness of every joint, in the same terms." if points else caption, True))
    return Section("Smoothness", items)


def _kind(moved: Sequence[Moved]) -> str:
    return "acceleration" if moved[0].order == 1 else "velocity"


def _table(moved: Sequence[Moved], what: str, caption: str, folded: bool = False) -> Table:
    kind = _kind(moved)
    largest = max(one.command_rms for one in moved)
    rows: list[tuple[Cell, ...]] = []
    for one in moved:
        still = one.command_rms <= np.sqrt(np.finfo(float).eps) * largest  # what is left is rounding
        shaking = float("nan") if still else 100.0 * one.shaking
        jerk = one.jerk_rms, float(one.jerk_size.max())
        rows.append((one.name, one.unit, *jerk, one.command_rms, shaking, one.freeze))
    per = "/s²" if kind == "acceleration" else "/s"
    columns = (what, "unit", "jerk rms [unit/s³]", "largest jerk [unit/s³]", f"{kind} rms [unit{per}]",
               "above 3 Hz [%]", "longest freeze [s]")  # fmt: skip
    return Table(columns, rows, caption, folded)


def _figure(run: Run, points: Sequence[Moved], joints: Sequence[Moved]) -> Figure:
    names = dict(zip((joint.name for joint in joints), short_names([joint.name for joint in joints]), strict=True))
    shown = _worst(points) if points else _worst(joints)
    with style.Canvas(3, 1, height=7.6) as canvas:
        over_time, over_frequency, per_joint = canvas.axes
        units = {one.unit for one in shown}
        for k, one in enumerate(shown):
            t = measure.times(run)[one.order :]
            label = names.get(one.name, one.name)
            style.curve(over_time, t, one.jerk_size, color=style.CYCLE[k], label=label, linewidth=0.9)
            _cumulative(over_frequency, one, label, style.CYCLE[k])
        unit = units.pop() if len(units) == 1 else "unit"
        style.over_time(over_time, run, "Jerk over time", f"jerk [{unit}/s³]")
        over_time.set_ylim(bottom=0)
        style.legend(over_time)
        _frequencies(over_frequency, run, _kind(joints))
        _bars(per_joint, joints, list(names.values()))
        who = "task points" if points else "joints with the largest jerk"
        return canvas.figure(
            "smoothness",
            f"Jerk of the {who}; which share of the power of their {_kind(joints)} lies below a frequency; and the "
            f"{_kind(joints)} of every joint, with the part above 3 Hz, where shaking is." + style.shaded(run),
        )


def _bars(axes: Axes, joints: Sequence[Moved], names: Sequence[str]) -> None:
    """The rms of each joint's command, and of its part above 3 Hz."""
    rms = np.array([joint.command_rms for joint in joints])
    shaking = rms * np.sqrt(np.nan_to_num([joint.shaking for joint in joints]))
    axes.bar(range(len(rms)), rms, width=0.62, color=style.BLUE + "55", linewidth=0, label="all")
    axes.bar(range(len(rms)), shaking, width=0.62, color=style.ORANGE, linewidth=0, label="above 3 Hz")
    name_joints(axes, names)
    axes.set_ylim(bottom=0)
    per = "/s²" if joints[0].order == 1 else "/s"
    axes.set_ylabel("rms " + ", ".join(f"[{unit}{per}]" for unit in dict.fromkeys(joint.unit for joint in joints)))
    axes.set_title(f"{_kind(joints).capitalize()} of every joint")
    style.legend(axes)


def _worst(moved: Sequence[Moved]) -> list[Moved]:
    return sorted(moved, key=lambda one: -one.jerk_rms)[:SHOWN]


def _cumulative(axes: Axes, one: Moved, label: str, colour: str) -> None:
    frequency, power = smoothness.spectrum(one.command, one.dt)
    if power.sum() > 0.0:
        kept = np.unique(np.geomspace(1, len(power), style.POINTS).astype(int)) - 1
        axes.plot(frequency[kept], (np.cumsum(power) / power.sum())[kept], color=colour, label=label)


def _frequencies(axes: Axes, run: Run, kind: str) -> None:
    style.logarithmic(axes, "x")
    lowest, highest = 1.0 / measure.seconds(run), 0.5 / float(run.meta["dt"])
    axes.set_xlim(min(lowest, 0.5 * smoothness.SHAKING), max(highest, 2.0 * smoothness.SHAKING))
    axes.set_ylim(0, 1.2)
    axes.set_yticks([0, 0.25, 0.5, 0.75, 1])
    axes.yaxis.set_major_formatter(lambda x, _: f"{100 * x:.3g} %")
    axes.set_xlabel("frequency [Hz]")
    axes.set_ylabel("power below it")
    axes.set_title(f"Where the power of the {kind} lies")
    style.bound(axes, smoothness.SHAKING, "3 Hz", vertical=True)
