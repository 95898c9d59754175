"""Sensors in a scenario: the controller gets an estimate of the base in place of the truth; how far off that was."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from wbc.errors import UnknownName
from wbc.report import measure
from wbc.robots import SENSORS, EstimatedBase
from wbc.robots.device import rotation
from wbc.sim.disturbance import Disturbance
from wbc.sim.scenario import Parameter, Trial

TRUTH = "truth"
#: What a scenario adds to its parameters.
PARAMETERS: Mapping[str, Parameter] = {"sensors": TRUTH, "seed": 0}
#: For how long the robot stands still, and is listened to, before the run [s].
STILL = 1.0
#: The floor of physics is a plane, but feet sink into it: heights of footholds differ by so much [m].
FLOOR = 1e-4
#: Of how many ticks the centre of mass and the rotation are looked at in one.
_EVERY = 10


class UnknownSensors(UnknownName):
    """No such set of sensors."""

    kind = "set of sensors"


def sensing(parameters: Mapping[str, Any]) -> list[Disturbance]:
    """The sensors that ``parameters`` name; none for the truth.

    Raises:
        UnknownSensors: with the names that are near.
        InvalidInput: a negative seed.
    """
    name = parameters["sensors"]
    if name == TRUTH:
        return []
    if name not in SENSORS:
        raise UnknownSensors(name, [TRUTH, *SENSORS])
    return [EstimatedBase(SENSORS[name], seed=parameters["seed"], still=STILL, floor=FLOOR)]


def off_estimate(trial: Trial, parameters: Mapping[str, Any]) -> dict[str, float]:
    """Figures of how far the controller's state was from the truth; none where it was the truth.

    Of the position the error at the end, of the heading too; of lean and velocity the rms. Of the centre of mass the
    largest error, which no error of a task shows: a task sees what the controller sees.
    """
    if parameters["sensors"] == TRUTH:
        return {}
    run, robot, turns, off = trial.run, trial.robot, [], []
    state = robot.state()
    for q, true_q, v in zip(run["q"][::_EVERY], run["plant.q"][::_EVERY], run["v"][::_EVERY], strict=True):
        turns.append(rotation(true_q[3:7]) @ robot.difference(true_q, q)[3:6])
        state.update(0.0, true_q, v)
        com = np.array(state.com)
        state.update(0.0, q, v)
        off.append(float(np.linalg.norm(state.com - com)))
    lean, velocity = np.array(turns)[:, :2], run["v"][:, :3] - run["plant.v"][:, :3]
    return {
        "estimate_drift_m": float(np.linalg.norm(run["q"][-1, :3] - run["plant.q"][-1, :3])),
        "estimate_heading_rad": float(turns[-1][2]),
        "estimate_lean_rms_rad": measure.rms(np.linalg.norm(lean, axis=1)),
        "estimate_velocity_rms_m_s": measure.rms(np.linalg.norm(velocity, axis=1)),
        "estimate_com_max_m": max(off),
    }
