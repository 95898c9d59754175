"""Statistics of diagnoses: faults of motors, pushes and loads of an arm are drawn and diagnosed."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, final

import numpy as np

import wbc
from wbc.models.pinocchio_ import PinocchioModel
from wbc.report import measure
from wbc.report.document import Section, Table, Text
from wbc.sim.actuator_fault import ActuatorFault
from wbc.sim.disturbance import Disturbance, Payload, Push
from wbc.sim.scenario import Check, Parameter, Parameters, Scenario, ScenarioResult, Setup, Trial
from wbc.types import Vec

from .. import (
    Cap,
    Carry,
    Compensate,
    Derate,
    FaultReaction,
    JointPositionLimits,
    Release,
    When,
)
from ..components.diagnosis import ACTUATOR, Diagnosis
from . import judge
from .arm_collision import jacobian, moved_links
from .arm_reach import TOOLS
from .waving import NOISE, Waving

#: Seconds without a fault that thresholds come from; after a fault that are watched.
LEARNING, WATCHED = 10.0, 2.0
#: What has to be recognised misses this many thresholds of some joint.
CLEAR = 3.0
TRUTHS = (*ACTUATOR, "push", "payload")
#: What it may be taken for; "another motor" is a loss laid to the wrong joint.
NAMED = (*ACTUATOR, "another motor", "external", "payload", "nothing")


@final
@dataclass(frozen=True)
class Case:
    """One trial: what it was, how clear, what it was called first, and what it was held for in the end."""

    truth: str
    size: float
    first: str
    final: str
    mass_error: float = np.nan

    @classmethod
    def of(cls, draw: Draw, events: Sequence[Diagnosis]) -> Case:
        """What came of it: the diagnoses since it happened."""
        held = [_called(d, draw.joint) for d in standing(events)]
        loads = [d.load.mass for d in events if d.load is not None]
        mass = draw.disturbance.mass if isinstance(draw.disturbance, Payload) else np.nan
        return cls(
            draw.truth, float((np.abs(draw.missing) / draw.waving.threshold).max()),
            _called(events[0], draw.joint) if events else "nothing", held[0] if held else "nothing",
            abs(loads[0] - mass) if loads else np.nan,
        )  # fmt: skip

    @property
    def accused(self) -> tuple[bool, bool]:
        """Whether a sound motor was blamed, first and in the end."""
        blamed = "another motor" if self.truth in ACTUATOR else (*ACTUATOR, "another motor")
        return self.first in blamed, self.final in blamed


@final
class DiagnosisStatistics(Scenario):
    """An arm waves, and ``cases`` times something drawn by ``seed`` happens to it: a motor fails totally, partly, by a
    bias or a ceiling; something pushes one of its links for 0.2 to 1.5 s; or its hand picks up a load. The answer is
    that of each diagnosis. Sensors have noise with ``noise``, the controller's masses are wrong by up to ``masses``.

    ``robot``: panda (needs example-robot-data) or arm.
    """

    name: ClassVar[str] = "diagnosis-statistics"
    group: ClassVar[str] = "faults"
    takes = 300.0
    summary: ClassVar[str] = "failing motors, pushes and loads drawn at random: what each is taken for"
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "robot": "panda", "cases": 240, "noise": False, "masses": 0.0, "seed": 0,
    }  # fmt: skip
    plants = ("mujoco",)

    def cases(self, p: Parameters) -> dict[str, dict[str, Any]]:
        count, masses = p.count("cases"), p.number("masses", low=0.0, high=0.5)
        waving = Waving(wbc.load(p["robot"]), masses, NOISE if p["noise"] else {}, p["seed"])
        p.settings.progress(0.0, "learning thresholds")
        waving.learn(LEARNING, p.settings.solver)
        truths = [TRUTHS[k % len(TRUTHS)] for k in range(count)]
        return {f"{k + 1}: {truth}": {"draw": Draw.of(waving, truth)} for k, truth in enumerate(truths)}

    def build(self, p: Parameters) -> Setup:
        draw: Draw = p["draw"]
        return draw.setup()

    def judge(self, trials: Iterator[Trial], p: Parameters) -> ScenarioResult:
        cases = []
        for trial in trials:  # a run is forgotten before the next one
            draw, reaction = trial.about
            cases.append(Case.of(draw, [diagnosis for diagnosis, _ in reaction.events if diagnosis.t >= draw.start]))
        clear = [case for case in cases if case.size >= CLEAR]
        motors = [c for c in clear if c.truth in ACTUATOR]
        pushes, loads = ([c for c in clear if c.truth == truth] for truth in ("push", "payload"))

        def share(chosen: Sequence[Case], good: Any) -> float:
            return sum(bool(good(c)) for c in chosen) / len(chosen) if chosen else np.nan

        figures: dict[str, Any] = {
            "cases": len(cases), "clear": len(clear), "held_for": counted(clear, "final"),
            "motor_found": share(motors, lambda c: c.first in ACTUATOR),
            "payload_recognised": share(loads, lambda c: c.final == "payload"),
            "mass_error_kg": max((c.mass_error for c in loads if np.isfinite(c.mass_error)), default=np.nan),
            "push_called_payload": share(pushes, lambda c: c.final == "payload"),
            "motor_called_payload": share(motors, lambda c: c.final == "payload"),
            "push_blamed_on_a_motor_first": share(pushes, lambda c: c.accused[0]),
            "push_blamed_on_a_motor_in_the_end": share(pushes, lambda c: c.accused[1]),
        }  # fmt: skip
        demands = [
            (motors, "failing motors named at once", "motor_found", ">=", 0.95),
            (loads, "loads recognised", "payload_recognised", ">=", 0.9),
            (pushes, "pushes called a load", "push_called_payload", "<=", 0.05),
            (motors, "motors called a load", "motor_called_payload", "<=", 0.02),
            (pushes, "pushes blamed on a motor in the end", "push_blamed_on_a_motor_in_the_end", "<=", 0.1),
        ]  # fmt: skip
        checks = [
            Check(f"{text}, of {len(chosen)}", figures[key], relation, bound, "share")
            for chosen, text, key, relation, bound in demands if chosen
        ]  # fmt: skip
        sections = [_section(trial.robot, cases, draw.waving.threshold)]
        return judge.verdict(trial, checks, violations={}, tracking={}, figures=figures, called="", sections=sections)


@final
@dataclass(frozen=True, eq=False)
class Draw:
    """Something that happens to a joint at ``start`` [s], ``missing`` torque at first (nj,) [N m]; the ``seed`` of the
    noise."""

    waving: Waving
    truth: str
    start: float
    joint: int
    disturbance: Disturbance
    missing: Vec
    seed: int

    @classmethod
    def of(cls, waving: Waving, truth: str) -> Draw:
        """One trial of this kind."""
        start = round(float(waving.random.uniform(0.5, 1.5)), 3)
        joint = int(waving.random.integers(waving.robot.nj))
        at = measure.row(waving.calm, start)
        drawn = _drawn(waving, truth, start, joint, waving.calm["plant.q"][at], waving.calm["tau"][at])
        return cls(waving, truth, start, joint, *drawn, waving.seed())

    def setup(self) -> Setup:
        """The wave with what is drawn, and an answer to it."""
        waving = self.waving
        observer = waving.observer()
        table = [
            When("total", [Release()]), When("partial", [Derate()]), When("bias", [Compensate()]),
            When("saturation", [Cap()]), When("payload", [Carry(observer)]),
        ]  # fmt: skip
        reaction = FaultReaction(
            observer, table=table, noise=waving.noise_of_a_tick, start=0.2, hands=[_hand(waving.robot)]
        )
        return waving.setup(
            self.start + WATCHED, disturbances=[self.disturbance], components=[observer, reaction],
            tasks=[reaction.limits], limits=[JointPositionLimits()], seed=self.seed, about=(self, reaction),
        )  # fmt: skip


def _hand(robot: PinocchioModel) -> str:
    return TOOLS.get(robot.name.lower(), robot.frame_names[-1])


def _drawn(  # noqa: PLR0917
    waving: Waving, truth: str, start: float, joint: int, q: Vec, tau: Vec
) -> tuple[Disturbance, Vec]:
    """What happens, and what it makes each joint miss at first (nj,) [N m]."""
    random, robot = waving.random, waving.robot
    if truth == "push":
        link = moved_links(robot)[joint]
        force = random.normal(size=3)
        force *= float(random.uniform(5.0, 60.0)) / np.linalg.norm(force)
        lasts = float(random.uniform(0.2, 1.5))
        return Push(link, tuple(force), start, lasts), jacobian(robot, link, q).T @ force
    if truth == "payload":
        load = Payload(_hand(robot), mass=float(random.uniform(0.3, 3.0)), start=start)
        state = robot.state()
        state.update(0.0, q, np.zeros(robot.nv))
        return load, load.mass * state.frame(load.frame).jacobian()[:3].T @ robot.gravity
    left, bias, ceiling = 1.0, 0.0, np.inf
    if truth == "bias":
        most = min(20.0 * float(waving.threshold[joint]), 0.5 * float(robot.limits.tau_max[joint]))
        bias = float(random.uniform(0.3, 1.0) * random.choice([-1.0, 1.0])) * most
    elif truth == "saturation":
        ceiling = float(random.uniform(0.3, 0.8)) * abs(float(tau[joint]))
    else:
        left = 0.0 if truth == "total" else float(random.uniform(0.25, 0.75))
    fault = ActuatorFault(joint=robot.joint_names[joint], effectiveness=left, bias=bias, ceiling=ceiling, start=start)
    missing = np.zeros(robot.nj)
    missing[joint] = fault.missing(start, float(tau[joint]))
    return fault, missing


def standing(events: Sequence[Diagnosis]) -> list[Diagnosis]:
    """Of diagnoses, those that were not taken back: a payload before a motor before a push."""
    motors: dict[int, Diagnosis] = {}
    others: list[Diagnosis] = []
    for d in events:
        for joint in d.instead_of:
            motors.pop(joint, None)
        if d.kind in ACTUATOR:
            motors[d.joint] = d
        else:
            others.append(d)
    loads = [d for d in others if d.kind == "payload"]
    return [*loads, *motors.values(), *(d for d in others if d.kind != "payload")]


def _called(diagnosis: Diagnosis, joint: int) -> str:
    if diagnosis.kind in ACTUATOR and diagnosis.joint != joint:
        return "another motor"
    return diagnosis.kind


def counted(cases: Sequence[Case], when: str) -> dict[str, dict[str, int]]:
    """How often each truth was called what, "first" or "final"."""
    return {
        truth: {named: sum(c.truth == truth and getattr(c, when) == named for c in cases) for named in NAMED}
        for truth in TRUTHS
    }


def _section(robot: PinocchioModel, cases: Sequence[Case], threshold: Vec) -> Section:
    clear = [case for case in cases if case.size >= CLEAR]
    small = [case for case in cases if case.size < CLEAR]

    def table(chosen: Sequence[Case], when: str, caption: str) -> Table:
        rows: list[tuple[str | int, ...]] = [(truth, *row.values()) for truth, row in counted(chosen, when).items()]
        return Table(("what it was", *NAMED), rows, caption)

    held = table(clear, "final", f"Held for {WATCHED:g} s later, of what misses {CLEAR:g} thresholds or more.")
    first = table(clear, "first", "The first decision on these, within some milliseconds of the alarm.")
    rest = table(small, "final", f"Held for {WATCHED:g} s later, of what misses less: nothing is demanded of it.")
    thresholds = Table(
        ("joint", "threshold [N m]"), list(zip(robot.joint_names, threshold.tolist(), strict=True)), folded=True
    )
    text = Text(
        "A push that turns one joint alone looks like a failing motor at first. A motor called dead is sent nothing: "
        "if its joint still misses torque, something pushes it, and the motor is taken back into service. A load shows "
        "as the weight and inertia of one body in the hand, over half a second in which the arm moves. A ceiling "
        "and a share are the same until the command has changed; so are a bias and a push on one joint that lasts."
    )
    return Section("What was taken for what", [text, held, first, rest, thresholds])
