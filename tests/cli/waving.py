"""A scenario as a user would write it in a file: an arm waves, on paper, and the verdict is what one asks for."""

from __future__ import annotations

from types import MappingProxyType

import numpy as np

from wbc.control.recorder import Run
from wbc.models import load
from wbc.report import measure
from wbc.sim.scenario import Check, Scenario, ScenarioResult

DT = 0.01


class Wave(Scenario):
    """Waves."""

    name = "wave"
    summary = "an arm waves"
    parameters = MappingProxyType(
        {"robot": "arm", "amplitude": 0.1, "good": True, "ends": "well", "waves": 2, "axis": (0.0, 0.0, 1.0)}
    )
    plants = ("paper", "integrator")
    duration = 0.4

    def cases(self, p):
        return {}  # nothing is simulated

    def judge(self, trials, p):
        settings = p.settings
        print("a scenario that chatters")
        robot = load(p["robot"])
        settings.progress(0.5, "half way")
        if p["ends"] == "interrupted":
            raise KeyboardInterrupt
        if p["ends"] == "with a bug":
            raise RuntimeError("a bug")
        t = np.arange(round(settings.duration / DT)) * DT
        swing = np.sin(2 * np.pi * t)[:, None] * np.ones(robot.nj)
        columns = {
            "t": t, "q": robot.q0 + p["amplitude"] * swing, "v": 0 * swing, "v_cmd": 0 * swing,
            "status": np.zeros(t.size, int), "tick_us": np.linspace(10.0, 20.0, t.size),
            "error.Position[tool]": np.full((t.size, 3), 1e-3),
        }  # fmt: skip
        limits = {key: getattr(robot.limits, key).tolist() for key in ("q_min", "q_max", "v_max", "tau_max")}
        meta = {
            "scenario": self.name, "robot": robot.name, "level": "velocity", "hierarchy": settings.hierarchy,
            "solver": settings.solver, "dt": DT, "duration": settings.duration, "joint_names": list(robot.joint_names),
            "joint_units": list(robot.joint_units), "limits": limits, "statuses": ["solved"], "contacts": {},
            "tasks": {"Position[tool]": {"units": ["m"] * 3}}, "plant": {"plant": settings.plant},
            "parameters": dict(p),
        }  # fmt: skip
        run = Run(columns, meta)
        good = bool(p["good"])
        return ScenarioResult(
            run=run, ok=good, violations=measure.violations(run), tracking=measure.tracking(run),
            verdict=[Check("it waves", 1.0, "<" if good else ">", 2.0, "Hz")], robot=robot,
            figures={"waves": np.int64(p["waves"]), "never": float("nan"), "path": np.arange(2.0)},
        )  # fmt: skip


wave = Wave()
not_a_scenario = 3
