"""A humanoid takes ten steps, one after the other: shift the weight, lift a foot, place it ahead."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import ClassVar, final

import numpy as np

import wbc
from wbc.errors import InvalidInput
from wbc.models.model import RobotState
from wbc.models.pinocchio_ import PinocchioModel
from wbc.report import measure
from wbc.sim.scenario import Check, Parameter, Parameters, Scenario, ScenarioResult, Setup, Trial
from wbc.stack.contact import Contact

from .. import CenterOfMass, ContactSchedule, Frame, Posture
from . import judge
from .estimated import PARAMETERS, off_estimate, sensing
from .humanoid_stand import STANCES
from .plan_step import PlanStep
from .standing import Stance, held_by_damping, joint_constraints, standing_plant, upright
from .walking import Footstep, Gait, Walk, walk

GAITS: Mapping[str, Gait] = {
    "talos": Gait(length=0.10, lift=0.05, shift=1.2, swing=1.0, inset=0.015),
    "g1": Gait(length=0.05, lift=0.03, shift=1.6, swing=0.8, inset=0.0),
    "humanoid": Gait(length=0.08, lift=0.04, shift=1.2, swing=0.8, inset=0.01),
}
#: The feet in the order of the robots' catalogue.
FEET = ("left", "right")
#: What a good walk keeps to: CoM error, rms [m]; placement and slip of a foot [m].
COM_RMS, PLACEMENT, SLIP = 2e-3, 1e-3, 2e-3
#: How long after it is down a foot's place is looked at [s].
PLACED = 0.1


@final
class HumanoidStep(Scenario):
    """Torque control at 1 kHz in MuJoCo; everything planned ahead as functions of time, no sensor in the feet.

    ``robot``: talos, g1 (both need example-robot-data) or humanoid. ``steps``: how many. ``length`` of a step [m]; 0:
    the robot's usual one (0.10, 0.05, 0.08). ``first``: the foot that takes the first step, left or right.
    ``sensors``: a set of ``wbc.robots.SENSORS`` by which the base is estimated, its errors drawn by ``seed``; or truth.
    """

    name: ClassVar[str] = "humanoid-step"
    group: ClassVar[str] = "legs"
    takes = 60.0
    summary: ClassVar[str] = "a humanoid takes ten steps: shift the weight, lift a foot, place it ahead"
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "robot": "talos", "steps": 10, "length": 0.0, "first": "left", **PARAMETERS,
    }  # fmt: skip
    robots = GAITS
    knows = "how these walk"
    plants = ("mujoco",)
    duration = 30.0

    def build(self, p: Parameters) -> Setup:
        name, steps = p["robot"], p.count("steps")
        length = p.number("length") or GAITS[name].length
        if p["first"] not in FEET:
            raise InvalidInput(f"parameter 'first' is {p['first']!r}; it must be left or right")
        stance = STANCES[name]
        robot = stance.robot(name)
        contacts = held_by_damping(robot)
        floor = standing_plant(robot, stance, contacts)
        state = robot.state()
        state.update(0.0, floor.q, floor.v)
        way = walk(state, robot.feet, replace(GAITS[name], length=length), steps, first=FEET.index(p["first"]))
        return Setup(
            stack=walking_stack(state, stance, way, contacts), plant=floor, disturbances=sensing(p),
            meta={"parameters": {**p, "length": length}}, about=way,
        )  # fmt: skip

    def judge(self, trials: Iterator[Trial], p: Parameters) -> ScenarioResult:
        (trial,) = trials
        run, robot, way, duration = trial.run, trial.robot, trial.about, p.settings.duration
        stood, com = measure.seconds(run), measure.tracking(run)["CenterOfMass"]
        asked = [step for step in way.steps if step.down + PLACED < duration]
        misses = [_miss(run, robot, step) for step in asked if step.down + PLACED < stood]
        placement = max(misses, default=0.0)
        taken = sum(miss <= PLACEMENT for miss in misses)
        steps, smooth = judge.stepping(run, robot.mass, way.timeline, [step.down for step in way.steps], SLIP)
        figures = steps | {
            "steps": taken,
            "com_rms_m": com["rms"],
            "com_max_error_m": com["max"],
            "placement_m": placement,
            "torque_use": float(measure.use(run)["torque"].max()),
            **off_estimate(trial, p),
        }
        checks = [
            judge.stood_check(run, duration),
            Check("steps taken", taken, "=", len(asked), ""),
            judge.error_check("CoM error, rms", run, "CenterOfMass", COM_RMS, np.ones(run.rows, dtype=bool)),
            Check("placement of a foot", placement, "<", PLACEMENT, "m"),
            *smooth,
            *judge.common_checks(run),
        ]
        return judge.verdict(trial, checks, figures=figures)


def walking_stack(state: RobotState, stance: Stance, way: Walk, contacts: Sequence[Contact]) -> wbc.Stack:
    """Weight, feet and posture along the way, the upper body as it is in ``state``; within all limits.

    The foot that stands has its task too: its contact decides, and nobody need switch.
    """
    robot = state.model
    assert isinstance(robot, PinocchioModel), "scenarios load their robots from URDF"
    return wbc.Stack(
        [
            CenterOfMass(target=way.com, kp=100),
            upright(state, stance),
            *(Frame(frame, target=motion, kp=100, weight=10.0) for frame, motion in way.feet.items()),
            Posture(robot.q0, kp=100, weight=1e-4),
        ],
        contacts=contacts,
        subject_to=joint_constraints(robot),
        components=[ContactSchedule(way.timeline, standing_rate=judge.FORCE_STEP), PlanStep()],
    )


def _miss(run: wbc.Run, robot: PinocchioModel, step: Footstep) -> float:
    """How far from where it was to go a foot stands, seen from above [m]; inf where it does not carry."""
    row, state = measure.row(run, step.down + PLACED), robot.state()
    state.update(0.0, run["plant.q"][row], run["plant.v"][row])
    name = next(name for name, contact in run.meta["contacts"].items() if contact["frame"] == step.frame)
    carries = run[f"plant.f.{name}"][row, 2] > 0.0
    return float(np.linalg.norm((state.frame(step.frame).position - step.position)[:2])) if carries else np.inf
