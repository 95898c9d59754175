"""A loop of one's own, written down tick by tick, is the run that a simulation of it would give."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import wbc
import wbc.tasks as T
from wbc.errors import InvalidInput, WbcError
from wbc.report.document import Plot, Table
from wbc.report.measure import fallbacks
from wbc.report.sections.solver import section
from wbc.sim.plant import IntegratorPlant
from wbc.sim.scenario import ScenarioResult
from wbc.sim.simulate import simulate

DT, TICKS = 0.002, 40


def controller(name: str = "humanoid") -> wbc.Controller:
    robot = wbc.load(name)
    frame = "left_hand" if name == "humanoid" else "tool"
    tasks = [T.Frame(frame, target=np.eye(4), weight=0.1), T.Posture(robot.q0)]
    stack = wbc.Stack(tasks, contacts=T.feet(robot) if name == "humanoid" else [], subject_to=[T.JointLimits()])
    return wbc.Controller(robot, stack, level=wbc.AccelerationLevel(), dt=DT)


def recorded(driver: Any, ticks: int = TICKS) -> wbc.Run:
    robot = driver.controller.model if isinstance(driver, wbc.Setpoint) else driver.model
    recorder, q, v = wbc.Recorder(8), robot.q0, np.zeros(robot.nv)
    for k in range(ticks):
        command = recorder.tick(driver, DT * k, q, v)
        q, v = command.q, command.v
    return recorder.run()


@pytest.mark.parametrize("name", ["humanoid", "arm"])
def test_a_recorded_loop_has_the_columns_of_a_simulation(name: str):
    own = recorded(controller(name))
    plant = IntegratorPlant(controller(name).model, dt=DT)
    other = simulate(controller(name), plant, duration=DT * TICKS)
    assert set(own) == set(other) - {"plant.q", "plant.v", "push"}
    for column in set(own) - {"tick_us"}:
        np.testing.assert_allclose(own[column], other[column], atol=1e-9, err_msg=column)
    assert (own["tick_us"] > 0.0).all()
    same = set(own.meta) & set(other.meta)
    assert {name: own.meta[name] for name in same} == {name: other.meta[name] for name in same}
    assert {"robot", "dt", "duration", "joint_names", "limits", "tasks", "contacts", "stack"} <= same


def test_the_ticks_of_a_setpoint_are_recorded_too():
    run = recorded(wbc.Setpoint(controller("arm"), feedback="measured"))
    assert run.rows == TICKS and run.meta["robot"] == "arm"


def test_columns_and_metadata_of_ones_own_stand_beside_the_others():
    driver = controller("arm")
    recorder, q = wbc.Recorder(2), driver.model.q0
    recorder.tick(driver, 0.0, q, 0 * q, force=[1.0, 2.0, 3.0], battery=48.0)
    run = recorder.run({"robot": "mine", "operator": "me"})
    assert run["force"].tolist() == [[1.0, 2.0, 3.0]] and run["battery"].tolist() == [48.0]
    assert run.meta["robot"] == "mine" and run.meta["operator"] == "me" and run.meta["dt"] == DT


@pytest.mark.parametrize(
    ("first", "later", "said"),
    [
        ({"tau": [1.0]}, {}, "column 'tau' is one that a recorder writes"),
        ({"status": 7, "active": [1.0]}, {}, "column 'status' is one that a recorder writes"),
        ({"cost.mine": 1.0}, {}, "column 'cost.mine' is one that a recorder writes"),
        ({"plant.q": [1.0]}, {}, r"column 'plant.q' has shape \(1,\); it must have \(7,\)"),
        ({"map": np.zeros((2, 2))}, {}, r"column 'map' has shape \(2, 2\)"),
        ({"battery": "full"}, {}, "column 'battery' must hold numbers, not 'full'"),
        ({"battery": [[1.0, 2.0], [3.0]]}, {}, "column 'battery' must hold numbers"),
        ({"battery": 1.0}, {"battery": [1.0]}, r"column 'battery' has shape \(\), fixed by the first row"),
        ({"battery": 1.0}, {"batery": 1.0}, "did you mean 'battery'"),
    ],
)
def test_columns_that_cannot_be_recorded_are_refused_before_the_controller_decides(first: Any, later: Any, said: str):
    driver = controller("arm")
    recorder, q = wbc.Recorder(2), driver.model.q0
    if later:
        recorder.tick(driver, 0.0, q, 0 * q, **first)
    before = driver.ticks
    with pytest.raises(WbcError, match=said):
        recorder.tick(driver, DT, q, 0 * q, **(later or first))
    assert driver.ticks == before


def test_a_column_of_ones_own_that_a_tick_leaves_out_has_a_gap_there_and_keeps_its_fractions():
    driver = controller("arm")
    recorder, q = wbc.Recorder(4), driver.model.q0
    for k, more in enumerate(({"battery": 48, "grip": 1}, {"battery": 47.5}, {}, {"battery": np.nan, "grip": 0})):
        recorder.tick(driver, DT * k, q, 0 * q, **more)  # type: ignore[arg-type]
    run = recorder.run()
    np.testing.assert_array_equal(run["battery"], [48.0, 47.5, np.nan, np.nan])
    assert run["grip"].tolist() == [1, -1, -1, 0] and run["grip"].dtype == np.int64


def test_metadata_of_ones_own_do_not_replace_what_the_columns_are_read_with():
    driver = controller("arm")
    recorder, q = wbc.Recorder(2), driver.model.q0
    recorder.tick(driver, 0.0, q, 0 * q)
    plant = IntegratorPlant(driver.model, dt=DT)
    for meta, said in (
        ({"dt": 5.0}, r"meta\['dt'\] is known of the run"),
        ({"parameters": 5}, "parameters is 5; it must be an object"),
    ):
        with pytest.raises(InvalidInput, match=said):
            recorder.run(meta)
        with pytest.raises(InvalidInput, match=said):
            simulate(driver, plant, duration=DT, meta=meta)
    with pytest.raises(InvalidInput, match="is known of the run"):
        simulate(driver, plant, duration=DT, meta={"ended": "complete"})


def test_a_recorder_belongs_to_one_controller():
    first, second = controller("arm"), controller("arm")
    recorder = wbc.Recorder(2)
    recorder.tick(first, 0.0, first.model.q0, np.zeros(first.model.nv))
    with pytest.raises(InvalidInput, match="one controller"):
        recorder.tick(second, 0.0, first.model.q0, np.zeros(first.model.nv))
    for nonsense in (None, "arm", first.model):
        with pytest.raises(InvalidInput, match=r"must be a wbc\.Controller"):
            wbc.Recorder(2).tick(nonsense, 0.0, first.model.q0, np.zeros(7))  # type: ignore[arg-type]


class Says(wbc.Component):
    """A signal of some size."""

    def __init__(self, size: int) -> None:
        super().__init__(name="member")
        self.size = size

    def signals(self) -> dict[str, Any]:
        return {"x": np.ones(self.size)}


HAND = {"frame": "left_hand", "name": "member"}
FOOT: dict[str, Any] = {"frame": "left_sole", "friction": 0.5, "name": "member"}


@pytest.mark.parametrize("swapped", [False, True])
@pytest.mark.parametrize(
    ("place", "members"),
    [
        ("tasks", [T.Position(**HAND, target=[0.4, 0.2, 1.0]), T.Frame(**HAND, target=np.eye(4))]),
        ("subject_to", [T.BoxLimits(**HAND, upper=2.0), T.HalfSpaceLimit(**HAND, normal=[0, 0, 1], offset=-2.0)]),
        ("contacts", [T.Point(**FOOT), T.Sole(**FOOT, half_size=(0.1, 0.05))]),
        ("components", [Says(2), Says(3)]),
    ],
)
@pytest.mark.filterwarnings("ignore::wbc.models.plausible.NothingHoldsTheBase")
def test_a_stack_whose_member_has_the_name_but_not_the_size_is_recorded_without_it(
    place: str, members: list[Any], swapped: bool
):
    """A loop goes on: of the other member, and of new ones, there is nothing in the columns of the first."""
    robot = wbc.load("humanoid")
    stacks = [
        wbc.Stack(**({"tasks": [posture]} | {place: [posture, one] if place == "tasks" else [one]}))
        for posture, one in zip((T.Posture(robot.q0), T.Posture(robot.q0, name="new")), members, strict=True)
    ]
    first, other = stacks[::-1] if swapped else stacks
    driver, recorder = wbc.Controller(robot, first, level=wbc.InverseDynamics(), dt=DT), wbc.Recorder(8)
    for k, stack in enumerate([first, other, first]):
        if k:
            driver.replace(stack)
        recorder.tick(driver, DT * k, robot.q0, np.zeros(robot.nv))
    run = recorder.run()
    assert np.isfinite(run["v_cmd"]).all() and f"error.{'Posture' if swapped else 'new'}" not in run.columns
    held = {
        name: np.isfinite(values).all(axis=1)
        for name, values in run.items()
        if name in ("error.member", "margin.member", "f.member", "signal.member.x")
    }
    assert held and all(finite.tolist() == [True, False, True] for finite in held.values()), held


def test_why_a_tick_had_no_answer_is_kept_with_its_problem_and_it_has_no_reasons():
    robot = wbc.load("arm")
    high = T.Position("tool", target=[0.4, 0.2, 4.0], kp=400.0)
    stack = wbc.Stack([T.Posture(robot.q0)], subject_to=[high.exactly(), T.JointAccelerationLimits(200.0)])
    driver = wbc.Controller(robot, stack, level=wbc.AccelerationLevel(), dt=DT)
    run = recorded(driver, 3)
    assert run.meta["failure"]["t"] == 0.0 and "Position[tool]" in run.meta["failure"]["why"]
    assert run.failed is not None and recorded(controller("arm")).meta["failure"] is None
    for column in ("active.row", "active.multiplier", "residual.Posture", "cost.Posture"):
        assert np.isnan(run[column]).all(), column


class Raises(wbc.Component):
    """Raises in some ticks."""

    def before(self, state: Any, last: Any, plan: Any) -> None:
        if 3 <= round(state.t / DT) < 18 or round(state.t / DT) == 30:
            raise ValueError("no")


def test_a_record_says_which_fallback_level_made_each_command():
    robot = wbc.load("arm")
    stack = wbc.Stack([T.Posture(robot.q0)], subject_to=[T.JointLimits()], components=[Raises()])
    driver, recorder = wbc.Controller(robot, stack, level=wbc.AccelerationLevel(), dt=DT), wbc.Recorder(8)
    made = [recorder.tick(driver, DT * k, robot.q0, np.zeros(robot.nv)).fallback_level for k in range(TICKS)]
    run = recorder.run()
    assert [run.meta["fallback_levels"][k] for k in run["fallback"].astype(int)] == made
    assert {name: ticks.sum() for name, ticks in fallbacks(run).items()} == {"solved": 24, "hold": 11, "damped": 5}
    page = section(ScenarioResult(run=run, ok=True, violations={}, tracking={}, verdict=[]))
    assert page is not None
    (table,) = (item for item in page.items if isinstance(item, Table) and item.columns[0] == "fallback level")
    assert [row[:2] for row in table.rows] == [("solved", 24), ("hold", 11), ("damped", 5)]
    (plot,) = (item for item in page.items if isinstance(item, Plot) and item.name == "fallbacks")
    spans = {strip.label: [round(t / DT) for span in strip.intervals for t in span] for strip in plot.strips}
    assert spans == {"hold": [3, 13, 30, 31], "damped": [13, 18]}


def reaching(level: wbc.Formulation | None = None, **settings: Any) -> wbc.Controller:
    """An arm with a target so far that joints are at their limits."""
    robot = wbc.load("arm")
    tasks = [T.Frame("tool", target=np.eye(4), kp=400.0), T.Posture(robot.q0, weight=1e-3)]
    stack = wbc.Stack(tasks, subject_to=[T.JointLimits()])
    return wbc.Controller(robot, stack, level=level or wbc.VelocityLevel(), dt=DT, **settings)


@pytest.mark.parametrize("solver", ["pdas", "daqp"])
@pytest.mark.parametrize("hierarchy", [wbc.Weighted(), wbc.Strict()], ids=["weighted", "strict"])
def test_a_record_has_the_active_rows_that_explain_names(solver: str, hierarchy: Any):
    driver = reaching(solver=solver, hierarchy=hierarchy)
    recorder, q = wbc.Recorder(TICKS), driver.model.q0
    explained = []
    for k in range(TICKS):
        q = recorder.tick(driver, DT * k, q, np.zeros(driver.model.nv)).q
        explained.append(driver.explain())
    run, seen = recorder.run(), 0
    rows = run.meta["active_rows"]
    for text, codes, bounds, multipliers in zip(
        explained, run["active.row"], run["active.bound"], run["active.multiplier"], strict=True
    ):
        for code, bound, multiplier in zip(codes, bounds, multipliers, strict=True):
            if np.isnan(code):
                continue
            row = rows[int(code)]
            unit = row["unit"]
            assert (
                f"  {row['owner']}: {row['label']} at its {row['side']} bound {bound:.4g} {unit}; "
                f"multiplier {multiplier:.3g} per {unit}"
            ) in text
            seen += 1
        assert np.isfinite(codes).sum() == text.count("multiplier")
    assert seen > TICKS, "the joints never came to their limits"


def test_a_record_has_the_residuals_and_shares_that_explain_names():
    driver = reaching()
    run = recorded(driver, 5)
    metres, radians = run["residual.Frame[tool]"][-1]
    costs = np.array([run["cost.Frame[tool]"][-1], run["cost.Posture"][-1]])
    share = 100.0 * costs / costs.sum()
    text = driver.explain()
    assert f"residual {metres:.3g} m/s, {radians:.3g} rad/s, {share[0]:.1f} % of the cost" in text
    assert f"residual {run['residual.Posture'][-1, 0]:.3g} rad/s, {share[1]:.1f} % of the cost" in text
    assert run.meta["residuals"] == {"Frame[tool]": "m/s, rad/s", "Posture": "rad/s"}


class Fickle(wbc.Component):
    """Sound signals, but for those of one tick."""

    def __init__(self, spoilt_tick: int, spoilt: Any) -> None:
        super().__init__(name="fickle")
        self.now, self.spoilt_tick, self.spoilt = -1, spoilt_tick, spoilt

    def signals(self) -> dict[str, Any]:
        self.now += 1
        if self.now != self.spoilt_tick:
            return {"x": np.ones(2)}
        if isinstance(self.spoilt, Exception):
            raise self.spoilt
        return {"x": self.spoilt}


@pytest.mark.parametrize("tick", [0, 2])
@pytest.mark.parametrize("spoilt", [ValueError("no"), np.ones(3), np.ones((2, 2)), "text", 1.0, None], ids=str)
def test_signals_that_fail_cost_neither_the_command_nor_the_other_columns(tick: int, spoilt: Any):
    """The robot waits for the command; the record says whose signals are missing, and why."""
    robot = wbc.load("arm")
    stack = wbc.Stack([T.Posture(robot.q0 + 0.1)], components=[Fickle(tick, spoilt), Says(1)])
    driver, recorder = wbc.Controller(robot, stack, level=wbc.VelocityLevel(), dt=DT), wbc.Recorder(8)
    commands = [recorder.tick(driver, DT * k, robot.q0, np.zeros(robot.nv)) for k in range(4)]
    assert all(command.status.ok for command in commands)
    run = recorder.run()
    assert run.rows == 4 and (run["signal.member.x"] == 1.0).all()
    assert list(run.meta["silent"]) == ["fickle"]
    if tick and "signal.fickle.x" in run.columns:
        np.testing.assert_array_equal(run["signal.fickle.x"], [[1, 1], [1, 1], [np.nan, np.nan], [1, 1]])
