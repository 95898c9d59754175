"""An arm follows a pose that moves, and steps further than its joints can go in a tick."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, final

import numpy as np
import pinocchio

import wbc
from wbc.errors import InvalidInput
from wbc.models.pinocchio_ import PinocchioModel
from wbc.report import measure
from wbc.sim.mujoco_ import MujocoPlant
from wbc.sim.plant import IntegratorPlant, Plant
from wbc.sim.scenario import Check, Parameter, Scenario, ScenarioResult, Settings
from wbc.sim.simulate import simulate
from wbc.stack.formulation import Formulation

from .. import Frame, JointPositionLimits, JointVelocityLimits, Posture, Sinusoid, TorqueLimits
from . import judge

STEP_TIME = 1.5  # [s]
TOOLS: Mapping[str, str] = {"panda": "panda_hand_tcp", "arm": "tool"}


@final
class ArmReach(Scenario):
    """The tool follows a sinusoid; at 1.5 s the target jumps by ``step`` [m] along y and the joints run into their
    speed limits until they have caught up.

    ``level``: velocity (joint speeds are the command, on the integrator) or dynamics (torques; on the integrator or in
    MuJoCo). ``robot``: panda (needs example-robot-data) or arm. ``frame``: what follows, by default the robot's tool.
    """

    name: ClassVar[str] = "arm-reach"
    group: ClassVar[str] = "arms"
    takes = 8.0
    summary: ClassVar[str] = "an arm follows a moving pose through a step beyond its speed limits"
    parameters: ClassVar[Mapping[str, Parameter]] = {"robot": "panda", "level": "velocity", "step": 0.25, "frame": ""}
    plants = ("integrator", "mujoco")
    duration = 4.0

    def run(self, parameters: Mapping[str, Any], settings: Settings) -> ScenarioResult:
        if settings.duration <= STEP_TIME + 1.0:
            raise InvalidInput(
                f"duration is {settings.duration:g} s; the target steps at {STEP_TIME:g} s: give at least 1 s more"
            )
        robot = wbc.load(parameters["robot"], base="fixed")
        frame = parameters["frame"] or TOOLS.get(parameters["robot"], robot.frame_names[-1])
        level = _level(parameters["level"], settings.plant)
        stack = _stack(robot, frame, parameters["step"], level)
        controller = wbc.Controller(robot, stack, level=level, solver=settings.solver, dt=1e-3)
        run = simulate(
            controller, _plant(robot, settings.plant, level), duration=settings.duration, progress=settings.progress,
            meta={"scenario": self.name, "parameters": dict(parameters)},
        )  # fmt: skip
        return _judged(run, robot, stack.tasks[0].name)


def _level(name: str, plant: str) -> Formulation:
    levels: dict[str, Formulation] = {"velocity": wbc.VelocityLevel(), "dynamics": wbc.InverseDynamics()}
    if name not in levels:
        raise InvalidInput(f"level is {name!r}; it must be velocity or dynamics")
    if name == "velocity" and plant == "mujoco":
        raise InvalidInput("the velocity level commands speeds and MuJoCo's motors take torques; use level=dynamics")
    return levels[name]


def _plant(robot: PinocchioModel, kind: str, level: Formulation) -> Plant:
    if kind == "mujoco":
        plant: Plant = MujocoPlant(robot)
    else:
        plant = IntegratorPlant(robot, level="velocity" if level.order == 1 else "acceleration")
    plant.reset(robot.q0)
    return plant


def _stack(robot: PinocchioModel, frame: str, step: float, level: Formulation) -> wbc.Stack:
    start = robot.state().frame(frame).placement.copy()
    path = Sinusoid(start.translation, amplitude=[0.06, 0.10, 0.08], frequency=[0.5, 0.4, 0.6])

    def target(t: float) -> tuple[pinocchio.SE3, Any, Any]:
        position, rate, acceleration = path(t)
        if t >= STEP_TIME:
            position = position + np.array([0.0, step, 0.0])
        still = np.zeros(3)
        return pinocchio.SE3(start.rotation, position), np.r_[rate, still], np.r_[acceleration, still]

    limits: list[Any] = [JointVelocityLimits(), JointPositionLimits()]
    if level.dynamics:
        limits.append(TorqueLimits())
    return wbc.Stack(
        [Frame(frame, target=target, kp=400, rate=100), Posture(robot.q0, kp=10, weight=1e-3)], subject_to=limits
    )


def _judged(run: wbc.Run, robot: PinocchioModel, task: str) -> ScenarioResult:
    t = run["t"]
    caught_up = judge.away_from(t, [0.0, STEP_TIME])
    tracking = measure.tracking(run, keep=caught_up)
    error = np.linalg.norm(run[f"error.{task}"][:, :3], axis=1)
    late = np.flatnonzero((t >= STEP_TIME) & (error > 0.01))
    figures = {
        "certified_share": judge.certified_share(run),
        "speed_use": float(measure.use(run)["velocity"].max()),
        "catch_up_s": float(t[late[-1]] - STEP_TIME) if len(late) else 0.0,
    }
    where = measure.place(run, np.where(caught_up, error, 0.0), np.inf, plot=f"tracking.{task}")
    verdict = [
        Check("position error after catching up, rms", tracking[task]["rms"], "<", 2e-3, "m", where),
        *judge.common_checks(run),
    ]
    return judge.result(run, verdict, tracking=tracking, figures=figures, robot=robot)
