"""How good a run was, recomputed from its record with Pinocchio alone: nothing of the controller is trusted.

Figures are floats of three digits, errors in m and rad; None where a run was too short to say.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
import pinocchio as pin

from wbc.sim.scenario import Trial
from wbc.types import Mat, Vec

from .robots import MadeRobot

#: Errors of one tick: gets Pinocchio's data, with frames and centre of mass up to date, and the tick.
Errors = Callable[[Any, int], tuple[float, ...]]


@dataclass(frozen=True)
class Support(ABC):
    """What the contact of a frame can give: rows of its Jacobian and the violation of its friction cone."""

    frame: str
    friction: float

    @abstractmethod
    def jacobian(self, model: Any, data: Any, frame: int) -> Mat:
        """(3 or 6, nv), in the axes in which its wrench is given."""

    @abstractmethod
    def violation(self, wrench: Vec) -> float:
        """By how much a wrench leaves the cone [N, N m]; negative inside."""


@final
@dataclass(frozen=True)
class PointSupport(Support):
    """A point on level ground: force in world axes, |f_x|, |f_y| <= µ f_z."""

    def jacobian(self, model: Any, data: Any, frame: int) -> Mat:
        return np.asarray(pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)[:3])

    def violation(self, wrench: Vec) -> float:
        f_x, f_y, f_z = wrench
        return float(max(abs(f_x) - self.friction * f_z, abs(f_y) - self.friction * f_z, -f_z))


@final
@dataclass(frozen=True)
class SoleSupport(Support):
    """A rectangular sole: wrench in the sole's axes, pyramid on the net force, centre of pressure inside."""

    half_size: tuple[float, float]

    def jacobian(self, model: Any, data: Any, frame: int) -> Mat:
        return np.asarray(pin.getFrameJacobian(model, data, frame, pin.LOCAL))

    def violation(self, wrench: Vec) -> float:
        f_x, f_y, f_z, m_x, m_y = wrench[:5]
        x, y = self.half_size
        slip = max(abs(f_x), abs(f_y)) - self.friction * f_z
        return float(max(slip, -f_z, abs(m_x) - y * f_z, abs(m_y) - x * f_z))


