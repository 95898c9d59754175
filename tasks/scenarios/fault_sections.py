"""What reports of failing motors show: residuals and decisions, every outcome, and limits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from wbc.report import measure
from wbc.report.document import Bound, Curve, Plot, Section, Table, Text

if TYPE_CHECKING:
    from .. import Thresholds
    from .fault_trials import Pair, Stand

#: The two runs that are shown.
WITH, WITHOUT = "with an answer", "without an answer"


def signals(pair: Pair, known: Thresholds) -> Section:
    """Residuals about the fault, the decision, and the error of the centre of mass before and after it."""
    start, answered = pair.answered.fault.start, pair.answered.run
    joints = answered.meta["joint_names"]
    i = joints.index(pair.answered.fault.joint)
    near = (answered["t"] > start - 0.05) & (answered["t"] < start + 0.1)
    residual = answered["signal.MomentumObserver.residual"]
    others = np.argsort(-(np.abs(residual[near]) / known.value).max(axis=0))
    bounds = [Bound(1.0, "threshold"), Bound(-1.0, "")]
    if pair.answered.found is not None:
        bounds.append(Bound(1e3 * pair.answered.delay, "answer", "x"))
    curves = [
        Curve(joints[joint], residual[near][:, joint] / known.value[joint])
        for joint in [i, *[j for j in others if j != i][:3]]
    ]
    said = f"{pair.label}. The failing joint and the three next to alarm."
    first = Plot(
        "residuals", "Residual over its threshold", "", 1e3 * (answered["t"][near] - start), curves, bounds,
        caption=said, over="time since the fault [ms]",
    )  # fmt: skip
    trials = ((WITH, pair.answered), (WITHOUT, pair.without))
    fates = " ".join(f"{name}: {outcome.fate}." for name, outcome in trials)
    second = Plot(
        "true_error", "Centre of mass, true error", "mm", measure.times(answered),
        [Curve(name, np.maximum(1e3 * outcome.error, 0.01), run=run, x=measure.times(outcome.run))
         for run, (name, outcome) in enumerate(trials)],
        [Bound(start, "fault", "x")], log="y",
        caption=f"{fates} Errors below 0.01 mm are drawn as 0.01 mm.",
    )  # fmt: skip
    rows = [
        (d.t, d.alarmed, d.joint_name, d.kind, d.share if d.kind in ("partial", "total") else None)
        for d in pair.answered.diagnoses
    ]
    table = Table(("t [s]", "alarm [s]", "joint", "diagnosis", "share lost"), rows, "Every decision of this run.")
    return Section("What was seen, and when", [first, second, table])


def outcomes(pairs: Sequence[Pair], varied: Sequence[Pair]) -> Section:
    """One row for each trial."""
    columns = ("trial", "torque lost [N m]", "without", "rms [mm]", "with", "rms [mm]", "slip [mm]", "answer [ms]")
    rows = [_row(pair) for pair in (*pairs, *varied)]
    text = (
        "Without an answer the stack, gains, motion, fault and noise are the same; only the component that reacts is "
        "left out. rms: true error of the centre of mass from a second after the fault on, as far as the run goes."
    )
    if varied:
        text += " Rows that name other gains are there so that the fall cannot be laid to the gains."
    return Section("Every trial", [Text(text), Table(columns, rows)])


def _row(pair: Pair) -> tuple[str | float | None, ...]:
    without, answered = pair.without, pair.answered
    joint = without.run.meta["joint_names"].index(without.fault.joint)
    at = measure.row(without.run, without.fault.start)
    lost = without.fault.missing(without.fault.start, float(without.run["tau"][at - 1, joint]))
    return (
        pair.label, lost, without.fate, 1e3 * without.rms, answered.fate, 1e3 * answered.rms, 1e3 * answered.slip,
        1e3 * answered.delay,
    )  # fmt: skip


def lost(pairs: Sequence[Pair], reasons: Sequence[tuple[float, float]]) -> Section:
    """Faults that the answer does not mend, and what statics says of them."""
    rows = [
        (pair.label, pair.without.fate, 1e3 * pair.without.rms, pair.answered.fate, 1e3 * pair.answered.rms, now, most)
        for pair, (now, most) in zip(pairs, reasons, strict=True)
    ]
    columns = (
        "joint", "without", "rms [mm]", "with", "rms [mm]", "least torque at the fault [N m]",
        "most over the sway [N m]",
    )  # fmt: skip
    text = Text(
        "The least torque that standing still asks of the joint over all contact forces in their cones and all torques "
        "of the others within their limits. Where it is not zero, no choice of forces spares the joint: the robot "
        "sags or tips, whatever a controller does. A dash: at that moment not even all motors could stand still. Where "
        "it is zero, statics has an answer and the way to it was lost."
    )
    return Section("Losses that the answer does not mend", [text, Table(columns, rows)])


def honesty(stand: Stand, known: Thresholds) -> Section:
    """What is assumed, and the thresholds of all joints."""
    robot = stand.robot()
    noise = "with the noise said above" if stand.noise else "without noise"
    masses = f"wrong by up to {100 * stand.masses:g} %" if stand.masses else "right"
    text = Text(
        f"The base's state and the feet's wrenches are measured, {noise}; the masses that the controller has are "
        f"{masses}. The motor fails free, not stiff. Thresholds are learnt from a run without a fault and with other "
        "noise."
    )
    rows = [(name, float(value)) for name, value in zip(robot.joint_names, known.value, strict=True)]
    return Section("Assumptions and thresholds", [text, Table(("joint", "threshold [N m]"), rows, folded=True)])
