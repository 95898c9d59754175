"""An arm is pushed; MomentumObserver finds the link without force sensors, and the arm yields."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, final

import numpy as np
import pinocchio

import wbc
from wbc.errors import InvalidInput
from wbc.methods import ContactEstimate
from wbc.models.pinocchio_ import PinocchioModel
from wbc.report import measure
from wbc.report.document import Bound, Curve, Plot, Section, Table, Text
from wbc.sim.disturbance import Push
from wbc.sim.scenario import Check, Parameter, Parameters, Scenario, ScenarioResult, Setup, Trial
from wbc.types import Vec

from .. import (
    Comply,
    FaultReaction,
    MomentumObserver,
    When,
)
from ..components.diagnosis import Diagnosis
from . import judge
from .arm_reach import arm_plant, following

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

    trial: Trial
    link: str
    direction: str
    diagnosis: Diagnosis | None
    found: str
    force: Vec
    felt: float
    own: float

    @classmethod
    def of(cls, trial: Trial, force: float) -> Hit:
        """What came of a trial with a push of ``force`` [N]."""
        robot, run, (link, direction, reaction) = trial.robot, trial.run, trial.about
        diagnosis = next((d for d, _ in reaction.events if d.t >= START), None)
        lever = force * jacobian(robot, link, run["plant.q"][measure.row(run, START)]).T @ DIRECTIONS[direction]
        own = abs(float(lever[moved_links(robot).index(link)])) if link in moved_links(robot) else 0.0
        found, estimate = ("none", np.full(3, np.nan)) if diagnosis is None else _estimated(robot, run, diagnosis)
        return cls(trial, link, direction, diagnosis, found, estimate, float(np.linalg.norm(lever)), own)

    @property
    def nameable(self) -> bool:
        """Whether the link's own joint feels the push: what only joints before it feel may come from links behind."""
        return self.own > 1.1 * THRESHOLD

    @property
    def delay(self) -> float:
        """From the push to the answer [s]; infinite: never."""
        return np.inf if self.diagnosis is None else self.diagnosis.t - START

    @property
    def yielded(self) -> float:
        """How far the tool is pushed off its path while the push lasts [m]."""
        t = self.trial.run["t"]
        return float(self.trial.error("Position")[(t >= START) & (t < START + LASTS)].max())


