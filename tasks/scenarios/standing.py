"""Standing on legs in physics: a stack for any robot with feet, and what it is judged by."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, final

import numpy as np

import wbc
from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.model import RobotState
from wbc.models.pinocchio_ import PinocchioModel
from wbc.report import measure
from wbc.sim.disturbance import Push
from wbc.sim.drives import PositionDrives
from wbc.sim.mujoco_ import MujocoPlant
from wbc.sim.scenario import Check, Parameters, Scenario, ScenarioResult, Setup, Trial
from wbc.stack.constraint import Constraint
from wbc.stack.contact import Contact

from .. import (
    CenterOfMass,
    JointPositionLimits,
    JointVelocityLimits,
    Orientation,
    Position,
    Posture,
    Sinusoid,
    Sole,
    TorqueLimits,
    feet,
)
from . import judge
from .estimated import off_estimate, sensing

#: What the controller keeps in hand for what it does not know of: of the floor's friction, of the joints' speed, of
#: their range [rad]. A push of 120 N throws a head by half a radian per second before any motor can answer.
FRICTION_SHARE, SPEED_SHARE, POSITION_MARGIN = 0.8, 0.8, 0.03
#: Time given to recover from a push, whose errors do not count [s].
RECOVERY = 1.0
#: Deceleration that every joint of these robots has torque for [rad/s²].
BRAKING = 40.0


@final
@dataclass(frozen=True)
class Stance:
    """What standing needs to know of a robot.

    ``upright`` the frame to keep upright, and that is pushed; ``sway`` amplitude [m] and ``frequency`` [Hz] of the
    centre of mass; ``hand`` the frame that draws a circle of ``radius`` [m]; ``joints`` positions other than the
    robot's own reference [rad]; ``geometry`` of the soles in physics. ``begun``: the sway starts with the phase that it
    has after so many seconds [s].
    """

    upright: str
    sway: tuple[float, float, float]
    frequency: tuple[float, float, float]
    hand: str | None = None
    radius: float = 0.05
    joints: Mapping[str, float] = field(default_factory=dict)
    geometry: str = "box"
    begun: float = 0.0

    def robot(self, name: str) -> PinocchioModel:
        """The robot with this stance as its reference configuration."""
        robot = wbc.load(name, base="floating")
        reference = dict(zip(robot.joint_names, robot.q0[-robot.nj :].tolist(), strict=True))
        standing: PinocchioModel = robot.replace(q0=robot.configuration(reference | dict(self.joints)))
        return standing


@final
@dataclass(frozen=True)
class Demand:
    """What a run must reach to be called good: CoM error away from pushes, rms [m]; true slip of the feet [m]."""

    com_rms: float
    slip: float


def true_surfaces(robot: PinocchioModel) -> list[Contact]:
    """The feet as physics has them: all the friction, and all the area where a foot stands on balls.

    Their cones are around the circular ones of physics.
    """
    surfaces = feet(robot, friction_share=1.0, friction_model="outer")
    for i, foot in enumerate(robot.feet.values()):
        if foot.half_size is not None and foot.balls:
            reach = np.abs(np.array(foot.balls) - foot.origin).max(axis=0)
            surfaces[i] = Sole(
                foot.frame, half_size=reach[:2], origin=foot.origin, friction=foot.friction, friction_model="outer"
            )
    return surfaces


def held_by_damping(robot: PinocchioModel) -> list[Contact]:
    """Feet that are not pulled back to where they were: the floor has no position to go back to."""
    return feet(robot, friction_share=FRICTION_SHARE, kp=0.0, kd=20.0)


def joint_constraints(robot: PinocchioModel) -> list[Constraint]:
    """Torque, speed and range of the joints, with what is kept in hand of each; the reference is always allowed."""
    limits, q_start = robot.limits, robot.q0[-robot.nj :]
    return [
        TorqueLimits(),
        JointVelocityLimits(SPEED_SHARE * limits.v_max),
        JointPositionLimits(
            lower=np.minimum(limits.q_min + POSITION_MARGIN, q_start),
            upper=np.maximum(limits.q_max - POSITION_MARGIN, q_start),
            braking=BRAKING,
        ),
    ]


def standing_plant(
    robot: PinocchioModel, stance: Stance, contacts: Sequence[Contact], *, drives: PositionDrives | None = None
) -> MujocoPlant:
    """Physics with the robot standing at rest on its feet, in its reference configuration."""
    friction = max(foot.friction for foot in robot.feet.values())
    plant = MujocoPlant(robot, contacts=contacts, friction=friction, sole_geometry=stance.geometry, drives=drives)
    plant.reset(plant.settled(robot.q0))
    return plant


def standing_stack(robot: PinocchioModel, stance: Stance) -> wbc.Stack:
    """Sway the centre of mass, keep upright, draw a circle with a hand, stay near the stance; within all limits."""
    state = robot.state()
    tasks: list[Any] = [
        CenterOfMass(target=sway(state, stance), kp=400),
        upright(state, stance),
        Posture(robot.q0, kp=100, weight=1e-4),
    ]
    if stance.hand is not None:
        circle = Sinusoid(
            state.frame(stance.hand).position,
            amplitude=[0.0, stance.radius, stance.radius], frequency=0.4, phase=[0.0, 0.0, np.pi / 2],
        )  # fmt: skip
        tasks.append(Position(stance.hand, target=circle, kp=100))
    return wbc.Stack(
        tasks,
        contacts=held_by_damping(robot),
        subject_to=joint_constraints(robot),
    )


def upright(state: RobotState, stance: Stance, weight: float = 1.0) -> Orientation:
    """Keep the frame that the stance keeps upright as it is."""
    return Orientation(stance.upright, target=np.array(state.frame(stance.upright).rotation), kp=100, weight=weight)


def sway(state: RobotState, stance: Stance) -> Sinusoid:
    """What the centre of mass follows, about where it is."""
    phase = 2.0 * np.pi * stance.begun * np.array(stance.frequency)
    return Sinusoid(state.com, amplitude=stance.sway, frequency=stance.frequency, phase=phase)


def usual_or(name: str, text: str, usual: float) -> float:
    """A parameter >= 0 that is a number, or "auto" for what is ``usual`` for the robot.

    Raises:
        InvalidInput: neither.
    """
    if text == "auto":
        return usual
    try:
        return checks.typed(f"parameter {name!r}", text, low=0.0)
    except InvalidInput as refusal:
        raise InvalidInput(f"{refusal}, or auto for what is usual for the robot") from None


def pushes_within(duration: float, frame: str, force: float) -> list[Push]:
    """Sideways at 1.5 s, forward at 6 s, 0.2 s each: those that are over, and seen to be survived, in time."""
    if force == 0.0:
        return []
    pushes = [
        Push(frame, force=(0.0, force, 0.0), start=1.5, duration=0.2),
        Push(frame, force=(force, 0.0, 0.0), start=6.0, duration=0.2),
    ]
    return [push for push in pushes if push.start + RECOVERY <= duration]


class StandingScenario(Scenario):
    """The standing stack by torque control at 1 kHz in MuJoCo, under pushes of ``push`` [N], and what it is judged by.

    ``stances`` by robot, ``demands`` of each, and the push that is usual for it [N].
    """

    group: ClassVar[str] = "legs"
    plants = ("mujoco",)
    duration = 10.0
    stances: ClassVar[Mapping[str, Stance]]
    demands: ClassVar[Mapping[str, Demand]]
    usual_push: ClassVar[Mapping[str, float]] = {}

    def build(self, p: Parameters) -> Setup:
        stance = self.stances[p["robot"]]
        robot, force = stance.robot(p["robot"]), p["push"]
        if isinstance(self.parameters["push"], str):
            force = usual_or("push", force, self.usual_push[p["robot"]])
        stack, pushes = standing_stack(robot, stance), pushes_within(p.settings.duration, stance.upright, force)
        return Setup(
            stack=stack, plant=standing_plant(robot, stance, stack.contacts),
            disturbances=[*pushes, *sensing(p)], meta={"parameters": {**p, "push": force}}, about=pushes,
        )  # fmt: skip

    def judge(self, trials: Iterator[Trial], p: Parameters) -> ScenarioResult:
        (trial,) = trials
        run, robot, pushes, demand = trial.run, trial.robot, trial.about, self.demands[p["robot"]]
        keep = judge.away_from(run["t"], [push.start for push in pushes], after=RECOVERY)
        most = 1e-3 * 9.81 * robot.mass  # soft contacts keep their cones to a thousandth of what they carry
        through = f" through pushes: {len(pushes)}" if pushes else ""
        wrenches = judge.cone_excess(run, true_surfaces(robot))
        outside, contacts = float(wrenches.max(initial=0.0)), feet(robot)
        steady = judge.error_check("CoM error away from pushes, rms", run, "CenterOfMass", demand.com_rms, keep)
        slip = judge.slip_check("true slip of the feet", run, judge.slid(run, contacts), demand.slip)
        figures = {
            "stood_s": measure.seconds(run),
            "com_rms_m": steady.value,
            "com_max_with_pushes_m": float(trial.error("CenterOfMass").max()),
            "slip_m": slip.value,
            "certified_share": judge.certified_share(run),
            "cone_excess_N": outside,
            "torque_use": float(measure.use(run)["torque"].max()),
        }
        checks = [
            judge.stood_check(run, p.settings.duration, through=through),
            steady,
            slip,
            Check(
                "net wrench of a foot outside its cone (bound: 0.1 % of the weight)", outside, "<=", most, "N",
                measure.place(run, wrenches, most, [contact.name for contact in contacts], "forces"),
            ),
            *judge.common_checks(run),
        ]  # fmt: skip
        tracking = measure.tracking(run, keep=keep)
        return judge.verdict(trial, checks, tracking=tracking, figures=figures | off_estimate(trial, p))
