"""Numbers read from a recorded run: tracking errors, broken limits, use of limits, contact forces, tick times.

Columns and metadata are those of :mod:`wbc.control.recorder`. Every function answers for runs that lack a column
(a kinematic run has no torques) with an empty result.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from wbc.sim.scenario import Place
from wbc.stack.member import EFFORTS
from wbc.types import Flags, Vec

if TYPE_CHECKING:
    from wbc.control.recorder import Run

#: A robot put onto soft contacts sinks into them first; slip counts from then on [s].
SETTLED = 0.3


class TickTimes(NamedTuple):
    """Time of one tick [µs]."""

    median: float
    p99: float
    max: float


class Excess(NamedTuple):
    """By how much a limit is exceeded, ``values`` (N, k), negative within it, of k ``parts`` of the robot in the
    ``units`` of each; the plot of the report that shows it."""

    values: Vec
    units: tuple[str, ...]
    parts: tuple[str, ...]
    plot: str


class ContactTrack(NamedTuple):
    """The force at a contact over the run: f_z (N,) [N], tangential ratio (N,), CoP (N, 2) [m] or None for a point."""

    normal: Vec
    ratio: Vec
    cop: Vec | None


def clock(run: Run) -> Vec:
    """Time of each row (N,) [s] as it was given; where that is no finite number, one between those of its neighbours,
    and without any the periods from 0."""
    t, rows = np.asarray(run.columns["t"], dtype=np.float64), np.arange(len(run.columns["t"]))
    known = np.isfinite(t)
    if known.all():
        return t
    return np.interp(rows, rows[known], t[known]) if known.any() else np.multiply(rows, float(run.meta.get("dt", 1.0)))


def times(run: Run) -> Vec:
    """Time of each row (N,) [s], from 0."""
    t = clock(run)
    return t - t[0] if t.size else t


def seconds(run: Run) -> float:
    """Simulated time, N dt [s], to the nanosecond."""
    return round(len(run.columns["t"]) * float(run.meta["dt"]), 9)


def row(run: Run, t: float) -> int:
    """The row of a time t [s] from 0, at most the last."""
    return min(round(t / float(run.meta["dt"])), run.rows - 1)


def tick_times(run: Run) -> TickTimes:
    """Median, 99th percentile and maximum of the controller's tick."""
    tick = np.asarray(run.columns["tick_us"], dtype=np.float64)
    if tick.size == 0:
        return TickTimes(np.nan, np.nan, np.nan)
    return TickTimes(float(np.median(tick)), float(np.percentile(tick, 99)), float(tick.max()))


def late(run: Run) -> int:
    """How many ticks took longer than the period."""
    return int((np.asarray(run.columns["tick_us"]) > 1e6 * float(run.meta["dt"])).sum())


def statuses(run: Run) -> dict[str, int]:
    """How often each status came, by the name of the :class:`~wbc.types.Status`."""
    names = _status_names(run)
    found, counts = np.unique(np.asarray(run.columns["status"], dtype=int), return_counts=True)
    return {names[i]: int(n) for i, n in zip(found, counts, strict=True)}


def fallbacks(run: Run) -> dict[str, Flags]:
    """In which ticks (N,) each fallback level made the command; "solved" is the first one."""
    levels = enumerate(run.meta.get("fallback_levels", ()) if "fallback" in run.columns else ())
    return {name: np.asarray(run.columns["fallback"]) == k for k, name in levels}


def solved(run: Run) -> Flags:
    """Which ticks (N,) ended SOLVED, that is with a certified answer."""
    return np.asarray(np.array(_status_names(run))[np.asarray(run.columns["status"], dtype=int)] == "SOLVED")


def pushes(run: Run) -> list[tuple[float, float]]:
    """Intervals (start, end) [s] in which a force pushed the robot."""
    return intervals(run, np.linalg.norm(run.columns["push"], axis=1) > 0) if "push" in run.columns else []


def intervals(run: Run, mask: Flags) -> list[tuple[float, float]]:
    """Intervals (start, end) [s] of the rows ``mask`` (N,)."""
    t = np.append(times(run), seconds(run))
    return [(float(t[i]), float(t[j])) for i, j in spans(mask)]


