"""Thresholds: from when on a residual is a fault, joint by joint, from a run without one or from sensors' noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import numpy as np

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.errors import InvalidInput
from wbc.models.model import RobotState
from wbc.types import Mat, Vec

#: How many standard deviations of noise, how much of the largest slow part, and how slow that is [s].
SIGMAS, SLOW_PART, WINDOW = 7.0, 1.5, 0.2


@final
@dataclass(frozen=True, eq=False)
class Thresholds(metaclass=TellsArguments):
    """``value`` (nj,) for :class:`~tasks.components.momentum_observer.MomentumObserver`, ``noise`` (nj,) of one tick's
    missing torques for :class:`~tasks.components.fault_reaction.FaultReaction`; and of the residual its ``deviation``
    about means over 0.2 s and the largest of these, ``slow`` (nj,). All [N m, N]."""

    value: Vec
    noise: Vec
    deviation: Vec
    slow: Vec

    @classmethod
    def learnt(cls, residual: Any, *, gain: Any, dt: float, floor: Any = 0.0) -> Thresholds:
        """From the residuals (N, nj) of a run without a fault: 7 standard deviations and 1.5 times the largest mean.

        Wrong masses show slowly, in the mean over 0.2 s; noise fast. ``floor`` [N m, N], a number or (nj,), is the
        least threshold. One threshold for all joints is wrong by a factor of 20: what a joint shows grows with the
        inertia that hangs on it.

        Raises:
            InvalidInput: fewer residuals than two windows; a gain or period that is not positive, a negative floor.

        Example:
            >>> import numpy as np
            >>> from wbc.tasks import Thresholds
            >>> noise = 0.1 * np.random.default_rng(0).normal(size=(4000, 1))
            >>> bool(0.7 < Thresholds.learnt(noise, gain=100.0, dt=1e-3).value[0] < 0.8)
            True
        """
        r = checks.array("residual", residual, (None, None))
        share, nj = _share(gain, dt, r.shape[1]), r.shape[1]
        length = max(round(WINDOW / dt), 1)
        windows = len(r) // length
        if windows < 2:
            raise InvalidInput(f"residual has {len(r)} rows; thresholds need at least two windows of {length}")
        cut = r[: windows * length].reshape(windows, length, r.shape[1])
        means = cut.mean(axis=1)
        deviation = np.sqrt(((cut - means[:, None]) ** 2).mean(axis=(0, 1)))
        slow = np.abs(means).max(axis=0)
        # √2 σ_p / dt from the residual's deviation, as if all of it were white noise of the velocity.
        noise = deviation * np.sqrt(2.0 - share) / share
        return cls(np.maximum(SIGMAS * deviation + SLOW_PART * slow, _least(floor, nj)), noise, deviation, slow)

    @classmethod
    def predicted(cls, state: RobotState, *, velocity: Any, gain: Any, dt: float, floor: Any = 0.0) -> Thresholds:
        """From white noise of the measured joint velocities, standard deviation ``velocity`` [rad/s, m/s], at a state.

        With Σ_p = diag(Λ diag(velocity²) Λ) the noise of the momentum, Λ = M_jj − M_jb M_bb⁻¹ M_bj, the residual's
        variance is 2 φ² Σ_p / (dt² (2 − φ)), φ = 1 − e^(−K dt) (:class:`wbc.methods.MomentumResidual`). Wrong masses
        are not in it.

        Raises:
            InvalidInput: no state, a gain or period that is not positive, a negative deviation or floor.

        Example:
            >>> import wbc
            >>> from wbc.tasks import Thresholds
            >>> state = wbc.load("arm").state()
            >>> bool((Thresholds.predicted(state, velocity=0.01, gain=100.0, dt=1e-3).value > 0.0).all())
            True
        """
        nj = checks.instance("state", state, RobotState, "a state of a robot, as robot.state()").model.nj
        spread, share = checks.gains("velocity", velocity, nj), _share(gain, dt, nj)
        momentum = np.sqrt((_relative_inertia(state) ** 2) @ spread**2)
        deviation = np.sqrt(2.0 / (2.0 - share)) * share * momentum / dt
        value = np.maximum(SIGMAS * deviation, _least(floor, nj))
        return cls(value, np.sqrt(2.0) * momentum / dt, deviation, np.zeros_like(deviation))


def _relative_inertia(state: RobotState) -> Mat:
    """Of the joints relative to a base that floats (nj, nj); M on a fixed one."""
    M, nb = np.array(state.M), state.model.nb
    if nb:
        M = M[nb:, nb:] - M[nb:, :nb] @ np.linalg.solve(M[:nb, :nb], M[:nb, nb:])
    return M


def _share(gain: Any, dt: Any, nj: int) -> Vec:
    """φ = 1 − e^(−K dt) of each joint (nj,)."""
    K = checks.gains("gain", gain, nj)
    for i in (K == 0.0).nonzero()[0]:
        raise InvalidInput(f"gain[{i}] is 0; it must be > 0")
    result: Vec = -np.expm1(-K * checks.number("dt", dt, low=0.0, strict=True))
    return result


def _least(floor: Any, nj: int) -> Vec:
    """The least thresholds (nj,), above zero."""
    result: Vec = np.maximum(checks.gains("floor", floor, nj), np.finfo(float).tiny)
    return result
