"""Disturbances and failing actuators do what their line says, at the time it says, the same each time."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tasks import Posture
from tests.models.builders import at
from tests.sim.builders import command
from wbc.errors import UnknownFrame
from wbc.models import Planar4P, load
from wbc.sim.actuator_fault import ActuatorFault
from wbc.sim.disturbance import Delay, Payload, Push, SensorNoise
from wbc.sim.plant import Delivered, ForwardDynamicsPlant, IntegratorPlant, Plant
from wbc.sim.simulate import simulate

ARM, LEGS = load("arm"), load("quadruped")


def readings(noise, model, count):
    effect = noise.begin(IntegratorPlant(model))
    q, v = model.q0, np.zeros(model.nv)
    measured = [effect.measure(q, v) for _ in range(count)]
    return np.array([model.difference(q, m) for m, _ in measured]), np.array([m for _, m in measured])


def test_noise_is_decided_by_its_seed():
    first, again = (readings(SensorNoise(position=1e-3, velocity=1e-2, seed=4), ARM, 20) for _ in range(2))
    other = readings(SensorNoise(position=1e-3, velocity=1e-2, seed=5), ARM, 20)
    np.testing.assert_array_equal(first, again)
    assert (np.array(first) != np.array(other)).all()


def test_noise_has_the_deviations_that_were_asked_for():
    wanted = SensorNoise(
        position=1e-3, velocity=1e-2, base_position=2e-3, base_orientation=3e-3, base_velocity=4e-2,
        base_angular_velocity=5e-2,
    )  # fmt: skip
    on_q, on_v = readings(wanted, LEGS, 4000)
    expected_q = np.repeat([2e-3, 3e-3, 1e-3], [3, 3, LEGS.nj])
    expected_v = np.repeat([4e-2, 5e-2, 1e-2], [3, 3, LEGS.nj])
    np.testing.assert_allclose(on_q.std(axis=0), expected_q, rtol=0.06)
    np.testing.assert_allclose(on_v.std(axis=0), expected_v, rtol=0.06)
    assert np.abs(on_q.mean(axis=0) / expected_q).max() < 0.08


def test_noise_changes_what_is_measured_and_never_the_plant():
    plant = IntegratorPlant(LEGS)
    q, _ = SensorNoise(base_orientation=0.1, seed=1).begin(plant).measure(plant.q, plant.v)
    assert abs(np.linalg.norm(q[3:7]) - 1.0) < 1e-12
    np.testing.assert_array_equal(plant.q, LEGS.q0)


@given(st.integers(0, 8), st.floats(-0.4, 0.4))
def test_commands_arrive_late_by_whole_steps_and_the_first_one_holds_until_then(steps, rounding):
    late = Delay(max(0.0, steps + rounding) * 1e-3).begin(IntegratorPlant(ARM, dt=1e-3))
    sent = [object() for _ in range(20)]
    for k, one in enumerate(sent):
        assert late.deliver(one) is sent[max(0, k - steps)]


class Notebook(Plant):
    """A plant that stands still and writes down which force acts in each step."""

    def __init__(self, dt):
        super().__init__(LEGS, dt)
        self.forces = []

    def push(self, frame, force):
        self._pushed = self._pushed + force

    def _place(self, q, v): ...

    def _advance(self, command):
        self.forces.append(self.pushed)
        return self.q.copy(), self.v.copy()


@given(st.floats(0.0, 0.02), st.floats(0.001, 0.02), st.sampled_from([1e-3, 2e-3]))
def test_a_push_acts_from_its_start_for_its_duration_to_half_a_step(start, duration, dt):
    plant = Notebook(dt)
    effect = Push("trunk", (1.0, 2.0, 3.0), start, duration).begin(plant)
    for _ in range(50):
        effect.push(plant.t)
        plant.step(None)
    on = np.flatnonzero(np.any(plant.forces, axis=1))
    assert abs(len(on) * dt - duration) <= dt + 1e-9
    if len(on):
        assert abs(on[0] * dt - start) <= 0.5 * dt + 1e-9
        assert (np.diff(on) == 1).all()
        np.testing.assert_array_equal(np.array(plant.forces)[on], np.tile([1.0, 2.0, 3.0], (len(on), 1)))


def test_a_push_of_whole_steps_has_exactly_its_impulse():
    plant = Notebook(1e-3)
    effects = [Push("trunk", (60.0, 0.0, 0.0), 1.5 + k, 0.2).begin(plant) for k in range(3)]
    for _ in range(4000):
        for effect in effects:
            effect.push(plant.t)
        plant.step(None)
    assert [sum(np.array(plant.forces)[1000 * k + 400 : 1000 * k + 1400, 0] > 0) for k in (1, 2)] == [200, 200]


@pytest.mark.physics
def test_a_payload_is_picked_up_once_and_makes_a_held_arm_sink():
    pytest.importorskip("mujoco")
    from wbc.sim.mujoco_ import MujocoPlant

    plant, gravity, heights = MujocoPlant(ARM), at(ARM).g, []
    effect = Payload("tool", mass=1.5, start=0.05).begin(plant)
    for _ in range(150):
        effect.push(plant.t)
        plant.step(command(ARM, tau=gravity))
        heights.append(at(ARM, plant.q).frame("tool").position[2])
    assert max(heights[:50]) - min(heights[:50]) < 1e-6
    assert heights[-1] < heights[49] - 0.01
    own = sum(link.inertial.mass for link in ARM.urdf.links if link.name == "tool" and link.inertial is not None)
    assert plant.physics.body("tool").mass[0] == pytest.approx(1.5 + own)


@pytest.mark.physics
def test_a_push_on_no_link_names_the_near_ones():
    pytest.importorskip("mujoco")
    from wbc.sim.mujoco_ import MujocoPlant

    with pytest.raises(UnknownFrame, match="no frame 'trnk'; did you mean 'trunk'"):
        Push("trnk", (1, 0, 0), 0.0, 0.1).begin(MujocoPlant(LEGS))


def test_each_says_itself_in_one_line():
    lines = [
        str(Push("torso", [0, 60, 0], 1.5, 0.2)), str(SensorNoise(position=1e-4, seed=2)), str(SensorNoise()),
        str(Delay(0.0025)), str(Payload("tool", 2.0, 5.0)),
    ]  # fmt: skip
    assert lines == [
        "push of (0, 60, 0) N at 'torso' from 1.5 s for 0.2 s",
        "sensor noise: position 0.0001 (standard deviations, SI units), seed 2",
        "sensor noise: none (standard deviations, SI units), seed 0",
        "commands arrive 2.5 ms late",
        "payload of 2 kg at 'tool' from 5 s",
    ]


# ---- actuators that fail
WANTED = Delivered(np.array([5.0, -2.0, 1.0, 3.0]), np.ones(4), np.zeros(4), np.full(4, 2.0))


def delivered(fault: ActuatorFault, t: float) -> np.ndarray:
    effect = fault.begin(ForwardDynamicsPlant(Planar4P()))
    effect.push(t)
    arrived = effect.deliver(WANTED)
    assert arrived.a is WANTED.a and arrived.v is WANTED.v and arrived.q is WANTED.q
    return arrived.tau


@pytest.mark.parametrize(
    ("fault", "arrives"),
    [
        (ActuatorFault(joint="q1"), 0.0),
        (ActuatorFault(joint="q1", effectiveness=0.3), 1.5),
        (ActuatorFault(joint="q1", effectiveness=1.0, bias=-2.0), 7.0),
        (ActuatorFault(joint="q1", effectiveness=0.5, bias=1.0), 1.5),
    ],
)
def test_what_arrives_is_what_is_commanded_less_what_is_missing(fault: ActuatorFault, arrives: float):
    assert delivered(fault, 0.0).tolist() == [arrives, -2.0, 1.0, 3.0]
    assert 5.0 - fault.missing(0.0, 5.0) == arrives


def test_it_lasts_from_start_to_end_whatever_rounding_makes_of_time():
    fault = ActuatorFault(joint="q3", start=0.3, end=0.6)
    late = [round(t, 3) for t in 1e-3 * np.arange(1000) if delivered(fault, t)[2] == 0.0]
    assert (late[0], late[-1], len(late)) == (0.3, 0.599, 300)


def test_it_says_what_it_is():
    assert str(ActuatorFault(joint="q1", effectiveness=0.5, bias=1.0, end=2.0)) == (
        "actuator q1 delivers 50 % less 1 from 0 s to 2 s"
    )
    assert (
        str(ActuatorFault(joint="q1", effectiveness=1.0, bias=-2.0, end=2.0))
        == "actuator q1 delivers 100 % plus 2 from 0 s to 2 s"
    )


@pytest.mark.parametrize("order", [1, -1])
def test_it_starts_and_ends_in_its_time_however_late_commands_are(order: int):
    robot, fault, late = Planar4P(), ActuatorFault(joint="q1", effectiveness=1.0, bias=2.0, start=0.01), Delay(0.02)
    stack = wbc.Stack([Posture(robot.q0, kp=10)])

    def run(*disturbances):
        controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics())
        return simulate(controller, ForwardDynamicsPlant(robot), duration=0.015, disturbances=disturbances)

    healthy, failing = run(late), run(*[fault, late][::order])
    moved = np.abs(failing["plant.v"] - healthy["plant.v"]).max(axis=1)
    assert not moved[:11].any() and moved[11:].all()
