"""Every leg joint of a standing robot fails at moments all over its sway."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, product
from typing import Any, ClassVar, final

import numpy as np

from wbc.errors import InvalidInput
from wbc.models.pinocchio_ import PinocchioModel
from wbc.report import measure
from wbc.report.document import Section, Table, Text
from wbc.sim.actuator_fault import ActuatorFault
from wbc.sim.scenario import Check, Parameter, Parameters, Scenario, ScenarioResult, Setup, Trial

from ..components.fault_reaction import TABLE
from . import humanoid_stand, judge
from .fault_trials import Case, Outcome, Stand, learnt
from .held_sway import Held, HeldSway, reserve, table_with
from .humanoid_joint_loss import HumanoidJointLoss
from .quadruped_joint_loss import QuadrupedJointLoss
from .stand_family import STANCES
from .standing import held_by_damping

#: When the motor fails: the sway is at its full size [s].
FAULT = 1.2
#: The sway's frequencies are multiples of 0.1 Hz: it repeats itself after so long [s]. Moments are a quarter farther
#: apart than n equal parts of it: at four of these an axis of 0.4 Hz would always be in the same phase.
PERIOD, APART = 10.0, 1.25
#: At the end of a run the centre of mass is no farther from its target than this, or the robot does not stand; and with
#: noise or wrong masses [m]. Where it stands, the error is a millimetre or two; where it is lost, it doubles in 0.1 s.
OFF, OFF_ROUGH = 5e-3, 2e-2


@final
@dataclass(frozen=True)
class Row:
    """One joint: how many of ``moments`` it stood, when it fell after the fault [s], and what statics says.

    ``possible``: of how many moments the robot could have stood still as it was at the fault, without the joint;
    ``broken``: how many of these it did not stand. ``delay`` the longest from fault to answer [s], ``error`` the
    largest rms error of the centre of mass of those that stood [m]; ``held`` the sway that can be held without the
    joint, None: none; ``enough``: whether it leaves enough in reserve.
    """

    joint: str
    moments: int
    stood: int
    possible: int
    broken: int
    falls: Sequence[float]
    delay: float
    error: float
    held: Held | None
    enough: bool

    @property
    def why(self) -> str:
        """What is done, or why it is lost."""
        if self.held is None:
            return "nowhere in the sway's box can the robot stand without it"
        if not self.enough:
            return f"at the best position {self.held.reserve:.2f} m/s² is left"
        done = "sways on" if self.held.whole else "half the sway" if self.held.share else "comes to rest"
        if self.possible == self.moments:
            return done
        return f"{done}; at {self.moments - self.possible} moments it could not stand still as it was"

    def as_dict(self) -> dict[str, Any]:
        """The row as JSON values."""
        held = self.held
        return {
            "joint": self.joint, "moments": self.moments, "stood": self.stood,
            "possible": self.possible, "broken": self.broken, "falls_after_s": list(self.falls),
            "delay_ms": 1e3 * self.delay, "com_rms_mm": 1e3 * self.error, "why": self.why,
            "share": None if held is None else held.share,
            "offset_mm": None if held is None else [1e3 * float(x) for x in held.offset],
            "reserve": None if held is None else held.reserve,
        }  # fmt: skip


@final
class FaultFamily(Scenario):
    """Each leg joint's motor loses its strength, at ``moments`` moments spread over the sway's period, with the answer.

    ``robot``: g1, talos, go2 (need example-robot-data), humanoid or quadruped; ``joints``: all, or names and parts of
    names, separated by commas; ``left``: what of the torque is left. ``noise``, ``masses``, ``seed``: as in
    humanoid-joint-loss. ``answer``: "usual" also changes the sway, "release" releases the joint alone, "none". A joint
    without which statics can hold a sway has to be survived at all moments at which the robot could have stood still
    as it was; of others the table says why not.
    """

    name: ClassVar[str] = "fault-family"
    group: ClassVar[str] = "faults"
    takes = 3600.0
    summary: ClassVar[str] = "every joint of every leg fails, at moments all over the sway: a table of what stands"
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "robot": "g1", "joints": "all", "moments": 8, "left": 0.0, "noise": False, "masses": 0.0, "seed": 0,
        "answer": "usual",
    }  # fmt: skip
    robots = STANCES
    plants = ("mujoco",)
    duration = 1.6  # of eight moments two are up to 1.57 s apart: every phase of the sway is passed

    def cases(self, p: Parameters) -> dict[str, dict[str, Any]]:
        loss = HumanoidJointLoss() if p["robot"] in humanoid_stand.STANCES else QuadrupedJointLoss()
        stand, moments = loss.stand(p), p.count("moments")
        left = p.number("left", low=0.0, high=0.9)
        if p["answer"] not in ("usual", "release", "none"):
            raise InvalidInput(f"parameter 'answer' is {p['answer']!r}; it must be usual, release or none")
        joints = chosen(stand.robot(), p["joints"])
        p.settings.progress(0.0, "learning thresholds")
        known, sway = learnt(stand, p.settings.solver), HeldSway.of(stand)
        table = table_with(sway) if p["answer"] == "usual" else TABLE
        cases = {}
        for joint, k in product(joints, range(moments)):
            started = replace(stand, stance=replace(stand.stance, begun=begun(k, moments)))
            fault = ActuatorFault(joint=joint, start=FAULT, effectiveness=left)
            case = Case(started, fault, known, react=p["answer"] != "none", table=table)
            cases[f"{joint}, moment {k + 1} of {moments}"] = {"case": case, "sway": sway}
        return cases

    def build(self, p: Parameters) -> Setup:
        setup: Setup = p["case"].setup(p.settings.duration)
        return replace(setup, about=(*setup.about, p["sway"]))

    def judge(self, trials: Iterator[Trial], p: Parameters) -> ScenarioResult:
        rows = []
        for joint, some in groupby(trials, lambda trial: trial.about[0].fault.joint):
            outcomes = [Outcome.of(trial) for trial in some]  # forgotten before the next joint's
            rows.append(_row(joint, outcomes, p["left"]))
        checks = [
            Check(f"{row.joint}: falls, of {row.possible} moments at which it can stand", float(row.broken), "=", 0.0)
            for row in rows if row.enough
        ]  # fmt: skip
        return judge.verdict(
            outcomes[-1].trial, checks, figures={"rows": [row.as_dict() for row in rows]}, sections=[_section(rows)]
        )


def begun(k: int, moments: int) -> float:
    """How long the sway has gone on when moment ``k`` of ``moments`` starts [s]."""
    return float(APART * PERIOD * k / moments % PERIOD)


def leg_joints(robot: PinocchioModel) -> list[str]:
    """The joints between the base and the feet, in the robot's order."""
    state = robot.state()
    moved = np.zeros(robot.nj, dtype=np.bool_)
    for foot in robot.feet.values():
        moved |= np.abs(state.frame(foot.frame).jacobian()[:, robot.nb :]).max(axis=0) > 1e-9
    return [name for name, moves in zip(robot.joint_names, moved, strict=True) if moves]


