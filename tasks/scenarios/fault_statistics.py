"""Statistics of detection: many short faults of an arm's motors, with noise and wrong masses."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter_ns
from typing import Any, ClassVar, final

import numpy as np

import wbc
from wbc.models.pinocchio_ import PinocchioModel
from wbc.report.document import Curve, Plot, Section, Table, Text
from wbc.sim.actuator_fault import ActuatorFault
from wbc.sim.disturbance import Effect, SensorNoise
from wbc.sim.mujoco_ import MujocoPlant
from wbc.sim.scenario import Check, Parameter, Parameters, Scenario, ScenarioResult, Trial
from wbc.types import Status, Vec

from .. import MomentumObserver, Posture, Sinusoid, Thresholds, TorqueLimits

GAIN, PERSISTENCE, FLOOR = 100.0, 2, 0.1
#: How long a fault lasts, and how long after it the robot is left alone before it counts as sound again [s].
LASTS, RECOVERY = 0.06, 0.5
#: Missing torque in units of its joint's threshold from which on a fault has to be found.
CLEAR = 3.0
KINDS = ("total", "partial", "bias")
SCALES = np.geomspace(0.2, 3.0, 40)
STATUSES = tuple(Status)


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
    Then it waves for ``nominal`` seconds more without a fault. How many are found, laid to the right joint, after how
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
        return {}  # one loop that goes on over all faults, see Arm

    def judge(self, trials: Iterator[Trial], p: Parameters) -> ScenarioResult:
        count, nominal = p.count("faults"), p.number("nominal", low=0.0)
        masses, learning = p.number("masses", low=0.0, high=0.5), p.number("learning", low=1.0)
        progress = p.settings.progress
        arm = Arm(wbc.load(p["robot"]), masses, p.settings.solver, p["seed"])
        progress(0.0, "learning thresholds")
        known = arm.learn(learning)
        faults, windows = [], []
        for k in range(count):
            if k % max(count // 100, 1) == 0:
                progress(k / (count + 1), f"fault {k + 1} of {count}")
            fault, window = arm.fault(known)
            faults.append(fault)
            windows.append(window)
        windows += [arm.sound(1.0, known) for _ in range(int(nominal))]
        return _judged(arm, p, known, faults, windows)


@final
class Arm:
    """The arm, its controller, its observer and its sensors, tick by tick."""

    def __init__(self, robot: PinocchioModel, masses: float, solver: str, seed: int) -> None:
        self.random = np.random.default_rng(seed)
        links = len(robot.pinocchio.inertias) - 1
        believed = robot.with_masses(1.0 + self.random.uniform(-masses, masses, links))
        self.observer = MomentumObserver(gain=GAIN)
        wave = Sinusoid(robot.q0, amplitude=0.3, frequency=np.linspace(0.3, 0.6, robot.nj))
        stack = wbc.Stack([Posture(wave, kp=100)], subject_to=[TorqueLimits()], components=[self.observer])
        self.controller = wbc.Controller(believed, stack, level=wbc.InverseDynamics(), solver=solver)
        self.plant = MujocoPlant(robot)
        self.plant.reset(robot.q0)
        self.robot, self.ticks = robot, 0
        self.noise = SensorNoise(position=5e-5, velocity=0.01, seed=seed).begin(self.plant)
        self.rows: list[dict[str, Any]] = []

    def step(self, effect: Effect | None = None) -> Vec:
        """One tick; the residual (nj,)."""
        plant = self.plant
        measured, began = self.noise.measure(plant.q, plant.v), perf_counter_ns()
        command: Any = self.controller.tick(plant.t, *measured)
        took = 1e-3 * (perf_counter_ns() - began)
        self.rows.append(
            {
                "t": plant.t,
                "status": STATUSES.index(command.status),
                "tick_us": took,
                "q": plant.q,
                "v": plant.v,
                "tau": command.tau,
            }
        )
        del self.rows[:-2000]
        if effect is not None:
            effect.push(plant.t)
            command = effect.deliver(command)
        plant.step(command)
        self.ticks += 1
        return self.observer.residual

    def learn(self, seconds: float) -> Thresholds:
        """Thresholds from a stretch without a fault."""
        residual = np.array([self.step() for _ in range(round(seconds * 1e3))])
        return Thresholds.learnt(residual[500:], gain=GAIN, dt=1e-3, floor=FLOOR)

    def sound(self, seconds: float, known: Thresholds) -> tuple[int, float]:
        """Ticks of a stretch without a fault, and the largest residual of any joint that lasted two ticks."""
        ratios = np.array([np.abs(self.step()) / known.value for _ in range(round(seconds * 1e3))])
        return len(ratios), float(_lasting(ratios).max(initial=0.0))

    def fault(self, known: Thresholds) -> tuple[Fault, tuple[int, float]]:
        """A stretch without a fault, then one of 60 ms, then time to recover."""
        random = self.random
        window = self.sound(float(random.uniform(0.1, 0.3)), known)
        joint, kind = int(random.integers(self.robot.nj)), KINDS[int(random.integers(3))]
        name, start = self.robot.joint_names[joint], self.plant.t - 0.5e-3
        if kind == "bias":
            size = float(random.uniform(0.5, 8.0) * random.choice([-1.0, 1.0]) * known.value[joint])
            fault = ActuatorFault(joint=name, effectiveness=1.0, bias=size, start=start)
        else:
            left = 0.0 if kind == "total" else float(random.uniform(0.25, 0.75))
            fault = ActuatorFault(joint=name, effectiveness=left, start=start)
        effect = fault.begin(self.plant)
        missing = abs(fault.missing(self.plant.t, float(self.rows[-1]["tau"][joint])))
        seen = np.array([np.abs(self.step(effect)) / known.value for _ in range(round(LASTS * 1e3))])
        lasting = _lasting(seen)
        over = np.flatnonzero((lasting > 1.0).any(axis=1))
        delay, found = (np.inf, -1) if not len(over) else (1e-3 * over[0], int(seen[over[0]].argmax()))
        for _ in range(round(RECOVERY * 1e3)):
            self.step()
        size = missing / float(known.value[joint])
        return Fault(joint, kind, size, float(lasting[:, joint].max()), float(delay), found), window


def _lasting(ratios: Vec) -> Vec:
    """What of ratios (N, nj) lasted as many ticks as an alarm needs."""
    shifted = np.vstack([np.zeros((1, ratios.shape[1])), ratios[:-1]])
    return np.minimum(ratios, shifted)


def _judged(
    arm: Arm, parameters: Mapping[str, Any], known: Thresholds, faults: Sequence[Fault],
    windows: Sequence[tuple[int, float]],
) -> ScenarioResult:  # fmt: skip
    robot = arm.robot
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
        "clear_Nm": {n: CLEAR * float(v) for n, v in zip(robot.joint_names, known.value, strict=True)},
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
    columns = {name: np.array([row[name] for row in arm.rows]) for name in arm.rows[0]}
    meta = {
        "scenario": FaultStatistics.name, "parameters": dict(parameters), "robot": robot.name, "dt": 1e-3,
        "level": arm.controller.level.name, "hierarchy": str(arm.controller.hierarchy),
        "solver": arm.controller.solver.name,
        "joint_names": list(robot.joint_names), "joint_units": list(robot.joint_units),
        "statuses": [status.name for status in STATUSES],
        "limits": {k: getattr(robot.limits, k).tolist() for k in ("q_min", "q_max", "v_max", "tau_max")},
    }  # fmt: skip
    return ScenarioResult(
        run=wbc.Run(columns, meta), ok=all(check.ok for check in verdict), verdict=verdict, violations={}, tracking={},
        figures=figures, sections=[_section(faults, windows, robot, known)],
    )  # fmt: skip


def _section(
    faults: Sequence[Fault], windows: Sequence[tuple[int, float]], robot: PinocchioModel, known: Thresholds
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
            (name, float(known.value[i]), CLEAR * float(known.value[i]), len(mine), len(clear),
             float(np.mean([t.found >= 0 for t in clear])) if clear else None,
             float(np.mean([t.found == i for t in clear])) if clear else None,
             float(max(missed)) * float(known.value[i]) if missed else 0.0)
        )  # fmt: skip
    columns = (
        "joint", "threshold [N m]", "has to be found from [N m]", "faults", "of these", "found", "rightly",
        "largest that was missed [N m]",
    )  # fmt: skip
    text = Text(
        "Noise of 0.01 rad/s on joint velocities and of 0.05 mrad on positions; masses of the controller wrong. A "
        "fault shows as missing torque alone: a dead motor that is asked for nothing is not seen, and harms nothing. "
        "Times, torques and velocities in this report are those of the last two seconds alone."
    )
    return Section("Faults found and missed", [text, *plots, Table(columns, rows)])
