"""An arm loses the motor of one joint; its brake holds the joint, and the other joints do its work."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, final

import numpy as np

import wbc
from wbc.errors import InvalidInput
from wbc.models.pinocchio_ import PinocchioModel
from wbc.report import measure
from wbc.report.document import Bound, Curve, Plot, Section, Table, Text
from wbc.sim.actuator_fault import ActuatorFault
from wbc.sim.mujoco_ import MujocoPlant
from wbc.sim.scenario import Check, Parameter, Parameters, Scenario, ScenarioResult, Setup, Trial
from wbc.types import Vec

from .. import (
    Brake,
    FaultReaction,
    MomentumObserver,
    Release,
    When,
)
from . import judge
from .arm_reach import following, tool, way

FAULT, RECOVERY = 3.0, 1.0  # seconds
#: At this moment the second joint stops where the others cannot reach all of the path [s].
EARLY = 2.0
GAIN, THRESHOLD = 100.0, 0.3
ANSWERS = ("nothing", "release", "brake")


@final
@dataclass(frozen=True, eq=False)
class Seen:
    """One trial: what was found, how long after the fault, what became of the tool."""

    trial: Trial
    joint: str
    answer: str
    start: float
    found: str
    delay: float

    @classmethod
    def of(cls, trial: Trial) -> Seen:
        """What came of a trial."""
        answer, fault, reaction = trial.about
        first = reaction.events[0][0] if reaction.events else None
        found, delay = (first.joint_name, first.t - fault.start) if first else ("none", float("inf"))
        return cls(replace(trial, name=answer), fault.joint, answer, fault.start, found, delay)

    @property
    def rms(self) -> float:
        """Distance of the tool from its target, from a second after the fault on [m]."""
        return measure.rms(self.trial.error("Position")[self.trial.run["t"] > self.start + RECOVERY])


@final
class ArmActuatorLoss(Scenario):
    """The tool follows a sinusoid; at 3 s the motor of a joint dies: each of the first ``joints`` joints in turn, once
    without an answer, once with its torque bounded to zero, once with its brake set.

    ``robot``: panda (needs example-robot-data) or arm.
    """

    name: ClassVar[str] = "arm-actuator-loss"
    group: ClassVar[str] = "faults"
    takes = 120.0
    summary: ClassVar[str] = "an arm loses one motor after the other; a brake and the other joints keep the tool going"
    parameters: ClassVar[Mapping[str, Parameter]] = {"robot": "panda", "joints": 6}
    plants = ("mujoco",)
    duration = 7.0

    def cases(self, p: Parameters) -> dict[str, dict[str, Any]]:
        robot, count = wbc.load(p["robot"]), int(p["joints"])
        if not 1 <= count <= robot.nj:
            raise InvalidInput(f"parameter 'joints' is {count}; {robot.name} has {robot.nj} joints")
        p.lasts_beyond(FAULT + RECOVERY, f"the fault comes at {FAULT:g} s")
        wanted = [(joint, answer, FAULT) for joint in robot.joint_names[:count] for answer in ANSWERS]
        wanted += [(joint, "brake", EARLY) for joint in robot.joint_names[1:2]]
        return {f"{joint} at {start:g} s, {answer}": {"joint": joint, "answer": answer, "start": start}
                for joint, answer, start in wanted}  # fmt: skip

    def build(self, p: Parameters) -> Setup:
        robot = wbc.load(p["robot"])
        plant, fault = MujocoPlant(robot), ActuatorFault(joint=p["joint"], start=p["start"])
        observer = MomentumObserver(gain=GAIN, threshold=THRESHOLD, persistence=2, release=0.5)
        lines = {"nothing": [], "release": [When("total", [Release()])], "brake": [When("total", [Brake(plant.brake)])]}
        reaction = FaultReaction(observer, table=lines[p["answer"]])
        stack = following(robot, [observer, reaction])
        return Setup(stack=stack, plant=plant, disturbances=[fault], about=(p["answer"], fault, reaction))

    def judge(self, trials: Iterator[Trial], p: Parameters) -> ScenarioResult:
        seen = [Seen.of(trial) for trial in trials]
        by = {answer: [s for s in seen if s.answer == answer and s.start == FAULT] for answer in ANSWERS}
        robot, braked = seen[0].trial.robot, by["brake"]
        # A joint that carries nothing breaks nothing: the worst without an answer must be bad, all with it good.
        lost, kept = [s.rms for s in by["nothing"]], [s.rms for s in braked]
        loaded, right = sum(rms > 1e-3 for rms in lost), sum(s.found == s.joint for s in braked)
        delay = max(s.delay for s in braked)
        figures = {
            "joint": [s.joint for s in braked], "found_joint": [s.found for s in braked],
            "delay_ms": [1e3 * s.delay for s in braked],
            "with": {"stands": True, "task_rms_m": max(kept), "each": kept},
            "without": {"stands": False, "task_rms_m": min(lost), "each": lost},
            "released": {"task_rms_m": [s.rms for s in by["release"]]},
        }  # fmt: skip
        checks = [
            Check("smallest rms error of the tool without an answer", min(lost), ">", 0.04, "m"),
            Check("largest rms error of the tool with a brake", max(kept), "<", 5e-4, "m"),
            Check("first diagnosis names the joint", float(right), "=", float(len(kept)), "of all"),
            Check("longest from fault to brake", delay, "<=", 0.02, "s"),
            Check("joints that carry something", float(loaded), "=", float(len(lost)), "of all"),
        ]
        shown = [by[answer][len(kept) // 2] for answer in ("brake", "nothing", "release")]
        early = [s for s in seen if s.start == EARLY]
        sections = [_section([s.trial for s in shown], shown[0].joint), _table(robot, by, early)]
        return judge.verdict([s.trial for s in shown], checks, figures=figures, sections=sections)


def out_of_reach(robot: PinocchioModel, frame: str, joint: str, q: Vec) -> float:
    """How far the path comes from what ``frame`` can reach with ``joint`` held as at q (nq,) [m]; limits count.

    At points along the path, the least distance by Gauss and Newton in the other joints, cut to their limits.
    """
    state, path, held = robot.state(), way(robot), robot.joint(joint)
    others, worst, still = [i for i in range(robot.nj) if i != held], 0.0, np.zeros(robot.nv)
    for t in np.arange(RECOVERY, RECOVERY + 10.0, 0.1):
        q = q.copy()
        distance = np.inf
        for _ in range(30):
            state.update(0.0, q, still)
            e = path(float(t))[0] - state.frame(frame).position
            distance = min(distance, float(np.linalg.norm(e)))
            J = state.frame(frame).jacobian()[:3, others]
            q[others] += J.T @ np.linalg.solve(J @ J.T + 1e-6 * np.eye(3), e)
            q[:] = np.clip(q, robot.limits.q_min, robot.limits.q_max)
        worst = max(worst, distance)
    return worst


def _section(shown: Sequence[Trial], joint: str) -> Section:
    run = shown[0].run
    t, joints = run["t"], run.meta["joint_names"]
    near = (t > FAULT - 0.02) & (t < FAULT + 0.06)
    residual = run["signal.MomentumObserver.residual"][near]
    error = judge.beside(
        "tool", f"{joint} dies: the tool's error", "mm", shown,
        lambda trial: np.maximum(1e3 * trial.error("Position"), 1e-3), log="y",
        caption="One of the joints. The path is three-dimensional: six joints can follow it. Errors "
        "below 0.001 mm are drawn as 0.001 mm.",
    )  # fmt: skip
    felt = Plot(
        "residuals", "Residuals about the fault; restarted when the brake is set", "N m", 1e3 * (t[near] - FAULT),
        [Curve(joint, residual[:, i]) for i, joint in enumerate(joints)], [Bound(THRESHOLD, "threshold")],
        over="time since the fault [ms]",
    )  # fmt: skip
    return Section("A dead motor", [error, felt])


def _table(robot: PinocchioModel, by: Mapping[str, Sequence[Seen]], early: Sequence[Seen]) -> Section:
    state = robot.state()
    rows = []
    for nothing, released, braked in zip(*(by[answer] for answer in ANSWERS), strict=True):
        run = nothing.trial.run
        state.update(0.0, run["plant.q"][measure.row(run, FAULT)], np.zeros(robot.nv))
        weight = abs(float(state.g[robot.joint(nothing.joint)]))
        rows.append(
            (nothing.joint, weight, 1e3 * nothing.rms, 1e3 * released.rms, 1e3 * braked.rms, 1e3 * braked.delay)
        )
    columns = (
        "joint", "gravity on it [N m]", "nothing: rms [mm]", "released: rms [mm]", "braked: rms [mm]",
        "brake after [ms]",
    )  # fmt: skip
    text = Text(
        "Bounding a dead joint's torque to zero does not save an arm: nothing but its motor holds what hangs on a "
        "serial joint, and the second column says how much that is. A brake is what it takes, and then a path of three "
        "coordinates has six joints left, if it is within their reach."
    )
    lost = []
    for case in early:
        at = case.trial.run["plant.q"][measure.row(case.trial.run, case.start + 0.02)]
        lost.append((case.joint, case.start, 1e3 * case.rms, 1e3 * out_of_reach(robot, tool(robot), case.joint, at)))
    beyond = Table(
        ("joint", "fault at [s]", "braked: rms [mm]", "path out of reach by up to [mm]"), lost,
        "A loss that a brake does not mend: where the joint stops, the others cannot reach all of the path.",
    )  # fmt: skip
    return Section("Every joint", [text, Table(columns, rows), beyond])
