"""Whatever stands in the place of an argument: an answer, or an error of the library. No other exception comes out."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wbc
from tasks import CollisionAvoidance, Point, Posture
from tests.reliability import walker
from wbc import testing
from wbc.errors import InvalidInput
from wbc.export import movie, to_mcap, to_rerun
from wbc.live import View
from wbc.models.collision import Distances
from wbc.models.inertial_regressor import InertialRegressor
from wbc.motion import Witness, made, retarget
from wbc.report import run_report, save_comparison, save_report
from wbc.sim.bench import bench
from wbc.sim.mujoco_ import MujocoPlant
from wbc.sim.plant import ForwardDynamicsPlant, IntegratorPlant
from wbc.sim.simulate import simulate
from wbc.sim.soak import soak
from wbc.sweep import sweep

pytest.importorskip("gymnasium", reason="the extra `gym`: every public class is walked over")

PUBLIC = walker.public()


@pytest.mark.slow
@pytest.mark.parametrize("name", PUBLIC)
def test_nonsense_is_refused_by_an_error_of_the_library(name: str):
    assert walker.walk(PUBLIC[name]) == []


def test_the_walk_covers_what_users_build():
    for name in ("control.controller.Controller", "stack.stack.Stack", "tasks.position.Position", "qp.problem.QP"):
        assert f"wbc.{name}" in PUBLIC
    assert len(PUBLIC) > 120
    assert sum(1 for thing in PUBLIC.values() if any(walker.examples(thing))) > 0.7 * len(PUBLIC)


def careless(size: Any, *, gain: Any = 1.0) -> float:
    """Multiplies what it gets.

    Example:
        >>> from tests.reliability.test_public_arguments import careless
        >>> careless(2.0)
        2.0
    """
    if gain is None:
        raise InvalidInput("gain is None")
    if gain == -1:
        raise InvalidInput("give another")
    return 1.0 * float(size) * float(gain)


def test_the_walk_finds_what_it_looks_for(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(walker, "_is_ours", lambda value: value is careless)
    found = dict(walker.walk(careless))
    assert found["careless.size: text"].startswith("ValueError: could not convert")
    assert found["careless.size: None"].startswith("TypeError") and found["careless.gain: beyond floats"]
    assert "careless.gain: None" not in found and found["careless.size: nan"] == "taken"
    assert found["careless.gain: negative"].startswith("not named in: give")


# ---- something of another kind in the place of a robot, a run, a controller or a plan; the walk has what else there is
ARM = wbc.load("arm")
CONTROLLER = wbc.Controller(ARM, wbc.Stack([Posture(ARM.q0)]), level=wbc.VelocityLevel())
PLANT = IntegratorPlant(ARM, level="velocity")
RUN = simulate(CONTROLLER, PLANT, duration=2e-3)
RECORDER = wbc.Recorder(3)
RECORDER.tick(CONTROLLER, 0.0, ARM.q0, np.zeros(ARM.nv))
MOTION = made("squat")
NOWHERE = Path("/nowhere/at/all")  # who wrote there would have missed the wrong argument

#: Each call with one argument missing, by what the error has to name.
CALLS: dict[str, Any] = {
    "save_report run": lambda x: save_report(x, NOWHERE),
    "save_report robot": lambda x: save_report(RUN, NOWHERE, robot=x),
    "save_report obstacles": lambda x: save_report(RUN, NOWHERE, obstacles=x),
    "save_report obstacles[0]": lambda x: save_report(RUN, NOWHERE, obstacles=[x]),
    "save_report no path here": lambda x: save_report(RUN, x),
    "save_comparison runs": lambda x: save_comparison(x, NOWHERE),
    "save_comparison runs['b']": lambda x: save_comparison({"a": RUN, "b": x}, NOWHERE),
    "save_comparison robot": lambda x: save_comparison({"a": RUN, "b": RUN}, NOWHERE, robot=x),
    "run_report result": run_report,
    "movie run": lambda x: movie(x, ARM, NOWHERE / "a.gif"),
    "movie robot": lambda x: movie(RUN, x, NOWHERE / "a.gif"),
    "to_mcap run": lambda x: to_mcap(x, NOWHERE),
    "to_mcap robot": lambda x: to_mcap(RUN, NOWHERE, robot=x),
    "to_rerun run": lambda x: to_rerun(x, NOWHERE),
    "to_rerun robot": lambda x: to_rerun(RUN, NOWHERE, robot=x),
    "simulate controller": lambda x: simulate(x, PLANT, duration=1.0),
    "simulate plant": lambda x: simulate(CONTROLLER, x, duration=1.0),
    "simulate disturbances": lambda x: simulate(CONTROLLER, PLANT, duration=1.0, disturbances=[x]),
    "simulate before_tick": lambda x: simulate(CONTROLLER, PLANT, duration=1.0, before_tick=x),
    "simulate progress": lambda x: simulate(CONTROLLER, PLANT, duration=1.0, progress=x),
    "simulate meta": lambda x: simulate(CONTROLLER, PLANT, duration=1.0, meta=x),
    "IntegratorPlant model": IntegratorPlant,
    "ForwardDynamicsPlant model": ForwardDynamicsPlant,
    "MujocoPlant robot": MujocoPlant,
    "bench scenario": bench,
    "soak scenario": lambda x: soak(x, ticks=10),
    "sweep plan": lambda x: sweep(x, out=NOWHERE),
    "View controller": View,
    "Recorder.tick controller": lambda x: wbc.Recorder(3).tick(x, 0.0, ARM.q0, np.zeros(ARM.nv)),
    "Recorder.run meta": RECORDER.run,
    "Controller robot": lambda x: wbc.Controller(x, wbc.Stack([Posture(ARM.q0)]), level=wbc.VelocityLevel()),
    "Controller stack": lambda x: wbc.Controller(ARM, x, level=wbc.VelocityLevel()),
    "Controller.replace stack": CONTROLLER.replace,
    "reach robot": lambda x: wbc.reach(x, [Posture(ARM.q0)]),
    "run_many plans": lambda x: wbc.run_many(x, [(0.0, ARM.q0, ARM.q0)]),
    "retarget motion": lambda x: retarget(x, ARM),
    "retarget robot": lambda x: retarget(MOTION, x),
    "Witness robot": lambda x: Witness(x, {}),
    "Witness contacts": lambda x: Witness(ARM, x),
    "Distances model": Distances,
    "Distances obstacles": lambda x: Distances(ARM, obstacles=x),
    "Distances obstacles[0]": lambda x: Distances(ARM, obstacles=[x]),
    "CollisionAvoidance CollisionAvoidance.obstacles[0]": lambda x: CollisionAvoidance([x]),
    "InertialRegressor model": InertialRegressor,
    "check_task task": testing.check_task,
    "check_task model": lambda x: testing.check_task(Posture(ARM.q0), x),
    "check_constraint constraint": testing.check_constraint,
    "check_contact contact": testing.check_contact,
    "check_contact model": lambda x: testing.check_contact(Point("tool", friction=0.5), x),
    "check_method method": testing.check_method,
    "levels_of member": lambda x: testing.levels_of(x, ARM),
    "levels_of model": lambda x: testing.levels_of(Posture(ARM.q0), x),
    "moments model": testing.moments,
}
#: What is no argument of these.
THINGS = st.one_of(
    st.integers(), st.floats(), st.binary(max_size=3), st.builds(object), st.just(np.zeros((2, 3))),
    st.sets(st.integers(), min_size=1, max_size=2), st.just(1j),
)  # fmt: skip


@pytest.mark.parametrize("call", CALLS)
@settings(max_examples=15)
@given(thing=THINGS)
def test_another_kind_of_thing_is_refused_by_name(call: str, thing: Any):
    with pytest.raises(InvalidInput) as refused:
        CALLS[call](thing)
    assert call.partition(" ")[2] in str(refused.value)
