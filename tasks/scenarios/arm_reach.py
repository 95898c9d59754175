"""An arm follows a moving pose whose target jumps farther than its joints can move in a tick."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar, final

import numpy as np
import pinocchio

import wbc
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel
from wbc.models.pinocchio_ import PinocchioModel
from wbc.report import measure
from wbc.sim.mujoco_ import MujocoPlant
from wbc.sim.plant import IntegratorPlant, Plant
from wbc.sim.scenario import Check, Parameter, Parameters, Scenario, ScenarioResult, Setup, Trial
from wbc.stack.formulation import Formulation

from .. import Frame, JointPositionLimits, JointVelocityLimits, Position, Posture, Sinusoid, TorqueLimits
from . import judge

STEP_TIME = 1.5  # [s]
TOOLS: Mapping[str, str] = {"panda": "panda_hand_tcp", "arm": "tool"}


@final
class ArmReach(Scenario):
    """The tool follows a sinusoid; at 1.5 s the target jumps by ``step`` [m] along y and the joints run into their
    speed limits until they have caught up.

    ``level``: velocity (joint speeds are the command, on the integrator) or dynamics (torques; on the integrator or in
    MuJoCo). ``robot``: panda (needs example-robot-data) or arm. ``frame``: what follows, or auto for the robot's tool.
    """

    name: ClassVar[str] = "arm-reach"
    group: ClassVar[str] = "arms"
    takes = 8.0
    summary: ClassVar[str] = "an arm follows a moving pose through a step beyond its speed limits"
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "robot": "panda",
        "level": "velocity",
        "step": 0.25,
        "frame": "auto",
    }
    plants = ("integrator", "mujoco")
    duration = 4.0

    def build(self, p: Parameters) -> Setup:
        p.lasts_beyond(STEP_TIME + 1.0, f"the step comes at {STEP_TIME:g} s")
        robot = wbc.load(p["robot"], base="fixed")
        level = _level(p["level"], p.settings.plant)
        frame = tool(robot, "say --set frame=NAME") if p["frame"] in ("", "auto") else p["frame"]
        plant = arm_plant(robot, p.settings.plant, level="velocity" if level.order == 1 else "acceleration")
        return Setup(stack=_stack(robot, frame, p["step"], level), plant=plant, level=level)

    def judge(self, trials: Iterator[Trial], p: Parameters) -> ScenarioResult:
        (trial,) = trials
        run, task = trial.run, trial.setup.stack.tasks[0].name
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
        behind = np.where(caught_up, error, 0.0)
        where = measure.place(run, behind, np.inf, [task], plot=f"tracking.{task}")
        checks = [
            Check("position error after catching up, rms", tracking[task]["rms"], "<", 2e-3, "m", where),
            *judge.common_checks(run),
        ]
        return judge.verdict(trial, checks, tracking=tracking, figures=figures)


def tool(robot: RobotModel, otherwise: str = "take an arm that has one") -> str:
    """The frame of an arm that works: known by its name, or the farthest on the one link that no joint moves further.

    Raises:
        InvalidInput: there are several such links; the sentence says what to do ``otherwise``.
    """
    named = TOOLS.get(robot.name.lower(), "")
    if named in robot.frame_names:
        return named
    ends = _ends(robot)
    if len(ends) > 1:
        raise InvalidInput(
            f"the robot {robot.name!r} has {len(ends)} ends, such as {', '.join(ends[:4])}, and none is known to be "
            f"its tool; {otherwise}"
        )
    return ends[0]


def _ends(robot: RobotModel) -> list[str]:
    """The farthest frame on each link that no joint moves further, those behind most joints first."""
    model, found = robot.pinocchio, dict[int, tuple[float, str]]()
    for name, index in robot.frames.items():
        frame = model.frames[index]
        far = round(float(np.linalg.norm(frame.placement.translation)), 9)
        if not len(model.children[frame.parentJoint]) and far > found.get(frame.parentJoint, (-1.0,))[0]:
            found[frame.parentJoint] = far, name
    return [found[joint][1] for joint in sorted(found, key=lambda joint: -len(model.supports[joint]))]


def following(robot: RobotModel, components: Sequence[Any] = ()) -> wbc.Stack:
    """The tool follows a sinusoid, within all limits of an arm that has torques."""
    return wbc.Stack(
        [Position(tool(robot), target=way(robot), kp=400), Posture(robot.q0, kp=10, weight=1e-3)],
        subject_to=[TorqueLimits(), JointVelocityLimits(), JointPositionLimits()], components=components,
    )  # fmt: skip


def way(robot: RobotModel) -> Sinusoid:
    """What the tool follows then."""
    start = np.array(robot.state().frame(tool(robot)).position)
    return Sinusoid(start, amplitude=[0.05, 0.08, 0.05], frequency=[0.5, 0.4, 0.6])


def arm_plant(robot: RobotModel, kind: str = "mujoco", *, level: str = "acceleration") -> Plant:
    """An arm at its reference, in MuJoCo or on the integrator at a ``level``."""
    plant: Plant = MujocoPlant(robot) if kind == "mujoco" else IntegratorPlant(robot, level=level)
    return plant


def _level(name: str, plant: str) -> Formulation:
    levels: dict[str, Formulation] = {"velocity": wbc.VelocityLevel(), "dynamics": wbc.InverseDynamics()}
    if name not in levels:
        raise InvalidInput(f"level is {name!r}; it must be velocity or dynamics")
    if name == "velocity" and plant == "mujoco":
        raise InvalidInput("the velocity level commands speeds and MuJoCo's motors take torques; use level=dynamics")
    return levels[name]


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
