"""How smooth a recorded motion is: jerk, power of the command at high frequencies, time at rest while a target moves.

Everything is measured of joints, and of task points: the origin of a frame, or the centre of mass, whose place a task
is about. The definitions stand in ``docs/reports.md``.
"""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple, final

import numpy as np

from wbc.report import measure
from wbc.report.motion import points as tasks_with_a_point
from wbc.types import Vec

if TYPE_CHECKING:
    from wbc.control.recorder import Run
    from wbc.models.model import RobotModel, RobotState

#: Power of the command above this frequency [Hz] is no motion that was meant, but shaking.
SHAKING = 3.0
#: A share of power needs a run of as many seconds: three periods of the frequency.
SHORTEST = 3.0 / SHAKING
#: At rest is what is slower than the first part of the target's mean speed, moving a target faster than the second.
RESTS, MOVES = 0.01, 0.1
#: A target that moves again within this time [s] moves meanwhile: a stream of samples is no sequence of rests.
PAUSE = 0.1


@final
class Moved(NamedTuple):
    """One joint or task point over the run.

    ``command`` (N, k): acceleration [unit/s²], or velocity [unit/s] where ``order`` is 2; ``jerk`` (N − order, k)
    [unit/s³]; ``freeze`` [s], NaN where no target moves.
    """

    name: str
    unit: str
    order: int
    dt: float
    command: Vec
    jerk: Vec
    freeze: float

    @property
    def jerk_size(self) -> Vec:
        """Euclidean norm of the jerk (N − order,) [unit/s³]."""
        return np.asarray(np.linalg.norm(self.jerk, axis=1))

    @property
    def command_rms(self) -> float:
        """Root of the mean square of the command's norm."""
        return measure.rms(np.linalg.norm(self.command, axis=1))

    @property
    def jerk_rms(self) -> float:
        """Root of the mean square of the jerk's norm [unit/s³]."""
        return measure.rms(self.jerk_size)

    @property
    def shaking(self) -> float:
        """Share of the command's power above 3 Hz, NaN where it cannot be said."""
        frequency, power = spectrum(self.command, self.dt)
        whole = float(power.sum())
        if len(self.command) * self.dt < SHORTEST or whole == 0.0:
            return float("nan")
        return float(power[frequency > SHAKING].sum()) / whole


def joints(run: Run) -> list[Moved]:
    """Every joint, in the order of the robot."""
    names = list(run.meta["joint_names"])
    units = run.meta.get("joint_units") or [""] * len(names)
    column, order = _command(run)
    if len(run[column]) <= order or not names:
        return []
    command = filled(run[column][:, -len(names) :])
    jerk = derived(command, order, _dt(run))
    actual, told = measure.joint_state(run)[0], np.asarray(run["q"], dtype=float)[:, -len(names) :]
    freezes = np.full(len(names), np.nan)
    for task, about in run.meta.get("tasks", {}).items():
        for k, label in enumerate(about.get("labels") or ()):
            if label in names and f"error.{task}" in run:
                i, error = names.index(label), run[f"error.{task}"][:, k]
                if error.any():
                    found = freeze(actual[:, [i]], (told[:, i] + error)[:, None], _dt(run))
                    freezes[i] = np.fmax(freezes[i], found)
    return [
        Moved(name, unit, order, _dt(run), command[:, [i]], jerk[:, [i]], float(freezes[i]))
        for i, (name, unit) in enumerate(zip(names, units, strict=True))
    ]


