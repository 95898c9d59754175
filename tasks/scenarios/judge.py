"""What a run is judged by, beside the figures of every report (:mod:`wbc.report.measure`)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from wbc.control.recorder import Run
from wbc.errors import InvalidInput
from wbc.models.collision import Obstacle
from wbc.report import measure
from wbc.report.document import Bound, Curve, Plot
from wbc.sim.scenario import Check, Place, ScenarioResult, Trial
from wbc.stack.contact import Contact
from wbc.types import Vec

from ..components.contact_schedule import ContactSchedule
from ..limits.collision import CollisionAvoidance

#: What a limit may be exceeded by before it counts as broken, in its own unit.
TOLERANCE = 1e-6
#: What a good change of contacts keeps to: step of the torques between two plans in one state [N m]; step of a normal
#: force [N per ms and kg of body mass].
PLAN_STEP, FORCE_STEP = 1.0, 0.05
#: How long after a foot is down an impact's effect on the torques is looked for [s].
IMPACT = 0.02


def away_from(t: Vec, disturbed: Sequence[float], *, after: float = 1.0) -> NDArray[np.bool_]:
    """Mask of the ticks that are not within ``after`` seconds of a disturbance's start."""
    mask = np.ones(len(t), dtype=np.bool_)
    for start in disturbed:
        mask &= ~((t >= start) & (t < start + after))
    return mask


def stood_check(run: Run, duration: float, *, through: str = "") -> Check:
    """That the robot stays up for ``duration`` [s]; its place is where it fell."""
    stood = measure.seconds(run)
    place = Place(plot="com") if stood >= duration else Place(stood, plot="com")
    return Check(f"stays up{through}", stood, ">=", duration, "s", place)


def slip_check(text: str, run: Run, slid: Mapping[str, Vec], bound: float) -> Check:
    """That no foot slides as far as ``bound`` [m]; ``slid`` (N,) [m] of each contact, over the run."""
    ways = np.column_stack(list(slid.values()))
    place = measure.place(run, ways, bound, list(slid), "slip")
    return Check(text, float(ways.max(initial=0.0)), "<", bound, "m", place)


def slid(run: Run, contacts: Sequence[Contact]) -> dict[str, Vec]:
    """How far each foot is from where it had settled (N,) [m]."""
    found = {contact.name: measure.slid(run, contact.name) for contact in contacts}
    return {name: np.zeros(run.rows) if way is None else way for name, way in found.items()}


def cone_excess(run: Run, contacts: Sequence[Contact]) -> Vec:
    """How far the net wrenches that physics produced were outside the cones of k ``contacts`` (N, k) [N, N m]."""
    wrenches = [(run[f"plant.f.{contact.name}"][:, contact.wrench_axes], contact.cone()) for contact in contacts]
    return np.column_stack([(wrench @ cone.T).max(axis=1) for wrench, cone in wrenches])


def certified_share(run: Run) -> float:
    """Share of the ticks that ended SOLVED, that is with a certified answer."""
    return float(measure.solved(run).mean())


def stance_slid(run: Run, contact: str, stances: Iterable[tuple[float, float]]) -> Vec:
    """How far a foot slid since it stands (N,) [m], within each of its ``stances``, (made, broken) [s]; 0 between."""
    slid, t = np.zeros(run.rows), measure.times(run)
    for start, end in stances:
        stands = (t >= max(start, measure.SETTLED)) & (t < end)
        path = run[f"plant.slip.{contact}"][stands]
        slid[stands] = np.linalg.norm(path - path[:1], axis=1)
    return slid


def force_step(run: Run) -> float:
    """Largest change of a commanded normal force [N/ms]."""
    changes = [np.abs(np.diff(run[f"f.{contact}"][:, 2])).max(initial=0.0) for contact in run.meta["contacts"]]
    return 1e-3 * float(max(changes)) / float(run.meta["dt"])


