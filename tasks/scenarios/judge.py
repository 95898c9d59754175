"""Figures and verdict of a recorded run, the same for every scenario."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from wbc.control.recorder import Run
from wbc.models.model import RobotModel
from wbc.stack.contact import Contact
from wbc.types import Vec

#: What a limit may be exceeded by before it counts as broken, in its own unit.
TOLERANCE = 1e-6


def quiet(t: Vec, disturbed: Sequence[float], *, after: float = 1.0) -> Vec:
    """Mask of the ticks that are not within ``after`` seconds of a disturbance's start."""
    mask = np.ones(len(t), dtype=bool)
    for start in disturbed:
        mask &= ~((t >= start) & (t < start + after))
    return mask


def tracking(run: Run, mask: Vec) -> dict[str, dict[str, float]]:
    """rms and max of each task's error norm over the masked ticks, in the task's own unit."""
    found = {}
    for name, values in run.columns.items():
        if name.startswith("error.") and values.ndim == 2:
            size = np.linalg.norm(values[mask], axis=1)
            found[name.removeprefix("error.")] = {
                "rms": float(np.sqrt(np.mean(size**2))),
                "max": float(size.max()),
            }
    return found


def limit_violations(run: Run, robot: RobotModel) -> dict[str, tuple[float, str]]:
    """How far torque, speed and position were beyond the robot's limits: worst over joints and ticks, 0 if never."""
    limits, nj = robot.limits, robot.nj
    q, v = run.columns["plant.q"][:, -nj:], run.columns["plant.v"][:, -nj:]
    found = {
        "joint velocity": (float((np.abs(v) - limits.v_max).max()), "rad/s"),
        "joint position": (float(np.maximum(q - limits.q_max, limits.q_min - q).max()), "rad"),
    }
    tau = run.columns.get("tau")
    if tau is not None and np.isfinite(tau).any():
        found["torque"] = (float((np.abs(tau) - limits.tau_max).max()), "N m")
    return {kind: (max(0.0, worst), unit) for kind, (worst, unit) in found.items()}


def cone_excess(run: Run, contacts: Sequence[Contact], *, prefix: str) -> float:
    """How far wrenches were outside the cones of the contacts, worst over rows and ticks [N, N m], 0 if never.

    ``prefix`` "f." takes the commanded wrenches, "plant.f." the net ones that physics produced.
    """
    worst = 0.0
    for contact in contacts:
        wrench = run.columns[f"{prefix}{contact.name}"][:, : contact.dim]
        worst = max(worst, float((wrench @ contact.cone().T).max()))
    return worst


def slip(run: Run, contacts: Sequence[Contact]) -> float:
    """Largest distance a material contact point slid from where it was 0.3 s after the start [m]."""
    start = int(np.searchsorted(run.columns["t"], 0.3))
    return max(
        float(np.linalg.norm(path[start:] - path[start], axis=1).max(initial=0.0))
        for path in (run.columns[f"plant.slip.{c.name}"] for c in contacts)
    )


def solved_share(run: Run, statuses: Sequence[str]) -> float:
    """Share of the ticks that ended SOLVED, that is with a certified answer."""
    return float(np.mean(run.columns["status"] == list(statuses).index("SOLVED")))
