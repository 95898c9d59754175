"""FaultScenario: a standing robot loses a motor at many moments, each time without and with an answer."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from wbc.report import measure
from wbc.sim.actuator_fault import ActuatorFault
from wbc.sim.scenario import Check, Parameters, Scenario, ScenarioResult, Setup, Trial

from .. import Thresholds, When
from . import fault_sections as sections
from . import judge
from .fault_trials import LEARNING, Case, Gains, Outcome, Pair, Stand, learnt
from .held_sway import HeldSway, table_with
from .least_torque import least_torque
from .standing import standing_stack


class FaultScenario(Scenario):
    """``fault`` of a robot that stands, from one of ``moments`` moments on, the first at ``first`` [s], the others
    ``between`` [s] apart; with ``variants`` also other gains, and faults that the answer does not mend.

    ``duration``: how long after the fault the robot is watched [s].
    """

    group: ClassVar[str] = "faults"
    plants = ("mujoco",)
    first: ClassVar[float]
    between: ClassVar[float]
    #: The joint that fails by default, and joints whose loss the answer does not mend, by robot.
    joints: ClassVar[Mapping[str, str]]
    hopeless: ClassVar[Mapping[str, Sequence[str]]]

    @abstractmethod
    def stand(self, p: Parameters) -> Stand:
        """Who stands."""

    @abstractmethod
    def demand(self, without: Sequence[Outcome], answered: Sequence[Outcome], p: Parameters) -> Sequence[Check]:
        """The demands on the outcomes."""

    @abstractmethod
    def variants(self, stand: Stand) -> Mapping[str, Gains]:
        """Gains other than the stand's by name, each tried once."""

    def table(self, stand: Stand) -> Sequence[When]:
        """What is done about a diagnosis."""
        return table_with(HeldSway.of(stand))

    def left(self, p: Parameters) -> float:
        """What share of its torque the motor that fails has left."""
        return 0.0

    def cases(self, p: Parameters) -> dict[str, dict[str, Any]]:
        stand, left, count = self.stand(p), self.left(p), p.count("moments")
        joint = self.joints[p["robot"]] if p["joint"] == "auto" else p["joint"]
        stand.robot().joint(joint)
        moments = [self.first + self.between * k for k in range(count)]
        fault = ActuatorFault(joint=joint, effectiveness=left, start=moments[count // 2])
        p.settings.progress(0.0, "learning thresholds")
        case = Case(stand, fault, learnt(stand, p.settings.solver), table=self.table(stand))
        tried = [replace(case, fault=replace(fault, start=at), label=f"fault at {at:g} s") for at in moments]
        if p["variants"]:
            tried += [
                replace(case, stand=replace(stand, gains={**stand.gains, **gains}), label=label)
                for label, gains in self.variants(stand).items()
            ]
            tried += [
                replace(case, fault=ActuatorFault(joint=other, start=fault.start), label=other)
                for other in self.hopeless[stand.name]
            ]
        return {
            f"{one.fault.joint}, {one.label}, {said} an answer": {"case": replace(one, react=react)}
            for one in tried for said, react in (("without", False), ("with", True))
        }  # fmt: skip

    def build(self, p: Parameters) -> Setup:
        case: Case = p["case"]
        return case.setup(p.settings.duration)

    def judge(self, trials: Iterator[Trial], p: Parameters) -> ScenarioResult:
        outcomes = [Outcome.of(trial) for trial in trials]
        stand, count, known = self.stand(p), p.count("moments"), outcomes[0].trial.about[0].known
        everything = [
            Pair(without.trial.about[0].label, without, answered)
            for without, answered in zip(outcomes[::2], outcomes[1::2], strict=True)
        ]
        cut = len(everything) - (len(self.hopeless[stand.name]) if p["variants"] else 0)
        pairs, varied, lost = everything[:count], everything[count:cut], everything[cut:]
        without, answered, shown = [p.without for p in pairs], [p.answered for p in pairs], pairs[count // 2]
        return judge.verdict(
            [replace(shown.answered.trial, name=sections.WITH), replace(shown.without.trial, name=sections.WITHOUT)],
            [*self.demand(without, answered, p), _nothing_before(answered)],
            figures=figures(known, stand, pairs, varied),
            sections=[
                sections.signals(shown, known),
                sections.outcomes(pairs, varied),
                *([sections.lost(lost, [reason(stand, pair) for pair in lost])] if lost else []),
                sections.honesty(stand, known),
            ],
        )  # fmt: skip


def figures(known: Thresholds, stand: Stand, pairs: Sequence[Pair], varied: Sequence[Pair]) -> dict[str, Any]:
    """Worst over all moments: {joint, found_joint, delay_ms, with: {stands, task_rms_m}, without: {…}} and counts."""

    def summed(outcomes: Sequence[Outcome]) -> dict[str, Any]:
        return {
            "stands": all(o.stands for o in outcomes),
            "task_rms_m": max(o.rms for o in outcomes),
            "stood": sum(o.stands for o in outcomes),
            "kept_its_place": sum(o.kept for o in outcomes),
            "slip_m": max(o.slip for o in outcomes),
        }

    answered, fault = [p.answered for p in pairs], pairs[0].answered.fault
    found = [o.found.joint_name if o.found else "none" for o in answered]
    wrong = [name for name in found if name != fault.joint]
    return {
        "joint": fault.joint,
        "found_joint": wrong[0] if wrong else fault.joint,
        "delay_ms": 1e3 * max(o.delay for o in answered),
        "share_lost": [o.found.share if o.found else None for o in answered],
        "share_at_the_end": [float(o.run["signal.FaultReaction.share"][-1].min()) for o in answered],
        "moments": len(pairs),
        "threshold_Nm": float(known.value[stand.robot().joint(fault.joint)]),
        "with": summed(answered),
        "without": summed([p.without for p in pairs]),
        "gain_variants": {p.label: {"without": p.without.fate, "with": p.answered.fate} for p in varied},
        "fates_without": [p.without.fate for p in pairs],
    }


def reason(stand: Stand, pair: Pair) -> tuple[float, float]:
    """The least torque [N m, N] that standing at the fault's moment asks of the dead joint, whatever the others do; and
    the most over the sway before it. Zero: statics could do without it."""
    robot = stand.robot()
    contacts, run, fault = standing_stack(robot, stand.stance).contacts, pair.without.run, pair.without.fault
    at = measure.row(run, fault.start)
    sway = [least_torque(robot, contacts, run["plant.q"][k], fault.joint) for k in range(at // 4, at + 1, at // 16)]
    return sway[-1], float(np.max(sway))


def _nothing_before(outcomes: Sequence[Outcome]) -> Check:
    count = sum(o.false_alarms for o in outcomes)
    seconds = sum(o.fault.start for o in outcomes) + LEARNING
    return Check(f"diagnoses without a fault, in {seconds:.0f} s", float(count), "=", 0.0)


def found_in_time(outcomes: Sequence[Outcome], bound: float) -> list[Check]:
    """The right joint at once, and the answer within ``bound`` [s]."""
    right = sum(o.found is not None and o.found.joint_name == o.fault.joint for o in outcomes)
    delay = max(o.delay for o in outcomes)
    return [
        Check("first diagnosis names the joint", float(right), "=", float(len(outcomes)), "of all"),
        Check("longest from fault to answer", delay, "<=", bound + 1e-9, "s"),
    ]
