"""Drives that follow positions: a spring and a damper within the torque limit, on which robots track and stand."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tasks import JointVelocityLimits, Position, Posture, Sinusoid
from tasks.scenarios.quadruped_stand import STANCES
from tasks.scenarios.standing import standing_plant, standing_stack
from tests.models.builders import at
from wbc.errors import InvalidInput, NotSupported
from wbc.sim.actuator_fault import ActuatorFault
from wbc.sim.disturbance import Push
from wbc.sim.drives import PositionDrives
from wbc.sim.engine import PhysicsSettings
from wbc.sim.mujoco_ import MujocoPlant
from wbc.sim.plant import IntegratorPlant
from wbc.sim.simulate import simulate

pytest.importorskip("mujoco", reason="the extra `sim`")
pytestmark = pytest.mark.physics

ARM = wbc.load("arm")
ENDLESS = PhysicsSettings(joint_stops=False)
SOFT = MujocoPlant(ARM, drives=PositionDrives(stiffness=30.0, damping=np.linspace(0.1, 2.0, ARM.nj)), settings=ENDLESS)
DEAF = MujocoPlant(ARM, drives=PositionDrives(stiffness=30.0, damping=1.0, feed_forward=False), settings=ENDLESS)
MOTORS = MujocoPlant(ARM, settings=ENDLESS)
PATH = Sinusoid(ARM.state().frame("tool").position, amplitude=[0.05, 0.08, 0.05], frequency=[0.5, 0.4, 0.6])
LEVELS = {"velocity": wbc.VelocityLevel(), "acceleration": wbc.AccelerationLevel(), "torque": wbc.InverseDynamics()}


def drawn(seed: int, size: float = 0.5) -> tuple[Any, Any, Any]:
    """A state, and a command near it or far from it."""
    rng = np.random.default_rng(seed)
    q, v = ARM.random_configuration(rng), rng.normal(size=ARM.nv)
    command = SimpleNamespace(
        q=q + size * rng.normal(size=ARM.nq), v=rng.normal(size=ARM.nv), tau=30.0 * rng.normal(size=ARM.nj)
    )
    return q, v, command


@given(
    st.integers(0, 2**32 - 1), st.sampled_from([SOFT, DEAF]), st.sampled_from([0.05, 5.0]), st.booleans(),
)  # fmt: skip
def test_a_drive_is_a_spring_and_a_damper_with_a_torque_limit(
    seed: int, plant: MujocoPlant, size: float, told: bool
) -> None:
    """The torque that a level decides is fed forward, where there is one and drives take it."""
    q, v, command = drawn(seed, size)
    if not told:
        command.tau = np.full(ARM.nj, np.nan)
    plant.reset(q, v)
    plant.step(command)
    torque = 30.0 * (command.q - q)
    torque += (np.linspace(0.1, 2.0, ARM.nj) if plant is SOFT else 1.0) * (command.v - v)
    torque += command.tau if told and plant is SOFT else 0.0
    most = ARM.limits.tau_max
    np.testing.assert_allclose(plant.truth()["plant.tau"], np.clip(torque, -most, most), atol=1e-9)


@given(st.integers(0, 2**32 - 1))
def test_drives_without_gains_are_motors(seed: int) -> None:
    q, v, command = drawn(seed)
    ends = []
    for plant in (MujocoPlant(ARM, drives=PositionDrives(stiffness=0.0), settings=ENDLESS), MOTORS):
        plant.reset(q, v)
        for _ in range(5):
            plant.step(command)
        ends.append((plant.q, plant.v))
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-12)


def test_a_robot_with_drives_is_the_same_robot() -> None:
    assert max(SOFT.agreement.values()) < 1e-11 and SOFT.agreement == MOTORS.agreement


def tracked(level: str, feedback: str, **drives: Any) -> float:
    """Error of the tool of the arm itself after half a second, rms [m]."""
    stack = wbc.Stack(
        [Position("tool", target=PATH, kp=400), Posture(ARM.q0, kp=10, weight=1e-3)],
        subject_to=[JointVelocityLimits()],
    )
    controller = wbc.Controller(ARM, stack, level=LEVELS[level])
    plant = MujocoPlant(ARM, drives=PositionDrives(**drives))
    plant.reset(ARM.q0)
    run = simulate(wbc.Setpoint(controller, feedback=feedback), plant, duration=1.5)
    assert run.meta["ended"] == "complete" and run.meta["feedback"] == feedback
    late = zip(run["t"][500:], run["plant.q"][500:], strict=True)
    errors = [np.linalg.norm(at(ARM, q).frame("tool").position - PATH(t)[0]) for t, q in late]
    assert run["q_cmd"].shape == run["q"].shape and (np.abs(run["plant.tau"]) <= ARM.limits.tau_max).all()
    return float(np.sqrt(np.mean(np.square(errors))))


def test_an_arm_with_drives_goes_where_it_is_told_and_without_torques_hangs_below_it() -> None:
    assert tracked("torque", "commanded") < 5e-4
    for level in LEVELS:
        soft, stiff = (tracked(level, "commanded", stiffness=k, feed_forward=False) for k in (500.0, 5000.0))
        assert stiff < 0.2 * soft and 5e-3 < soft < 0.1, "a tenth of the sag on drives ten times as stiff"


def test_setpoints_from_the_measured_state_do_not_hold_an_arm_up() -> None:
    assert tracked("torque", "measured", feed_forward=False) > 0.1


def stood(feedback: str, **drives: Any) -> wbc.Run:
    stance = STANCES["quadruped"]
    robot = stance.robot("quadruped")
    stack = standing_stack(robot, stance)
    plant = standing_plant(robot, stance, stack.contacts, drives=PositionDrives(**drives))
    controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics())
    push = Push(stance.upright, force=(0.0, 20.0, 0.0), start=0.5, duration=0.2)
    return simulate(wbc.Setpoint(controller, feedback=feedback), plant, duration=1.5, disturbances=[push])


def test_a_quadruped_with_drives_stands_and_takes_a_push() -> None:
    run = stood("commanded")
    assert run.meta["ended"] == "complete" and set(run["status"]) == {0}
    base = run["plant.q"][:, :3] - run["q_cmd"][:, :3]
    assert np.abs(base).max() < 0.01, "the base is where the setpoint has it"


def test_a_quadruped_whose_setpoints_start_from_where_it_hangs_falls() -> None:
    assert stood("measured", feed_forward=False).meta["fallen"]


@pytest.mark.parametrize("level", ["velocity", "acceleration"])
def test_on_a_plant_that_follows_exactly_the_feedback_does_not_matter(level: str) -> None:
    runs = []
    for feedback in ("measured", "commanded"):
        stack = wbc.Stack([Position("tool", target=PATH)], subject_to=[JointVelocityLimits()])
        setpoint = wbc.Setpoint(wbc.Controller(ARM, stack, level=LEVELS[level]), feedback=feedback)
        runs.append(simulate(setpoint, IntegratorPlant(ARM, level=level), duration=0.1))
    np.testing.assert_allclose(runs[0]["plant.q"], runs[1]["plant.q"], atol=1e-12)
    assert [run.meta["feedback"] for run in runs] == ["measured", "commanded"]


def test_torques_of_a_setpoint_are_not_for_a_robot_without_drives() -> None:
    stack = wbc.Stack([Posture(ARM.q0)])
    controller = wbc.Controller(ARM, stack, level=wbc.InverseDynamics())
    with pytest.raises(InvalidInput, match=r"feedback='commanded'.*drives"):
        simulate(wbc.Setpoint(controller), MOTORS, duration=0.01)


def test_an_actuator_that_makes_its_own_torque_cannot_lose_some_of_what_is_commanded() -> None:
    with pytest.raises(NotSupported, match="drives that follow positions"):
        ActuatorFault(joint=ARM.joint_names[0]).begin(SOFT)


def test_without_a_torque_limit_the_stiffness_must_be_given() -> None:
    limits = ARM.limits
    endless = ARM.replace(limits=type(limits)(**{**vars(limits), "tau_max": np.full(ARM.nj, np.inf)}))
    with pytest.raises(InvalidInput, match="has no torque limit"):
        PositionDrives().gains(endless)
    assert PositionDrives(stiffness=7.0).gains(endless)[1] == pytest.approx(0.35)
