"""An arm reaches through a post and past a swinging ball, with and without collision avoidance."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, final

import numpy as np
import pinocchio

import wbc
from wbc.errors import InvalidInput
from wbc.models.collision import Distances
from wbc.models.geometry import Cylinder, Sphere
from wbc.models.pinocchio_ import PinocchioModel
from wbc.report.document import Bound, Curve, Plot, Section, Table, Text
from wbc.sim.scenario import Check, Parameter, Parameters, Place, Scenario, ScenarioResult, Setup, Trial
from wbc.types import Vec

from .. import CollisionAvoidance, JointLimits, Obstacle, Position, Posture
from . import judge
from .arm_reach import arm_plant

#: From here to there and back, in so many seconds [m, s]. The post stands between.
HERE, THERE, PERIOD = (0.55, 0.0, 0.42), (0.33, 0.45, 0.42), 8.0
POST_AT, POST_RADIUS, POST_LENGTH = (0.40, 0.25, 0.30), 0.04, 0.6
#: The ball swings across behind the hand, and would meet the forearm on its way.
BALL_RADIUS, BALL_PERIOD = 0.06, 5.0
#: So that no torque jumps where a joint meets its speed limit [rad/s², rad/s³].
A_MAX, J_MAX = 40.0, 4000.0
#: Every so many ticks all distances are measured.
EVERY = 4
#: Distances above this [m] are not told apart.
FAR = 0.3


@final
@dataclass(frozen=True, eq=False)
class Clearance:
    """The smallest distance of all pairs (k,) [m] at times (k,) [s], and which pair had it."""

    times: Vec
    distances: Vec
    pairs: Sequence[tuple[str, str]]

    @property
    def smallest(self) -> float:
        """Over the whole run [m]."""
        return float(self.distances.min())

    @property
    def closest(self) -> str:
        """The pair that came nearest."""
        return " and ".join(self.pairs[int(np.argmin(self.distances))])

    @property
    def place(self) -> Place:
        """When they came nearest, and the plot that shows it."""
        return Place(float(self.times[int(np.argmin(self.distances))]), self.closest, "distance")


@final
class CollisionDodge(Scenario):
    """The tool is to move through a post and back while a ball swings across the arm; run twice, the same gains and
    limits, with and without ``CollisionAvoidance``.

    The obstacles are not in the physics: what is touched is not felt, so that the run without shows how deep the task
    leads. Distances are those of the robot that physics moved, of all pairs of shapes and not only of those that had a
    row. ``margin`` [m] is what is to be kept; ``robot`` an arm whose tool is ``frame``.
    """

    name: ClassVar[str] = "collision-dodge"
    group: ClassVar[str] = "arms"
    takes = 25.0
    summary: ClassVar[str] = "an arm keeps away from a post, a swinging ball and itself, where its task leads through"
    parameters: ClassVar[Mapping[str, Parameter]] = {"robot": "arm", "frame": "tool", "margin": 0.02}
    plants = ("mujoco", "integrator")
    duration = 8.0

    def cases(self, p: Parameters) -> dict[str, dict[str, Any]]:
        return {"with collision avoidance": {"avoids": True}, "without": {"avoids": False}}

    def build(self, p: Parameters) -> Setup:
        robot, margin = wbc.load(p["robot"], base="fixed"), p["margin"]
        robot.check_frame(p["frame"])
        if not 0.0 < margin < 0.08:
            raise InvalidInput(f"margin is {margin:g} m; it must be above 0 and below 0.08")
        limits = [CollisionAvoidance(obstacles(), margin=margin)] if p["avoids"] else []
        return Setup(stack=stack(robot, p["frame"], limits), plant=arm_plant(robot, p.settings.plant))

    def judge(self, trials: Iterator[Trial], p: Parameters) -> ScenarioResult:
        done, margin, around = list(trials), p["margin"], obstacles()
        run, clearances = done[0].run, [clearance(trial.run, trial.robot, around) for trial in done]
        kept, free = clearances
        figures = {
            "min_distance_m": kept.smallest,
            "without_m": free.smallest,
            "margin_m": margin,
            "closest": kept.closest,
            "closest_without": free.closest,
            "largest_torque_step_Nm": float(np.abs(np.diff(run["tau"], axis=0)).max(initial=0.0)),
            "tool_error_at_the_end_m": float(done[0].error("Position")[-1]),
        }
        checks = [
            Check("smallest distance", kept.smallest, ">", 0.0, "m", kept.place),
            Check("smallest distance minus the margin", kept.smallest - margin, ">", -1e-3, "m", kept.place),
            *judge.common_checks(run),
        ]
        if len(kept.times) * EVERY * float(run.meta["dt"]) > 0.5 * PERIOD:
            without = Check("smallest distance without the limit", free.smallest, "<", 0.0, "m", free.place)
            checks.insert(2, without)
        shown = [_section(done, clearances, margin)]
        return judge.verdict(done, checks, figures=figures, obstacles=around, sections=shown)


def obstacles() -> list[Obstacle]:
    """A post that stands, and a ball that swings."""

    def swinging(t: float) -> Any:
        phase = 2.0 * np.pi * t / BALL_PERIOD
        return pinocchio.SE3(np.eye(3), np.array([0.15 + 0.05 * np.cos(phase), -0.35 * np.cos(phase), 0.72]))

    post = Obstacle("post", Cylinder(POST_RADIUS, POST_LENGTH), pinocchio.SE3(np.eye(3), np.array(POST_AT)))
    return [post, Obstacle("ball", Sphere(BALL_RADIUS), swinging)]


def path(t: float) -> tuple[Vec, Vec, Vec]:
    """From here to there and back, smoothly."""
    phase, w = 2.0 * np.pi * t / PERIOD, 2.0 * np.pi / PERIOD
    share, rate, second = 0.5 * (1 - np.cos(phase)), 0.5 * w * np.sin(phase), 0.5 * w**2 * np.cos(phase)
    way = np.array(THERE) - np.array(HERE)
    return np.array(HERE) + share * way, rate * way, second * way


def stack(robot: PinocchioModel, frame: str, limits: Sequence[Any]) -> wbc.Stack:
    """The task that leads through the obstacle, and the other tasks.

    Positions keep a milliradian more from their limits: physics steps a little differently from what is decided.
    """
    low, high = robot.limits.q_min + 1e-3, robot.limits.q_max - 1e-3
    return wbc.Stack(
        [Position(frame, target=path, kp=100), Posture(robot.q0, kp=10, weight=1e-2)],
        subject_to=[JointLimits(lower=low, upper=high, a_max=A_MAX, j_max=J_MAX), *limits],
    )


def clearance(run: wbc.Run, robot: PinocchioModel, around: Sequence[Obstacle]) -> Clearance:
    """Distances of every pair of shapes, along what the plant did."""
    state, measured = robot.state(drifts=False), Distances(robot, obstacles=around, count=1, reach=FAR)
    rest, times, distances, pairs = np.zeros(robot.nv), [], [], []
    for row in range(0, run.rows, EVERY):
        state.update(float(run["t"][row]), np.asarray(run["plant.q"][row]), rest)
        measured.reset()  # else a pair keeps the row until another is nearer by a tenth of the reach
        measured.read(state)
        times.append(state.t)
        distances.append(float(measured.distance[0]))
        pairs.append(measured.pairs[measured.which[0]] if measured.which[0] >= 0 else ("nothing", "near"))
    return Clearance(np.array(times), np.array(distances), pairs)


def _section(done: Sequence[Trial], clearances: Sequence[Clearance], margin: float) -> Section:
    kept, names = clearances[0], [trial.name for trial in done]
    distance = Plot(
        "distance", "The smallest distance of all pairs of shapes", "m", kept.times,
        [Curve(name, made.distances, run=k, x=None if made is kept else made.times)
         for k, (name, made) in enumerate(zip(names, clearances, strict=True))],
        [Bound(margin, "margin"), Bound(0.0, "touching")], wide=True,
        caption="Both runs have the same task, gains and other limits. Below zero shapes are inside one another: the "
        "obstacles are not in the physics, so that nothing but the limit keeps the arm away from them.",
    )  # fmt: skip
    costs = judge.beside("tool", "What the way round costs the task: error of the tool", "m", done,
                         lambda trial: trial.error("Position"), wide=True)  # fmt: skip
    table = Table(
        ("run", "smallest distance [m]", "between"),
        [(name, made.smallest, made.closest) for name, made in zip(names, clearances, strict=True)],
    )
    text = Text(
        "The limit acts on distances measured in the tick. These are measured again afterwards, for every pair of "
        "shapes of the robot as physics moved it."
    )
    return Section("Distances", [text, table, distance, costs])
