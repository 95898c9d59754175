"""An arm is told to reach through a post and past a swinging ball, with and without collision avoidance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, final

import numpy as np
import pinocchio

import wbc
from wbc.errors import InvalidInput
from wbc.models.collision import Distances
from wbc.models.geometry import Cylinder, Sphere
from wbc.models.pinocchio_ import PinocchioModel
from wbc.report import measure
from wbc.report.document import Bound, Curve, Plot, Section, Table, Text
from wbc.sim.mujoco_ import MujocoPlant
from wbc.sim.plant import IntegratorPlant, Plant
from wbc.sim.scenario import Check, Parameter, Scenario, ScenarioResult, Settings, trials
from wbc.sim.simulate import simulate
from wbc.types import Vec

from .. import CollisionAvoidance, JointLimits, Obstacle, Position, Posture
from . import judge

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

    def run(self, parameters: Mapping[str, Any], settings: Settings) -> ScenarioResult:
        robot = wbc.load(parameters["robot"], base="fixed")
        robot.check_frame(parameters["frame"])
        if not 0.0 < parameters["margin"] < 0.08:
            raise InvalidInput(f"margin is {parameters['margin']:g} m; it must be above 0 and below 0.08")
        around = obstacles()
        avoidance = CollisionAvoidance(around, margin=parameters["margin"])
        meta = {"scenario": self.name, "parameters": dict(parameters)}
        runs = []
        for limits, one in trials(settings.progress, ([avoidance], [])):
            controller = wbc.Controller(
                robot, stack(robot, parameters["frame"], limits), level=wbc.InverseDynamics(), solver=settings.solver
            )
            runs.append(
                simulate(controller, _plant(robot, settings.plant), duration=settings.duration, progress=one, meta=meta)
            )
        clearances = [clearance(run, robot, around) for run in runs]
        return _judged(runs, clearances, robot, parameters["margin"], around)


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
    """The task that leads through, and what else is asked.

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
        measured.read(state)
        times.append(state.t)
        distances.append(float(measured.distance[0]))
        pairs.append(measured.pairs[measured.which[0]] if measured.which[0] >= 0 else ("nothing", "near"))
    return Clearance(np.array(times), np.array(distances), pairs)


def _plant(robot: PinocchioModel, kind: str) -> Plant:
    plant: Plant = MujocoPlant(robot) if kind == "mujoco" else IntegratorPlant(robot, level="acceleration")
    plant.reset(np.array(robot.q0))
    return plant


def _judged(
    runs: Sequence[wbc.Run], clearances: Sequence[Clearance], robot: PinocchioModel, margin: float,
    around: Sequence[Obstacle],
) -> ScenarioResult:  # fmt: skip
    run, (kept, free) = runs[0], clearances
    steps = np.abs(np.diff(run["tau"], axis=0)).max(initial=0.0)
    figures = {
        "min_distance_m": kept.smallest,
        "without_m": free.smallest,
        "margin_m": margin,
        "closest": kept.closest,
        "closest_without": free.closest,
        "largest_torque_step_Nm": float(steps),
        "tool_error_at_the_end_m": float(np.linalg.norm(_error(run)[-1])),
    }
    through = len(kept.times) * EVERY * float(run.meta["dt"]) > 0.5 * PERIOD
    verdict = [
        Check("smallest distance", kept.smallest, ">", 0.0, "m"),
        Check("smallest distance minus the margin", kept.smallest - margin, ">", -1e-3, "m"),
        *judge.common_checks(run),
    ]
    if through:
        verdict.insert(2, Check("smallest distance without the limit", free.smallest, "<", 0.0, "m"))
    return judge.result(
        run, verdict, figures=figures, robot=robot, obstacles=around,
        called="with collision avoidance", beside={"without": runs[1]},
        sections=[lambda result: _section(result, clearances, runs, margin)],
    )  # fmt: skip


def _error(run: wbc.Run) -> Vec:
    return np.asarray(run[next(name for name in run.columns if name.startswith("error.Position"))])


def _section(
    result: ScenarioResult, clearances: Sequence[Clearance], runs: Sequence[wbc.Run], margin: float
) -> Section:
    kept, names = clearances[0], (result.called, *result.beside)
    distance = Plot(
        "distance", "The smallest distance of all pairs of shapes", "m", kept.times,
        [Curve(name, made.distances, run=k, x=None if made is kept else made.times)
         for k, (name, made) in enumerate(zip(names, clearances, strict=True))],
        [Bound(margin, "margin"), Bound(0.0, "touching")], wide=True,
        caption="Both runs have the same task, gains and other limits. Below zero shapes are inside one another: the "
        "obstacles are not in the physics, so that nothing but the limit keeps the arm away from them.",
    )  # fmt: skip
    costs = Plot(
        "tool", "What the way round costs the task: error of the tool", "m", measure.times(runs[0]),
        [Curve(name, np.linalg.norm(_error(run), axis=1), run=k, x=None if k == 0 else measure.times(run))
         for k, (name, run) in enumerate(zip(names, runs, strict=True))], wide=True,
    )  # fmt: skip
    table = Table(
        ("run", "smallest distance [m]", "between"),
        [(name, made.smallest, made.closest) for name, made in zip(names, clearances, strict=True)],
    )
    text = Text(
        "The barrier has the distances of coal, measured in the tick; here they are measured again, for every pair of "
        "shapes of the robot that physics moved."
    )
    return Section("Distances", [text, table, distance, costs])
