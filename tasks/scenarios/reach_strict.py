"""A humanoid reaches for a target out of reach: strict levels keep its balance, weights do not."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar, final

import numpy as np

import wbc
from wbc.models.pinocchio_ import PinocchioModel
from wbc.report import measure
from wbc.report.document import Cell, Section, Table, Text
from wbc.sim.plant import IntegratorPlant, Plant
from wbc.sim.scenario import Check, Parameter, Parameters, Scenario, ScenarioResult, Setup, Trial
from wbc.stack.hierarchy import HIERARCHIES

from .. import CenterOfMass, MinimumJerk, Position, Posture
from . import judge
from .humanoid_stand import STANCES
from .standing import Stance, held_by_damping, joint_constraints, standing_plant, upright

#: The hand's target leaves at this time [s], and arrives this much later.
START, WAY = 0.5, 1.5


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
    summary: ClassVar[str] = "a humanoid reaches for a target out of reach: strict levels keep its balance"
    parameters: ClassVar[Mapping[str, Parameter]] = {"robot": "humanoid", "reach": 0.6}
    robots = STANCES
    plants = ("mujoco", "integrator")
    hierarchies = ("strict", "weighted", "scaled")
    duration = 4.0

    def cases(self, p: Parameters) -> dict[str, dict[str, Any]]:
        asked = p.settings.hierarchy
        return {name: {"hierarchy": name} for name in (asked, *(name for name in self.hierarchies if name != asked))}

    def build(self, p: Parameters) -> Setup:
        stance = STANCES[p["robot"]]
        robot = stance.robot(p["robot"])
        if p.settings.plant == "mujoco":
            plant: Plant = standing_plant(robot, stance, held_by_damping(robot))
        else:
            plant = IntegratorPlant(robot, level="acceleration")
        return Setup(stack=_stack(robot, stance, p["reach"]), plant=plant, hierarchy=HIERARCHIES[p["hierarchy"]])

    def judge(self, trials: Iterator[Trial], p: Parameters) -> ScenarioResult:
        done = list(trials)
        runs = {trial.name: trial.run for trial in done}
        conditions = {trial.name: float(np.linalg.cond(trial.controller.qp.H)) for trial in done}
        run = done[0].run
        rms = {trial.name: measure.rms(trial.error("CenterOfMass")) for trial in done}
        figures = {
            "balance_rms_m": rms,
            "hand_error_m": float(done[0].error("Position")[-1]),
            "stood_s": {kind: measure.seconds(each) for kind, each in runs.items()},
            "tick_us": {kind: measure.tick_times(each).median for kind, each in runs.items()},
            "condition": conditions,
            "certified_share": judge.certified_share(run),
        }
        checks = [judge.stood_check(run, p.settings.duration), *judge.common_checks(run)]
        if p.settings.hierarchy == "strict":
            checks.insert(1, Check("error of the centre of mass, rms", rms["strict"], "<", 2e-3, "m"))
        return judge.verdict(done, checks, figures=figures, sections=[_costs(done, conditions, rms)])


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
                upright(state, stance),
            ],
            # Where an arm is stretched out, a hand alone asks for any joint speed that brings it a little nearer: with
            # a hundredth of its weight a posture leaves torques that change sides in every tick, with a tenth none.
            [Position(stance.hand, target=away, kp=100), Posture(robot.q0, kp=100, weight=0.1)],
        ],
        contacts=held_by_damping(robot),
        subject_to=joint_constraints(robot),
    )


def _costs(done: Sequence[Trial], conditions: Mapping[str, float], rms: Mapping[str, float]) -> Section:
    """What the choice of the hierarchy costs and gives."""
    rows: list[list[Cell]] = []
    for trial in done:
        kind, tick, hand = trial.name, measure.tick_times(trial.run), float(trial.error("Position")[-1])
        rows.append([kind, measure.seconds(trial.run), 1e3 * rms[kind], hand, conditions[kind], tick.median, tick.p99])
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
        judge.beside("balance", "Error of the centre of mass", "mm", done, lambda of: 1e3 * of.error("CenterOfMass")),
        judge.beside("hand", "Error of the hand", "mm", done, lambda of: 1e3 * of.error("Position")),
    ]
    return Section("What the hierarchy costs", [text, Table(columns, rows), *plots])
