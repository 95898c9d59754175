"""What a tick may cost besides time, which no test measures: calls of numpy, and memory that stays."""

from __future__ import annotations

import gc
import tracemalloc

import numpy as np
import pytest

import wbc
from tasks import CenterOfMass, Frame, JointPositionLimits, JointVelocityLimits, Posture, Sole, TorqueLimits
from tests.control.numpy_calls import calls_of
from wbc import Controller, InverseDynamics, Stack, VelocityLevel

ARM, HUMANOID = wbc.load("arm"), wbc.load("humanoid")


def reaching():
    pose = ARM.state().frame("tool").placement
    stack = Stack([Frame("tool", target=pose), Posture(ARM.q0, weight=1e-4)],
                  subject_to=[JointPositionLimits(), JointVelocityLimits()])  # fmt: skip
    return Controller(ARM, stack, level=VelocityLevel())


def standing():
    stack = Stack(
        [CenterOfMass(target=HUMANOID.state().com), Posture(HUMANOID.q0, kp=10.0, weight=1e-3)],
        subject_to=[TorqueLimits(), JointVelocityLimits()],
        contacts=[Sole(foot, half_size=(0.08, 0.04), friction=0.6) for foot in HUMANOID.feet],
    )
    return Controller(HUMANOID, stack, level=InverseDynamics())


#: Calls counted when this was written, with one or two to spare. Those of BLAS on vectors cost a third of an operator
#: between arrays, which is not counted: where one can do the other's work, more calls are less time.
BUDGETS = {reaching: 15, standing: 40}


def ready(make):
    """A controller that has ticked, and its tick with a state that moves a little."""
    controller = make()
    robot = controller.model
    q, v, step = np.array(robot.q0), np.zeros(robot.nv), 1e-4 * np.sin(np.arange(robot.nv))

    def tick(k):
        return controller.tick(1e-3 * k, q, v + step * (k % 7))

    for k in range(20):
        assert tick(k).status.ok
    return tick


@pytest.mark.parametrize("make", BUDGETS, ids=lambda make: make.__name__)
def test_calls_of_numpy_stay_within_their_budget(make):
    found = calls_of(ready(make), 10)
    assert np.median(found) <= BUDGETS[make], found


@pytest.mark.parametrize("make", BUDGETS, ids=lambda make: make.__name__)
def test_no_memory_stays_from_tick_to_tick(make):
    tick = ready(make)
    sizes = []
    tracemalloc.start()
    try:
        for k in range(3000):
            tick(k)
            if k in (1000, 2999):
                gc.collect()
                sizes.append(tracemalloc.get_traced_memory()[0])
    finally:
        tracemalloc.stop()
    # A byte a tick is a megabyte in a million.
    assert sizes[1] - sizes[0] <= 2000