def stepping(
    run: Run, mass: float, timeline: Sequence[tuple[float, Iterable[str]]], downs: Iterable[float], slip: float
) -> tuple[dict[str, Any], list[Check]]:
    """Figures and checks of a robot of ``mass`` [kg] whose feet stand by ``timeline`` and land at ``downs`` [s].

    A foot that stands slides less than ``slip`` [m]; torques and normal forces change smoothly with the contacts.
    """
    stances = ContactSchedule(timeline)
    names = {contact["frame"]: name for name, contact in run.meta["contacts"].items()}
    slid = {name: stance_slid(run, name, stances.holds(frame)) for frame, name in names.items()}
    check = slip_check("slip of a foot while it stands", run, slid, slip)
    plan_step, step = float(np.abs(run["signal.PlanStep.tau"]).max()), force_step(run) / mass
    figures = {
        "fell": bool(run.meta["fallen"]),
        "plan_torque_step_Nm": plan_step,
        "impact_torque_step_Nm": torque_step(run, downs, within=IMPACT),
        "normal_force_step_N_per_ms_kg": step,
        "slip_m": check.value,
        "certified_share": certified_share(run),
    }
    return figures, [
        check,
        Check("step of the torques at a change of plan", plan_step, "<=", PLAN_STEP, "N m"),
        Check("step of a normal force", step, "<=", FORCE_STEP + TOLERANCE, "N/ms/kg"),
    ]


def torque_step(run: Run, times: Iterable[float], *, within: float) -> float:
    """Largest change of a commanded torque from one tick to the next ``within`` seconds of one of ``times`` [N m]."""
    t, change = measure.times(run)[1:], np.abs(np.diff(run["tau"], axis=0)).max(axis=1)
    return max((float(change[np.abs(t - moment) <= within].max(initial=0.0)) for moment in times), default=0.0)


def error_check(text: str, run: Run, task: str, bound: float, keep: NDArray[np.bool_]) -> Check:
    """That the rms of a task's error [m] over the ticks ``keep`` (N,) is below ``bound``. Its place: the worst tick."""
    error = np.where(keep, np.linalg.norm(run[f"error.{task}"], axis=1), 0.0)
    worst = measure.place(run, error, np.inf, plot=f"tracking.{task}")
    return Check(text, measure.rms(error[keep]), "<", bound, "m", worst)


def verdict(shown: Trial | Sequence[Trial], checks: Sequence[Check], **fields: Any) -> ScenarioResult:
    """What a scenario hands back: it is good where all ``checks`` hold.

    The first trial that is ``shown`` is recorded, and the others beside it. ``fields`` are those of
    :class:`~wbc.sim.scenario.ScenarioResult`; tracking and violations are measured where they are not given, and the
    obstacles are those of the stacks' :class:`~wbc.tasks.CollisionAvoidance`.

    Raises:
        InvalidInput: no trial is shown.
    """
    trials = [shown] if isinstance(shown, Trial) else list(shown)
    if not trials:
        raise InvalidInput("no trial is shown: those that judge is given can be taken once; pass on what was taken")
    first, *others = trials
    made: dict[str, Any] = {
        "violations": measure.violations(first.run), "tracking": measure.tracking(first.run), "robot": first.robot,
        "called": first.name if others else "", "beside": {trial.name: trial.run for trial in others},
        "obstacles": avoided([first, *others]),
    }  # fmt: skip
    return ScenarioResult(run=first.run, ok=all(check.ok for check in checks), verdict=checks, **made | fields)


def avoided(trials: Iterable[Trial]) -> list[Obstacle]:
    """The obstacles that the stacks of ``trials`` keep away from, each name once."""
    limits = [limit for trial in trials for limit in trial.setup.stack.subject_to]
    found = [one for limit in limits if isinstance(limit, CollisionAvoidance) for one in limit.obstacles]
    return list({obstacle.name: obstacle for obstacle in found}.values())


def beside(
    name: str, title: str, unit: str, trials: Sequence[Trial], values: Callable[[Trial], Vec],
    *, bounds: Sequence[Bound] = (), replays: bool = True, **more: Any,
) -> Plot:  # fmt: skip
    """A plot of one quantity, ``values`` (N,) of each trial; the first one is recorded.

    ``replays``: whether the others are recorded beside it, so that a curve and a robot belong together.
    """
    curves = [
        Curve(trial.name, values(trial), run=k if replays else None, x=measure.times(trial.run))
        for k, trial in enumerate(trials)
    ]
    return Plot(name, title, unit, measure.times(trials[0].run), curves, bounds, **more)


def common_checks(run: Run) -> list[Check]:
    """Every tick certified, no limit broken."""
    share, missed = certified_share(run), ~measure.solved(run)
    where = measure.place(run, missed.astype(float), 0.5, plot="certificate") if missed.any() else Place()
    checks, found = [Check("certified ticks", share, "=", 1.0, "share", where)], measure.excesses(run)
    for kind, (value, unit) in measure.violations(run).items():
        excess = found.get(kind)
        place = Place() if excess is None else measure.place(run, excess.values, TOLERANCE, excess.parts, excess.plot)
        checks.append(Check(f"{kind} beyond its limit", value, "<=", TOLERANCE, unit, place))
    return checks
