"""A failing actuator delivers what is commanded less what is missing, in its time and on its joint alone."""

from __future__ import annotations

import numpy as np
import pytest

import wbc
from tasks import Posture
from wbc.models import Planar4P
from wbc.sim.actuator_fault import ActuatorFault
from wbc.sim.disturbance import Delay
from wbc.sim.plant import Delivered, ForwardDynamicsPlant
from wbc.sim.simulate import simulate

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
