"""Something pushes an arm: it is felt without any sensor, the link is named, and the arm yields."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, final

import numpy as np

import wbc
from wbc import checks
from wbc.errors import InvalidInput
from wbc.methods import ContactEstimate
from wbc.models.pinocchio_ import PinocchioModel
from wbc.report import measure
from wbc.report.document import Bound, Curve, Plot, Section, Table, Text
from wbc.sim.disturbance import Push
from wbc.sim.mujoco_ import MujocoPlant
from wbc.sim.scenario import Check, Parameter, Scenario, ScenarioResult, Settings, trials
from wbc.sim.simulate import simulate
from wbc.types import Vec

from .. import (
    Comply,
    FaultReaction,
    JointPositionLimits,
    JointVelocityLimits,
    MomentumObserver,
    Position,
    Posture,
    Sinusoid,
    TorqueLimits,
    When,
)
from ..components.diagnosis import Diagnosis
from . import judge
from .arm_reach import TOOLS

#: When something pushes, and for how long [s].
YIELDING = 0.2  # share of the damping that is left
START, LASTS = 1.5, 0.8
GAIN, THRESHOLD, FRICTION = 100.0, 0.3, 0.6
#: Directions of the pushes, world axes.
DIRECTIONS: Mapping[str, Vec] = {"x": np.array([1.0, 0, 0]), "y": np.array([0, 1.0, 0]), "down": np.array([0, 0, -1.0])}


@final
@dataclass(frozen=True, eq=False)
class Hit:
    """One push, and what was made of it."""

    link: str
    direction: str
    run: wbc.Run
    diagnosis: Diagnosis | None
    found: str
    force: Vec
    felt: float
    own: float

    @property
    def nameable(self) -> bool:
        """Whether the link's own joint feels the push: what only joints before it feel may come from links behind."""
        return self.own > 1.1 * THRESHOLD

    @property
    def delay(self) -> float:
        """From the push to the answer [s]; infinite: never."""
        return np.inf if self.diagnosis is None else self.diagnosis.t - START


@final
class ArmCollision(Scenario):
    """A force of ``force`` [N] pushes the centre of mass of ``link`` for 0.8 s while the tool follows a sinusoid, in
    three directions; then every other link is pushed. The answer: all tasks lose stiffness and most damping.

    ``robot``: panda (needs example-robot-data) or arm; ``link``: auto, the one of the fourth joint, or a link's name.
    """

    name: ClassVar[str] = "arm-collision"
    group: ClassVar[str] = "arms"
    takes = 90.0
    summary: ClassVar[str] = "an arm is pushed: felt without sensors, the link named, the arm yields"
    parameters: ClassVar[Mapping[str, Parameter]] = {"robot": "panda", "link": "auto", "force": 30.0}
    plants = ("mujoco",)
    duration = 3.0

    def run(self, parameters: Mapping[str, Any], settings: Settings) -> ScenarioResult:
        if settings.duration < START + LASTS:
            raise InvalidInput(f"duration is {settings.duration:g} s; the push ends at {START + LASTS:g} s")
        robot = wbc.load(parameters["robot"])
        force = checks.number("parameter 'force'", parameters["force"], low=0.0, strict=True)
        links = moved_links(robot)
        link = links[3] if parameters["link"] == "auto" else parameters["link"]
        robot.check_frame(link)
        meta = {"scenario": self.name, "parameters": dict(parameters), "duration": settings.duration}
        wanted = [(link, direction) for direction in DIRECTIONS]
        wanted += [(other, direction) for other in links if other != link for direction in DIRECTIONS]
        hits = list[Hit]()
        for (pushed, direction), one in trials(settings.progress, [*wanted, (link, "x")]):
            one(0.0, f"push on {pushed}, {direction}")
            complies = len(hits) < len(wanted)
            hits.append(
                _trial(robot, pushed, direction, force=force, complies=complies, solver=settings.solver, meta=meta)
            )
        return _judged(robot, hits[:-1], hits[-1], link, force)


