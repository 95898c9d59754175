"""Every demand of a verdict can be failed: by a record that is spoilt in what the demand is about; and short runs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import pinocchio
import pytest

from tasks.scenarios import SCENARIOS
from wbc.control.recorder import Run
from wbc.errors import InvalidInput
from wbc.report.document import Table
from wbc.sim.scenario import Parameters, Settings, Trial
from wbc.stack.task import Task

pytestmark = pytest.mark.physics

NO_RANGE = "joint position beyond its limit"
#: How each scenario is run here, for how long [s], and demands on formulas, on solvers, and on limits that the robot
#: does not have: no record fails them.
RUNS: Mapping[str, tuple[list[str], float, tuple[str, ...]]] = {
    "humanoid-stand": (["robot=humanoid"], 0.4, ()),
    "quadruped-stand": (["robot=quadruped"], 0.4, ()),
    "humanoid-step": (["robot=humanoid", "steps=1"], 3.0, ()),
    "quadruped-trot-in-place": (["robot=quadruped"], 1.7, ()),
    "stand-family": (["robot=quadruped", "sides=1"], 1.3, ()),
    "dual-arm": (["robot=humanoid"], 0.4, ()),
    "position-drives": (["robot=arm"], 0.4, ()),
    "arm-reach": (["robot=arm"], 2.55, ()),
    "collision-dodge": ([], 0.05, ()),
    "pg-step": (["robot=arm"], 0.3, ("α* in the plane", "difference of QP and step")),
    "pr-torque": ([], 0.3, ("τ(0) by", "τ(0) for", NO_RANGE)),
    "pr-fault": ([], 0.3, ("share lost of joint 1", "alarm of joint 1 later", NO_RANGE)),
    "4p-adaptive": ([], 0.5, ("M_r of unit masses", NO_RANGE)),
}
MOTION = ("error.", "plant.q", "plant.v", "q", "v", "v_cmd", "plant.slip.")
EFFORT, SIGNAL = ("tau", "plant.tau", "f.", "plant.f."), ("signal.",)
Spoil = Callable[[str, Any], Any]


def off(names: tuple[str, ...], size: float, *, always: bool = False) -> Spoil:
    """Adds ``size`` on every third row, or on all, to columns of these names, or of these prefixes with a dot."""

    def spoilt(name: str, values: Any) -> Any:
        if not any(name.startswith(one) if one.endswith(".") else name == one for one in names):
            return values
        rows = always | (np.arange(len(values)) % 3 == 1)
        return values + size * rows.reshape(-1, *[1] * (values.ndim - 1))

    return spoilt


SPOILT: Mapping[str, Spoil] = {
    "off by a decimetre, or a tenth of a radian": off(MOTION, 0.1),
    "efforts off by a hundred newtons or newton metres": off(EFFORT, 100.0),
    "signals off by a hundred": off(SIGNAL, 100.0),
    "signals off by a hundred to the other side": off(SIGNAL, -100.0),
    "far beyond every limit": off((*MOTION, *EFFORT), 1e4, always=True),
    "no tick certified": lambda name, values: np.ones_like(values) if name == "status" else values,
    "over after half the time": lambda name, values: values[: len(values) // 2],
}


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("name", RUNS)
def test_each_demand_fails_on_a_record_that_is_spoilt_in_what_it_is_about(name: str) -> None:
    scenario, (settings, duration, never) = SCENARIOS[name], RUNS[name]
    chosen = Settings(**scenario.choose(plant=None, hierarchy=None, duration=duration))
    p = Parameters(scenario.parse(settings), chosen)
    trials = list(scenario.simulated(scenario.cases(p), p))

    def failed(spoil: Spoil) -> set[str]:
        runs = [
            Run({name: spoil(name, values) for name, values in trial.run.columns.items()}, trial.run.meta)
            for trial in trials
        ]
        spoilt: list[Any] = [Trial(t.name, t.setup, t.controller, run) for t, run in zip(trials, runs, strict=True)]
        return {check.text for check in scenario.judge(iter(spoilt), p).verdict if not check.ok}

    result = scenario.judge(iter(trials), p)
    whole, items = result.verdict, [item for section in result.sections for item in section.items]
    tables = [item for item in items if isinstance(item, Table)]
    assert all(len(row) == len(table.columns) and isinstance(row, tuple) for table in tables for row in table.rows)
    assert all(isinstance(check.text, str) and isinstance(check.unit, str) for check in whole)
    texts = {check.text for check in whole}
    assert len(texts) == len(whole)
    assert texts - set().union(*map(failed, SPOILT.values())) == {text for text in texts if text.startswith(never)}


@pytest.mark.parametrize("name", [*RUNS, "arm-payload", "arm-actuator-loss", "arm-collision"])
def test_a_run_of_one_tick_is_judged_or_refused_before_it_starts(name: str) -> None:
    scenario = SCENARIOS[name]
    chosen = Settings(**scenario.choose(plant=None, hierarchy=None, duration=1e-3))
    settings = RUNS[name][0] if name in RUNS else [] if name == "arm-payload" else ["robot=arm"]
    try:
        result = scenario.run(scenario.parse(settings), chosen)
    except InvalidInput as refused:
        assert "duration is 0.001 s" in str(refused)
    else:
        assert result.run.rows == 1 and result.verdict


@pytest.mark.parametrize("name", RUNS)
def test_targets_that_move_go_millimetres_or_milliradians_at_least_and_no_metres_a_second(name: str) -> None:
    scenario = SCENARIOS[name]
    p = Parameters(
        scenario.parse(RUNS[name][0]), Settings(**scenario.choose(plant=None, hierarchy=None, duration=None))
    )
    when = np.arange(0.0, scenario.duration, 0.01)
    for task in scenario.first_setup(p).stack.tasks:
        target = getattr(task, "target", None)
        if not isinstance(task, Task) or not callable(target):
            continue
        values, rates, _ = zip(*map(target, when), strict=True)
        if isinstance(values[0], pinocchio.SE3):
            first = values[0].rotation
            values = [np.append(v.translation, pinocchio.log3(v.rotation @ first.T)) for v in values]  # type: ignore[assignment]
        ways = np.ptp(np.array(values), axis=0)
        assert (ways[ways > 1e-9] > 1e-3).all(), task.name
        assert np.abs(np.array(rates)).max() < 5.0, task.name


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_scenario_says_what_it_is_and_takes_seconds_to_an_hour(name: str) -> None:
    scenario = SCENARIOS[name]
    assert scenario.name == name and scenario.summary
    assert 0.05 <= scenario.duration <= 60.0
    assert scenario.takes is None or 1.0 <= scenario.takes <= 7200.0
