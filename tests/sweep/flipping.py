"""A scenario that takes no time: a coin is flipped. It may take its worker down, or raise."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import numpy as np

from wbc.control.recorder import Run
from wbc.report import measure
from wbc.sim.scenario import Check, Scenario, ScenarioResult


class Flip(Scenario):
    """Head is good. ``deadly``: a file; the run that finds it takes it away and its worker down."""

    name = "flip"
    summary = "a coin is flipped"
    parameters = {"bias": 0.5, "seed": 0, "faces": 2, "coin": "euro", "deadly": "", "wait": 0.0, "bug": False}  # noqa: RUF012
    hierarchies = ("weighted", "strict")
    duration = 0.1

    def cases(self, p):
        return {}  # nothing is simulated

    def judge(self, trials, p):
        place = Path(p["deadly"] or "nowhere")
        if place.is_file():
            place.unlink(missing_ok=True)
            os.kill(os.getpid(), signal.SIGKILL)
        if p["wait"]:
            import time

            time.sleep(p["wait"])
        if p["bug"]:
            raise ZeroDivisionError("a bug of the scenario")
        rng = np.random.default_rng(p["seed"])
        t = np.arange(5) * 0.02
        height = rng.normal(size=(5, 1))
        columns = {"t": t, "status": np.zeros(5, int), "tick_us": np.linspace(5, 9, 5), "error.Height": height}
        meta = {"dt": 0.02, "statuses": ["SOLVED"], "tasks": {"Height": {"units": ["m"]}}, "scenario": self.name}
        run, head = Run(columns, meta), bool(rng.uniform() < p["bias"])
        return ScenarioResult(
            run=run, ok=head, violations={"height": (float(height.max()), "m")}, tracking=measure.tracking(run),
            verdict=[Check("shows head", float(head), "=", 1.0)], figures={"faces": p["faces"]},
        )  # fmt: skip


flip = Flip()
