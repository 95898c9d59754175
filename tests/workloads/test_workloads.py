"""Workloads: what the controller answers is certified, keeps every limit and obeys the equations of motion."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tasks.workloads import WORKLOADS
from wbc.errors import InvalidInput, WbcError
from wbc.sim.bench import bench
from wbc.sim.scenario import find, scenarios

LIMITS = ("tau_viol_max_Nm", "vel_viol_max", "pos_viol_max", "friction_viol_max_N")
FIELDS = {
    "peer", "version", "variant", "workload", "ticks", "repeats", "total_us", "raw_us", "split_us", "qp",
    "solver_failures", "counts", "certified", "pinocchio_us", "total_over_pinocchio", "quality",
}  # fmt: skip

each_workload = pytest.mark.parametrize("name", WORKLOADS)


@cache
def short(name: str) -> dict[str, Any]:
    return bench(WORKLOADS[name], ticks=80, repeats=1)


@cache
def full(name: str) -> dict[str, Any]:
    return bench(WORKLOADS[name], repeats=1)


@each_workload
def test_every_tick_is_certified(name: str):
    row = short(name)
    assert row["certified"] == 1.0 and row["solver_failures"] == 0


@each_workload
def test_limits_and_cones_hold_at_every_tick(name: str):
    quality = short(name)["quality"]
    assert {key: quality[key] for key in LIMITS if quality.get(key, 0.0) > 1e-6} == {}


@each_workload
def test_the_answer_obeys_the_equations_of_motion(name: str):
    assert short(name)["quality"].get("dyn_residual_max", 0.0) <= 1e-8


@each_workload
def test_moving_targets_go_to_and_fro_by_centimetres_on_each_axis_that_moves(name: str):
    workload = WORKLOADS[name]
    asked = workload.complete_parameters()
    setup = workload.first_setup(asked)
    when = np.arange(0.0, asked.settings.duration, 10.0 * setup.plant.dt)
    moving = [task.target for task in setup.stack.tasks if callable(getattr(task, "target", None))]
    assert moving
    for target in moving:
        values = [value[0] if isinstance(value, tuple) else value for value in map(target, when)]
        way = np.array([getattr(value, "translation", value) for value in values])
        moves = np.ptp(way, axis=0)
        turns = (np.diff(np.sign(np.diff(way, axis=0)), axis=0) != 0).sum(axis=0)
        assert moves.any() and turns[moves > 0.0].min() >= 2, "an axis does not come back"
        assert moves[moves > 0.0].min() > 0.01 and moves.max() < 0.5


def test_errors_at_the_end_are_those_of_the_last_tick_and_speeds_are_shares_of_limits():
    for name in ("W1", "W3"):
        workload = WORKLOADS[name]
        setup = workload.first_setup(workload.complete_parameters())
        made, problem = setup.about
        told = replace(setup, about=(made, replace(problem, errors=lambda data, k: (float(k), 10.0 * k))))
        trial = told.run(duration=45 * setup.plant.dt)
        quality, limits = workload.quality(trial), made.robot.limits
        assert [value for key, value in quality.items() if "_final" in key] == [44.0, 440.0]
        used = np.abs(np.vstack([trial.run["v"], trial.setup.plant.v])) / limits.v_max
        assert used[:-1].max() * 0.99 <= quality["vel_use_max"] <= used.max() * 1.01


@each_workload
def test_a_row_can_be_written_and_has_every_field(name: str):
    row = short(name)
    assert json.loads(json.dumps(row)) == row
    assert set(row) == FIELDS
    assert set(row["total_us"]) == set(row["raw_us"]) == {"median", "mean", "p99", "max"}
    assert set(row["split_us"]) == {"update", "fill", "solve", "decode", "rest"}
    assert min(row["split_us"][part] for part in ("update", "fill", "solve", "decode")) > 0.0
    assert sum(row["counts"].values()) == row["ticks"] == 80


def test_sizes_are_those_of_the_problems():
    sizes = {name: tuple(short(name)["qp"].values()) for name in WORKLOADS}
    assert sizes == {
        "W1": (7, 0, 7),
        "W2": (35, 0, 29),
        "W3": (7, 0, 14),
        "W4": (30, 18, 40),
        "W5": (50, 18, 96),
        "W6": (50, 18, 96),
    }


@pytest.mark.parametrize("solver", ["daqp", "proxqp"])
def test_any_solver_that_keeps_limits_can_be_asked(solver: str):
    row = bench(WORKLOADS["W4"], ticks=40, repeats=1, solver=solver)
    assert row["variant"] == f"inverse dynamics, weighted, {solver}, standard"
    assert row["certified"] == 1.0
    ours, theirs = bench(WORKLOADS["W4"], ticks=40, repeats=1)["quality"], row["quality"]
    assert theirs["pos_err_rms2ndhalf_m"] == pytest.approx(ours["pos_err_rms2ndhalf_m"], rel=0.01)


def test_progress_goes_on_to_the_end():
    seen: list[float] = []
    bench(WORKLOADS["W1"], ticks=130, repeats=1, progress=lambda done, text="": seen.append(done))
    assert seen == sorted(seen) and seen[-1] == 1.0 and len(seen) > 100


def test_a_workload_is_a_scenario_with_a_verdict():
    workload = WORKLOADS["W4"]
    asked = workload.complete_parameters(duration=0.05)
    result = workload.run(asked, asked.settings)
    assert result.ok and result.figures["dyn_residual_max"] <= 1e-8
    assert {name: WORKLOADS[name] for name in WORKLOADS} == scenarios("workloads")


def test_any_scenario_can_be_timed():
    row = bench(find("arm-torque"), ticks=30, repeats=2)
    assert row["certified"] == 1.0 and row["ticks"] == 30 and row["quality"] == {}
    assert set(row) == FIELDS


@pytest.mark.parametrize("hierarchy", ["strict", "scaled"])
@pytest.mark.parametrize("name", ["W4", "W5"])
def test_ranked_stacks_are_certified_and_end_near_the_weighted_ones(name: str, hierarchy: str):
    row = bench(WORKLOADS[name], ticks=80, repeats=1, hierarchy=hierarchy)
    assert row["variant"] == f"inverse dynamics, {hierarchy}, pdas, levels" and row["certified"] == 1.0
    ours, weighted = row["quality"], short(name)["quality"]
    assert ours["pos_err_rms2ndhalf_m"] <= 1.02 * weighted["pos_err_rms2ndhalf_m"] + 1e-9


def test_a_pause_is_told_and_changes_no_answer():
    row = bench(WORKLOADS["W1"], ticks=20, repeats=1, pause=1e-4)
    assert row["variant"].endswith("after 0.1 ms of sleep")
    assert row["quality"] == bench(WORKLOADS["W1"], ticks=20, repeats=1)["quality"]


@pytest.mark.parametrize("argument", [{"hierarchy": "strikt"}, {"pause": -1.0}])
def test_settings_that_make_no_sense_are_refused(argument: dict[str, Any]):
    with pytest.raises(WbcError, match=next(iter(argument))):
        bench(WORKLOADS["W1"], ticks=20, repeats=1, **argument)


@pytest.mark.parametrize("argument", ["ticks", "repeats"])
def test_nothing_to_run_is_refused(argument: str):
    with pytest.raises(InvalidInput, match=argument):
        bench(WORKLOADS["W1"], **{argument: 0})


@pytest.mark.slow
@each_workload
def test_full_runs_keep_every_limit_and_reach_the_ones_that_make_them_hard(name: str):
    row = full(name)
    quality = row["quality"]
    assert row["certified"] == 1.0 and row["solver_failures"] == 0
    assert {key: quality[key] for key in LIMITS if quality.get(key, 0.0) > 1e-6} == {}
    assert quality.get("dyn_residual_max", 0.0) <= 1e-8
    if name in ("W1", "W2", "W3"):
        assert quality["vel_use_max"] == 1.0
    else:
        assert row["counts"]["repaired"] > 0  # the set of active cones changes


@pytest.mark.slow
@each_workload
def test_full_runs_end_where_other_libraries_do(name: str, peers: Path):
    rows = [r for r in json.loads((peers / "results.json").read_text(encoding="utf-8")) if trustworthy(r, name)]
    if name == "W6":
        pytest.skip("W6 is this library's own stack")
    assert rows
    row = full(name)
    keys = [key for key in row["quality"] if "rms" in key]
    assert keys
    for key in keys:
        low, high = min(r["quality"][key] for r in rows), max(r["quality"][key] for r in rows)
        # The damping of errors that cannot be reduced, which peers do not have, leaves W2's feet 5 % nearer.
        assert 0.94 * low <= row["quality"][key] <= 1.02 * high, key
    assert set(rows[0]["quality"]) <= set(row["quality"])


def trustworthy(row: dict[str, Any], name: str) -> bool:
    """A full run of the same workload that kept its limits; some solvers of others do not."""
    quality = row.get("quality")
    return (
        row.get("workload") == name
        and quality is not None
        and not row.get("solver_failures")
        and all(quality.get(key, 0.0) <= 1e-6 for key in LIMITS)
    )
