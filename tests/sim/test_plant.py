"""Plants without contacts: what they integrate they integrate exactly, and what they cannot do they say."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.models.builders import at
from tests.sim.builders import command
from wbc.errors import SimulationError
from wbc.models import load
from wbc.sim.plant import ForwardDynamicsPlant, IntegratorPlant

ARM, LEGS = load("arm"), load("quadruped")


def energy(model, q, v):
    """Kinetic and potential [J]."""
    state = at(model, q, v)
    return 0.5 * v @ state.M @ v - model.mass * model.gravity @ state.com


@given(st.integers(0, 2**31))
def test_a_constant_velocity_is_one_long_step_of_the_configuration(seed):
    random = np.random.default_rng(seed)
    plant = IntegratorPlant(LEGS, dt=1e-2, level="velocity")
    q0, v = LEGS.random_configuration(random), random.standard_normal(LEGS.nv)
    plant.reset(q0)
    for _ in range(50):
        plant.step(SimpleNamespace(v=v))
    np.testing.assert_allclose(LEGS.difference(LEGS.integrate(q0, 0.5 * v), plant.q), 0.0, atol=1e-9)
    np.testing.assert_array_equal(plant.v, v)


def test_a_constant_acceleration_gives_the_parabola_exactly():
    plant, a = IntegratorPlant(ARM, dt=1e-3, level="acceleration"), np.linspace(-1.0, 1.0, ARM.nv)
    v0 = np.linspace(0.5, -0.5, ARM.nv)
    plant.reset(ARM.q0, v0)
    for _ in range(500):
        plant.step(command(ARM, a=a))
    np.testing.assert_allclose(plant.q, ARM.q0 + 0.5 * v0 + 0.125 * a, atol=1e-12)
    np.testing.assert_allclose(plant.v, v0 + 0.5 * a, atol=1e-12)


def test_time_does_not_drift():
    plant = IntegratorPlant(ARM, dt=1e-3)
    plant.reset(ARM.q0, t=2.0)
    for _ in range(1000):
        plant.step(command(ARM))
    assert plant.t == 3.0


def test_free_motion_keeps_the_energy():
    plant = ForwardDynamicsPlant(ARM, dt=1e-3, substeps=20)
    plant.reset(ARM.q0)
    before = energy(ARM, plant.q, plant.v)
    for _ in range(200):
        plant.step(command(ARM))
    kinetic = energy(ARM, plant.q, plant.v) - energy(ARM, plant.q, 0.0 * plant.v)
    assert kinetic > 0.1
    assert abs(energy(ARM, plant.q, plant.v) - before) < 1e-2 * kinetic


def test_in_free_flight_the_centre_of_mass_falls_with_g_whatever_the_legs_do():
    plant = ForwardDynamicsPlant(LEGS, dt=1e-3, substeps=10)
    plant.reset(LEGS.q0)
    for k in range(100):
        plant.step(command(LEGS, tau=2.0 * np.sin(0.1 * k + np.arange(LEGS.nj))))
    np.testing.assert_allclose(at(LEGS, plant.q).com - at(LEGS).com, 0.5 * LEGS.gravity * 0.1**2, atol=5e-5)


def test_states_are_read_only_and_belong_to_their_moment():
    plant = IntegratorPlant(ARM, dt=1e-3)
    before = plant.q
    plant.step(command(ARM, a=np.ones(ARM.nv)))
    assert before is not plant.q
    with pytest.raises(ValueError, match="read-only"):
        plant.q[0] = 1.0


def test_a_command_that_is_not_finite_never_moves_a_plant():
    for plant in (IntegratorPlant(ARM), IntegratorPlant(ARM, level="velocity"), ForwardDynamicsPlant(ARM)):
        nan = np.full(ARM.nv, np.nan)
        with pytest.raises(SimulationError, match=r"command\.\w+\[0\] is nan at t = 0"):
            plant.step(command(ARM, tau=nan, a=nan, v=nan))
        np.testing.assert_array_equal(plant.q, ARM.q0)