def points(run: Run, robot: RobotModel | None) -> list[Moved]:
    """The point of every task that is about the place of one, along the task's axes; none without a robot."""
    column, order = _command(run)
    wanted = {} if robot is None else tasks_with_a_point(run, robot)
    if robot is None or not wanted or len(run[column]) <= order:
        return []
    state, dt = robot.state(), _dt(run)
    frames = list(dict.fromkeys(frame for frame, _ in wanted.values()))
    told = {frame: np.empty((run.rows, 3)) for frame in frames}
    commands = {frame: np.empty((run.rows, 3)) for frame in frames}
    for k, (q, v, x) in enumerate(zip(filled(run["q"]), filled(run["v"]), filled(run[column]), strict=True)):
        state.update(0.0, q, v)
        for frame in frames:
            position, jacobian, drift = _point(state, frame)
            told[frame][k] = position
            commands[frame][k] = jacobian @ x + (drift if column == "a" else 0.0)
    actual = told
    if "plant.q" in run:
        actual = {frame: np.empty((run.rows, 3)) for frame in frames}
        for k, q in enumerate(filled(run["plant.q"])):
            state.update(0.0, q, np.zeros(robot.nv))
            for frame in frames:
                actual[frame][k] = _point(state, frame)[0]
    found = []
    for task, (frame, rows) in wanted.items():
        axes = list(rows)
        target = told[frame][:, axes] + filled(run[f"error.{task}"][:, list(rows.values())])
        command = commands[frame][:, axes]
        jerk = derived(command, order, dt)
        found.append(Moved(task, "m", order, dt, command, jerk, freeze(actual[frame][:, axes], target, dt)))
    return found


def derived(command: Vec, order: int, dt: float) -> Vec:
    """The jerk of a command (N, k), by differences over ticks: ȧ of accelerations, v̈ of velocities."""
    return np.asarray(np.diff(command, n=order, axis=0)) / dt**order


def spectrum(signal: Vec, dt: float) -> tuple[Vec, Vec]:
    """Frequencies (m,) [Hz] above zero and the power of a signal (N, k) at each, all columns added.

    The periodogram of the signal minus its mean, under a Hann window.

    Example:
        >>> import numpy as np
        >>> from wbc.report.smoothness import spectrum
        >>> t = np.arange(4000) * 1e-3
        >>> frequency, power = spectrum(np.sin(2 * np.pi * 5.0 * t)[:, None], 1e-3)
        >>> float(frequency[power.argmax()])
        5.0
    """
    n = len(signal)
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * (np.arange(n) + 0.5) / n)
    transformed = np.fft.rfft((signal - signal.mean(axis=0)) * window[:, None], axis=0)
    power: Vec = np.sum(np.square(np.abs(transformed)), axis=1)
    frequency: Vec = np.arange(1, len(power)) / (n * dt)
    return frequency, power[1:]


def freeze(position: Vec, target: Vec, dt: float) -> float:
    """The longest time [s] for which ``position`` (N, k) rests while ``target`` (N, k) moves; NaN: it never does."""
    if len(target) < 2:
        return float("nan")
    speed, wanted = (np.linalg.norm(np.diff(x, axis=0), axis=1) / dt for x in (position, target))
    mean = float(wanted.mean())
    # What moves by less than half the digits of its place is rounded, not moved.
    if float(np.ptp(target, axis=0).max()) <= np.sqrt(np.finfo(float).eps) * (1.0 + float(np.abs(target).max())):
        return float("nan")
    moves = wanted > MOVES * mean
    places = np.flatnonzero(moves)
    for i, j in pairwise(places):
        if (j - i) * dt <= PAUSE:
            moves[i:j] = True
    return max((end - start for start, end in measure.spans(moves & (speed < RESTS * mean))), default=0) * dt


def filled(values: Vec) -> Vec:
    """Columns (N, k) whose rows without a number, of ticks that went wrong, are what lies between their neighbours."""
    result = np.array(values, dtype=float)
    rows = np.arange(len(result))
    for column in result.T:
        known = np.isfinite(column)
        if not known.all():
            column[:] = np.interp(rows, rows[known], column[known]) if known.any() else 0.0
    return result


def _dt(run: Run) -> float:
    return float(run.meta["dt"])


def _command(run: Run) -> tuple[str, int]:
    """The column with the command, and how often it is to be derived to be a jerk: ȧ or v̈."""
    return ("a", 1) if "a" in run else ("v_cmd" if "v_cmd" in run else "v", 2)


def _point(state: RobotState, frame: str) -> tuple[Vec, Vec, Vec]:
    """Place, Jacobian and drift of a frame's origin, or of the centre of mass."""
    if not frame:
        return state.com, state.com_jacobian, state.com_drift
    there = state.frame(frame)
    return there.position, there.jacobian()[:3], there.linear_drift()
