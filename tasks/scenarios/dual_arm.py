"""A standing humanoid holds a rigid bar in both hands, moves it, and squeezes it with a given force."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, ClassVar, final

import numpy as np
import pinocchio as pin

import wbc
from wbc.models.collision import Obstacle
from wbc.models.geometry import Cylinder
from wbc.report import measure
from wbc.report.document import Curve, Plot, Section
from wbc.sim.scenario import Check, Parameter, Parameters, Scenario, ScenarioResult, Setup, Trial
from wbc.types import Vec

from .. import CenterOfMass, ContactForce, Frame, LoopClosure, MinimumJerk, Posture, Sinusoid
from ..criteria.manipulability import ROWS
from ..motions import pose_motion, swing
from . import judge
from .humanoid_stand import STANCES
from .standing import held_by_damping, joint_constraints, standing_plant, upright

#: The hands of each robot, left and right; how they are held, where the robot's own stance leaves them too little room
#: [rad]; and how much the bar moves [m] and turns [rad].
HANDS: Mapping[str, tuple[str, str]] = {
    "g1": ("left_rubber_hand", "right_rubber_hand"),
    "humanoid": ("left_hand", "right_hand"),
}
HELD: Mapping[str, Mapping[str, float]] = {
    "g1": {f"{side}_{joint}": angle
           for side in ("left", "right") for joint, angle in (("elbow_joint", 0.2), ("shoulder_pitch_joint", 0.0))},
    "humanoid": {},
}  # fmt: skip
WAY, FREQUENCY, TURN = (0.02, 0.0, 0.04), 0.4, 0.1
#: The squeeze comes up within ``SQUEEZED`` from ``START`` on [s]; figures count from then.
START, SQUEEZED = 0.5, 1.0
#: What a good run keeps to: the bar from where it is to be [m], the squeeze from what it is to be [N].
BAR, SQUEEZE = 2e-3, 1.0
#: How thick the bar is drawn, where it is to be [m].
RADIUS = 0.012


@final
class DualArm(Scenario):
    """Torque control at 1 kHz in MuJoCo, standing on both feet. The bar is a weld between the hands and weighs nothing.

    ``squeeze`` [N]: how hard the hands press on its ends. ``robot``: g1 (needs example-robot-data) or humanoid.
    """

    name: ClassVar[str] = "dual-arm"
    group: ClassVar[str] = "legs"
    takes = 20.0
    summary: ClassVar[str] = "a humanoid holds a rigid bar in both hands, moves it and squeezes it"
    parameters: ClassVar[Mapping[str, Parameter]] = {"robot": "g1", "squeeze": 15.0}
    robots = HANDS
    knows = "how these hold a bar"
    plants = ("mujoco",)
    duration = 6.0

    def build(self, p: Parameters) -> Setup:
        name, squeeze = p["robot"], p.number("squeeze")
        stance, (left, right) = replace(STANCES[name], joints={**STANCES[name].joints, **HELD[name]}), HANDS[name]
        robot = stance.robot(name)
        bar = LoopClosure(right, to=left, rows=ROWS, kp=100.0, name="bar")
        contacts = [*held_by_damping(robot), bar]
        floor = standing_plant(robot, stance, contacts)
        state = robot.state()
        state.update(0.0, floor.q, floor.v)
        hand = state.frame(left)
        along = hand.rotation.T @ (state.frame(right).position - hand.position)
        length = float(np.linalg.norm(along))
        along /= length
        motion = pose_motion(
            Sinusoid(hand.position, amplitude=WAY, frequency=FREQUENCY),
            swing(np.array(hand.rotation), [0.0, 1.0, 0.0], angle=TURN, frequency=FREQUENCY),
        )
        press = MinimumJerk(np.zeros(6), [*(squeeze * along), 0, 0, 0], duration=SQUEEZED, start_time=START)
        stack = wbc.Stack(
            [
                CenterOfMass(target=np.array(state.com), kp=400, weight=10.0),
                upright(state, stance, weight=10.0),
                Frame(left, target=motion, kp=400, weight=10.0),
                ContactForce("bar", target=press, weight=1.0),
                Posture(robot.q0, kp=100, weight=1e-3),
            ],
            contacts=contacts,
            subject_to=joint_constraints(robot),
        )
        asked = np.array([press(t)[0][:3] for t in floor.dt * np.arange(round(p.settings.duration / floor.dt))])
        middle = pin.SE3(pin.Quaternion.FromTwoVectors(np.eye(3)[2], along).matrix(), 0.5 * length * along)
        drawn = Obstacle("bar", Cylinder(RADIUS, length), lambda t: motion(t)[0] * middle)
        return Setup(stack=stack, plant=floor, about=(asked, drawn))

    def judge(self, trials: Iterator[Trial], p: Parameters) -> ScenarioResult:
        (trial,) = trials
        run, hands = trial.run, HANDS[p["robot"]]
        asked, drawn = trial.about[0][: run.rows], trial.about[1]
        tracking, task = measure.tracking(run), f"Frame[{hands[0]}]"
        bar, way, plot = tracking[task], np.linalg.norm(measure.errors(run, task)["m"], axis=1), f"tracking.{task}"
        error = np.linalg.norm(run["plant.f.bar"] - asked, axis=1)
        figures = {
            "bar_error_m": bar["max"],
            "bar_rms_m": bar["rms"],
            "grip_error_m": _grip_error(run, trial.robot, hands),
            "internal_force_error_N": float(error.max()),
            "internal_force_rms_N": measure.rms(error),
            "com_max_error_m": tracking["CenterOfMass"]["max"],
            "certified_share": judge.certified_share(run),
            "torque_use": float(measure.use(run)["torque"].max()),
        }
        away, squeezed = measure.place(run, way, BAR, plot=plot), measure.place(run, error, SQUEEZE, plot="bar-error")
        checks = [
            judge.stood_check(run, p.settings.duration),
            Check("distance of the bar from its target", bar["max"], "<", BAR, "m", away),
            Check("error of the force in the bar", float(error.max()), "<", SQUEEZE, "N", squeezed),
            *judge.common_checks(run),
        ]
        return judge.verdict(trial, checks, figures=figures, obstacles=[drawn], sections=[_section(run, asked)])


def _section(run: wbc.Run, asked: Vec) -> Section:
    """The force along the bar, as a section of the report."""
    t, size = measure.times(run), float(np.linalg.norm(asked[-1]))
    along = asked[-1] / size if size else np.eye(3)[0]
    error = np.linalg.norm(run["plant.f.bar"] - asked, axis=1)
    forces = (("in physics", run["plant.f.bar"]), ("commanded", run["f.bar"][:, :3]), ("wanted", asked))
    return Section("The bar", [
        Plot("bar-force", "Force along the bar", "N", t, [Curve(label, force @ along) for label, force in forces],
             caption="What the left hand presses on the right through the bar, a weld."),
        Plot("bar-error", "Error of the force", "mN", t, [Curve("in physics minus wanted", 1e3 * error)]),
    ])  # fmt: skip


def _grip_error(run: wbc.Run, robot: Any, hands: tuple[str, str]) -> float:
    """How much nearer or farther from one another the hands ever were than at the start [m]."""
    state, apart = robot.state(), []
    for q in run["plant.q"][::10]:
        state.update(0.0, q, np.zeros(robot.nv))
        first, second = (state.frame(hand).position for hand in hands)
        apart.append(float(np.linalg.norm(second - first)))
    ways: Vec = np.array(apart)
    return float(np.abs(ways - ways[0]).max())
