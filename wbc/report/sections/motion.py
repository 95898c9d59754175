"""The motion: moments side by side, and the 3-D replay as a page of its own."""

from __future__ import annotations

from wbc.report.document import Page, Section
from wbc.report.replay import replay
from wbc.report.shapes import obstacle_parts, parts
from wbc.report.stills import stills
from wbc.sim.scenario import ScenarioResult


def section(result: ScenarioResult) -> Section | None:
    """Stills and replay of the recorded motion; nothing without a robot to draw."""
    run, robot = result.run, result.robot
    if robot is None or not run.rows:
        return None
    caption = (
        "Drag to orbit, scroll to zoom, use the bar to play. Green: contact forces on the robot, "
        "the robot's weight half a metre long; red: a push."
    )
    obstacles = result.obstacles
    solid = [*parts(robot), *obstacle_parts(obstacles)]
    title = f"{run.meta.get('scenario', 'run')} · {robot.name}"
    page = Page("replay.html", caption, replay(run, robot, solid, title=title, obstacles=obstacles))
    return Section("Motion", [page, stills(run, robot, solid, obstacles=obstacles)])