@final
class ArmCollision(Scenario):
    """A force of ``force`` [N] pushes the centre of mass of ``link`` for 0.8 s while the tool follows a sinusoid, in
    three directions; then every other link is pushed. The answer: all tasks lose stiffness and most damping.

    ``robot``: panda (needs example-robot-data) or arm; ``link``: auto, the one of the fourth joint, or a link's name.
    """

    name: ClassVar[str] = "arm-collision"
    group: ClassVar[str] = "arms"
    takes = 90.0
    summary: ClassVar[str] = "an arm is pushed: the link is found without force sensors, and the arm yields"
    parameters: ClassVar[Mapping[str, Parameter]] = {"robot": "panda", "link": "auto", "force": 30.0}
    plants = ("mujoco",)
    duration = 3.0

    def cases(self, p: Parameters) -> dict[str, dict[str, Any]]:
        p.lasts_beyond(START + LASTS, "the push ends then")
        p.number("force", low=0.0, strict=True)
        robot = wbc.load(p["robot"])
        links, link = moved_links(robot), _pushed(robot, p)
        cases = {
            f"push on {other}, {direction}": {"pushed": other, "direction": direction, "complies": True}
            for other in (link, *(other for other in links if other != link)) for direction in DIRECTIONS
        }  # fmt: skip
        return cases | {"stiff": {"pushed": link, "direction": "x", "complies": False}}

    def build(self, p: Parameters) -> Setup:
        robot, pushed, direction = wbc.load(p["robot"]), p["pushed"], p["direction"]
        observer = MomentumObserver(gain=GAIN, threshold=THRESHOLD, persistence=2, release=0.5)
        table = [When("external", [Comply(damping=YIELDING)])] if p["complies"] else []
        reaction = FaultReaction(observer, table=table)
        push = Push(pushed, tuple(p["force"] * DIRECTIONS[direction]), START, LASTS)
        return Setup(
            stack=following(robot, [observer, reaction]), plant=arm_plant(robot), disturbances=[push],
            about=(pushed, direction, reaction),
        )  # fmt: skip

    def judge(self, trials: Iterator[Trial], p: Parameters) -> ScenarioResult:
        force = p["force"]
        *hits, stiff = [Hit.of(trial, force) for trial in trials]
        link = _pushed(stiff.trial.robot, p)
        mine = [hit for hit in hits if hit.link == link and hit.nameable]
        if not mine:
            raise InvalidInput(f"no push on {link} is felt by its own joint: nothing could name it")
        felt = [hit for hit in hits if hit.nameable]
        named, delay = sum(hit.found == hit.link for hit in felt), max(hit.delay for hit in mine)
        off = min(float(np.linalg.norm(hit.force - force * DIRECTIONS[hit.direction])) for hit in mine) / force
        wrong = [hit.found for hit in mine if hit.found != link]
        figures = {
            "delay_ms": 1e3 * delay, "link": wrong[0] if wrong else link, "true_link": link,
            "all_links": {f"{hit.link} {hit.direction}": [hit.found, 1e3 * hit.delay] for hit in hits},
            "force_off_share": off, "yielded_m": {"stiff": stiff.yielded, "yielding": mine[0].yielded},
        }  # fmt: skip
        right = float(len(mine) - len(wrong))
        checks = [
            Check(f"pushes on {link} that are laid to it", right, "=", float(len(mine)), "of all"),
            Check("longest from push to answer", delay, "<=", 0.02, "s"),
            Check("best of their forces estimated, off by", off, "<=", 0.25, "share"),
            Check("how far the tool moves, yielding over stiff", mine[0].yielded / stiff.yielded, ">=", 2.0),
            Check("links named rightly, of pushes that their own joint feels", float(named), ">=", 0.9 * len(felt),
                  f"of {len(felt)}"),
        ]  # fmt: skip
        shown = [replace(mine[0].trial, name="yields"), stiff.trial]
        return judge.verdict(shown, checks, figures=figures, sections=[_pictures(shown, mine[0]), _every(hits)])


def _pushed(robot: PinocchioModel, p: Parameters) -> str:
    """The link that is looked at most."""
    link: str = moved_links(robot)[3] if p["link"] == "auto" else p["link"]
    robot.check_frame(link)
    return link


def moved_links(robot: PinocchioModel) -> list[str]:
    """The link that each joint moves, in the order of the joints."""
    child = {joint.name: joint.child for joint in robot.urdf.joints}
    return [child[joint] for joint in robot.joint_names]


def jacobian(robot: PinocchioModel, link: str, q: Vec) -> Vec:
    """Of the link's centre of mass (3, nj), world axes."""
    state = robot.state()
    state.update(0.0, q, np.zeros(robot.nv))
    frame = state.frame(link)
    J = frame.jacobian()
    return np.array(J[:3] - pinocchio.skew(frame.rotation @ _centre(robot, link)) @ J[3:])


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
    J = jacobian(robot, link, run["q"][measure.row(run, diagnosis.t)])
    free = ContactEstimate(J, diagnosis.missing).closed_form().force
    if not np.linalg.norm(free) > 1e-9:
        return link, free
    return link, ContactEstimate(J, diagnosis.missing, normal=-free, friction=FRICTION).solve("daqp").force


def _pictures(shown: Sequence[Trial], hit: Hit) -> Section:
    run = shown[0].run
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
    tool = judge.beside(
        "tool", "The tool's distance from its path", "mm", shown, lambda trial: 1e3 * trial.error("Position"),
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
        "once; it is taken for one if it happens to be a share of the command of that motor."
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
