"""A robot whose drives follow positions: what each feedback makes of the same stack, beside torque control."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple, final

import numpy as np

import wbc
from wbc.control.recorder import Run
from wbc.models.pinocchio_ import PinocchioModel
from wbc.report import measure
from wbc.report.document import Cell, Section, Table, Text
from wbc.sim.drives import PositionDrives
from wbc.sim.mujoco_ import MujocoPlant
from wbc.sim.scenario import Check, Parameter, Scenario, ScenarioResult, Settings, trials
from wbc.sim.simulate import simulate
from wbc.types import Vec

from .. import JointPositionLimits, JointVelocityLimits, Position, Posture, Sinusoid, TorqueLimits
from ..trajectories import Trajectory
from . import arm_reach, humanoid_stand, judge, quadruped_stand
from .standing import Stance, standing_plant, standing_stack

STANCES: Mapping[str, Stance] = {**humanoid_stand.STANCES, **quadruped_stand.STANCES}
#: The error counts from here on [s]: drives that are sent no torques sag first.
SAGGED = 0.5
#: What commanded positions with torques keep to, rms [m].
ERROR = 5e-3


class Way(NamedTuple):
    """How a robot may be driven: which state the controller decides from, what the drives are sent."""

    feedback: str
    drives: PositionDrives | None


#: The first is the one that is recorded and judged.
WAYS: Mapping[str, Way] = {
    "commanded, with torques": Way("commanded", PositionDrives()),
    "commanded, positions alone": Way("commanded", PositionDrives(feed_forward=False)),
    "measured, with torques": Way("measured", PositionDrives()),
    "torques alone": Way("measured", None),
}


@final
class PositionControl(Scenario):
    """The tool of an arm, or the centre of mass of a robot on its feet, follows a sinusoid in MuJoCo four times: with
    position drives that are sent the controller's own setpoint, with and without its torques; that are sent setpoints
    from the measured state; and without drives, by torques. The first is recorded.

    ``robot``: arm, quadruped, humanoid, or panda, go2, talos, g1 (these need example-robot-data).
    """

    name: ClassVar[str] = "position-drives"
    group: ClassVar[str] = "arms"
    takes = 60.0
    summary: ClassVar[str] = "one stack on drives that follow positions, by what feedback and feed-forward they get"
    parameters: ClassVar[Mapping[str, Parameter]] = {"robot": "humanoid"}
    robots = (*STANCES, *arm_reach.TOOLS)
    knows = "what these can do"
    plants = ("mujoco",)
    duration = 4.0

    def run(self, parameters: Mapping[str, Any], settings: Settings) -> ScenarioResult:
        aim = _aim(parameters["robot"])
        runs = dict[str, Run]()
        for (name, way), one in trials(settings.progress, WAYS.items()):
            controller = wbc.Controller(
                aim.robot, aim.stack, level=wbc.InverseDynamics(), solver=settings.solver, dt=1e-3
            )
            runs[name] = simulate(
                wbc.Setpoint(controller, feedback=way.feedback), aim.plant(way.drives), duration=settings.duration,
                progress=one, meta={"scenario": self.name, "parameters": dict(parameters)},
            )  # fmt: skip
        return _judged(runs, aim, settings.duration)


@final
class _Aim(NamedTuple):
    """What is to follow which way; ``frame`` None: the centre of mass."""

    robot: PinocchioModel
    stack: wbc.Stack
    path: Trajectory
    frame: str | None
    stance: Stance | None

    def plant(self, drives: PositionDrives | None) -> MujocoPlant:
        """Physics at the start."""
        if self.stance is not None:
            return standing_plant(self.robot, self.stance, self.stack.contacts, drives=drives)
        plant = MujocoPlant(self.robot, drives=drives)
        plant.reset(self.robot.q0)
        return plant

    def errors(self, run: Run) -> Vec:
        """How far the robot itself, not its setpoint, is from the path (N,) [m]."""
        state, rows = self.robot.state(), zip(run["t"], run["plant.q"], run["plant.v"], strict=True)
        errors = np.empty(run.rows)
        for k, (t, q, v) in enumerate(rows):
            state.update(t, q, v)
            place = state.com if self.frame is None else np.array(state.frame(self.frame).position)
            errors[k] = np.linalg.norm(place - self.path(t)[0])
        return errors


def _aim(name: str) -> _Aim:
    if name in STANCES:
        stance = STANCES[name]
        robot = stance.robot(name)
        path = Sinusoid(robot.state().com, amplitude=stance.sway, frequency=stance.frequency)
        return _Aim(robot, standing_stack(robot, stance), path, None, stance)
    robot, tool = wbc.load(name, base="fixed"), arm_reach.TOOLS[name]
    start = np.array(robot.state().frame(tool).position)
    path = Sinusoid(start, amplitude=[0.05, 0.08, 0.05], frequency=[0.5, 0.4, 0.6])
    stack = wbc.Stack(
        [Position(tool, target=path, kp=400), Posture(robot.q0, kp=10, weight=1e-3)],
        subject_to=[JointVelocityLimits(), JointPositionLimits(), TorqueLimits()],
    )
    return _Aim(robot, stack, path, tool, None)


def _judged(runs: Mapping[str, Run], aim: _Aim, duration: float) -> ScenarioResult:
    rms, largest = dict[str, float](), dict[str, float]()
    for name, each in runs.items():
        late = measure.times(each) >= min(SAGGED, 0.5 * duration)
        error = aim.errors(each)[late]
        rms[name] = float(np.sqrt(np.mean(error**2))) if len(error) else np.inf
        largest[name] = float(error.max(initial=0.0))
    asked, run = next(iter(runs.items()))
    stood = {name: measure.seconds(each) for name, each in runs.items()}
    figures = {
        "error_rms_m": rms,
        "error_max_m": largest,
        "stood_s": stood,
        "certified_share": judge.certified_share(run),
    }
    verdict = [
        judge.stood_check(run, duration),
        Check("error of the robot itself, rms", rms[asked], "<", ERROR, "m"),
        *judge.common_checks(run),
    ]
    return judge.result(
        run, verdict, figures=figures, robot=aim.robot, sections=[_comparison],
        called=asked, beside={name: each for name, each in runs.items() if name != asked},
    )  # fmt: skip


def _comparison(result: ScenarioResult) -> Section:
    """What came of each way, as a section of the report."""
    figures, rows = result.figures, list[list[Cell]]()
    for name, stood in figures["stood_s"].items():
        rows.append([name, stood, 1e3 * figures["error_rms_m"][name], 1e3 * figures["error_max_m"][name]])
    text = Text(
        "The same stack on the same robot, and the error of the robot itself. Commanded: the controller decides from "
        "its own last setpoint, and the drives keep to it; what it sends does not depend on the robot. Measured: it "
        "decides from the robot, and each setpoint is one tick from there. Everything else in this report is of the "
        "first line, where the errors of tasks are those of the setpoint."
    )
    columns = ["what is sent", "up [s]", f"error after {SAGGED:g} s, rms [mm]", "largest [mm]"]
    return Section("Drives and feedback", [text, Table(columns, rows)])
