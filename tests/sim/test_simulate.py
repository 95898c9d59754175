"""The loop records what happened, says why it ended, and is the same each time."""

from __future__ import annotations

import re
import warnings

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from tasks import Damping, JointVelocityLimits, Position, Posture, TorqueLimits
from tests.sim.builders import stander, standing
from wbc.control.controller import Controller
from wbc.control.recorder import Run
from wbc.errors import InvalidInput, SimulationError
from wbc.models import load
from wbc.qp import QP
from wbc.qp.conflict import conflict
from wbc.report import save_report
from wbc.sim.disturbance import Delay, Push, SensorNoise
from wbc.sim.joining import guests, joined
from wbc.sim.plant import IntegratorPlant, Plant
from wbc.sim.simulate import Interrupted, NoAnswer, simulate
from wbc.stack.component import Component
from wbc.stack.formulation import AccelerationLevel, InverseDynamics, VelocityLevel
from wbc.stack.overrides import Overrides
from wbc.stack.stack import Stack
from wbc.types import Status

ARM, LEGS = load("arm"), load("quadruped")
TARGET = [0.4, 0.2, 0.5]


class Counter(Component):
    """Counts its ticks and starts again when told."""

    def reset(self, state):
        self.count = 0

    def after(self, state, command):
        self.count += 1

    def signals(self):
        return {"count": self.count, "pair": np.array([self.count, -self.count])}


def reaching(level=None, **settings):
    tasks = [Position("tool", target=TARGET, kp=100.0), Posture(ARM.q0, weight=1e-4)]
    stack = Stack(tasks, subject_to=[JointVelocityLimits()], components=[Counter()])
    return Controller(ARM, stack, level=level or VelocityLevel(), **settings)


def run_for(duration, controller=None, plant=None, **more):
    """A run of an arm that follows velocities."""
    return simulate(
        controller or reaching(), plant or IntegratorPlant(ARM, level="velocity"), duration=duration, **more
    )


def test_a_reach_is_recorded_column_by_column():
    run = run_for(1.5, meta={"scenario": "reach", "parameters": {"x": 1}})
    assert run.rows == 1500 and run.meta["ended"] == "complete"
    assert run.meta["scenario"] == "reach"
    np.testing.assert_allclose(run["t"], 1e-3 * np.arange(1500), atol=1e-12)
    assert run["q"].shape == (1500, ARM.nq) and run["v_cmd"].shape == (1500, ARM.nv)
    assert run["certificate"].shape == (1500, 3) and run["certificate"].max() < 1e-6
    assert [run.meta["statuses"][i] for i in np.unique(run["status"])] == ["SOLVED"]
    assert (run["tick_us"] > 0).all()
    assert np.linalg.norm(run["error.Position[tool]"][-1]) < 1e-3
    assert run.meta["tasks"]["Position[tool]"]["units"] == ["m", "m", "m"]
    assert len(run.meta["tasks"]["Posture"]["units"]) == ARM.nj
    assert run.meta["tasks"]["Position[tool]"]["point"] == "tool" and "point" not in run.meta["tasks"]["Posture"]
    assert run["distance.Position[tool]"].shape == (1500,) and 0.0 < run["distance.Position[tool]"].max() < 1e-6
    assert run.meta["distances"] == {"Position[tool]": "m/s", "Posture": "rad/s"}
    np.testing.assert_array_equal(run["signal.Counter.count"], np.arange(1, 1501))
    assert run["signal.Counter.pair"].shape == (1500, 2)
    np.testing.assert_array_equal(run["push"], 0.0)


def test_what_a_level_does_not_decide_is_no_column():
    velocity, acceleration = run_for(0.01), run_for(0.01, reaching(AccelerationLevel()), IntegratorPlant(ARM))
    assert not {"a", "tau"} & set(velocity)
    assert "a" in acceleration and "tau" not in acceleration


def test_the_same_seed_gives_the_same_run_to_the_bit():
    def once(seed):
        return run_for(0.1, disturbances=[SensorNoise(position=1e-3, velocity=1e-2, seed=seed), Delay(0.003)])

    first, second, third = once(1), once(1), once(2)
    for name in set(first) - {"tick_us"}:
        np.testing.assert_array_equal(first[name], second[name])
    assert not np.array_equal(first["q"], third["q"])
    assert first.meta["seed"] == 1 and len(first.meta["disturbances"]) == 2
    assert (first["q"] != first["plant.q"]).any()


@pytest.mark.parametrize("late", [0, 4])
def test_the_plant_of_the_next_row_is_where_the_command_led_that_arrived(late):
    """The first one holds until others arrive."""
    run = run_for(0.05, disturbances=[Delay(1e-3 * late)] * (late > 0))
    moved = np.diff(run["plant.q"], axis=0) * 1e3
    np.testing.assert_allclose(moved[late:], run["v_cmd"][: len(moved) - late], atol=1e-9)
    np.testing.assert_allclose(moved[:late], np.tile(run["v_cmd"][0], (late, 1)), atol=1e-9)
    np.testing.assert_array_equal(run["q"], run["plant.q"])


