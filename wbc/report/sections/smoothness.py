"""How smooth the motion is: jerk, shaking, and unwanted rests."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from wbc.report import measure, smoothness
from wbc.report.document import Bound, Cell, Curve, Item, Plot, Section, Table, Text
from wbc.report.sections.joints import short_names
from wbc.report.smoothness import Moved
from wbc.sim.scenario import ScenarioResult

if TYPE_CHECKING:
    from wbc.control.recorder import Run

#: As many curves as can be told apart, and points of a spectrum.
SHOWN, POINTS = 5, 1200


def section(result: ScenarioResult) -> Section | None:
    """Jerk over time, where the power of the command lies, and a table of task points and of joints."""
    joints = smoothness.joints(result.run)
    if not joints:
        return None
    points = smoothness.points(result.run, result.robot)
    items = _plots(result.run, points, joints)
    kind = _kind(joints)
    caption = (
        f"Jerk, rms {kind} and its share of power above 3 Hz are those of the command. A freeze is the longest time at "
        "rest while the target moves; a dash: no target moves."
    )
    items.append(_table(points, "task point", caption) if points else Text(caption))
    items.append(_table(joints, "joint", "Smoothness of every joint", True))
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


def _plots(run: Run, points: Sequence[Moved], joints: Sequence[Moved]) -> list[Item]:
    """Jerk over time, and which share of the power lies below a frequency."""
    names = dict(zip((joint.name for joint in joints), short_names([joint.name for joint in joints]), strict=True))
    moved = _worst(points or joints)
    units = {one.unit for one in moved}
    unit = units.pop() if len(units) == 1 else "unit"
    t = measure.times(run)[moved[0].order :]
    jerks = [Curve(names.get(one.name, one.name), one.jerk_size, shown=k < SHOWN) for k, one in enumerate(moved)]
    who = "task points" if points else "joints"
    made: list[Item] = [Plot("jerk", f"Jerk of {who}", f"{unit}/s³", t, jerks, zero=True)]
    spectra = [(names.get(one.name, one.name), *smoothness.spectrum(one.command, one.dt)) for one in moved[:SHOWN]]
    moving = [(label, frequency, power) for label, frequency, power in spectra if power.sum() > 0.0]
    if moving:
        frequency = moving[0][1]
        kept = np.unique(np.geomspace(1, len(frequency), POINTS).astype(int)) - 1
        shares = [Curve(label, (100.0 * np.cumsum(power) / power.sum())[kept]) for label, _, power in moving]
        made.append(
            Plot("power", f"Power of the {_kind(joints)} below a frequency", "%", frequency[kept], shares,
                 [Bound(smoothness.SHAKING, "3 Hz", "x")], over="frequency [Hz]", log="x", zero=True)
        )  # fmt: skip
    return made


def _worst(moved: Sequence[Moved]) -> list[Moved]:
    return sorted(moved, key=lambda one: -one.jerk_rms)