def chosen(robot: PinocchioModel, text: str) -> list[str]:
    """The leg joints that ``text`` names: "all", or names and parts of names, separated by commas.

    Raises:
        InvalidInput: a part that no leg joint has in its name.
    """
    legs = leg_joints(robot)
    if text == "all":
        return legs
    parts = [part.strip() for part in text.split(",")]
    for part in parts:
        if not any(part in joint for joint in legs):
            raise InvalidInput(f"parameter 'joints' has {part!r}; no leg joint is called so: {', '.join(legs)}")
    return [joint for joint in legs if any(part in joint for part in parts)]


def _row(joint: str, outcomes: Sequence[Outcome], left: float) -> Row:
    case, _, sway = outcomes[0].trial.about
    stand: Stand = case.stand
    robot, off, at = stand.robot(), OFF_ROUGH if stand.rough else OFF, measure.row(outcomes[0].run, FAULT)
    contacts, held = held_by_damping(robot), sway.held([joint])
    good = [o.stands and float(o.error[-1]) < off for o in outcomes]
    possible = [left > 0.0 or reserve(robot, contacts, o.run["plant.q"][at], [joint]) >= 0.0 for o in outcomes]
    return Row(
        joint, len(outcomes), sum(good), sum(possible), sum(p and not g for p, g in zip(possible, good, strict=True)),
        [round(float(o.run["t"][-1]) - FAULT, 2) for o, g in zip(outcomes, good, strict=True) if not g],
        max(o.delay for o in outcomes), max((o.rms for o, g in zip(outcomes, good, strict=True) if g), default=np.nan),
        held, left > 0.0 or (held is not None and held.reserve >= sway.least),
    )  # fmt: skip


def _section(rows: Sequence[Row]) -> Section:
    columns = ("joint", "stands", "falls after [s]", "answer [ms]", "rms [mm]", "share of the sway", "shifted by [mm]",
               "left [m/s²]", "what is done, or why not")  # fmt: skip
    text = Text(
        "Every motor fails at moments spread over the period of the sway. What is left: the least acceleration of the "
        "centre of mass, over the level directions and the positions of the sway that is held, that forces within "
        "their cones and torques within their limits can still give without the joint."
    )
    shown = [
        (
            row.joint, f"{row.stood} of {row.moments}", ", ".join(f"{t:.2f}" for t in row.falls), 1e3 * row.delay,
            1e3 * row.error, None if row.held is None else row.held.share,
            "" if row.held is None else " ".join(f"{1e3 * x:.0f}" for x in row.held.offset),
            None if row.held is None else row.held.reserve, row.why,
        )
        for row in rows
    ]  # fmt: skip
    return Section("Every joint", [text, Table(columns, shown)])
