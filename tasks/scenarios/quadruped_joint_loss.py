"""A quadruped that sways on four feet loses a hip: without an answer it falls, with one it sways on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, final

from wbc import checks
from wbc.sim.actuator_fault import ActuatorFault
from wbc.sim.scenario import Check, Parameter, Scenario, ScenarioResult, Settings

from . import fault_scenario
from .fault_trials import Gains, Outcome, Stand
from .held_sway import HeldSway, table_with
from .quadruped_stand import STANCES

JOINTS: Mapping[str, str] = {"go2": "FL_hip_joint", "quadruped": "front_left_hip_roll"}
KNEES: Mapping[str, str] = {"go2": "FL_calf_joint", "quadruped": "front_left_knee"}
FLOOR = 0.2
GAINS: Gains = {"CenterOfMass": {"kp": 100.0}, "Posture": {"kp": 10.0, "weight": 1e-3}}
FIRST, BETWEEN = 2.0, 0.25


@final
class QuadrupedJointLoss(Scenario):
    """A hip's motor dies at ``moments`` moments of the sway; each time without and with an answer.

    ``robot``: go2 (needs example-robot-data) or quadruped; ``joint``: auto, or a joint's name. ``noise``: sensors with
    noise; ``masses``: by what share the controller's masses may be wrong, with ``seed``. ``variants``: also try other
    gains, and a dead knee, which three legs cannot make good.
    """

    name: ClassVar[str] = "quadruped-joint-loss"
    group: ClassVar[str] = "faults"
    takes = 300.0
    summary: ClassVar[str] = "a quadruped loses a hip's motor: it falls without an answer and sways on with one"
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "robot": "go2", "joint": "auto", "moments": 12, "noise": False, "masses": 0.0, "seed": 0, "variants": True,
    }  # fmt: skip
    robots = STANCES
    plants = ("mujoco",)
    duration = 4.0

    def run(self, parameters: Mapping[str, Any], settings: Settings) -> ScenarioResult:
        stand, joint, moments = standing_of(parameters, JOINTS, settings.solver)
        plan = fault_scenario.Plan(
            stand, ActuatorFault(joint=joint), [FIRST + BETWEEN * k for k in range(moments)],
            lambda without, answered: _demand(without, answered, stand.rough), after=settings.duration,
            table=table_with(HeldSway.of(stand)),
            variants=VARIANTS if parameters["variants"] else {},
            lost=[ActuatorFault(joint=KNEES[stand.name])] if parameters["variants"] else [],
        )  # fmt: skip
        meta = {"scenario": self.name, "parameters": dict(parameters)}
        return fault_scenario.run(plan, meta=meta, progress=settings.progress)


#: Other gains, as somebody might have chosen them.
VARIANTS: Mapping[str, Gains] = {
    "CoM kp 400, posture kp 100 weight 1e-4": {
        "CenterOfMass": {"kp": 400.0}, "Posture": {"kp": 100.0, "weight": 1e-4},
    },
    "CoM kp 30": {"CenterOfMass": {"kp": 30.0}},
    "posture kp 100": {"Posture": {"kp": 100.0, "weight": 1e-3}},
    "contacts kp 100": {"contacts": {"kp": 100.0}},
}  # fmt: skip


def standing_of(parameters: Mapping[str, Any], joints: Mapping[str, str], solver: str) -> tuple[Stand, str, int]:
    """Who stands, the joint that fails, and at how many moments.

    Raises:
        UnknownJoint, InvalidInput: a parameter that makes no sense.
    """
    name = parameters["robot"]
    masses = checks.number("parameter 'masses'", parameters["masses"], low=0.0, high=0.5)
    stand = Stand(
        name, STANCES[name], FLOOR, gains=GAINS, noise=parameters["noise"], masses=masses, solver=solver,
        seed=parameters["seed"],
    )  # fmt: skip
    joint = joints[name] if parameters["joint"] == "auto" else parameters["joint"]
    stand.robot().joint(joint)
    return stand, joint, int(checks.number("parameter 'moments'", parameters["moments"], low=1))


def _demand(without: Sequence[Outcome], answered: Sequence[Outcome], rough: bool) -> list[Check]:
    n = len(answered)
    fell, stood = sum(not o.stands for o in without), sum(o.stands for o in answered)
    rms, bound, needed = max(o.rms for o in answered), 10e-3 if rough else 3e-3, -(-10 * n // 12)
    return [
        Check("without an answer it falls", float(fell), ">=", float(needed), f"of {n}"),
        Check("with it, it stands", float(stood), "=", float(n), f"of {n}"),
        Check("CoM error with it, rms", rms, "<", bound, "m"),
        *fault_scenario.found_in_time(answered, 20e-3 if rough else 6e-3),
    ]
