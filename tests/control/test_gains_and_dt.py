"""Gains that a time step cannot carry are refused by the task's name: while building, and in ticks when assigned there.

The oracle moves one coordinate by hand as commands move it and takes the eigenvalues of that map.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tasks import Posture
from wbc.errors import InvalidInput
from wbc.testing.strategies import magnitudes

ARM = wbc.load("arm")
LEVELS = [wbc.VelocityLevel(), wbc.AccelerationLevel(), wbc.InverseDynamics()]


def growth(kp: float, kd: float, dt: float) -> float:
    """Spectral radius of (e, v) -> (e, v) under a = kp e − kd v, held for dt."""
    columns = []
    for e, v in ((1.0, 0.0), (0.0, 1.0)):
        a = kp * e - kd * v
        columns.append((e - v * dt - 0.5 * a * dt**2, v + a * dt))
    return float(np.abs(np.linalg.eigvals(np.array(columns).T)).max())


def build(level: Any, dt: float, **gains: Any) -> wbc.Controller:
    return wbc.Controller(ARM, wbc.Stack([Posture(ARM.q0, **gains)]), level=level, dt=dt)


@given(st.floats(0.01, 4.0), st.floats(0.01, 8.0), magnitudes(1e-4, 1e-2))
def test_accelerations_are_refused_exactly_where_errors_grow(damping: float, stiffness: float, dt: float) -> None:
    kd, kp = damping / dt, stiffness / dt**2
    radius = growth(kp, kd, dt)
    if abs(radius - 1.0) < 1e-6:
        return
    if radius < 1.0:
        build(wbc.AccelerationLevel(), dt, kp=kp, kd=kd)
    else:
        with pytest.raises(InvalidInput, match=r"Posture\.k[pd] is .*makes the error grow"):
            build(wbc.AccelerationLevel(), dt, kp=kp, kd=kd)


@given(magnitudes(1e-4, 1e-2), st.floats(0.1, 4.0))
def test_rates_are_refused_beyond_two_per_tick(dt: float, per_tick: float) -> None:
    if abs(per_tick - 2.0) < 1e-6:
        return
    if per_tick < 2.0:
        build(wbc.VelocityLevel(), dt, rate=per_tick / dt)
    else:
        with pytest.raises(InvalidInput, match=r"Posture\.rate is .*2/dt"):
            build(wbc.VelocityLevel(), dt, rate=per_tick / dt)


@pytest.mark.parametrize("dt", [1e-4, 1e-3, 3e-3, 7e-3, 1e-2])
def test_deadbeat_and_the_edge_are_allowed(dt: float) -> None:
    for rate in (1.0 / dt, 2.0 / dt):
        build(wbc.VelocityLevel(), dt, rate=rate)
    build(wbc.InverseDynamics(), dt, kp=1.0 / dt**2, kd=2.0 / dt)
    build(wbc.InverseDynamics(), dt, kp=4.0 / dt**2, kd=0.0)


@pytest.mark.parametrize("level", LEVELS, ids=lambda level: level.name)
def test_gains_assigned_between_ticks_are_refused_in_the_tick(level: Any) -> None:
    task = Posture(ARM.q0, kp=100.0, rate=5.0)
    controller = wbc.Controller(ARM, wbc.Stack([task]), level=level, dt=1e-3)
    q, v = np.array(ARM.q0) + 0.1, np.zeros(ARM.nv)
    assert controller.tick(0.0, q, v).status.ok
    task.rate, task.kd = 5000.0, 5000.0
    for k in range(1, 4):
        command = controller.tick(k * 1e-3, q, v)
        assert not command.status.ok
        assert "Posture" in controller.why and "makes the error grow" in controller.why
        assert np.isfinite(command.v).all()
    task.rate, task.kd = 50.0, None
    assert controller.tick(4e-3, q, v).status.ok
