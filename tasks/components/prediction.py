"""Prediction: what the parameters make of the torques that were sent, without a measured acceleration."""

from __future__ import annotations

from typing import final

import numpy as np

from wbc.models.model import RobotState
from wbc.types import Mat, Vec

from .adaptive_law import InertialLaw


@final
class Prediction:
    """W â against τ_F, both through the filter F = λ / (s + λ).

    The momentum p = Y_p a changes by ṗ = τ − Y_β a, so that τ_F = W a with W = λ (Y_p − F Y_p) + F Y_β: the derivative
    of p is moved into the filter. What known rotors take, λ (p_r − F p_r) with p_r = rotors v, is taken off τ_F.
    Friction is no part of it. Source: Slotine, Li, Automatica 1989.
    """

    def __init__(self, law: InertialLaw, rate: float) -> None:
        self._law, self._rate = law, rate
        self.reset()

    def reset(self) -> None:
        """Start with the next tick: the filters are empty, so that W = 0 and τ_F = 0 there."""
        self._last: tuple[Mat, Mat, Vec, Vec] | None = None

    def error(self, state: RobotState, tau: Vec, a_hat: Vec, dt: float) -> tuple[Mat, Vec]:
        """W (nj, p) of the links and ε = τ_F − W â (nj,) at this tick; ``tau`` was decided for what follows it."""
        inertial, p = self._law.inertial, self._law.p_links
        Y_p, Y_beta = inertial.momentum(state.q, state.v), inertial.drive(state.q, state.v)
        spin = inertial.rotors * state.v
        if self._last is None:
            self._momentum, self._drive, self._torque = Y_p.copy(), np.zeros_like(Y_beta), np.zeros(len(tau))
            self._spin = spin
        else:
            last_Y_p, last_Y_beta, last_spin, sent = self._last
            share = -np.expm1(-self._rate * dt)
            self._momentum += share * (0.5 * (Y_p + last_Y_p) - self._momentum)
            self._drive += share * (0.5 * (Y_beta + last_Y_beta) - self._drive)
            self._spin = self._spin + share * (0.5 * (spin + last_spin) - self._spin)
            self._torque += share * (sent - self._torque)
        self._last = Y_p, Y_beta, spin, np.array(tau)
        W = self._rate * (Y_p - self._momentum) + self._drive
        return W, self._torque - self._rate * (spin - self._spin) - W @ a_hat[:p]
