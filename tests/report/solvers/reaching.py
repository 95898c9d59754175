"""A scenario as a user would write it in a file: a short reach into the limits on speed."""

from __future__ import annotations

import numpy as np

from tasks import JointVelocityLimits, Position, Posture
from wbc.control.controller import Controller
from wbc.models import load
from wbc.report import measure
from wbc.sim.plant import IntegratorPlant
from wbc.sim.scenario import Check, Scenario, ScenarioResult
from wbc.sim.simulate import simulate
from wbc.stack.formulation import VelocityLevel
from wbc.stack.stack import Stack


class Reach(Scenario):
    """The tool goes up by ``way`` metres."""

    name = "reach"
    summary = "an arm reaches up"
    parameters = {"way": 0.3, "good": True, "robot": "arm"}  # noqa: RUF012 - a user's own style
    duration = 0.3

    def run(self, parameters, settings):
        robot = load(parameters["robot"])
        above = robot.state().frame("tool").position + np.array([0.0, 0.0, parameters["way"]])
        stack = Stack(
            [Position("tool", target=above, kp=400), Posture(robot.q0, weight=1e-3)],
            subject_to=[JointVelocityLimits()],
        )
        controller = Controller(robot, stack, level=VelocityLevel(), solver=settings.solver, dt=1e-3)
        plant = IntegratorPlant(robot, level="velocity", dt=1e-3)
        about = {"scenario": self.name}
        run = simulate(controller, plant, duration=settings.duration, progress=settings.progress, meta=about)
        good = bool(parameters["good"]) and measure.statuses(run) == {"SOLVED": run.rows}
        return ScenarioResult(
            run=run, ok=good, violations=measure.violations(run), tracking=measure.tracking(run),
            verdict=[Check("every tick is solved", float(good), "=", 1.0)], robot=robot,
            figures={"way": parameters["way"]},
        )  # fmt: skip


reach = Reach()
