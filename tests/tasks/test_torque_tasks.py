"""Gravity compensation and joint impedance: torques by their equations, and what a robot does under them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given

import wbc
from tasks import CenterOfMass, Damping, GravityCompensation, JointImpedance, Orientation, Posture, Sinusoid, feet
from wbc.models.model import RobotState
from wbc.sim.plant import ForwardDynamicsPlant
from wbc.testing.strategies import states

ARM, HUMANOID = wbc.load("arm"), wbc.load("humanoid")
LEVEL = wbc.InverseDynamics(regularisation=1e-12)
K = np.array([80.0, 80.0, 60.0, 60.0, 5.0, 5.0, 2.0])
#: Critical for each joint alone: held for a tick, more would turn light joints around.
D = 2.0 * np.sqrt(K * np.diag(ARM.state().M))


def controller(*tasks: Any, **more: Any) -> wbc.Controller:
    return wbc.Controller(ARM, wbc.Stack([list(tasks)], **more), level=LEVEL, dt=1e-3)


@given(states(ARM))
def test_an_arm_that_carries_its_own_weight_goes_on_as_it_would_without_gravity(state: RobotState):
    command = controller(GravityCompensation()).tick(0.0, state.q, state.v)
    np.testing.assert_allclose(command.tau, state.g, atol=1e-5 * (1.0 + np.abs(state.g).max()))


@pytest.mark.parametrize("coriolis", [False, True])
@given(states(ARM))
def test_torques_are_those_of_springs_and_dampers_and_of_the_weight(coriolis: bool, state: RobotState):
    wave = Sinusoid(ARM.q0, amplitude=0.2, frequency=0.5)
    command = controller(JointImpedance(wave, stiffness=K, damping=D, coriolis=coriolis)).tick(0.3, state.q, state.v)
    target, rate, _ = wave(0.3)
    wanted = (state.h if coriolis else state.g) + K * (target - state.q) + D * (rate - state.v)
    np.testing.assert_allclose(command.tau, wanted, atol=1e-5 * (1.0 + np.abs(wanted).max()))


def test_the_energy_of_springs_and_links_only_falls_and_the_arm_comes_to_its_target():
    target = ARM.q0 + 0.3
    ticking = controller(JointImpedance(target, stiffness=K, damping=D))
    plant = ForwardDynamicsPlant(ARM, dt=1e-3)
    state, energies = ARM.state(), []
    for _ in range(3000):
        state.update(plant.t, plant.q, plant.v)
        e = target - plant.q
        energies.append(0.5 * plant.v @ state.M @ plant.v + 0.5 * e @ (K * e))
        plant.step(ticking.tick(plant.t, plant.q, plant.v))
    assert np.diff(energies).max() < 1e-3 * energies[0]
    assert np.abs(target - plant.q).max() < 0.02


def test_a_guided_arm_comes_to_rest_by_damping_without_being_pulled_back():
    ticking = controller(GravityCompensation(), Damping(kd=5.0, weight=1e3))
    plant = ForwardDynamicsPlant(ARM, dt=1e-3)
    plant.reset(ARM.q0, np.full(7, 0.3))
    for _ in range(2000):
        plant.step(ticking.tick(plant.t, plant.q, plant.v))
    assert np.abs(plant.v).max() < 1e-2 and np.abs(plant.q - ARM.q0).max() > 0.02


def test_arms_of_a_humanoid_are_springs_while_it_stands():
    arms = [
        name for name in HUMANOID.joint_names if name.startswith("left_") and ("elbow" in name or "shoulder" in name)
    ]
    others = {name: 0.0 for name in arms}
    target = HUMANOID.q0[-HUMANOID.nj :] + 0.1
    spring = JointImpedance(target, joints=["left_(shoulder|elbow).*"], stiffness=30.0, damping=2.0, weight=10.0)
    balance = [
        CenterOfMass(target=HUMANOID.state().com, weight=10.0),
        Orientation(HUMANOID.frame_names[0], target=np.eye(3)),
    ]
    rest = Posture(HUMANOID.q0, weight={".*": 1e-1} | others)
    stack = wbc.Stack([*balance, spring, rest], contacts=feet(HUMANOID))
    command = wbc.Controller(HUMANOID, stack, level=LEVEL).tick(0.0, HUMANOID.q0, np.zeros(HUMANOID.nv))
    index = [HUMANOID.joint(name) for name in arms]
    assert command.status.ok and arms
    wanted = HUMANOID.state().g[HUMANOID.nb :][index] + 30.0 * 0.1
    np.testing.assert_allclose(command.tau[index], wanted, atol=0.05)


def test_stiffness_may_be_assigned_between_ticks_by_name_too():
    task = JointImpedance(ARM.q0 + 0.1, stiffness=K, damping=D)
    ticking = controller(task)
    before = ticking.tick(0.0, ARM.q0, np.zeros(7)).tau
    task.stiffness = {".*": 50.0, "elbow": 5.0}
    after = ticking.tick(0.0, ARM.q0, np.zeros(7)).tau
    stiffness = np.where(np.array(ARM.joint_names) == "elbow", 5.0, 50.0)
    np.testing.assert_allclose(after - before, 0.1 * (stiffness - K), atol=1e-4)
