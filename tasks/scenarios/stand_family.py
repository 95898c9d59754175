"""A standing robot is pushed from all sides and gets a load in either hand."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, ClassVar, final

import numpy as np

from wbc.errors import InvalidInput
from wbc.report.document import Section, Table, Text
from wbc.sim.disturbance import Payload, Push
from wbc.sim.scenario import Check, Parameter, Parameters, Scenario, ScenarioResult, Setup, Trial

from . import humanoid_stand, judge, quadruped_stand
from .standing import Stance, standing_plant, standing_stack, usual_or

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

    def cases(self, p: Parameters) -> dict[str, dict[str, Any]]:
        p.lasts_beyond(START, f"pushes and loads come at {START:g} s")
        name, load, sides = p["robot"], p["load"], p.count("sides")
        force = usual_or("push", p["push"], PUSH[name])
        mass = usual_or("load", load, LOAD.get(name, 0.0))
        cases: dict[str, dict[str, Any]] = {}
        for k in range(sides if force else 0):
            angle = 2.0 * np.pi * k / sides
            way = (force * float(np.cos(angle)), force * float(np.sin(angle)), 0.0)
            push = Push(STANCES[name].upright, way, start=START, duration=LASTS)
            cases[f"push towards {360 * k / sides:.0f}°"] = {"disturbance": push, "off": OFF}
        for hand in HANDS.get(name, ()) if mass else ():
            cases[f"load in {hand}"] = {"disturbance": Payload(hand, mass=mass, start=START), "off": OFF_LOADED}
        if not cases:
            raise InvalidInput("parameters 'push' and 'load' leave nothing to stand")
        return cases

    def build(self, p: Parameters) -> Setup:
        stance = replace(STANCES[p["robot"]], hand=None)
        robot = stance.robot(p["robot"])
        stack = standing_stack(robot, stance)
        plant = standing_plant(robot, stance, stack.contacts)
        return Setup(stack=stack, plant=plant, disturbances=[p["disturbance"]], about=p["off"])

    def judge(self, trials: Iterator[Trial], p: Parameters) -> ScenarioResult:
        rows = list[dict[str, Any]]()
        for trial in trials:  # a run is forgotten before the next one
            error = trial.error("CenterOfMass")
            last = float(error[-1])
            most = float(error[trial.run["t"] > START].max(initial=last))  # it may have fallen before
            stands = not trial.setup.plant.fallen and last < trial.about
            rows.append({"what": trial.name, "stands": stands, "most_mm": 1e3 * most, "last_mm": 1e3 * last})
        checks = [Check("stands", float(sum(row["stands"] for row in rows)), "=", float(len(rows)), f"of {len(rows)}")]
        shown = [(row["what"], "yes" if row["stands"] else "no", row["most_mm"], row["last_mm"]) for row in rows]
        text = Text("0° is forward, 90° to the left. Errors of the centre of mass: the largest, and that at the end.")
        table = Table(("what", "stands", "most [mm]", "last [mm]"), shown)
        return judge.verdict(
            trial, checks, figures={"rows": rows}, called="", sections=[Section("From all sides", [text, table])]
        )
