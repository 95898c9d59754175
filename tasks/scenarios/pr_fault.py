"""The PR robot loses actuators; a momentum observer finds which one, and how much of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple, final

import numpy as np

import wbc
from wbc.methods import FaultFraction
from wbc.models import PlanarPR
from wbc.report import measure
from wbc.report.document import Bound, Curve, Plot, Section, Table, Text
from wbc.sim.actuator_fault import ActuatorFault
from wbc.sim.scenario import Check, Parameter, Parameters, Scenario, ScenarioResult, Setup, Trial
from wbc.types import Vec

from .. import MomentumObserver, Torque
from . import judge
from .exact_plant import EXACT, ExactPlant

#: Where the robot is when the fault comes [m, rad], how it moves, and the commands of its actuators [N, N m].
Q_START, V_START, TAU = np.array([0.0, np.pi / 2]), np.array([1.0, -1.0]), np.array([5.0, -2.0])
UNITS = ("N", "N m")
#: At this time [s] the source's numbers are read, for its two gains [1/s].
AT, PUBLISHED = 0.1, {10.0: 3.1606, 3.0: 1.2959}
#: What the integrators of plant and observer leave [N, N m]; link 2 turns faster and faster, so it is not zero.
LEFT = 5e-4

FAULTS: Mapping[str, Sequence[ActuatorFault]] = {
    "total, joint 1": [ActuatorFault(joint="q1")],
    "partial, 60 % of joint 1 lost": [ActuatorFault(joint="q1", effectiveness=0.4)],
    "bias, 0.5 N m of joint 2": [ActuatorFault(joint="q2", effectiveness=1.0, bias=0.5)],
    "concurrent, 60 % of 1 and all of 2": [ActuatorFault(joint="q1", effectiveness=0.4), ActuatorFault(joint="q2")],
}


class Seen(NamedTuple):
    """A run with one kind of fault, and the missing torques (2,) [N, N m]."""

    run: wbc.Run
    missing: Vec

    @classmethod
    def of(cls, trial: Trial) -> Seen:
        """What came of a trial."""
        missing = np.zeros(2)
        for fault in trial.about:
            joint = trial.robot.joint(fault.joint)
            missing[joint] += fault.missing(0.0, TAU[joint])
        return cls(trial.run, missing)

    def residual(self, gain: float) -> Vec:
        """r (N, 2) of the observer with this gain."""
        return np.asarray(self.run[f"signal.{_name(gain)}.residual"])

    def expected(self, gain: float) -> Vec:
        """τ_f (1 − e^(−K t)) (N, 2): the tick at t knows of the interval before it."""
        return np.asarray((1.0 - np.exp(-gain * self.run["t"]))[:, None] * self.missing)

    def off(self) -> float:
        """Largest difference between residual and expectation, over joints, ticks and gains."""
        return max(float(np.abs(self.residual(k) - self.expected(k)).max()) for k in PUBLISHED)


@final
class PrFault(Scenario):
    """At t = 0 actuator 1 dies while (5 N, −2 N m) are commanded; two observers watch, K = 10 and K = 3 [1/s].

    Then the same with a partial fault, a bias, and two faults at once. ``threshold`` [N, N m] raises the alarm.
    """

    name: ClassVar[str] = "pr-fault"
    group: ClassVar[str] = "planar"
    takes = 8.0
    summary: ClassVar[str] = "the PR robot's actuators fail; the momentum residual says which and how much"
    parameters: ClassVar[Mapping[str, Parameter]] = {"threshold": (0.5, 0.1)}
    duration = 1.0

    def cases(self, p: Parameters) -> dict[str, dict[str, Any]]:
        p.lasts_beyond(AT, f"residuals are read at {AT:g} s")
        return {kind: {"faults": faults} for kind, faults in FAULTS.items()}

    def build(self, p: Parameters) -> Setup:
        robot = PlanarPR(m1=1.0, m2=1.0, l2=0.5, d2=0.25, I2=0.1, v_max=[10.0, 40.0], tau_max=[10.0, 5.0])
        observers = [MomentumObserver(gain=gain, threshold=p["threshold"], name=_name(gain)) for gain in PUBLISHED]
        plant = ExactPlant(robot)
        plant.reset(Q_START, V_START)
        stack = wbc.Stack([Torque(TAU, weight=1e6)], components=observers)
        return Setup(stack=stack, plant=plant, level=EXACT, disturbances=p["faults"], about=p["faults"])

    def judge(self, trials: Iterator[Trial], p: Parameters) -> ScenarioResult:
        done, solver = list(trials), p.settings.solver
        seen = {trial.name: Seen.of(trial) for trial in done}
        total = seen[done[0].name]
        run, row = total.run, measure.row(total.run, AT)
        momentum = done[0].robot.momentum(Q_START, V_START)
        fast = max(PUBLISHED)
        alarm = run[f"signal.{_name(fast)}.alarm"]
        detected = float(run["t"][np.argmax(alarm[:, 0] > 0)]) if alarm[:, 0].any() else np.inf
        latest = -np.log(1.0 - p["threshold"][0] / abs(total.missing[0])) / fast
        late, lost = float(detected - latest), _fractions(total, solver)
        figures: dict[str, Any] = {
            f"r1_at_{AT:g}_s_K_{gain:g}_N": float(total.residual(gain)[row, 0]) for gain in PUBLISHED
        }
        figures |= {
            "largest_r2_Nm": max(float(np.abs(total.residual(gain)[:, 1]).max()) for gain in PUBLISHED),
            "detected_s": detected,
            "share_lost_joint_1": float(lost[1][0]),
            "share_lost_joint_2": float(lost[1][1]),
            "momentum_start_1": float(momentum[0]),
            "momentum_start_2": float(momentum[1]),
        }
        off = {gain: abs(float(total.residual(gain)[row, 0]) - value) for gain, value in PUBLISHED.items()}
        checks = [
            *(
                Check(f"r1({AT:g} s) for K = {gain:g} minus {value}", off[gain], "<=", 5e-5, "N")
                for gain, value in PUBLISHED.items()
            ),
            Check("residual of the healthy joint, total fault", figures["largest_r2_Nm"], "<=", LEFT, "N m"),
            *(
                Check(f"residual minus its formula: {kind}", of.off(), "<=", LEFT, "N, N m")
                for kind, of in seen.items()
            ),
            Check("alarm of joint 1 not before the time of the formula", late, ">=", 0.0, "s"),
            Check("alarm of joint 1 later than the formula says", late, "<=", 2e-3, "s"),
            Check("alarms of the healthy joint", float(alarm[:, 1].sum()), "=", 0.0, "ticks"),
            Check("share lost of joint 1, formula and QP apart", float(np.abs(lost[0] - lost[1]).max()), "<=", 1e-6),
            *judge.common_checks(run),
        ]  # fmt: skip
        shown = [_total_fault(total, momentum), _other_faults(seen, solver)]
        return judge.verdict(done[0], checks, tracking={}, figures=figures, sections=shown)


def _name(gain: float) -> str:
    return f"K={gain:g}"


def _fractions(of: Seen, solver: str) -> tuple[Vec, Vec]:
    """What share of each command is lost at the end, by formula and by QP: min |diag(τ) l − r|, 0 ≤ l ≤ 1."""
    problem = FaultFraction(TAU, of.residual(max(PUBLISHED))[-1])
    return problem.closed_form().fraction, problem.solve(solver).fraction


def _total_fault(total: Seen, momentum: Vec) -> Section:
    t = measure.times(total.run)
    first = [Curve(f"K1 = {gain:g}", total.residual(gain)[:, 0]) for gain in PUBLISHED]
    first += [
        Curve(
            f"K1 = {gain:g}, without p(0)", total.expected(gain)[:, 0] - gain * momentum[0] * np.exp(-gain * t), False
        )
        for gain in PUBLISHED
    ]
    second = [Curve(f"K2 = {gain:g}", 1e3 * total.residual(gain)[:, 1]) for gain in PUBLISHED]
    plots = [
        Plot("fault-dead", "Residual of actuator 1, dead from t = 0", "N", t, first, [Bound(TAU[0], "τ1 commanded")],
             caption="Once r1 stands at the command, the fault is total. Without p(0) the residual, r = K (∫ … − p), "
             "would start at −K p1(0), far below, whatever the fault: a click in the legend shows it."),
        Plot("fault-healthy", "Residual of the healthy actuator", "mN m", t, second),
    ]  # fmt: skip
    text = Text(
        f"At the fault p = ({momentum[0]:g} kg m/s, {momentum[1]:g} kg m²/s). The residual is "
        "r = K (∫ (τ − β − r) dt − (p − p(0))), and ṙ = K (τ_f − r) from r(0) = 0, whatever the robot does."
    )
    rows = [
        (f"K1 = {gain:g}", float(total.residual(gain)[measure.row(total.run, AT), 0]),
         float(TAU[0] * (1 - np.exp(-gain * AT))), float(-gain * momentum[0]))
        for gain in PUBLISHED
    ]  # fmt: skip
    table = Table(("gain", "r1(0.1 s) [N]", "by formula [N]", "r1(0) without p(0) [N]"), rows)
    return Section("Total fault of actuator 1", [text, *plots, table])


def _other_faults(seen: Mapping[str, Seen], solver: str) -> Section:
    others = list(seen.items())[1:]
    fast = max(PUBLISHED)
    plots = [
        Plot(f"fault-{k}", f"{kind[0].upper()}{kind[1:]}: residuals for K = {fast:g} 1/s", ", ".join(UNITS),
             measure.times(of.run),
             [Curve(f"r{joint + 1} [{UNITS[joint]}]", of.residual(fast)[:, joint]) for joint in range(2)],
             [Bound(of.missing[joint], f"missing of joint {joint + 1}") for joint in np.flatnonzero(of.missing)])
        for k, (kind, of) in enumerate(others)
    ]  # fmt: skip
    rows = []
    for kind, of in seen.items():
        by_formula, by_qp = _fractions(of, solver)
        for joint in range(2):
            rows.append(
                (kind, f"q{joint + 1}", UNITS[joint], float(of.missing[joint]), float(of.residual(fast)[-1, joint]),
                 float(by_formula[joint]), float(by_qp[joint]))
            )  # fmt: skip
    columns = (
        "fault",
        "joint",
        "unit",
        "missing",
        "residual at the end",
        "share lost, formula",
        f"share lost, {solver}",
    )
    caption = (
        "Residuals at the end. The share l of the command that is lost solves min |diag(τ) l − r|² under 0 ≤ l ≤ 1. A "
        "bias that takes away from the command looks like a loss, one that adds to it like none."
    )
    return Section("Other faults", [*plots, Table(columns, rows, caption)])