def moved_links(robot: PinocchioModel) -> list[str]:
    """The link that each joint moves, in the order of the joints."""
    child = {joint.name: joint.child for joint in robot.urdf.joints}
    return [child[joint] for joint in robot.joint_names]


def _trial(
    robot: PinocchioModel, link: str, direction: str, *, force: float, complies: bool, solver: str,
    meta: Mapping[str, Any],
) -> Hit:  # fmt: skip
    tool = TOOLS.get(str(meta["parameters"]["robot"]), robot.frame_names[-1])
    path = Sinusoid(robot.state().frame(tool).position, amplitude=[0.05, 0.08, 0.05], frequency=[0.5, 0.4, 0.6])
    observer = MomentumObserver(gain=GAIN, threshold=THRESHOLD, persistence=2, release=0.5)
    reaction = FaultReaction(observer, table=[When("external", [Comply(damping=YIELDING)])] if complies else [])
    stack = wbc.Stack(
        [Position(tool, target=path, kp=400), Posture(robot.q0, kp=10, weight=1e-3)],
        subject_to=[TorqueLimits(), JointVelocityLimits(), JointPositionLimits()], components=[observer, reaction],
    )  # fmt: skip
    controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), solver=solver, dt=1e-3)
    plant = MujocoPlant(robot)
    plant.reset(robot.q0)
    push = Push(link, tuple(force * DIRECTIONS[direction]), START, LASTS)
    run = simulate(controller, plant, duration=float(meta["duration"]), disturbances=[push], meta=dict(meta))
    diagnosis = next((d for d, _ in reaction.events if d.t >= START), None)
    lever = force * jacobian(robot, link, run["plant.q"][round(START / 1e-3)]).T @ DIRECTIONS[direction]
    own = abs(float(lever[moved_links(robot).index(link)])) if link in moved_links(robot) else 0.0
    found, estimate = ("none", np.full(3, np.nan)) if diagnosis is None else _estimated(robot, run, diagnosis)
    return Hit(link, direction, run, diagnosis, found, estimate, float(np.linalg.norm(lever)), own)


def jacobian(robot: PinocchioModel, link: str, q: Vec) -> Vec:
    """Of the link's centre of mass (3, nj), world axes."""
    state = robot.state()
    state.update(0.0, q, np.zeros(robot.nv))
    frame = state.frame(link)
    J = frame.jacobian()
    x, y, z = frame.rotation @ _centre(robot, link)
    arm = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.array(J[:3] - arm @ J[3:])


def _centre(robot: PinocchioModel, link: str) -> Vec:
    """Centre of mass of a link alone, in its frame; what is fixed to the link counts with it."""
    model = robot.pinocchio
    frame = model.frames[robot.frames[link]]
    inertia = frame.placement.actInv(model.inertias[frame.parentJoint])
    return np.array(inertia.lever)


def _estimated(robot: PinocchioModel, run: wbc.Run, diagnosis: Diagnosis) -> tuple[str, Vec]:
    """The link that was pushed, the last one felt, and the force at its centre that explains it best.

    The surface there is taken for one that faces the free estimate.
    """
    link = moved_links(robot)[diagnosis.joint]
    J = jacobian(robot, link, run["q"][round(diagnosis.t / 1e-3)])
    free = ContactEstimate(J, diagnosis.missing).closed_form().force
    if not np.linalg.norm(free) > 1e-9:
        return link, free
    return link, ContactEstimate(J, diagnosis.missing, normal=-free, friction=FRICTION).solve("daqp").force


