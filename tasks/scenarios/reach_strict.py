"""A humanoid is asked to reach what it cannot: strictly ranked, its balance does not give."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, final

import numpy as np

import wbc
from wbc.control.recorder import Run
from wbc.models.pinocchio_ import PinocchioModel
from wbc.report import measure
from wbc.report.document import Cell, Curve, Plot, Section, Table, Text
from wbc.sim.plant import IntegratorPlant, Plant
from wbc.sim.scenario import Check, Parameter, Scenario, ScenarioResult, Settings, trials
from wbc.sim.simulate import simulate
from wbc.stack.hierarchy import Hierarchy

from .. import CenterOfMass, MinimumJerk, Orientation, Position, Posture
from . import judge
from .humanoid_stand import STANCES
from .standing import Stance, held_by_damping, joint_constraints, standing_plant

#: The hand's target leaves at this time [s], and arrives this much later.
START, WAY = 0.5, 1.5
HIERARCHIES: Mapping[str, Hierarchy] = {
    "strict": wbc.Strict(), "weighted": wbc.Weighted(), "scaled": wbc.Scaled()
}  # fmt: skip


@final
class ReachStrict(Scenario):
    """The target of a hand moves ``reach`` [m] ahead and as much to the side, out of reach, and stays there.

    There are two levels: balance (centre of mass and trunk), and below it hand and posture. The same stack runs once
    strictly ranked, once with the tasks added up by their weights and once scaled; the record is of the hierarchy asked
    for, the figures are of all. ``robot``: humanoid, talos or g1 (the last two need example-robot-data).
    """

    name: ClassVar[str] = "reach-strict"
    group: ClassVar[str] = "legs"
    takes = 35.0
    summary: ClassVar[str] = "a humanoid reaches for what is out of reach; ranked strictly, its balance does not give"
    parameters: ClassVar[Mapping[str, Parameter]] = {"robot": "humanoid", "reach": 0.6}
    robots = STANCES
    plants = ("mujoco", "integrator")
    hierarchies = ("strict", "weighted", "scaled")
    duration = 4.0

    def run(self, parameters: Mapping[str, Any], settings: Settings) -> ScenarioResult:
        stance = STANCES[parameters["robot"]]
        robot = stance.robot(parameters["robot"])
        meta = {"scenario": self.name, "parameters": dict(parameters)}
        names = [settings.hierarchy, *(name for name in HIERARCHIES if name != settings.hierarchy)]
        runs, conditions = dict[str, Run](), dict[str, float]()
        for kind, one in trials(settings.progress, names):
            controller = wbc.Controller(
                robot, _stack(robot, stance, parameters["reach"]), level=wbc.InverseDynamics(),
                hierarchy=HIERARCHIES[kind], solver=settings.solver, dt=1e-3,
            )  # fmt: skip
            runs[kind] = simulate(
                controller, _plant(robot, stance, settings.plant), duration=settings.duration, meta=meta,
                progress=one,
            )  # fmt: skip
            conditions[kind] = float(np.linalg.cond(controller.qp.H))
        return _judged(
            runs, conditions, asked=settings.hierarchy, robot=robot, stance=stance, duration=settings.duration
        )


def _stack(robot: PinocchioModel, stance: Stance, reach: float) -> wbc.Stack:
    state = robot.state()
    assert stance.hand is not None
    start = np.array(state.frame(stance.hand).position)
    side = float(np.sign(start[1] - state.com[1]))
    away = MinimumJerk(start, start + reach * np.array([1.0, side, 0.0]), duration=WAY, start_time=START)
    return wbc.Stack(
        [
            [
                CenterOfMass(target=np.array(state.com), kp=100),
                Orientation(stance.upright, target=np.array(state.frame(stance.upright).rotation), kp=100),
            ],
            # Where an arm is stretched out, a hand alone asks for any joint speed that brings it a little nearer: with
            # a hundredth of its weight a posture leaves torques that change sides in every tick, with a tenth none.
            [Position(stance.hand, target=away, kp=100), Posture(robot.q0, kp=100, weight=0.1)],
        ],
        contacts=held_by_damping(robot),
        subject_to=joint_constraints(robot),
    )


def _plant(robot: PinocchioModel, stance: Stance, kind: str) -> Plant:
    if kind == "mujoco":
        return standing_plant(robot, stance, held_by_damping(robot))
    plant = IntegratorPlant(robot, level="acceleration")
    plant.reset(robot.q0)
    return plant


def _balance(run: Run) -> float:
    """Error of the centre of mass, rms [m]."""
    return float(np.sqrt((run["error.CenterOfMass"] ** 2).sum(axis=1).mean()))


def _hand(run: Run, stance: Stance) -> float:
    """How far the hand is from its target at the end [m]."""
    return float(np.linalg.norm(run[f"error.Position[{stance.hand}]"][-1]))


def _judged(
    runs: Mapping[str, Run], conditions: Mapping[str, float], *, asked: str, robot: PinocchioModel, stance: Stance,
    duration: float,
) -> ScenarioResult:  # fmt: skip
    run = runs[asked]
    rms = {kind: _balance(each) for kind, each in runs.items()}
    figures = {
        "balance_rms_m": rms,
        "hand_error_m": _hand(run, stance),
        "stood_s": {kind: measure.seconds(each) for kind, each in runs.items()},
        "tick_us": {kind: measure.tick_times(each).median for kind, each in runs.items()},
        "condition": dict(conditions),
        "certified_share": judge.certified_share(run),
    }
    verdict = [
        judge.stood_check(run, duration),
        *judge.common_checks(run),
    ]
    if asked == "strict":
        verdict.insert(1, Check("error of the centre of mass, rms", rms["strict"], "<", 2e-3, "m"))
    return judge.result(
        run, verdict, figures=figures, robot=robot, sections=[_Costs(runs, conditions, stance)],
        called=asked, beside={kind: each for kind, each in runs.items() if kind != asked},
    )  # fmt: skip


@final
class _Costs:
    """What the choice of the hierarchy costs and gives, as a section of the report."""

    def __init__(self, runs: Mapping[str, Run], conditions: Mapping[str, float], stance: Stance) -> None:
        self._runs, self._conditions, self._stance = runs, conditions, stance

    def __call__(self, result: ScenarioResult) -> Section:
        rows: list[list[Cell]] = []
        for kind, run in self._runs.items():
            tick, balance = measure.tick_times(run), 1e3 * _balance(run)
            rows.append([
                kind, measure.seconds(run), balance, _hand(run, self._stance), self._conditions[kind], tick.median,
                tick.p99,
            ])  # fmt: skip
        text = Text(
            "The same stack on the same robot. Strictly ranked, the hand gets what balance leaves it; added up by "
            "weights, the two share the error that neither can avoid; scaled, each goes its own way as far as it can. "
            "The condition number is that of the Hessian of the last QP in standard form."
        )
        columns = [
            "hierarchy", "up [s]", "centre of mass, rms [mm]", "hand at the end [m]", "condition number",
            "tick, median [µs]", "p99 [µs]",
        ]  # fmt: skip
        plots = [
            Plot(name, title, "mm", measure.times(result.run),
                 [Curve(kind, 1e3 * np.linalg.norm(run[f"error.{task}"], axis=1), run=k, x=measure.times(run))
                  for k, (kind, run) in enumerate(self._runs.items())])
            for name, title, task in (
                ("balance", "Error of the centre of mass", "CenterOfMass"),
                ("hand", "Error of the hand", f"Position[{self._stance.hand}]"),
            )
        ]  # fmt: skip
        return Section("What the hierarchy costs", [text, Table(columns, rows), *plots])
