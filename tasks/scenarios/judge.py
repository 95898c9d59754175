"""What a run is judged by, beside the figures of every report (:mod:`wbc.report.measure`)."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from wbc.control.recorder import Run
from wbc.report import measure
from wbc.sim.scenario import Check
from wbc.stack.contact import Contact
from wbc.types import Vec

#: What a limit may be exceeded by before it counts as broken, in its own unit.
TOLERANCE = 1e-6
#: What a good change of contacts keeps to: step of the torques between two plans in one state [N m]; step of a normal
#: force [N per ms and kg of body mass].
PLAN_STEP, FORCE_STEP = 1.0, 0.05


def away_from(t: Vec, disturbed: Sequence[float], *, after: float = 1.0) -> NDArray[np.bool_]:
    """Mask of the ticks that are not within ``after`` seconds of a disturbance's start."""
    mask = np.ones(len(t), dtype=np.bool_)
    for start in disturbed:
        mask &= ~((t >= start) & (t < start + after))
    return mask


def slip(run: Run, contacts: Sequence[Contact]) -> float:
    """The farthest that a foot slid [m]."""
    return max(measure.slip(run, contact.name) or 0.0 for contact in contacts)


def cone_excess(run: Run, contacts: Sequence[Contact]) -> float:
    """How far the net wrenches that physics produced were outside the cones of ``contacts`` [N, N m], 0 if never."""
    worst = 0.0
    for contact in contacts:
        wrench = run[f"plant.f.{contact.name}"][:, contact.wrench_axes]
        worst = float(np.maximum(worst, (wrench @ contact.cone().T).max()))  # NaN stays NaN: it is no pass
    return worst


def certified_share(run: Run) -> float:
    """Share of the ticks that ended SOLVED, that is with a certified answer."""
    return measure.statuses(run).get("SOLVED", 0) / run.rows


def stance_slip(run: Run, contact: str, stances: Iterable[tuple[float, float]]) -> float:
    """The farthest that a foot slid within one of its ``stances``, (made, broken) [s] each [m]."""
    worst, t = 0.0, measure.times(run)
    for start, end in stances:
        path = run[f"plant.slip.{contact}"][(t >= max(start, measure.SETTLED)) & (t < end)]
        worst = max(worst, float(np.linalg.norm(path - path[:1], axis=1).max(initial=0.0)))
    return worst


def force_step(run: Run) -> float:
    """Largest change of a commanded normal force [N/ms]."""
    changes = [np.abs(np.diff(run[f"f.{contact}"][:, 2])).max(initial=0.0) for contact in run.meta["contacts"]]
    return 1e-3 * float(max(changes)) / float(run.meta["dt"])


def step_checks(plan_step: float, force_step: float) -> list[Check]:
    """Whether contacts are changed smoothly: torques [N m] and normal forces [N/ms/kg]."""
    most = FORCE_STEP + TOLERANCE
    return [
        Check("step of the torques at a change of plan", plan_step, PLAN_STEP, plan_step <= PLAN_STEP, "N m"),
        Check("step of a normal force", force_step, FORCE_STEP, force_step <= most, "N/ms/kg"),
    ]


def torque_step(run: Run, times: Iterable[float], *, within: float) -> float:
    """Largest change of a commanded torque from one tick to the next ``within`` seconds of one of ``times`` [N m]."""
    t, change = measure.times(run)[1:], np.abs(np.diff(run["tau"], axis=0)).max(axis=1)
    return max((float(change[np.abs(t - moment) <= within].max(initial=0.0)) for moment in times), default=0.0)


def common_checks(run: Run, violations: Mapping[str, tuple[float, str]]) -> list[Check]:
    """Every tick certified, no limit broken."""
    share = certified_share(run)
    checks = [Check("certified ticks", share, 1.0, share == 1.0, "share")]
    for kind, (value, unit) in violations.items():
        checks.append(Check(f"{kind} beyond its limit", value, TOLERANCE, value <= TOLERANCE, unit))
    return checks
