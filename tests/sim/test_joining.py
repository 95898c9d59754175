"""Who joins a simulation sees every tick and brings disturbances along; nobody else notices."""

from __future__ import annotations

import numpy as np
import pytest

from tasks import Posture
from wbc.control.controller import Controller
from wbc.control.recorder import Run
from wbc.models import load
from wbc.sim.disturbance import SensorNoise
from wbc.sim.joining import guests, joined
from wbc.sim.plant import IntegratorPlant
from wbc.sim.simulate import simulate
from wbc.stack.formulation import VelocityLevel
from wbc.stack.stack import Stack

ARM = load("arm")


def resting() -> Run:
    controller = Controller(ARM, Stack([Posture(ARM.q0 + 0.1)]), level=VelocityLevel())
    return simulate(controller, IntegratorPlant(ARM, level="velocity"), duration=0.02)


def test_a_watcher_sees_every_tick_with_its_answer():
    seen = []
    with joined(lambda tick, ticks, controller: seen.append((tick, ticks, controller.qp.cost(controller.last.v)))):
        run = resting()
    assert [(tick, ticks) for tick, ticks, _ in seen] == [(k, 20) for k in range(20)]
    assert np.isfinite([cost for *_, cost in seen]).all()
    assert all(np.array_equal(run[name], resting()[name]) for name in ("q", "v_cmd", "status"))


def test_a_disturbance_that_is_brought_along_acts_and_is_named_in_the_record():
    quiet = resting()
    with joined(disturbances=[SensorNoise(position=1e-3, seed=7)]):
        noisy = resting()
    assert quiet.meta["disturbances"] == [] and len(noisy.meta["disturbances"]) == 1
    assert noisy.meta["seed"] == 7
    assert not np.array_equal(quiet["v_cmd"], noisy["v_cmd"])


def test_after_the_block_nobody_is_there():
    with pytest.raises(ZeroDivisionError), joined(), joined():
        assert len(guests()) == 2
        raise ZeroDivisionError
    assert guests() == ()