def test_a_plan_of_the_caller_runs_before_each_tick_and_progress_is_told():
    controller, times, shares = reaching(), [], []
    task = controller.stack.tasks[0]

    def before(t):
        times.append(t)
        if t >= 0.01:
            task.target = np.add(TARGET, [0.0, 0.0, 0.1])

    run = run_for(0.02, controller, before_tick=before, progress=shares.append)
    np.testing.assert_array_equal(times, run["t"])
    jump = np.abs(np.diff(run["error.Position[tool]"][:, 2]))
    assert jump.argmax() == 9 and jump.max() > 0.09
    assert shares[0] == 0.0 and shares[-1] == 1.0 and shares == sorted(shares)


def test_a_stack_that_is_replaced_goes_on_in_the_columns_of_the_first(tmp_path):
    control = reaching()
    reach = Position("tool", target=TARGET[:2], axes="xy", kp=100.0)
    other = Stack([reach, Damping(weight=0.1)], subject_to=[JointVelocityLimits()])
    run = run_for(0.1, control, before_tick=lambda t: control.replace(other) if t == 0.05 else None)
    assert run.meta["ended"] == "complete" and not run["status"].any()
    for name in ("error.Posture", "error.Position[tool]", "signal.Counter.count"):
        assert (np.isfinite(run[name]).reshape(100, -1).all(axis=1) == (np.arange(100) < 50)).all(), name
    assert "error.Damping" not in run
    save_report(run, tmp_path)


def test_controller_starts_anew_and_the_plant_goes_on():
    controller, plant = reaching(), IntegratorPlant(ARM, level="velocity")
    run_for(0.02, controller, plant)
    run = run_for(0.02, controller, plant)
    assert run["t"][0] == pytest.approx(0.02)
    assert run["signal.Counter.count"][0] == 1


def test_a_short_record_keeps_only_time_status_and_duration():
    run = run_for(0.02, recorder=False)
    assert set(run) == {"t", "status", "tick_us"} and run.rows == 20


class Breaking(Plant):
    """Takes velocities, and breaks down after three steps."""

    takes = "velocity"

    def _place(self, q, v):
        self.steps = 0

    def _advance(self, command):
        self.steps += 1
        if self.steps > 3:
            raise SimulationError("the gears are gone")
        return self.q, self.v


@pytest.mark.parametrize("name", ["q", "tick_us", "plant.q", "error.Position[tool]", "signal.Counter.count"])
def test_a_truth_of_a_plant_replaces_no_column_of_the_record(name):
    class Knowing(Breaking):
        steps = 0

        def truth(self):
            return {"plant.warmth": 20.0, name: np.zeros(ARM.nq)}

    with pytest.raises(
        InvalidInput, match=rf"Knowing.truth\(\) gives {re.escape(repr(name))}, a column that the record"
    ):
        simulate(reaching(), Knowing(ARM, 1e-3), duration=0.1)


def test_physics_that_breaks_down_ends_the_run_with_a_reason():
    plant = Breaking(ARM, 1e-3)
    plant.reset(ARM.q0)
    run = run_for(0.02, plant=plant)
    assert run.meta["ended"] == "the gears are gone" and run.rows == 4


def test_a_run_survives_the_disk(tmp_path):
    run = run_for(0.02)
    loaded = Run.load(run.save(tmp_path / "out"))
    for name, values in run.items():
        np.testing.assert_array_equal(loaded[name], values)
    assert loaded.meta["limits"]["q_max"] == ARM.limits.q_max.tolist()
    assert {"numpy", "pin", "python"} <= set(loaded.meta["versions"])
    assert {"processor", "cores", "system"} == set(loaded.meta["machine"])


class Misspelt(Component):
    """Overrides a target of a task that does not exist, from its third tick on where it is told to wait."""

    def __init__(self, waits):
        super().__init__()
        self.waits = waits

    def before(self, state, last, plan):
        return None if self.waits and state.t < 2.5e-3 else Overrides(tasks={"Positon[tool]": {"target": TARGET}})


@pytest.mark.parametrize("waits", [False, True])
def test_a_run_without_a_solved_tick_is_warned_about(waits):
    stack = Stack([Position("tool", target=TARGET)], subject_to=[JointVelocityLimits()], components=[Misspelt(waits)])
    controller = Controller(ARM, stack, level=VelocityLevel())
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        run = run_for(5e-3, controller)
    told = [str(one.message) for one in said if one.category is NoAnswer]
    assert len(told) == (not waits) and run.meta["failure"] is not None
    assert all("'Positon[tool]'" in one and "no tick of this run was solved" in one for one in told)


