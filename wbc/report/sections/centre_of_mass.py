"""The way of the centre of mass over the feet."""

from __future__ import annotations

import numpy as np

from wbc.report import measure
from wbc.report.document import Curve, Item, Map, Plot, Section
from wbc.report.motion import hull, soles
from wbc.sim.scenario import ScenarioResult
from wbc.types import Mat

SAMPLES = 800


def section(result: ScenarioResult) -> Section | None:
    """The path seen from above, with the soles and their hull, and its displacement; for a floating base only."""
    run, robot = result.run, result.robot
    if robot is None or robot.nb == 0 or not run.rows:
        return None
    rows = np.unique(np.linspace(0, run.rows - 1, SAMPLES).astype(int))
    q = np.asarray(run.columns.get("plant.q", run["q"]))[rows]
    state, rest = robot.state(), np.zeros(robot.nv)
    com: Mat = np.empty((len(q), 3))
    for i, row in enumerate(q):
        state.update(0.0, row, rest)
        com[i] = state.com
    state.update(0.0, q[0], rest)
    ground = [corners[:, :2] for corners in soles(run, robot, state).values()]
    t = measure.times(run)[rows]
    outlines = [("contact", corners) for corners in ground if len(corners) > 1]
    if (around := hull(np.vstack([*ground, np.zeros((0, 2))]))) is not None:
        outlines.append(("hull of the contacts", around))
    items: list[Item] = [
        Map("com", "Path seen from above, with the contacts at the start", "m", t, com[:, 0], com[:, 1], outlines),
        Plot("com", "Displacement from the start", "mm", t,
             [Curve(axis, 1e3 * (com[:, i] - com[0, i])) for i, axis in enumerate("xyz")]),
    ]  # fmt: skip
    return Section("Centre of mass", items)
