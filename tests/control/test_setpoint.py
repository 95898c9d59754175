"""A setpoint decides from the measured state or from its own, stays near the robot, and survives bad ticks."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tasks import JointVelocityLimits, Posture
from tests.reliability.faults import limited, sabotaged
from wbc.control.setpoint import FEEDBACK
from wbc.stack.interval import BRAKING
from wbc.types import Status

DT = 1e-3
ROBOTS = {name: wbc.load(name) for name in ("arm", "humanoid")}
LEVELS = {"velocity": wbc.VelocityLevel(), "acceleration": wbc.AccelerationLevel(), "torque": wbc.InverseDynamics()}
CASES = pytest.mark.parametrize(("robot", "level"), [(r, level) for r in ROBOTS for level in LEVELS])


def made(robot: str, level: str, feedback: str = "commanded", **settings: Any) -> wbc.Setpoint:
    model, formulation = ROBOTS[robot], LEVELS[level]
    stack = limited(model, formulation)
    stack.tasks[-1].target = model.q0[-model.nj :] + 0.05  # type: ignore[attr-defined]
    return wbc.Setpoint(wbc.Controller(model, stack, level=formulation, dt=DT), feedback=feedback, **settings)


def near(model: Any, rng: np.random.Generator, size: float) -> Any:
    return model.integrate(model.q0, rng.uniform(-size, size, model.nv))


@CASES
def test_on_a_robot_that_follows_exactly_both_feedbacks_are_one(robot: str, level: str):
    model = ROBOTS[robot]
    paths = []
    for feedback in FEEDBACK:
        setpoint = made(robot, level, feedback)
        q, v, path = model.q0, np.zeros(model.nv), []
        for k in range(30):
            command = setpoint.tick(k * DT, q, v)
            assert command.status.ok
            q, v = setpoint.q, setpoint.v
            path.append(np.concatenate([q, v]))
        assert np.abs(setpoint.drift).max() < 1e-12
        paths.append(np.array(path))
    np.testing.assert_array_equal(*paths)
    assert np.abs(paths[0][-1] - paths[0][0]).max() > 1e-5, "it does move"


@CASES
@given(seed=st.integers(0, 2**32 - 1))
def test_what_is_commanded_does_not_depend_on_the_robot_while_the_drift_is_small(robot: str, level: str, seed: int):
    model, rng = ROBOTS[robot], np.random.default_rng(seed)
    ideal, noisy = made(robot, level), made(robot, level)
    for k in range(8):
        q, v = (model.q0, np.zeros(model.nv)) if k == 0 else (near(model, rng, 0.02), rng.normal(size=model.nv))
        ideal.tick(k * DT, *((q, v) if k == 0 else (ideal.q, ideal.v)))
        noisy.tick(k * DT, q, v)
        assert (noisy.q == ideal.q).all() and (noisy.v == ideal.v).all()
    assert noisy.dragged == 0 and np.abs(noisy.drift).max() > 1e-3


@CASES
@given(seed=st.integers(0, 2**32 - 1), bound=st.floats(1e-3, 0.2))
def test_drift_is_bounded_wherever_the_robot_is(robot: str, level: str, seed: int, bound: float):
    """The controller never decides from a state farther than ``max_drift`` from the measured one, in any component."""
    model, rng = ROBOTS[robot], np.random.default_rng(seed)
    setpoint = made(robot, level, max_drift=bound)
    for k in range(6):
        q = near(model, rng, 0.3)
        measured, own = rng.uniform(-1.0, 1.0, model.nv), setpoint.v
        command = setpoint.tick(k * DT, q, measured)
        ahead = model.difference(q, setpoint.controller.state.q)
        assert np.abs(ahead).max() <= bound + 1e-9
        if k > 0:
            dragged = np.abs(setpoint.drift) > bound
            assert (setpoint.controller.state.v == np.where(dragged, measured, own)).all()
        sent = model.difference(setpoint.controller.state.q, setpoint.q)
        assert np.abs(sent).max() < 0.05, "and what is sent is one tick away from there"
        assert (setpoint.q == command.q).all()
    assert setpoint.dragged > 0 or np.abs(setpoint.drift).max() <= bound


@CASES
def test_a_blocked_robot_does_not_wind_the_setpoint_up(robot: str, level: str):
    model, bound = ROBOTS[robot], 1e-3
    setpoint = made(robot, level, max_drift=bound)
    still, farthest = np.zeros(model.nv), 0.0
    for k in range(150):
        setpoint.tick(k * DT, model.q0, still)
        farthest = max(farthest, np.abs(model.difference(model.q0, setpoint.q)).max())
    assert setpoint.dragged > 0
    assert farthest < 3 * bound


def sagging(feedback: str) -> tuple[float, float]:
    """Drives that hang 0.02 rad below what they are sent; errors of the setpoint and the robot after three seconds."""
    model = ROBOTS["arm"]
    posture = np.array(model.q0 + 0.1)
    stack = wbc.Stack([Posture(posture, rate=5.0)], subject_to=[JointVelocityLimits(1.0)])
    controller = wbc.Controller(model, stack, level=wbc.VelocityLevel(), dt=0.01)
    setpoint = wbc.Setpoint(controller, feedback=feedback)
    q = np.array(model.q0)
    for k in range(300):
        setpoint.tick(0.01 * k, q, np.zeros(model.nv))
        q = setpoint.q - 0.02
    return float(np.abs(setpoint.q - posture).max()), float(np.abs(q - posture).max())


def test_drives_that_sag_are_kept_to_the_sag_by_what_is_commanded_and_sink_with_what_is_measured():
    ahead, behind = sagging("commanded")
    assert ahead < 1e-6 and behind == pytest.approx(0.02, abs=1e-6)
    _, sunk = sagging("measured")
    assert sunk > 0.1


@CASES
@pytest.mark.parametrize("feedback", FEEDBACK)
def test_measurements_that_cannot_be_believed_bring_the_setpoint_to_rest_without_a_step(
    robot: str, level: str, feedback: str
):
    model = ROBOTS[robot]
    setpoint = made(robot, level, feedback)
    q, v = model.q0, np.zeros(model.nv)
    for k in range(30):
        setpoint.tick(k * DT, q, v)
        q, v = setpoint.q, setpoint.v
    assert np.abs(v).max() > 0.0
    hold = setpoint.controller.fallbacks.recovery.hold_ticks
    lost, k = np.full(model.nq, np.nan), 30
    for _ in range(hold + 400):
        before = setpoint.q
        command = setpoint.tick(k * DT, lost, v)
        k += 1
        assert command.status is Status.INVALID_STATE
        speed = max(np.abs(v).max(), np.abs(setpoint.v).max())
        assert np.abs(model.difference(before, setpoint.q)).max() <= DT * speed + 2 * BRAKING * DT**2 + 1e-12
        v = setpoint.v
    assert np.abs(v).max() < 1e-3 and np.isfinite(setpoint.q).all()
    rest = setpoint.q
    assert setpoint.tick(k * DT, rest, v).status.ok
    assert np.abs(model.difference(rest, setpoint.q)).max() < 1e-3, "it goes on from where it stopped"
    assert setpoint.dragged == 0


@CASES
def test_when_every_solver_fails_the_setpoint_brakes_stays_and_goes_on_from_there(robot: str, level: str):
    """The robot itself stays where it was; without a bound on the drift nothing of that is in the setpoint."""
    model, formulation = ROBOTS[robot], LEVELS[level]
    controller, script = sabotaged(model, formulation, other=False, dt=DT)
    controller.stack.tasks[-1].target = model.q0[-model.nj :] + 0.05  # type: ignore[attr-defined]
    setpoint, still = wbc.Setpoint(controller, max_drift=np.inf), np.zeros(model.nv)
    for k in range(30):
        setpoint.tick(k * DT, model.q0, still)
    assert np.abs(setpoint.v).max() > 0.01
    script.fault = "raises"
    for k in range(30, 430):
        setpoint.tick(k * DT, model.q0, still)
    rest = setpoint.q
    assert setpoint.tick(430 * DT, model.q0, still).fallback_level == "damped"
    assert np.abs(setpoint.v).max() < 1e-3
    assert np.abs(model.difference(rest, setpoint.q)).max() < 1e-6, "it stays"
    rest, script.fault = setpoint.q, ""
    assert setpoint.tick(431 * DT, model.q0, still).status.ok
    assert np.abs(model.difference(rest, setpoint.q)).max() < 1e-4, "no step when it is solved again"


@pytest.mark.parametrize("feedback", FEEDBACK)
def test_there_is_nothing_to_send_before_a_measurement_that_can_be_believed(feedback: str):
    model = ROBOTS["arm"]
    setpoint = made("arm", "velocity", feedback)
    assert setpoint.tick(0.0, model.q0 * np.nan, np.zeros(model.nv)).status is Status.INVALID_STATE
    assert np.isnan(setpoint.q).all() and np.isnan(setpoint.v).all()
    start = model.q0 + 0.3
    setpoint.tick(DT, start, np.zeros(model.nv))
    assert np.abs(setpoint.q - start).max() < 0.01 and (setpoint.drift == 0.0).all()


def test_after_a_reset_the_setpoint_begins_where_the_robot_is():
    model = ROBOTS["humanoid"]
    setpoint = made("humanoid", "torque", max_drift=np.inf)
    setpoint.tick(0.0, model.q0, np.zeros(model.nv))
    setpoint.reset()
    assert np.isnan(setpoint.q).all() and setpoint.controller.ticks == 0
    moved = model.integrate(model.q0, np.full(model.nv, 0.1))
    setpoint.tick(DT, moved, np.zeros(model.nv))
    assert np.abs(model.difference(moved, setpoint.q)).max() < 1e-3 and (setpoint.drift == 0.0).all()