def spans(mask: Flags) -> list[tuple[int, int]]:
    """First row and row after the last of every run of rows of ``mask`` (N,).

    Example:
        >>> import numpy as np
        >>> from wbc.report.measure import spans
        >>> spans(np.array([1, 1, 0, 1], dtype=bool))
        [(0, 2), (3, 4)]
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]])))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def standing(run: Run) -> dict[str, Flags]:
    """Of each contact with a force the rows (N,) on which it carries more than 1 % of its largest load."""
    tracks = {
        name: contact_track(run, name, true=True) or contact_track(run, name, true=False)
        for name in run.meta.get("contacts", {})
    }
    return {name: np.isfinite(track.ratio) for name, track in tracks.items() if track is not None}


def tasks(run: Run) -> list[str]:
    """Names of the tasks whose error was recorded."""
    return [name.removeprefix("error.") for name in run.columns if name.startswith("error.")]


def errors(run: Run, task: str) -> dict[str, Vec]:
    """The error of a task by unit: {"m": (N, 3), "rad": (N, 3)} for a frame."""
    error = np.asarray(run.columns[f"error.{task}"], dtype=np.float64).reshape(len(run.columns["t"]), -1)
    units = run.meta.get("tasks", {}).get(task, {}).get("units") or [""] * error.shape[1]
    return {unit: error[:, [i for i, u in enumerate(units) if u == unit]] for unit in dict.fromkeys(units)}


def rms(values: Vec) -> float:
    """Root of the mean of the squares; NaN of no values."""
    return float(np.sqrt(np.mean(np.square(values)))) if np.size(values) else float("nan")


def tracking(run: Run, *, keep: Flags | None = None) -> dict[str, dict[str, float]]:
    """{task: {"rms", "max"}} of the Euclidean norm of the error, over the rows ``keep`` (N,).

    A task with two units gives two entries, the second named "task [unit]".
    """
    result: dict[str, dict[str, float]] = {}
    for task in tasks(run):
        for unit, error in errors(run, task).items():
            norm = np.linalg.norm(error if keep is None else error[keep], axis=1)
            name = f"{task} [{unit}]" if task in result else task
            result[name] = {"rms": rms(norm), "max": float(norm.max(initial=0.0))}
    return result


def joint_state(run: Run) -> tuple[Vec, Vec]:
    """Joint positions and velocities (N, nj) each: the plant's own where it was recorded."""
    q = np.asarray(run.columns.get("plant.q", run.columns["q"]), dtype=np.float64)
    v = np.asarray(run.columns.get("plant.v", run.columns["v"]), dtype=np.float64)
    nj = len(run.meta["joint_names"])
    return q[:, q.shape[1] - nj :], v[:, v.shape[1] - nj :]


def limits(run: Run) -> dict[str, Vec]:
    """The robot's limits (nj,) each: q_min, q_max, v_max, tau_max; ±inf where there is none."""
    nj = len(run.meta["joint_names"])
    none = {"q_min": -np.inf, "q_max": np.inf, "v_max": np.inf, "tau_max": np.inf}
    given: Mapping[str, Any] = run.meta.get("limits", {})
    result = {}
    for name, default in none.items():
        values = given.get(name) or [None] * nj
        result[name] = np.array([default if x is None else float(x) for x in values])
    return result


def torques(run: Run) -> Vec | None:
    """Torques (N, nj): those that drives gave, or else those that were commanded; None where there were none."""
    tau = run.columns.get("plant.tau", run.columns.get("tau"))
    return None if tau is None or not np.isfinite(tau).any() else np.asarray(tau, dtype=np.float64)


def use(run: Run) -> dict[str, Vec]:
    """Share of each limit in use (N, nj): torque |τ|/τ_max, velocity |v|/v_max, position |q − centre|/half range.

    A row without a number, from a tick that went wrong, counts as no use.
    """
    bound, (q, v) = limits(run), joint_state(run)
    result = {}
    tau = torques(run)
    if tau is not None:
        result["torque"] = np.abs(tau) / _positive(bound["tau_max"])
    result["velocity"] = np.abs(v) / _positive(bound["v_max"])
    bounded = np.isfinite(bound["q_min"]) & np.isfinite(bound["q_max"])
    low, high = (np.where(bounded, bound[name], 0.0) for name in ("q_min", "q_max"))
    centre, half = 0.5 * (low + high), np.where(bounded, 0.5 * (high - low), np.inf)
    result["position"] = np.abs(q - centre) / _positive(half)
    return {kind: np.nan_to_num(share, nan=0.0) for kind, share in result.items()}