def tracking_of_velocities(
    made: MadeRobot, trial: Trial, errors: Errors, *, names: Sequence[str], step_time: float, every: int = 10
) -> dict[str, Any]:
    """Limits kept and errors left by commanded velocities.

    The state behind tick k should meet the target of tick k. The rms is over the two thirds of the time before
    ``step_time`` [s] that lie behind the ramp. ``ms_after_step_to_1cm``: from when on the first error is below 1 cm.
    """
    model, nj, dt, ticks = made.reference, made.robot.nj, trial.setup.plant.dt, trial.run.rows
    q, v = _states(trial)
    speed, limit = np.abs(v[1:, -nj:]), model.velocityLimit[-nj:]
    reached = q[1:, -nj:]
    low, high = model.lowerPositionLimit[-nj:], model.upperPositionLimit[-nj:]
    figures: dict[str, Any] = {
        "vel_viol_max": _positive(speed - limit),
        "vel_use_max": (speed / limit).max(),
        "pos_viol_max": _positive(np.maximum(reached - high, low - reached)),
    }
    data = model.createData()
    samples = []
    for k in _sampled(ticks, every):
        pin.centerOfMass(model, data, q[k + 1])
        pin.updateFramePlacements(model, data)
        samples.append(errors(data, k))
    found = np.array(samples)
    until = int(step_time / dt / every)
    for name, error in zip(names, found.T, strict=True):
        figures[f"{name}_final"] = error[-1]
        figures[f"{name}_rms_before_step"] = _rms(error[until // 3 : until])
    near = np.flatnonzero(found[until:, 0] < 0.01)
    return _rounded(figures) | {"ms_after_step_to_1cm": int(near[0] * every * dt * 1e3) if len(near) else None}


def tracking_of_accelerations(
    made: MadeRobot, trial: Trial, supports: Sequence[Support], errors: Errors, every: int = 20
) -> dict[str, Any]:
    """Limits and cones kept, equations of motion, and errors (position, orientation) of inverse dynamics.

    The equations of motion M a + h = Sᵀ τ + Jᵀ f and the errors are looked at on every ``every``-th tick, everything
    else on all.
    """
    model, nj, run = made.reference, made.robot.nj, trial.run
    (q, v), tau, a = _states(trial), run["tau"], run["a"]
    wrenches = [run[f"f.{contact.name}"] for contact in trial.setup.stack.contacts]
    tau_max, v_max = model.effortLimit[-nj:], model.velocityLimit[-nj:]
    figures: dict[str, Any] = {
        "tau_viol_max_Nm": _positive(np.abs(tau) - tau_max),
        "vel_viol_max": _positive(np.abs(v[1:, -nj:]) - v_max),
        "tau_use_max": (np.abs(tau) / tau_max).max(),
        "vel_use_max": (np.abs(v[:-1, -nj:]) / v_max).max(),
    }
    data = model.createData()
    frames = [model.getFrameId(support.frame) for support in supports]
    pin.framesForwardKinematics(model, data, q[0])
    anchors = [data.oMf[frame].translation.copy() for frame in frames]
    residual = drift = 0.0
    samples = []
    for k in _sampled(run.rows, every):
        pin.computeAllTerms(model, data, q[k], v[k])
        pin.updateFramePlacements(model, data)
        missing = pin.crba(model, data, q[k], pin.Convention.WORLD) @ a[k] + data.nle
        missing[-nj:] -= tau[k]
        for support, frame, anchor, wrench in zip(supports, frames, anchors, wrenches, strict=True):
            missing -= support.jacobian(model, data, frame).T @ wrench[k]
            drift = max(drift, float(np.linalg.norm(data.oMf[frame].translation - anchor)))
        residual = max(residual, float(np.abs(missing).max()))
        samples.append(errors(data, k))
    if supports:
        worst = max(s.violation(f) for s, forces in zip(supports, wrenches, strict=True) for f in forces)
        figures["friction_viol_max_N"] = max(0.0, worst)
        figures["contact_drift_max_m"] = drift
    position, orientation = np.array(samples).T
    half = position[len(position) // 2 :]
    figures |= {
        "dyn_residual_max": residual,
        "pos_err_final_m": position[-1],
        "ori_err_final_rad": orientation[-1],
        "pos_err_rms2ndhalf_m": _rms(half),
        "pos_err_max2ndhalf_m": half.max(),
    }
    return _rounded(figures)


def _states(trial: Trial) -> tuple[Vec, Vec]:
    """The states q (N + 1, nq) and v (N + 1, nv) of a run, the last one behind the last tick."""
    run, plant = trial.run, trial.setup.plant
    return np.vstack([run["q"], plant.q]), np.vstack([run["v"], plant.v])


def distance(target: Vec, actual: Vec) -> float:
    """Between two points [m]."""
    return float(np.linalg.norm(target - actual))


def angle(target: Mat, actual: Mat) -> float:
    """Of the rotation from ``actual`` to ``target`` [rad]."""
    return float(np.linalg.norm(pin.log3(np.asarray(target) @ np.asarray(actual).T)))


def _sampled(ticks: int, every: int) -> list[int]:
    """Each ``every``-th tick and the last."""
    return sorted({*range(0, ticks, every), ticks - 1})


def _positive(excess: Vec) -> float:
    return max(0.0, float(excess.max()))


def _rms(error: Vec) -> float | None:
    return float(np.sqrt(np.mean(error**2))) if len(error) else None


def _rounded(figures: dict[str, Any]) -> dict[str, Any]:
    return {name: None if value is None else float(f"{value:.3g}") for name, value in figures.items()}
