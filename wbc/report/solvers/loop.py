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
from wbc.report.smoothness import joints
from wbc.report.solvers.measure import plain
from wbc.sim.scenario import Settings, find

if TYPE_CHECKING:
    from wbc.control.recorder import Run

#: Time at the start that is not judged [s]: a robot that is put down is not smooth.
SKIPPED = 0.05


def closed_loop(
    scenario: str, parameters: Mapping[str, Any], settings: Mapping[str, Any], solver: Solver
) -> dict[str, Any]:
    """Run a scenario with ``solver`` in the loop; the figures of one row. ``error`` says why there are none."""
    chosen: Any = solver  # a controller takes settings as well as names
    try:
        with redirect_stdout(stderr):
            result = find(scenario).run(parameters, Settings(**settings, solver=chosen))
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
        "jerk": jerk(run),
    }


def jerk(run: Run) -> float | None:
    """The jerk of commanded joint motion, rms over joints and ticks [rad/s³, m/s³], as docs/reports.md defines it."""
    found = joints(run) if {"a", "v_cmd"} & set(run) and run.meta.get("joint_names") else []
    if not found or run.rows * found[0].dt < 2.0 * SKIPPED:
        return None
    start = round(SKIPPED / found[0].dt)
    return plain(float(np.sqrt(np.mean([np.mean(one.jerk[start:] ** 2) for one in found]))))
