"""Runs that never happened, with everything a report can show: small, and the same on every machine."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wbc.control.recorder import Run
from wbc.models import load
from wbc.report import Report, measure, run_report, write
from wbc.sim.scenario import Check, ScenarioResult

DT = 0.01
HALF_SIZE = (0.11, 0.05)
FRICTION = 0.5


def metadata(robot: Any, **more: Any) -> dict[str, Any]:
    """What the loop writes down about a run."""
    return {
        "scenario": "made-up", "robot": robot.name, "level": "inverse dynamics", "hierarchy": "Weighted()",
        "solver": "pdas", "dt": DT, "duration": 1.0, "seed": None, "ended": "complete",
        "joint_names": list(robot.joint_names), "joint_units": list(robot.joint_units),
        "limits": {key: getattr(robot.limits, key).tolist() for key in ("q_min", "q_max", "v_max", "tau_max")},
        "statuses": ["solved", "infeasible"], "tasks": {}, "contacts": {}, "disturbances": [],
        "plant": {"plant": "MadeUp", "nested": {"cone": "elliptic"}}, "parameters": {"robot": robot.name},
        "versions": {"wbc-qp": "0"}, "machine": {"cores": 2}, "stack": "Stack\n  level 1: Frame",
    } | more  # fmt: skip


def result_of(run: Run, robot: Any, *, ok: bool = True) -> ScenarioResult:
    """A judged run: one demand, met or not."""
    return ScenarioResult(
        run=run, ok=ok, violations=measure.violations(run), tracking=measure.tracking(run),
        verdict=[Check("stays | up", 1.0, ">=", 0.5 if ok else 2.0, "m")], figures={"peak": 1.25}, robot=robot,
    )  # fmt: skip


def standing_run(rows: int = 120) -> Run:
    """A humanoid that stands on two soles and is pushed once."""
    robot = load("humanoid")
    t = np.arange(rows) * DT
    wave = np.sin(2 * np.pi * t)
    q = np.tile(robot.q0, (rows, 1))
    q[:, 1] += 0.02 * wave
    v = np.tile(0.05 * wave[:, None], (1, robot.nv))
    push = np.zeros((rows, 3))
    push[30:50, 1] = 60.0
    weight = robot.mass * 9.81
    columns: dict[str, Any] = {
        "t": t, "q": q, "v": v, "v_cmd": v, "a": np.zeros_like(v), "plant.q": q, "plant.v": v, "push": push,
        "tau": 0.4 * robot.limits.tau_max * wave[:, None], "status": (np.arange(rows) == 7).astype(int),
        "tick_us": 50.0 + 10.0 * wave**2, "certificate": np.full((rows, 3), 1e-10),
        "iterations": np.ones(rows, int), "active": 4 + (push[:, 1] > 0),
        "error.CenterOfMass": 1e-3 * np.column_stack([wave, wave, 0 * wave]),
        "error.Frame[left_hand]": np.column_stack([np.full((rows, 3), 2e-3), np.full((rows, 3), 4e-3)]),
        "error.Posture": np.tile(0.01 * wave[:, None], (1, robot.nj)),
        "distance.CenterOfMass": np.where(np.arange(rows) == 7, np.nan, 1e-9 + 1e-10 * np.arange(rows)),
        "distance.Frame[left_hand]": np.full(rows, 2e-9),
        "distance.Posture": np.full(rows, np.nan),
    }  # fmt: skip
    pushed = push[:, 1] > 0
    for task, sizes in (("CenterOfMass", 1), ("Frame[left_hand]", 2), ("Posture", 1)):
        columns |= {
            f"residual.{task}": np.full((rows, sizes), 0.25),
            f"cost.{task}": np.where(pushed, 3.0 * sizes, 0.0),
        }
    columns |= {"active.row": np.full((rows, 4), np.nan), "active.bound": np.full((rows, 4), np.nan),
                "active.multiplier": np.full((rows, 4), np.nan)}  # fmt: skip
    for column, values in (("row", (0, 1)), ("bound", (40.0, 0.0)), ("multiplier", (7.5, 2.5))):
        columns[f"active.{column}"][pushed, :2] = values
    contacts = {}
    for side, share in (("left", 0.5 + 0.3 * wave), ("right", 0.5 - 0.3 * wave)):
        wrench = np.column_stack([5 + 0 * t, 0 * t, share * weight, 2 * wave, 3 * wave, 0 * t])
        name = f"Sole[{side}_sole]"
        columns |= {f"f.{name}": wrench, f"plant.f.{name}": 1.01 * wrench, f"plant.slip.{name}": np.outer(t, [1e-4, 0])}
        cone = [[1, 0, -FRICTION, 0, 0, 0], [-1, 0, -FRICTION, 0, 0, 0], [0, 0, -HALF_SIZE[1], 1, 0, 0]]
        contacts[name] = {
            "kind": "sole", "frame": f"{side}_sole", "friction": FRICTION, "half_size": list(HALF_SIZE), "cone": cone
        }  # fmt: skip
    tasks = {
        "CenterOfMass": {"units": ["m"] * 3}, "Frame[left_hand]": {"units": ["m"] * 3 + ["rad"] * 3},
        "Posture": {"units": ["rad"] * robot.nj},
    }  # fmt: skip
    distances = {"CenterOfMass": "m/s²", "Frame[left_hand]": "m/s², rad/s²", "Posture": "rad/s²"}
    reasons = {
        "residuals": {"CenterOfMass": "m/s²", "Frame[left_hand]": "m/s², rad/s²", "Posture": "rad/s²"},
        "active_rows": [
            {"owner": "TorqueLimits", "label": "left_knee", "unit": "N m", "side": "upper"},
            {"owner": "friction[left_sole]", "label": "fy <= mu fz", "unit": "N", "side": "upper"},
        ],
    }
    disturbances = ["push of (0, 60, 0) N at 'torso' from 0.3 s for 0.2 s"]
    about = {"tasks": tasks, "contacts": contacts, "disturbances": disturbances, "distances": distances}
    return Run(columns, metadata(robot, **about, **reasons))


def reaching_run(rows: int = 60) -> Run:
    """An arm at the velocity level: no torques, no contacts, no plant."""
    robot = load("arm")
    t = np.arange(rows) * DT
    q = robot.q0 + 0.1 * np.sin(t)[:, None]
    v = np.tile(0.1 * np.cos(t)[:, None], (1, robot.nv))
    columns = {
        "t": t, "q": q, "v": v, "v_cmd": v, "status": np.zeros(rows, int), "tick_us": np.full(rows, 20.0),
        "certificate": np.zeros((rows, 3)), "iterations": np.ones(rows, int), "active": np.zeros(rows, int),
        "error.Position[tool]": np.full((rows, 3), 1e-3),
    }  # fmt: skip
    return Run(columns, metadata(robot, level="velocity", tasks={"Position[tool]": {"units": ["m"] * 3}}))


@pytest.fixture(scope="session")
def standing() -> ScenarioResult:
    """A judged run with everything in it."""
    return result_of(standing_run(), load("humanoid"))


@pytest.fixture(scope="session")
def reaching() -> ScenarioResult:
    """A judged run with as little as there can be."""
    return result_of(reaching_run(), load("arm"), ok=False)


@pytest.fixture(scope="session")
def report(standing: ScenarioResult) -> Report:
    """The report of the full run, drawn once."""
    return run_report(standing)


@pytest.fixture(scope="session")
def folder(report: Report, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of the full run on disk."""
    place = tmp_path_factory.mktemp("report")
    write(report, place)
    return place


@pytest.fixture
def changed() -> Callable[..., Run]:
    """A copy of a run with other columns or metadata; ``None`` takes a column away."""

    def change(run: Run, *, meta: dict[str, Any] | None = None, **columns: Any) -> Run:
        kept = {**run.columns, **columns}
        return Run({k: v for k, v in kept.items() if v is not None}, {**run.meta, **(meta or {})})

    return change