def excesses(run: Run) -> dict[str, Excess]:
    """By how much torque, velocity, position and contact cone are exceeded over the run, by kind of limit.

    Position and velocity are the true state's, wrench and torque the command's, or the torque that drives gave.
    """
    bound, (q, v) = limits(run), joint_state(run)
    names = tuple(run.meta["joint_names"])
    units = tuple(run.meta.get("joint_units", ["rad"] * len(names)))
    speeds, efforts = tuple(f"{unit}/s" for unit in units), tuple(EFFORTS[unit] for unit in units)
    found = {
        "joint velocity": Excess(np.abs(v) - bound["v_max"], speeds, names, "velocities"),
        "joint position": Excess(np.maximum(q - bound["q_max"], bound["q_min"] - q), units, names, "positions"),
    }
    tau = torques(run)
    if tau is not None:
        found["torque"] = Excess(np.abs(tau) - bound["tau_max"], efforts, names, "torques")
    cones = {}
    for name, contact in run.meta.get("contacts", {}).items():
        cone = np.array(contact.get("cone") or [], dtype=np.float64)
        if cone.size and f"f.{name}" in run.columns:
            cones[name] = (run.columns[f"f.{name}"][:, : cone.shape[1]] @ cone.T).max(axis=1)
    if cones:
        beyond = np.column_stack(list(cones.values()))
        found["commanded wrench"] = Excess(beyond, ("N",) * len(cones), tuple(cones), "forces")
    return found


def violations(run: Run) -> dict[str, tuple[float, str]]:
    """{kind: (worst, unit)}: by how much each limit of :func:`excesses` was exceeded at worst, 0 if never."""
    broken = {}
    for kind, found in excesses(run).items():
        worst = np.nan_to_num(found.values, nan=-np.inf).max(axis=0, initial=-np.inf)
        broken[kind] = float(worst.max(initial=0.0)), found.units[int(worst.argmax())] if found.units else ""
    return broken


def place(run: Run, values: Vec, bound: float, parts: Sequence[str] = (), plot: str = "") -> Place:
    """Where ``values`` (N, k) of ``parts`` first exceed ``bound``, or else are largest; nowhere without values."""
    rows = np.nan_to_num(values.reshape(len(values), -1), nan=-np.inf)
    if not rows.size or not np.isfinite(rows).any():
        return Place(plot=plot)
    worst = rows.max(axis=1)
    row = int(np.argmax(worst > bound)) if (worst > bound).any() else int(np.argmax(worst))
    return Place(float(times(run)[row]), parts[int(np.argmax(rows[row]))] if parts else "", plot)


def contact_track(run: Run, name: str, *, true: bool) -> ContactTrack | None:
    """Normal force, tangential ratio and centre of pressure of a contact; None where it was not recorded.

    The ratio √(f_x² + f_y²) / f_z is NaN while the contact carries less than 1 % of its largest load. CoP =
    (−m_y, m_x) / f_z.
    """
    column = f"plant.f.{name}" if true else f"f.{name}"
    if column not in run.columns:
        return None
    f = np.asarray(run.columns[column], dtype=np.float64)
    loaded = f[:, 2] > 0.01 * max(float(np.nanmax(f[:, 2], initial=0.0)), 1e-9)
    normal = np.where(loaded, f[:, 2], np.nan)
    tangential = np.hypot(f[:, 0], f[:, 1])
    sole = f.shape[1] == 6 and bool(run.meta.get("contacts", {}).get(name, {}).get("half_size"))
    cop = np.column_stack([-f[:, 4], f[:, 3]]) / normal[:, None] if sole else None
    return ContactTrack(f[:, 2], tangential / normal, cop)


def slid(run: Run, name: str) -> Vec | None:
    """How far the contact's material point is from where it had settled (N,) [m]; None where it was not recorded."""
    column = run.columns.get(f"plant.slip.{name}")
    if column is None:
        return None
    path, first = np.asarray(column, dtype=np.float64), int(np.searchsorted(times(run), SETTLED))
    if first >= len(path):
        return np.zeros(len(path))
    return np.where(np.arange(len(path)) < first, 0.0, np.linalg.norm(path - path[first], axis=1))


def slip(run: Run, name: str) -> float | None:
    """How far the contact's material point slid from where it had settled [m]; None where it was not recorded."""
    way = slid(run, name)
    return None if way is None else float(way.max(initial=0.0))


def _status_names(run: Run) -> list[str]:
    return [str(name).upper().replace(" ", "_") for name in run.meta["statuses"]]


def _positive(values: Vec) -> Vec:
    """A limit of 0 in a model is no limit anybody kept: it counts as none."""
    return np.where(values > 0, values, np.inf)
