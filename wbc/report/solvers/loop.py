"""A scenario with the loop closed by one solver: what its accuracy does to the robot."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import redirect_stdout
from sys import stderr
from typing import TYPE_CHECKING, Any

import numpy as np

from wbc.errors import WbcError
from wbc.qp.solver import Solver
from wbc.report import measure
from wbc.report.solvers.measure import plain
from wbc.sim.scenario import find, silent
from wbc.types import Vec

if TYPE_CHECKING:
    from wbc.control.recorder import Run

#: Motion of a robot's links ends well below; what is above is chatter [Hz].
CHATTER = 30.0
#: Ticks at the start that are not judged: a robot that is put down is not smooth.
SKIPPED = 0.05


def closed_loop(
    scenario: str, parameters: Mapping[str, Any], settings: Mapping[str, Any], solver: Solver
) -> dict[str, Any]:
    """Run a scenario with ``solver`` in the loop; the figures of one row. ``error`` says why there are none."""
    chosen: Any = solver  # a controller takes settings as well as names
    try:
        with redirect_stdout(stderr):
            result = find(scenario).run(parameters, solver=chosen, progress=silent, **settings)
    except WbcError as refusal:
        return {"error": str(refusal)}
    run = result.run
    tick = np.asarray(run["tick_us"], dtype=np.float64) if "tick_us" in run else np.full(max(run.rows, 1), np.nan)
    return {
        "error": None,
        "ok": bool(result.ok),
        "ended": str(run.meta.get("ended", "complete")),
        "ticks": run.rows,
        "solved": measure.statuses(run).get("SOLVED", 0) if "statuses" in run.meta else None,
        "tracking": {task: plain(float(value["rms"])) for task, value in result.tracking.items()},
        "violations": {kind: [plain(float(worst)), unit] for kind, (worst, unit) in result.violations.items()},
        "tick_us": [plain(float(x)) for x in (np.median(tick), np.percentile(tick, 99), tick.max())],
        "late": int((tick > 1e6 * float(run.meta.get("dt", np.inf))).sum()),
        **smoothness(run),
    }


def smoothness(run: Run) -> dict[str, Any]:
    """``jerk``: rms of the change of commanded joint acceleration [rad/s³, m/s³]; ``chatter``: rms of the command above
    30 Hz, of torques [N m] where there are any, of accelerations [rad/s²] else, and its ``chatter_unit``.

    Accelerations are the command's, or differences of commanded velocities where it has none.
    """
    empty = {"jerk": None, "chatter": None, "chatter_unit": ""}
    dt, nj = float(run.meta.get("dt", np.nan)), len(run.meta.get("joint_names", ()))
    start = round(SKIPPED / dt) if dt > 0 else 0
    if not nj or run.rows < start + 64 or not {"a", "v_cmd"} & set(run):
        return empty
    if "a" in run:
        acceleration = np.asarray(run["a"])[start:, -nj:]
    else:
        acceleration = np.diff(np.asarray(run["v_cmd"])[start:, -nj:], axis=0) / dt
    torques = measure.has_torques(run)
    command = np.asarray(run["tau"])[start:] if torques else acceleration
    if not (np.isfinite(command).all() and np.isfinite(acceleration).all()):
        return empty
    return {
        "jerk": plain(_rms(np.diff(acceleration, axis=0) / dt)),
        "chatter": plain(chatter(command, dt)),
        "chatter_unit": "N m" if torques else "rad/s²",
    }


def chatter(signal: Vec, dt: float) -> float:
    """rms over all columns of signal (N, k) of what lies above 30 Hz, from its spectrum under a Hann window.

    Example:
        >>> import numpy as np
        >>> from wbc.report.solvers.loop import chatter
        >>> t = np.arange(4000) * 1e-3
        >>> signal = np.sin(2 * np.pi * 2 * t) + 0.1 * np.sin(2 * np.pi * 100 * t)
        >>> round(chatter(signal[:, None], 1e-3), 3)  # 0.1 / √2
        0.071
    """
    n = len(signal)
    window = np.hanning(n)
    spectrum = np.fft.rfft((signal - signal.mean(axis=0)) * window[:, None], axis=0)
    power = np.abs(spectrum) ** 2
    above = np.fft.rfftfreq(n, dt) > CHATTER
    # Parseval: each line of a one-sided spectrum stands for two.
    return float(np.sqrt(2.0 * power[above].sum() / (n * (window**2).sum() * signal.shape[1])))


def _rms(values: Vec) -> float:
    return float(np.sqrt(np.mean(values**2)))
