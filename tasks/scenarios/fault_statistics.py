"""Statistics of detection: many short faults of an arm's motors, with noise and wrong masses."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, final

import numpy as np

import wbc
from wbc.models.pinocchio_ import PinocchioModel
from wbc.report.document import Curve, Plot, Section, Table, Text
from wbc.sim.actuator_fault import ActuatorFault
from wbc.sim.scenario import Check, Parameter, Parameters, Scenario, ScenarioResult, Setup, Trial
from wbc.types import Vec

from . import judge
from .waving import NOISE, Waving

#: How long a fault lasts, and how long after it the robot is left alone before it counts as sound again [s].
LASTS, RECOVERY = 0.06, 0.5
#: Missing torque in units of its joint's threshold from which on a fault has to be found.
CLEAR = 3.0
KINDS = ("total", "partial", "bias")
SCALES = np.geomspace(0.2, 3.0, 40)
#: So many faults are in one run.
STRETCH = 50
#: So long a run without one is [s].
CALM = 60.0


@final
@dataclass(frozen=True)
class Fault:
    """One fault: what it was, how much of a threshold was missing at its start, and what came of it.

    ``peak``: the largest residual of the joint, in thresholds, that lasted two ticks; ``delay`` [s] and ``found`` at
    the default thresholds, infinite and −1 where none was passed.
    """

    joint: int
    kind: str
    size: float
    peak: float
    delay: float
    found: int


@final
class FaultStatistics(Scenario):
    """An arm waves while, one after the other, ``faults`` motors drawn by ``seed`` fail for 60 ms: totally, partly, by
    a bias, at any moment; sensors have noise and the controller's masses are wrong by up to ``masses``. Nothing reacts.
    Before that it waves for ``nominal`` seconds without a fault. How many are found, laid to the right joint, after how
    long, and how many alarms there are without one; at the default thresholds, and at others.

    ``robot``: panda (needs example-robot-data) or arm; ``learning``: seconds without a fault that thresholds come from.
    """

    name: ClassVar[str] = "fault-statistics"
    group: ClassVar[str] = "faults"
    takes = 300.0
    summary: ClassVar[str] = "many short faults of an arm's motors: how many are found, how soon; false alarms"
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "robot": "panda", "faults": 1000, "nominal": 60.0, "learning": 40.0, "masses": 0.1, "seed": 0,
    }  # fmt: skip
    plants = ("mujoco",)

    def cases(self, p: Parameters) -> dict[str, dict[str, Any]]:
        count, nominal = p.count("faults"), p.number("nominal", low=0.0)
        masses, learning = p.number("masses", low=0.0, high=0.5), p.number("learning", low=1.0)
        waving = Waving(wbc.load(p["robot"]), masses, NOISE, p["seed"])
        p.settings.progress(0.0, "learning thresholds")
        waving.learn(learning, p.settings.solver)
        some = [range(k, min(k + STRETCH, count)) for k in range(0, count, STRETCH)]
        cases = {f"faults {s[0] + 1} to {s[-1] + 1}": {"stretch": Stretch.of(waving, len(s))} for s in some}
        calm = {
            f"no fault from {k:g} s": {"stretch": Stretch(waving, min(CALM, nominal - k), (), waving.seed())}
            for k in np.arange(0.0, nominal, CALM)
        }
        return {**calm, **cases}

    def build(self, p: Parameters) -> Setup:
        stretch: Stretch = p["stretch"]
        return stretch.setup()

    def judge(self, trials: Iterator[Trial], p: Parameters) -> ScenarioResult:
        faults, windows = list[Fault](), list[tuple[int, float]]()
        for trial in trials:  # a run is forgotten before the next one
            stretch: Stretch = trial.about
            faults += stretch.found(trial.run)
            windows += stretch.sound(trial.run)
        return _judged(trial, stretch.waving.threshold, faults, windows)


@final
@dataclass(frozen=True, eq=False)
class Stretch:
    """A wave of ``seconds`` with these faults: of each how many ticks without one are before it, its joint, its kind
    and what fails."""

    waving: Waving
    seconds: float
    faults: Sequence[tuple[int, int, str, ActuatorFault]]
    seed: int

    @classmethod
    def of(cls, waving: Waving, count: int) -> Stretch:
        """So many faults of 60 ms, with time to recover behind each."""
        random, robot, faults, tick = waving.random, waving.robot, [], round(RECOVERY * 1e3)
        for _ in range(count):
            before = round(float(random.uniform(0.1, 0.3)) * 1e3)
            tick += before
            joint, kind = int(random.integers(robot.nj)), KINDS[int(random.integers(3))]
            left, bias = 1.0, 0.0
            if kind == "bias":
                bias = float(random.uniform(0.5, 8.0) * random.choice([-1.0, 1.0]) * waving.threshold[joint])
            else:
                left = 0.0 if kind == "total" else float(random.uniform(0.25, 0.75))
            start = 1e-3 * tick
            fault = ActuatorFault(
                joint=robot.joint_names[joint], effectiveness=left, bias=bias, start=start, end=start + LASTS
            )
            faults.append((before, joint, kind, fault))
            tick += round((LASTS + RECOVERY) * 1e3)
        return cls(waving, 1e-3 * tick, faults, waving.seed())

    def setup(self) -> Setup:
        """The run."""
        faults = [fault for *_, fault in self.faults]
        return self.waving.setup(self.seconds, disturbances=faults, seed=self.seed, about=self)

    def ratios(self, run: wbc.Run) -> Vec:
        """The residual of each tick in thresholds (N, nj)."""
        return np.asarray(np.abs(run["signal.MomentumObserver.residual"]) / self.waving.threshold)

    def sound(self, run: wbc.Run) -> list[tuple[int, float]]:
        """Of each part without a fault how many ticks it has, and the largest residual that lasted two ticks."""
        ratios, first = self.ratios(run), round(RECOVERY * 1e3)
        spans = [(round(1e3 * f.start) - before, round(1e3 * f.start)) for before, *_, f in self.faults]
        spans = spans or [(k, min(k + 1000, len(ratios))) for k in range(first, len(ratios), 1000)]
        return [(end - k, float(_lasting(ratios[k:end]).max(initial=0.0))) for k, end in spans]

    def found(self, run: wbc.Run) -> list[Fault]:
        """What came of each fault."""
        ratios, found = self.ratios(run), []
        for _, joint, kind, fault in self.faults:
            at = round(1e3 * fault.start)
            missing = abs(fault.missing(fault.start, float(run["tau"][at - 1, joint])))
            seen = ratios[at : at + round(LASTS * 1e3)]
            lasting = _lasting(seen)
            over = np.flatnonzero((lasting > 1.0).any(axis=1))
            delay, who = (np.inf, -1) if not len(over) else (1e-3 * over[0], int(seen[over[0]].argmax()))
            size = missing / float(self.waving.threshold[joint])
            found.append(Fault(joint, kind, size, float(lasting[:, joint].max()), float(delay), who))
        return found


def _lasting(ratios: Vec) -> Vec:
    """What of ratios (N, nj) lasted as many ticks as an alarm needs."""
    shifted = np.vstack([np.zeros((1, ratios.shape[1])), ratios[:-1]])
    return np.minimum(ratios, shifted)


def _judged(
    trial: Trial, threshold: Vec, faults: Sequence[Fault], windows: Sequence[tuple[int, float]]
) -> ScenarioResult:
    robot = trial.robot
    clear = [t for t in faults if t.size >= CLEAR]
    detected = [t for t in clear if t.found >= 0]
    right = [t for t in detected if t.found == t.joint]
    delays = [1e3 * t.delay for t in detected]
    ticks = sum(n for n, _ in windows)
    alarms = sum(peak > 1.0 for _, peak in windows)
    rates = {
        "detected": len(detected) / max(len(clear), 1), "isolated": len(right) / max(len(detected), 1),
        "delay_median_ms": float(np.median(delays)) if delays else np.inf,
        "delay_p99_ms": float(np.percentile(delays, 99)) if delays else np.inf,
        "false_alarms_per_million": 1e6 * alarms / ticks,
    }  # fmt: skip
    figures = {
        **rates, "faults": len(faults), "clear_faults": len(clear), "nominal_ticks": ticks, "false_alarms": alarms,
        "clear_Nm": {n: CLEAR * float(v) for n, v in zip(robot.joint_names, threshold, strict=True)},
    }  # fmt: skip
    verdict = [
        Check(f"alarms without a fault, in {ticks} ticks", float(alarms), "<=", 1e-6 * ticks),
    ]
    if clear:  # a few faults may all be too small to be demanded
        verdict = [
            Check(f"of faults of {CLEAR:g} thresholds and more: detected", rates["detected"], ">=", 0.99, "share"),
            Check("of those: laid to the right joint", rates["isolated"], ">=", 0.98, "share"),
            Check("median delay", rates["delay_median_ms"], "<=", 20.0, "ms"),
            *verdict,
        ]  # fmt: skip
    sections = [_section(faults, windows, robot, threshold)]
    return judge.verdict(trial, verdict, violations={}, tracking={}, figures=figures, called="", sections=sections)


def _section(
    faults: Sequence[Fault], windows: Sequence[tuple[int, float]], robot: PinocchioModel, threshold: Vec
) -> Section:
    peaks, ticks = np.array([peak for _, peak in windows]), sum(n for n, _ in windows)
    false = np.array([1e6 * float((peaks > c).sum()) / ticks for c in SCALES])[::-1]
    sizes = [(low, high, np.array([t.peak for t in faults if low <= t.size < high]))
             for low, high in ((0.5, 1.0), (1.0, 3.0), (3.0, np.inf))]  # fmt: skip
    found = [
        Curve(f"{low:g} to {high:g} thresholds" if np.isfinite(high) else f"{low:g} thresholds and more",
              np.array([float((some > c).mean()) for c in SCALES])[::-1])
        for low, high, some in sizes if len(some)
    ]  # fmt: skip
    seen = sorted((t for t in faults if np.isfinite(t.delay)), key=lambda t: t.size)
    delays = [Curve(kind, np.array([1e3 * t.delay if t.kind == kind else np.nan for t in seen])) for kind in KINDS]
    plots = [
        Plot("roc", "Share detected", "", np.maximum(false, 0.5), found, over="false alarms per million ticks", log="x",
             zero=True, dots=True, caption="By how much is missing. Each point is another multiple of all thresholds, "
             "0.2 to 3; none is drawn at 0.5."),
        Plot("delays", "Delay", "ms", np.array([t.size for t in seen]), delays, over="missing torque / threshold",
             log="x", dots=True, lines=False),
    ]  # fmt: skip
    rows = []
    for i, name in enumerate(robot.joint_names):
        mine = [t for t in faults if t.joint == i]
        clear = [t for t in mine if t.size >= CLEAR]
        missed = [t.size for t in mine if t.found < 0]
        rows.append(
            (name, float(threshold[i]), CLEAR * float(threshold[i]), len(mine), len(clear),
             float(np.mean([t.found >= 0 for t in clear])) if clear else None,
             float(np.mean([t.found == i for t in clear])) if clear else None,
             float(max(missed)) * float(threshold[i]) if missed else 0.0)
        )  # fmt: skip
    columns = (
        "joint", "threshold [N m]", "has to be found from [N m]", "faults", "of these", "found", "rightly",
        "largest that was missed [N m]",
    )  # fmt: skip
    text = Text(
        "Noise of 0.01 rad/s on joint velocities and of 0.05 mrad on positions; masses of the controller wrong. A "
        "fault shows as missing torque alone: a dead motor without a command is not seen, and harms nothing. "
        "Times, torques and velocities in this report are those of the last stretch of faults alone."
    )
    return Section("Faults found and missed", [text, *plots, Table(columns, rows)])
