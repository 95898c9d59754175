"""What scenarios of failing motors have in common: trials at many moments, their verdict, their figures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, final

import numpy as np

from wbc.sim.actuator_fault import ActuatorFault
from wbc.sim.scenario import Check, Progress, ScenarioResult

from .. import Thresholds, When
from ..components.fault_reaction import TABLE
from . import fault_sections as sections
from . import judge
from .fault_trials import LEARNING, Gains, Outcome, Pair, Stand, learnt, trial
from .least_torque import least_torque
from .standing import standing_stack

#: How long after the fault the robot is watched [s].
AFTER = 6.0


@final
@dataclass(frozen=True)
class Plan:
    """What to try: ``fault`` (its start is replaced) at each of ``moments`` [s], with ``table`` and without any.

    ``variants``: gains other than the stand's by name, each tried once. ``lost``: faults that the answer does not mend.
    ``demand``: what is asked of the outcomes, checks from (without, with).
    """

    stand: Stand
    fault: ActuatorFault
    moments: Sequence[float]
    demand: Callable[[Sequence[Outcome], Sequence[Outcome]], Sequence[Check]]
    table: Sequence[When] = TABLE
    variants: Mapping[str, Gains] = field(default_factory=dict)
    lost: Sequence[ActuatorFault] = ()
    after: float = AFTER


def run(plan: Plan, *, meta: Mapping[str, Any], progress: Progress) -> ScenarioResult:
    """All trials, one after the other, and what they add up to."""
    stand, done = plan.stand, 0
    total = 2 * (len(plan.moments) + len(plan.variants) + len(plan.lost)) + 1

    def step(text: str) -> None:
        nonlocal done
        progress(done / total, f"{done + 1} of {total}, {text}")
        done += 1

    step("learning thresholds")
    known = learnt(stand)

    def pair(label: str, stand: Stand, fault: ActuatorFault) -> Pair:
        outcomes = []
        for react in (False, True):
            step(f"{fault.joint}, {label}, {'with' if react else 'without'} an answer")
            outcomes.append(
                trial(stand, fault, known, react=react, after=plan.after, table=plan.table, meta=dict(meta))
            )
        return Pair(label, *outcomes)

    pairs = [pair(f"fault at {at:g} s", stand, replace(plan.fault, start=at)) for at in plan.moments]
    middle = plan.moments[len(plan.moments) // 2]
    varied = [
        pair(label, replace(stand, gains={**stand.gains, **gains}), replace(plan.fault, start=middle))
        for label, gains in plan.variants.items()
    ]
    lost = [pair(fault.joint, stand, replace(fault, start=middle)) for fault in plan.lost]
    return _judged(plan, known, pairs, varied, lost)


def _judged(
    plan: Plan, known: Thresholds, pairs: Sequence[Pair], varied: Sequence[Pair], lost: Sequence[Pair]
) -> ScenarioResult:
    without, answered = [p.without for p in pairs], [p.answered for p in pairs]
    shown = pairs[len(pairs) // 2]
    run, stand = shown.answered.run, plan.stand
    reasons = [reason(stand, pair) for pair in lost]
    verdict = [*plan.demand(without, answered), _nothing_before(answered)]
    return judge.result(
        run, verdict, figures=figures(plan.fault, known, stand, pairs, varied),
        robot=stand.robot(), called="with an answer", beside={"without an answer": shown.without.run},
        sections=[
            lambda result: sections.signals(result, shown, known),
            lambda result: sections.outcomes(pairs, varied),
            lambda result: sections.lost(lost, reasons),
            lambda result: sections.honesty(stand, known),
        ],
    )  # fmt: skip


def figures(
    fault: ActuatorFault, known: Thresholds, stand: Stand, pairs: Sequence[Pair], varied: Sequence[Pair]
) -> dict[str, Any]:
    """Worst over all moments: {joint, found_joint, delay_ms, with: {stands, task_rms_m}, without: {…}} and counts."""

    def summed(outcomes: Sequence[Outcome]) -> dict[str, Any]:
        return {
            "stands": all(o.stands for o in outcomes),
            "task_rms_m": max(o.rms for o in outcomes),
            "stood": sum(o.stands for o in outcomes),
            "kept_its_place": sum(o.kept for o in outcomes),
            "slip_m": max(o.slip for o in outcomes),
        }

    answered = [p.answered for p in pairs]
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
    at = int(np.searchsorted(run["t"], fault.start))
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
