"""The motion: moments side by side; the robot itself stands beside all plots."""

from __future__ import annotations

from wbc.report.document import Section
from wbc.report.shapes import obstacle_parts, parts
from wbc.report.stills import stills
from wbc.sim.scenario import ScenarioResult


def section(result: ScenarioResult) -> Section | None:
    """Stills of the recorded motion; nothing without a robot to draw."""
    run, robot = result.run, result.robot
    if robot is None or not run.rows:
        return None
    solid = [*parts(robot), *obstacle_parts(result.obstacles)]
    return Section("Motion", [stills(run, robot, solid, obstacles=result.obstacles)]) if solid else None