def test_linear_algebra_has_one_thread_while_it_runs_and_its_threads_back_after():
    def threads():
        return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}

    during = set()
    with threadpool_limits(2):
        before = threads()
        run_for(0.002, before_tick=lambda t: during.update(threads()))
        assert threads() == before
    assert during == {1}


@pytest.mark.physics
class TestStanding:
    """A quadruped in physics."""

    @pytest.fixture
    def plant(self):
        pytest.importorskip("mujoco")
        from wbc.sim.mujoco_ import MujocoPlant

        return MujocoPlant(LEGS, contacts=standing(LEGS))

    def test_a_push_is_felt_answered_and_recorded(self, plant):
        push = Push("trunk", (0.0, 25.0, 0.0), start=0.1, duration=0.1)
        run = simulate(stander(LEGS), plant, duration=0.6, disturbances=[push])
        assert run.meta["ended"] == "complete" and not run.meta["fallen"]
        on = np.flatnonzero(run["push"][:, 1])
        assert on[0] == 100 and len(on) == 100
        error = np.linalg.norm(run["error.CenterOfMass"], axis=1)
        assert error[:100].max() < 1e-3 < error[100:250].max() and error[-1] < 0.5 * error.max()
        names = list(run.meta["contacts"])
        assert len(names) == 4
        for name in names:
            assert run[f"plant.f.{name}"].shape == (600, 6) and run[f"f.{name}"].shape == (600, 3)
            assert run[f"plant.slip.{name}"].shape == (600, 2)
            cone = np.array(run.meta["contacts"][name]["cone"])
            assert (run[f"f.{name}"] @ cone.T).max() < 1e-6
            assert run.meta["contacts"][name]["kind"] == "point"
        # Weight and push against the feet: what they carry is what the robot's momentum does not take up.
        sideways = sum(run[f"plant.f.{name}"][100:200, 1] for name in names).mean()
        assert -25.0 < sideways < 0.0

    def test_measured_and_commanded_forces_agree_on_a_robot_at_rest(self, plant):
        run = simulate(stander(LEGS), plant, duration=0.5)
        for name in run.meta["contacts"]:
            commanded, true = run[f"f.{name}"][-100:], run[f"plant.f.{name}"][-100:, :3]
            assert np.abs(commanded - true).max() < 0.02 * LEGS.mass * 9.81

    def test_a_push_too_strong_ends_the_run_as_fallen(self, plant):
        push = Push("trunk", (0.0, 400.0, 0.0), start=0.05, duration=0.3)
        run = simulate(stander(LEGS), plant, duration=3.0, disturbances=[push])
        assert run.meta["fallen"] and run.meta["ended"].startswith("fallen at t = ")
        assert run.rows < 3000

    def test_every_tick_is_certified_under_noise_and_delay(self, plant):
        noise = SensorNoise(position=1e-4, velocity=1e-2, base_velocity=5e-3, base_position=5e-4, seed=3)
        run = simulate(stander(LEGS), plant, duration=0.5, disturbances=[noise, Delay(0.002)])
        assert set(run["status"]) == {list(Status).index(Status.SOLVED)}
        assert not run.meta["fallen"]


def test_the_first_tick_without_an_answer_is_explained_and_its_problem_kept(tmp_path):
    there = ARM.state().frame("tool").position.copy()
    high = Position("tool", target=lambda t: there + 50.0 * (t >= 0.005) * np.eye(3)[2], kp=1e4, name="high")
    stack = Stack([Posture(ARM.q0)], subject_to=[high.exactly(), TorqueLimits()])
    control = Controller(ARM, stack, level=InverseDynamics())
    run = simulate(control, IntegratorPlant(ARM, level="acceleration"), duration=0.01)
    assert run.meta["failure"]["t"] == pytest.approx(0.005)
    assert "high exactly" in run.meta["failure"]["why"] and "TorqueLimits" in run.meta["failure"]["why"]
    run.save(tmp_path / "run")
    found = conflict(QP.load(tmp_path / "run" / "failed.npz"))
    assert found is not None and all(str(change) in run.meta["failure"]["why"] for change in found.gives)
    good = simulate(control, IntegratorPlant(ARM, level="acceleration"), duration=0.004)
    assert good.meta["failure"] is None and good.failed is None


@pytest.mark.parametrize(("when", "rows"), [(0.0045, 5), (-1.0, 0)])
def test_ctrl_c_hands_over_the_ticks_so_far(when, rows):
    def stop(t: float) -> None:
        if t > when:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as caught:
        run_for(1.0, before_tick=stop)
    if not rows:
        assert not isinstance(caught.value, Interrupted)
        return
    run = caught.value.run
    assert run.rows == rows and run.meta["ended"] == str(caught.value) == "interrupted at t = 0.005 s"
    assert caught.value.robot is ARM and isinstance(caught.value, Interrupted)


# ---- who joins a simulation
def resting() -> Run:
    return run_for(0.02, Controller(ARM, Stack([Posture(ARM.q0 + 0.1)]), level=VelocityLevel()))


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
