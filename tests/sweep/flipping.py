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

    def run(self, parameters, settings):
        place = Path(parameters["deadly"] or "nowhere")
        if place.is_file():
            place.unlink(missing_ok=True)
            os.kill(os.getpid(), signal.SIGKILL)
        if parameters["wait"]:
            import time

            time.sleep(parameters["wait"])
        if parameters["bug"]:
            raise ZeroDivisionError("a bug of the scenario")
        rng = np.random.default_rng(parameters["seed"])
        t = np.arange(5) * 0.02
        height = rng.normal(size=(5, 1))
        columns = {"t": t, "status": np.zeros(5, int), "tick_us": np.linspace(5, 9, 5), "error.Height": height}
        meta = {"dt": 0.02, "statuses": ["SOLVED"], "tasks": {"Height": {"units": ["m"]}}, "scenario": self.name}
        run, head = Run(columns, meta), bool(rng.uniform() < parameters["bias"])
        return ScenarioResult(
            run=run, ok=head, violations={"height": (float(height.max()), "m")}, tracking=measure.tracking(run),
            verdict=[Check("shows head", float(head), "=", 1.0)], figures={"faces": parameters["faces"]},
        )  # fmt: skip


flip = Flip()
