"""A robot on its feet is pushed from all sides and gets a load in either hand: which of these it stands."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, final

import numpy as np

import wbc
from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.pinocchio_ import PinocchioModel
from wbc.report.document import Section, Table, Text
from wbc.sim.disturbance import Disturbance, Payload, Push
from wbc.sim.scenario import Check, Parameter, Progress, Scenario, ScenarioResult, Settings, trials
from wbc.sim.simulate import simulate

from . import humanoid_stand, judge, quadruped_stand
from .standing import Stance, push_force, standing_plant, standing_stack

STANCES: Mapping[str, Stance] = {**humanoid_stand.STANCES, **quadruped_stand.STANCES}
#: Push [N], and load in a hand [kg], that are usual.
PUSH: Mapping[str, float] = {**humanoid_stand.PUSH, "go2": 30.0, "quadruped": 30.0}
LOAD: Mapping[str, float] = {"talos": 2.0, "g1": 0.5, "humanoid": 1.0}
HANDS: Mapping[str, tuple[str, str]] = {
    "talos": ("gripper_left_base_link", "gripper_right_base_link"),
    "g1": ("left_wrist_yaw_link", "right_wrist_yaw_link"),
    "humanoid": ("left_hand", "right_hand"),
}
#: When it comes, for how long a push lasts [s]; at the end the centre of mass is no farther from its target [m]: a load
#: that nobody told of moves it by its share of the mass.
START, LASTS, OFF, OFF_LOADED = 1.2, 0.2, 5e-3, 3e-2


@final
@dataclass(frozen=True)
class Row:
    """One disturbance, and what came of it: the largest and the last error of the centre of mass [m]."""

    what: str
    stands: bool
    most: float
    last: float

    def as_dict(self) -> dict[str, Any]:
        """The row as JSON values."""
        return {"what": self.what, "stands": self.stands, "most_mm": 1e3 * self.most, "last_mm": 1e3 * self.last}


@final
class StandFamily(Scenario):
    """A swaying robot is pushed for 0.2 s from ``sides`` sides, once each; a humanoid gets a load in either hand too.

    ``robot``: talos, g1, go2 (need example-robot-data), humanoid or quadruped. ``push`` [N] and ``load`` [kg]: numbers,
    or auto for what is usual; 0: none. No hand draws a circle: nothing but the disturbance tells the sides apart.
    """

    name: ClassVar[str] = "stand-family"
    group: ClassVar[str] = "legs"
    takes = 120.0
    summary: ClassVar[str] = "a standing robot is pushed from eight sides and loaded in either hand: a table"
    parameters: ClassVar[Mapping[str, Parameter]] = {"robot": "g1", "sides": 8, "push": "auto", "load": "auto"}
    robots = STANCES
    plants = ("mujoco",)
    duration = 3.2

    def run(self, parameters: Mapping[str, Any], settings: Settings) -> ScenarioResult:
        name = parameters["robot"]
        force = push_force(parameters["push"], PUSH[name])
        load, sides = parameters["load"], int(checks.number("parameter 'sides'", parameters["sides"], low=1))
        mass = LOAD.get(name, 0.0) if load == "auto" else checks.typed("parameter 'load' (or auto)", load, low=0.0)
        stance = replace(STANCES[name], hand=None)
        robot = stance.robot(name)
        cases = _cases(stance, sides, force, HANDS.get(name, ()), mass)
        if not cases:
            raise InvalidInput("parameters 'push' and 'load' leave nothing to stand")
        rows = []
        for (what, disturbance), one in trials(settings.progress, cases):
            one(0.0, what)
            meta = {"scenario": self.name, "parameters": dict(parameters)}
            run, stands = _simulated(
                robot, stance, disturbance, duration=settings.duration, solver=settings.solver, meta=meta, one=one
            )
            error = np.linalg.norm(run["error.CenterOfMass"], axis=1)
            last = float(error[-1])
            off = OFF if isinstance(disturbance, Push) else OFF_LOADED
            rows.append(Row(what, stands and last < off, float(error[run["t"] > START].max()), last))
        return _judged(robot, rows, run)


def _cases(
    stance: Stance, sides: int, force: float, hands: Sequence[str], mass: float
) -> list[tuple[str, Disturbance]]:
    cases: list[tuple[str, Disturbance]] = []
    for k in range(sides if force else 0):
        angle = 2.0 * np.pi * k / sides
        way = (force * float(np.cos(angle)), force * float(np.sin(angle)), 0.0)
        cases.append((f"push towards {360 * k / sides:.0f}°", Push(stance.upright, way, start=START, duration=LASTS)))
    if mass:
        cases += [(f"load in {hand}", Payload(hand, mass=mass, start=START)) for hand in hands]
    return cases


def _simulated(
    robot: PinocchioModel, stance: Stance, disturbance: Disturbance, *, duration: float, solver: str,
    meta: Mapping[str, Any], one: Progress,
) -> tuple[wbc.Run, bool]:  # fmt: skip
    stack = standing_stack(robot, stance)
    controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), solver=solver, dt=1e-3)
    plant = standing_plant(robot, stance, stack.contacts)
    run = simulate(controller, plant, duration=duration, disturbances=[disturbance], progress=one, meta=dict(meta))
    return run, not plant.fallen


def _judged(robot: PinocchioModel, rows: Sequence[Row], run: wbc.Run) -> ScenarioResult:
    stood = sum(row.stands for row in rows)
    verdict = [Check("stands", float(stood), "=", float(len(rows)), f"of {len(rows)}")]
    shown = {"rows": [row.as_dict() for row in rows]}
    return judge.result(run, verdict, figures=shown, robot=robot, sections=[lambda result: _section(rows)])


def _section(rows: Sequence[Row]) -> Section:
    shown = [(row.what, "yes" if row.stands else "no", 1e3 * row.most, 1e3 * row.last) for row in rows]
    text = Text("0° is forward, 90° to the left. Errors of the centre of mass: the largest, and that at the end.")
    return Section("From all sides", [text, Table(("what", "stands", "most [mm]", "last [mm]"), shown)])
