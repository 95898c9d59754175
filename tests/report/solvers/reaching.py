"""A scenario as a user would write it in a file: a short reach into the limits on speed."""

from __future__ import annotations

import numpy as np

from tasks import JointVelocityLimits, Position, Posture
from tasks.scenarios import judge
from wbc.models import load
from wbc.report import measure
from wbc.sim.plant import IntegratorPlant
from wbc.sim.scenario import Check, Scenario, Setup
from wbc.stack.formulation import VelocityLevel
from wbc.stack.stack import Stack


class Reach(Scenario):
    """The tool goes up by ``way`` metres."""

    name = "reach"
    summary = "an arm reaches up"
    parameters = {"way": 0.3, "good": True, "robot": "arm"}  # noqa: RUF012 - a user's own style
    duration = 0.3

    def build(self, p):
        robot = load(p["robot"])
        above = robot.state().frame("tool").position + np.array([0.0, 0.0, p["way"]])
        stack = Stack(
            [Position("tool", target=above, kp=400), Posture(robot.q0, weight=1e-3)],
            subject_to=[JointVelocityLimits()],
        )
        return Setup(stack=stack, plant=IntegratorPlant(robot, level="velocity", dt=1e-3), level=VelocityLevel())

    def judge(self, trials, p):
        (trial,) = trials
        good = bool(p["good"]) and measure.statuses(trial.run) == {"SOLVED": trial.run.rows}
        checks = [Check("every tick is solved", float(good), "=", 1.0)]
        return judge.verdict(trial, checks, figures={"way": p["way"]})


reach = Reach()
