"""An arm loses the motor of one joint; its brake holds the joint, and the other joints do its work."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, final

import numpy as np

import wbc
from wbc.errors import InvalidInput
from wbc.models.pinocchio_ import PinocchioModel
from wbc.report import measure
from wbc.report.document import Bound, Curve, Plot, Section, Table, Text
from wbc.sim.actuator_fault import ActuatorFault
from wbc.sim.mujoco_ import MujocoPlant
from wbc.sim.scenario import Check, Parameter, Scenario, ScenarioResult, Settings, trials
from wbc.sim.simulate import simulate
from wbc.types import Vec

from .. import (
    Brake,
    FaultReaction,
    JointPositionLimits,
    JointVelocityLimits,
    MomentumObserver,
    Position,
    Posture,
    Release,
    Sinusoid,
    TorqueLimits,
    When,
)
from . import judge
from .arm_reach import TOOLS

FAULT, RECOVERY = 3.0, 1.0  # seconds
#: At this moment the second joint stops where the others cannot reach all of the path [s].
EARLY = 2.0
GAIN, THRESHOLD = 100.0, 0.3
ANSWERS = ("nothing", "release", "brake")


@final
@dataclass(frozen=True, eq=False)
class Seen:
    """One run: who failed, what was done, what came of it."""

    joint: str
    answer: str
    run: wbc.Run
    found: str
    delay: float
    start: float

    @property
    def error(self) -> Vec:
        """Distance of the tool from its target (N,) [m]."""
        name = next(name for name in self.run.columns if name.startswith("error.Position"))
        distance: Vec = np.linalg.norm(self.run[name], axis=1)
        return distance

    @property
    def rms(self) -> float:
        """From a second after the fault on [m]."""
        late = self.error[self.run["t"] > self.start + RECOVERY]
        return float(np.sqrt(np.mean(late**2)))


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

    def run(self, parameters: Mapping[str, Any], settings: Settings) -> ScenarioResult:
        robot = wbc.load(parameters["robot"])
        count = int(parameters["joints"])
        if not 1 <= count <= robot.nj:
            raise InvalidInput(f"parameter 'joints' is {count}; {robot.name} has {robot.nj} joints")
        if settings.duration <= FAULT + RECOVERY:
            raise InvalidInput(
                f"duration is {settings.duration:g} s; the fault comes at {FAULT:g} s: give at least 2 s more"
            )
        meta = {"scenario": self.name, "parameters": dict(parameters)}
        seen: list[Seen] = []
        wanted = [(joint, answer) for joint in robot.joint_names[:count] for answer in ANSWERS]
        for (joint, answer), one in trials(settings.progress, wanted):
            one(0.0, f"{joint}, {answer}")
            fault = ActuatorFault(joint=joint, start=FAULT)
            seen.append(_trial(robot, fault, answer, duration=settings.duration, solver=settings.solver, meta=meta))
        early = [
            _trial(
                robot,
                ActuatorFault(joint=joint, start=EARLY),
                "brake",
                duration=settings.duration,
                solver=settings.solver,
                meta=meta,
            )
            for joint in robot.joint_names[1:2]
        ]
        return _judged(robot, seen, early)


def _trial(
    robot: PinocchioModel, fault: ActuatorFault, answer: str, *, duration: float, solver: str, meta: Mapping[str, Any]
) -> Seen:
    tool = TOOLS.get(str(meta["parameters"]["robot"]), robot.frame_names[-1])
    plant = MujocoPlant(robot)
    plant.reset(robot.q0)
    path = _path(robot, tool)
    observer = MomentumObserver(gain=GAIN, threshold=THRESHOLD, persistence=2, release=0.5)
    lines = {"nothing": [], "release": [When("total", [Release()])], "brake": [When("total", [Brake(plant.brake)])]}
    reaction = FaultReaction(observer, table=lines[answer])
    stack = wbc.Stack(
        [Position(tool, target=path, kp=400), Posture(robot.q0, kp=10, weight=1e-3)],
        subject_to=[TorqueLimits(), JointVelocityLimits(), JointPositionLimits()], components=[observer, reaction],
    )  # fmt: skip
    controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), solver=solver, dt=1e-3)
    run = simulate(controller, plant, duration=duration, disturbances=[fault], meta=meta)
    first = reaction.events[0][0] if reaction.events else None
    found, delay = (first.joint_name, first.t - fault.start) if first else ("none", float("inf"))
    return Seen(fault.joint, answer, run, found, delay, fault.start)


def _path(robot: PinocchioModel, tool: str) -> Sinusoid:
    return Sinusoid(robot.state().frame(tool).position, amplitude=[0.05, 0.08, 0.05], frequency=[0.5, 0.4, 0.6])


def out_of_reach(robot: PinocchioModel, tool: str, joint: str, q: Vec) -> float:
    """How far the path comes from what ``tool`` can reach with ``joint`` held as at q (nq,) [m]; limits count.

    At points along the path, the least distance by Gauss and Newton in the other joints, cut to their limits.
    """
    state, path, held = robot.state(), _path(robot, tool), robot.joint(joint)
    others, worst, still = [i for i in range(robot.nj) if i != held], 0.0, np.zeros(robot.nv)
    for t in np.arange(RECOVERY, RECOVERY + 10.0, 0.1):
        q = q.copy()
        distance = np.inf
        for _ in range(30):
            state.update(0.0, q, still)
            e = path(float(t))[0] - state.frame(tool).position
            distance = min(distance, float(np.linalg.norm(e)))
            J = state.frame(tool).jacobian()[:3, others]
            q[others] += J.T @ np.linalg.solve(J @ J.T + 1e-6 * np.eye(3), e)
            q[:] = np.clip(q, robot.limits.q_min, robot.limits.q_max)
        worst = max(worst, distance)
    return worst


def _judged(robot: PinocchioModel, seen: Sequence[Seen], early: Sequence[Seen]) -> ScenarioResult:
    by = {answer: [s for s in seen if s.answer == answer] for answer in ANSWERS}
    # A joint that carries nothing breaks nothing: the worst without an answer must be bad, all with it good.
    lost, kept = [s.rms for s in by["nothing"]], [s.rms for s in by["brake"]]
    loaded = [s for s in by["nothing"] if s.rms > 1e-3]
    right = sum(s.found == s.joint for s in by["brake"])
    delay = max(s.delay for s in by["brake"])
    figures = {
        "joint": [s.joint for s in by["brake"]], "found_joint": [s.found for s in by["brake"]],
        "delay_ms": [1e3 * s.delay for s in by["brake"]],
        "with": {"stands": True, "task_rms_m": max(kept), "each": kept},
        "without": {"stands": False, "task_rms_m": min(lost), "each": lost},
        "released": {"task_rms_m": [s.rms for s in by["release"]]},
    }  # fmt: skip
    shown = {answer: seen[len(kept) // 2].run for answer, seen in by.items()}
    run = shown.pop("brake")
    verdict = [
        Check("tool's error without an answer, rms, least of all", min(lost), ">", 0.04, "m"),
        Check("with a brake, most of all", max(kept), "<", 5e-4, "m"),
        Check("first diagnosis names the joint", float(right), "=", float(len(kept)), "of all"),
        Check("longest from fault to brake", delay, "<=", 0.02, "s"),
        Check("joints that carry something", float(len(loaded)), "=", float(len(lost)), "of all"),
    ]
    return judge.result(
        run, verdict, figures=figures, robot=robot,
        called="brake", beside=shown,
        sections=[lambda result: _section(result, by), lambda result: _table(robot, by, early)],
    )  # fmt: skip


def _section(result: ScenarioResult, by: Mapping[str, Sequence[Seen]]) -> Section:
    shown = len(by["brake"]) // 2
    t, joints = result.run["t"], result.run.meta["joint_names"]
    near = (t > FAULT - 0.02) & (t < FAULT + 0.06)
    residual = result.run["signal.MomentumObserver.residual"][near]
    names = (result.called, *result.beside)
    error = Plot(
        "tool", f"{by['brake'][shown].joint} dies: the tool's error", "mm", measure.times(result.run),
        [Curve(answer, np.maximum(1e3 * by[answer][shown].error, 1e-3), run=k, x=measure.times(by[answer][shown].run))
         for k, answer in enumerate(names)], log="y",
        caption="One of the joints. The path is three-dimensional: six joints can follow it.",
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
        at = int(np.searchsorted(nothing.run["t"], FAULT))
        state.update(0.0, nothing.run["plant.q"][at], np.zeros(robot.nv))
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
        tool = TOOLS.get(robot.name.lower(), robot.frame_names[-1])
        at = case.run["plant.q"][min(round((case.start + 0.02) / 1e-3), case.run.rows - 1)]
        lost.append((case.joint, case.start, 1e3 * case.rms, 1e3 * out_of_reach(robot, tool, case.joint, at)))
    beyond = Table(
        ("joint", "fault at [s]", "braked: rms [mm]", "path out of reach by up to [mm]"), lost,
        "A loss that a brake does not mend: where the joint stops, the others cannot reach all of the path.",
    )  # fmt: skip
    return Section("Every joint", [text, Table(columns, rows), beyond])
