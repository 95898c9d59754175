"""A quadruped trots in place: two diagonal feet swing, then the other two."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar, NamedTuple, final

import numpy as np

import wbc
from wbc.models.model import RobotState
from wbc.models.pinocchio_ import PinocchioModel
from wbc.report import measure
from wbc.sim.mujoco_ import MujocoPlant
from wbc.sim.scenario import Check, Parameter, Parameters, Scenario, ScenarioResult, Setup, Trial
from wbc.stack.plan_view import PlanView
from wbc.types import Vec

from .. import CenterOfMass, ContactSchedule, MinimumJerk, Piecewise, Position, Posture
from ..trajectories import Trajectory
from . import judge
from .estimated import PARAMETERS, off_estimate, sensing
from .plan_step import PlanStep
from .quadruped_stand import STANCES
from .standing import Stance, held_by_damping, joint_constraints, standing_plant, upright

#: The weight goes over the middle of the feet in ``CENTRED`` s; the first feet swing at ``START``, the last are down
#: ``END`` s before the run ends. A pair is up for ``SWING``, all feet are down for ``STAND`` between [s].
CENTRED, START, END, SWING, STAND = 0.6, 1.0, 0.3, 0.2, 0.2
LIFT = 0.03
#: From this height above where it stood [m] a foot comes down at this speed [m/s], until it is felt. It brakes before:
#: the ground may be that much higher or lower, and the plan with the foot in the air asks for no acceleration that the
#: plan with the foot on the ground does not have.
CLEARANCE, LANDING = 1e-3, 0.05
UP = np.array([0.0, 0.0, 1.0])
#: What a sensor in a foot must feel to say that it touches: a share of the robot's weight.
TOUCH = 0.0125
#: What a good trot keeps to [m].
DRIFT, SLIP = 5e-3, 2e-3


class Swing(NamedTuple):
    """Two feet are up between these times [s]."""

    feet: tuple[str, str]
    lifted: float
    down: float


def swings(feet: Sequence[str], duration: float) -> list[Swing]:
    """The pairs across, in turn, as long as there is time: of front left, front right, rear left, rear right."""
    front_left, front_right, rear_left, rear_right = feet
    pairs = ((front_left, rear_right), (front_right, rear_left))
    count = max(0, int((duration - START - END + STAND + 1e-9) / (SWING + STAND)))
    starts = [START + k * (SWING + STAND) for k in range(count)]
    return [Swing(pairs[k % 2], start, start + SWING) for k, start in enumerate(starts)]


def timeline(feet: Sequence[str], trot: Sequence[Swing]) -> list[tuple[float, list[str]]]:
    """What a contact schedule has to know."""
    entries = [(0.0, list(feet))]
    for swing in trot:
        entries += [(swing.lifted, [foot for foot in feet if foot not in swing.feet]), (swing.down, list(feet))]
    return entries


def swinging(position: Vec, lifted: Sequence[float]) -> Trajectory:
    """Up and down at each of these times, and on into the ground until it is felt; the contact ends that."""
    top, above, half = position + LIFT * UP, position + CLEARANCE * UP, 0.5 * SWING
    braked = half - CLEARANCE / LANDING
    pieces: list[tuple[float, Trajectory]] = [(0.0, MinimumJerk(position, position, duration=START))]
    for t in lifted:
        pieces += [
            (t, MinimumJerk(position, top, duration=half, start_time=t)),
            (t + half, MinimumJerk(top, above, duration=braked, start_time=t + half, end_rate=-LANDING * UP)),
        ]
    return Piecewise(pieces)


@final
class QuadrupedTrotInPlace(Scenario):
    """Torque control at 1 kHz in MuJoCo. On two feet nothing holds a robot up for long: it comes down on the others
    before it has tipped over. A contact is made when a force sensor in the foot feels the ground.

    ``robot``: go2 (needs example-robot-data) or quadruped.
    ``sensors``: a set of ``wbc.robots.SENSORS`` by which the base is estimated, its errors drawn by ``seed``; or truth.
    """

    name: ClassVar[str] = "quadruped-trot-in-place"
    group: ClassVar[str] = "legs"
    takes = 25.0
    summary: ClassVar[str] = "a quadruped lifts two feet across from one another, then the other two, in place"
    parameters: ClassVar[Mapping[str, Parameter]] = {"robot": "go2", **PARAMETERS}
    robots = STANCES
    plants = ("mujoco",)
    duration = 10.0

    def build(self, p: Parameters) -> Setup:
        stance = STANCES[p["robot"]]
        robot = stance.robot(p["robot"])
        floor = standing_plant(robot, stance, held_by_damping(robot))
        trot = swings(list(robot.feet), p.settings.duration)
        return Setup(stack=trotting_stack(robot, stance, floor, trot), plant=floor, disturbances=sensing(p), about=trot)

    def judge(self, trials: Iterator[Trial], p: Parameters) -> ScenarioResult:
        (trial,) = trials
        run, robot, trot = trial.run, trial.robot, trial.about
        t = measure.times(run)
        after = t >= min(START, t[-1])
        tracking = measure.tracking(run, keep=after)
        names = {contact["frame"]: name for name, contact in run.meta["contacts"].items()}
        done = sum(_done(run, swing, names) for swing in trot)
        base = run["plant.q"][:, :2]
        drift = np.where(after, np.linalg.norm(base - base[after][0], axis=1), 0.0)
        steps, smooth = judge.stepping(
            run, robot.mass, timeline(list(names), trot), [swing.down for swing in trot], SLIP
        )
        figures = steps | {
            "steps": done,
            "drift_m": float(drift.max()),
            "com_rms_m": tracking["CenterOfMass"]["rms"],
            "tilt_max_rad": next(value["max"] for name, value in tracking.items() if name.startswith("Orientation")),
            **off_estimate(trial, p),
        }
        checks = [
            judge.stood_check(run, p.settings.duration),
            Check("pairs of feet up and down again", done, "=", len(trot), ""),
            Check("drift of the base", float(drift.max()), "<", DRIFT, "m", measure.place(run, drift, DRIFT)),
            *smooth,
            *judge.common_checks(run),
        ]
        return judge.verdict(trial, checks, tracking=tracking, figures=figures)


@final
class Landed(wbc.Component):
    """Feet that were felt stay where they stand: their targets (3,) [m], by foot, go down no further.

    From the tick after that in which a contact is made, in which the plans before and after ask for the same.
    """

    def __init__(self, places: Mapping[str, Vec]) -> None:
        super().__init__()
        self._places = dict(places)

    def reset(self, state: RobotState) -> None:
        self._stood, self._stands, self._said = frozenset[str](), frozenset[str](), wbc.Overrides()

    def before(self, state: RobotState, last: object, plan: PlanView) -> wbc.Overrides:
        now = frozenset(contact.frame for contact in plan.stack.contacts)
        stood, self._stands = self._stands & now, now
        if stood != self._stood:
            self._stood = stood
            self._said = wbc.Overrides(tasks={f"Position[{foot}]": {"target": self._places[foot]} for foot in stood})
        return self._said


def trotting_stack(robot: PinocchioModel, stance: Stance, plant: MujocoPlant, trot: Sequence[Swing]) -> wbc.Stack:
    """Weight in the middle of the feet, upright, feet up and down; contacts by the plant's force sensors."""
    state: RobotState = robot.state()
    state.update(0.0, plant.q, plant.v)
    places = {foot: np.array(state.frame(foot).position) for foot in robot.feet}
    middle = np.mean(list(places.values()), axis=0)
    touch = TOUCH * 9.81 * robot.mass
    return wbc.Stack(
        [
            CenterOfMass(target=MinimumJerk(state.com, [*middle[:2], state.com[2]], duration=CENTRED), kp=100),
            upright(state, stance),
            *(
                Position(foot, target=swinging(place, [s.lifted for s in trot if foot in s.feet]), kp=100, weight=10.0)
                for foot, place in places.items()
            ),
            Posture(robot.q0, kp=100, weight=1e-4),
        ],
        contacts=held_by_damping(robot),
        subject_to=joint_constraints(robot),
        components=[
            ContactSchedule(timeline(list(places), trot), touching=lambda foot: plant.wrenches()[foot][2] > touch),
            Landed(places),
            PlanStep(),
        ],
    )


def _done(run: wbc.Run, swing: Swing, names: Mapping[str, str]) -> bool:
    """Whether both feet were off the ground in the middle of their swing and carry before the next begins."""
    middle, next_one = (
        round(t / float(run.meta["dt"])) for t in (swing.lifted + 0.5 * SWING, swing.down + STAND - 0.01)
    )
    if next_one >= run.rows:
        return False
    loads = [run[f"plant.f.{names[foot]}"][:, 2] for foot in swing.feet]
    return all(load[middle] == 0.0 and load[next_one] > 0.0 for load in loads)
