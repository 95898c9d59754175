"""Many states through controllers: the answers of ``tick``, on one process or several."""

from __future__ import annotations

import os

import numpy as np
import pytest

import wbc
from tasks import JointAccelerationLimits, JointJerkLimits, JointVelocityLimits, Position, Posture, feet
from wbc import AccelerationLevel, Component, Controller, Stack
from wbc.errors import WbcError

ARM, LEGS = wbc.load("arm"), wbc.load("quadruped")


def controller(target=None):
    stack = Stack([Posture(ARM.q0 if target is None else target)], subject_to=[JointVelocityLimits()])
    return Controller(ARM, stack, level=AccelerationLevel())


def states(n):
    rng = np.random.default_rng(3)
    return [(0.0, ARM.random_configuration(rng), 0.1 * rng.normal(size=ARM.nv)) for _ in range(n)]


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_answers_are_those_of_one_tick_after_the_other(workers):
    asked = states(23)
    batch = wbc.run_many(controller(), asked, workers=workers, alone=False)
    one = controller()
    expected = [one.tick(*state) for state in asked]
    np.testing.assert_allclose(batch.a, [command.a for command in expected], rtol=0, atol=1e-9)
    np.testing.assert_allclose(batch.v, [command.v for command in expected], rtol=0, atol=1e-9)
    assert np.isnan(batch.tau).all()  # accelerations decide no torques
    assert batch.certified.all() and set(batch.status) == {wbc.Status.SOLVED}
    assert batch.ticks_per_second > 0.0


def hand(level):
    stack = Stack([Position("tool", target=[0.4, 0.2, 0.5]), Posture(ARM.q0, weight=1e-3)])
    return Controller(ARM, stack, level=level(), dt=2e-3)


def jerky(level):
    limits = [JointVelocityLimits(), JointAccelerationLimits(20.0), JointJerkLimits(1000.0)]
    return Controller(ARM, Stack([Posture(ARM.q0 + 0.3, kp=400.0)], subject_to=limits), level=level(), dt=2e-3)


def standing(level):
    return Controller(LEGS, Stack([Posture(LEGS.q0)], contacts=feet(LEGS)), level=level(), dt=2e-3)


def some_states(robot, n):
    rng, states = np.random.default_rng(5), []
    for k in range(n):
        q = robot.integrate(robot.q0, 0.1 * rng.normal(size=robot.nv))
        q[0] += 0.3 * k * (robot.nb > 0)
        states.append((0.0, q, 0.1 * rng.normal(size=robot.nv)))
    return states


@pytest.mark.parametrize("level", [wbc.VelocityLevel, AccelerationLevel, wbc.InverseDynamics])
@pytest.mark.parametrize("make", [hand, jerky, standing])
def test_each_answer_is_that_of_its_state_alone_in_any_order_on_any_number_of_workers(level, make):
    asked = some_states(LEGS if make is standing else ARM, 8)
    expected = [make(level).tick(*state).a for state in asked]
    for workers, order in ((1, 1), (2, 1), (3, -1)):
        found = wbc.run_many(make(level), asked[::order], workers=workers).a[::order]
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)


def test_each_state_may_have_a_controller_of_its_own():
    asked = states(4)
    targets = [ARM.q0 + 0.1 * i for i in range(4)]
    batch = wbc.run_many([controller(target) for target in targets], asked, workers=2)
    expected = [controller(target).tick(*state).a for target, state in zip(targets, asked, strict=True)]
    np.testing.assert_allclose(batch.a, expected, rtol=0, atol=1e-9)


def test_workers_leave_the_controllers_given_as_they_are():
    given = controller()
    wbc.run_many(given, states(6), workers=2)
    assert given.ticks == 0


class Dies(Component):
    """Ends its process, as the system does where memory runs out."""

    here = os.getpid()

    def before(self, state, last, plan):
        if os.getpid() != self.here:
            os._exit(1)


def test_a_worker_that_dies_is_reported():
    mortal = Controller(ARM, Stack([Posture(ARM.q0)], components=[Dies()]), level=AccelerationLevel())
    with pytest.raises(WbcError, match="a worker of run_many died"):
        wbc.run_many(mortal, states(4), workers=2)
