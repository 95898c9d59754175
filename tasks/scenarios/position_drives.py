"""Position drives: the same stack with measured and commanded feedback, beside torque control."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, ClassVar, NamedTuple, final

import numpy as np

import wbc
from wbc.report import measure
from wbc.report.document import Section, Table, Text
from wbc.sim.drives import PositionDrives
from wbc.sim.mujoco_ import MujocoPlant
from wbc.sim.plant import Plant
from wbc.sim.scenario import Check, Parameter, Parameters, Scenario, ScenarioResult, Setup, Trial
from wbc.types import Vec

from . import arm_reach, judge
from .stand_family import STANCES
from .standing import standing_plant, standing_stack, sway

#: The error counts from here on [s]: drives that are sent no torques sag first.
SAGGED = 0.5
#: What commanded positions with torques keep to, rms [m].
ERROR = 5e-3


class DriveMode(NamedTuple):
    """The state that the controller decides from (measured or commanded), and the drives; None for torques."""

    feedback: str
    drives: PositionDrives | None


#: The first is the one that is recorded and judged.
DRIVE_MODES: Mapping[str, DriveMode] = {
    "commanded, with torques": DriveMode("commanded", PositionDrives()),
    "commanded, positions alone": DriveMode("commanded", PositionDrives(feed_forward=False)),
    "measured, with torques": DriveMode("measured", PositionDrives()),
    "torques alone": DriveMode("measured", None),
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

    def cases(self, p: Parameters) -> dict[str, dict[str, Any]]:
        return {name: {"mode": mode} for name, mode in DRIVE_MODES.items()}

    def build(self, p: Parameters) -> Setup:
        name, mode = p["robot"], p["mode"]
        if name in STANCES:
            stance = STANCES[name]
            robot = stance.robot(name)
            stack, path = standing_stack(robot, stance), sway(robot.state(), stance)
            plant: Plant = standing_plant(robot, stance, stack.contacts, drives=mode.drives)
        else:
            robot = wbc.load(name, base="fixed")
            stack, path = arm_reach.following(robot), arm_reach.way(robot)
            plant = MujocoPlant(robot, drives=mode.drives)
        return Setup(stack=stack, plant=plant, feedback=mode.feedback, about=path)

    def judge(self, trials: Iterator[Trial], p: Parameters) -> ScenarioResult:
        done, rms, largest = list(trials), dict[str, float](), dict[str, float]()
        for trial in done:
            late = measure.times(trial.run) >= min(SAGGED, 0.5 * p.settings.duration)
            error = _error(trial)[late]
            rms[trial.name] = measure.rms(error) if len(error) else np.inf
            largest[trial.name] = float(error.max(initial=0.0))
        run, stood = done[0].run, {trial.name: measure.seconds(trial.run) for trial in done}
        figures = {
            "error_rms_m": rms,
            "error_max_m": largest,
            "stood_s": stood,
            "certified_share": judge.certified_share(run),
        }
        checks = [
            judge.stood_check(run, p.settings.duration),
            Check("error of the robot itself, rms", rms[done[0].name], "<", ERROR, "m"),
            *judge.common_checks(run),
        ]
        rows = [(name, stood[name], 1e3 * rms[name], 1e3 * largest[name]) for name in stood]
        columns = ["what is sent", "up [s]", f"error after {SAGGED:g} s, rms [mm]", "largest [mm]"]
        text = Text(
            "The same stack on the same robot, and the error of the robot itself. Commanded: the controller decides "
            "from its own last setpoint, and the drives keep to it; what it sends does not depend on the robot. "
            "Measured: it decides from the robot, and each setpoint is one tick from there. Everything else in this "
            "report is of the first line, where the errors of tasks are those of the setpoint."
        )
        section = Section("Drives and feedback", [text, Table(columns, rows)])
        return judge.verdict(done, checks, figures=figures, sections=[section])


def _error(trial: Trial) -> Vec:
    """How far the robot itself, not its setpoint, is from the path (N,) [m]."""
    run, state, path = trial.run, trial.robot.state(), trial.about
    errors = np.empty(run.rows)
    for k, (t, q, v) in enumerate(zip(run["t"], run["plant.q"], run["plant.v"], strict=True)):
        state.update(t, q, v)
        place = state.com if trial.robot.nb else np.array(state.frame(arm_reach.tool(trial.robot)).position)
        errors[k] = np.linalg.norm(place - path(t)[0])
    return errors
