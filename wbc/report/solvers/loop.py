"""A scenario with the loop closed by one solver: what its accuracy does to the robot."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import redirect_stdout
from sys import stderr
from typing import TYPE_CHECKING, Any

import numpy as np

from wbc.errors import WbcError
from wbc.qp.solver import Solver
from wbc.report.measure import rms
from wbc.report.record import outline
from wbc.report.smoothness import joints
from wbc.report.solvers.measure import plain
from wbc.sim.joining import joined
from wbc.sim.scenario import Settings, find

if TYPE_CHECKING:
    from wbc.control.controller import Controller
    from wbc.control.recorder import Run

#: Time at the start that is not judged [s]: a robot that is put down is not smooth.
SKIPPED = 0.05


def closed_loop(
    scenario: str, parameters: Mapping[str, Any], settings: Mapping[str, Any], solver: Solver
) -> dict[str, Any]:
    """Run a scenario with ``solver`` in the loop; the figures of one row. ``error`` says why there are none, ``helped``
    in which share of the ticks the solver failed and the controller's fallback solved the problem."""
    chosen: Any = solver  # a controller takes settings as well as names
    helped: list[bool] = []
    try:
        with redirect_stdout(stderr), joined(lambda tick, ticks, control: helped.append(_helped(control))):
            result = find(scenario).run(parameters, Settings(**settings, solver=chosen))
    except WbcError as refusal:
        return {"error": str(refusal)}
    return outline(result) | {"jerk": jerk(result.run), "helped": float(np.mean(helped)) if helped else 0.0}


def _helped(controller: Controller) -> bool:
    """Whether the last tick was solved by another solver than the controller's own, which had failed."""
    return controller.last is not None and controller.last.fallback_level == "other solver"


def jerk(run: Run) -> float | None:
    """The jerk of commanded joint motion, rms over joints and ticks [rad/s³, m/s³], as docs/reports.md defines it."""
    found = joints(run) if {"a", "v_cmd"} & set(run) and run.meta.get("joint_names") else []
    if not found or run.rows * found[0].dt < 2.0 * SKIPPED:
        return None
    start = round(SKIPPED / found[0].dt)
    return plain(rms(np.array([one.jerk[start:] for one in found])))