def _judged(robot: PinocchioModel, hits: Sequence[Hit], stiff: Hit, link: str, force: float) -> ScenarioResult:
    mine = [hit for hit in hits if hit.link == link and hit.nameable]
    if not mine:
        raise InvalidInput(f"no push on {link} is felt by its own joint: nothing could name it")
    felt = [hit for hit in hits if hit.nameable]
    named = sum(hit.found == hit.link for hit in felt)
    delay = max(hit.delay for hit in mine)
    fights = [_yielded(hit) for hit in (stiff, mine[0])]
    off = min(float(np.linalg.norm(hit.force - force * DIRECTIONS[hit.direction])) for hit in mine) / force
    wrong = [hit.found for hit in mine if hit.found != link]
    figures = {
        "delay_ms": 1e3 * delay, "link": wrong[0] if wrong else link, "true_link": link,
        "all_links": {f"{hit.link} {hit.direction}": [hit.found, 1e3 * hit.delay] for hit in hits},
        "force_off_share": off, "gives_way_m": {"stiff": fights[0], "yielding": fights[1]},
    }  # fmt: skip
    run = mine[0].run
    verdict = [
        Check(f"pushes on {link} that are laid to it", float(len(mine) - len(wrong)), "=", float(len(mine)), "of all"),
        Check("longest from push to answer", delay, "<=", 0.02, "s"),
        Check("best of their forces estimated, off by", off, "<=", 0.25, "share"),
        Check("how far the tool moves, yielding over stiff", fights[1] / fights[0], ">=", 2.0),
        Check("links named rightly, of pushes that their own joint feels", float(named), ">=", 0.9 * len(felt),
              f"of {len(felt)}"),
    ]  # fmt: skip
    return judge.result(
        run, verdict, figures=figures, robot=robot,
        called="yields", beside={"stiff": stiff.run},
        sections=[lambda result: _pictures(result, mine[0], stiff), lambda result: _every(hits)],
    )  # fmt: skip


def _yielded(hit: Hit) -> float:
    """How far the tool is pushed off its path while the push lasts [m]."""
    name = next(name for name in hit.run.columns if name.startswith("error.Position"))
    during = (hit.run["t"] >= START) & (hit.run["t"] < START + LASTS)
    return float(np.linalg.norm(hit.run[name][during], axis=1).max())


def _pictures(result: ScenarioResult, hit: Hit, stiff: Hit) -> Section:
    run = result.run
    joints = run.meta["joint_names"]
    near = (run["t"] > START - 0.03) & (run["t"] < START + 0.08)
    bounds = [Bound(THRESHOLD, "threshold"), Bound(-THRESHOLD, "")]
    if hit.diagnosis is not None:
        bounds.append(Bound(1e3 * hit.delay, "answer", "x"))
    residual = run["signal.MomentumObserver.residual"][near]
    felt = Plot(
        "residuals", f"A push on {hit.link}: joints behind it feel nothing", "N m", 1e3 * (run["t"][near] - START),
        [Curve(joint, residual[:, i]) for i, joint in enumerate(joints)], bounds, over="time since the push [ms]",
    )  # fmt: skip
    name = next(name for name in run.columns if name.startswith("error.Position"))
    tool = Plot(
        "tool", "The tool's distance from its path", "mm", measure.times(run),
        [Curve(said, 1e3 * np.linalg.norm(trial.run[name], axis=1), run=k, x=measure.times(trial.run))
         for k, (said, trial) in enumerate(zip((result.called, *result.beside), (hit, stiff), strict=True))],
        caption="After the push the arm stays soft, until somebody resets it.",
    )  # fmt: skip
    return Section("The push", [felt, tool])


def _every(hits: Sequence[Hit]) -> Section:
    rows = [
        (hit.link, hit.direction, hit.felt, hit.found, 1e3 * hit.delay if np.isfinite(hit.delay) else None,
         float(np.linalg.norm(hit.force)) if np.isfinite(hit.force).all() else None, hit.nameable)
        for hit in hits
    ]  # fmt: skip
    text = Text(
        "What a push does to the joints is its lever, Jᵀ f: a force through their axes, or along the first one, moves "
        "none of them, and no observer of momenta can see it. Such pushes are in the table with next to nothing felt: "
        "they stay undetected. One that the link's own joint does not feel is laid to a link before it, with a force "
        "that does the same to the joints. A push that turns one joint alone cannot be told from a failing motor at "
        "once; it is taken for one if it happens to be a share of what that motor is asked for."
    )
    columns = (
        "link",
        "push along",
        "felt by the joints [N m]",
        "found",
        "after [ms]",
        "force estimated [N]",
        "own joint feels it",
    )
    return Section("Every link, and pushes that cannot be felt", [text, Table(columns, rows)])
