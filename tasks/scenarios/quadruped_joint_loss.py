"""A quadruped that sways on four feet loses a hip motor, without and with a reaction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, final

from wbc.sim.scenario import Check, Parameter, Parameters

from .fault_scenario import FaultScenario, found_in_time
from .fault_trials import GAINS, Gains, Outcome, Stand
from .quadruped_stand import STANCES

JOINTS: Mapping[str, str] = {"go2": "FL_hip_joint", "quadruped": "front_left_hip_roll"}
KNEES: Mapping[str, str] = {"go2": "FL_calf_joint", "quadruped": "front_left_knee"}
#: What three legs cannot make good.
LOST: Mapping[str, Sequence[str]] = {name: [knee] for name, knee in KNEES.items()}
FLOOR = 0.2
FIRST, BETWEEN = 2.0, 0.25
#: Other gains, as somebody might have chosen them.
VARIANTS: Mapping[str, Gains] = {
    "CoM kp 400, posture kp 100 weight 1e-4": {
        "CenterOfMass": {"kp": 400.0}, "Posture": {"kp": 100.0, "weight": 1e-4},
    },
    "CoM kp 30": {"CenterOfMass": {"kp": 30.0}},
    "posture kp 100": {"Posture": {"kp": 100.0, "weight": 1e-3}},
    "contacts kp 100": {"contacts": {"kp": 100.0}},
}  # fmt: skip


class QuadrupedFault(FaultScenario):
    """A motor of a quadruped fails."""

    robots = STANCES
    first, between = FIRST, BETWEEN
    hopeless = LOST
    duration = 4.0

    def stand(self, p: Parameters) -> Stand:
        return Stand.of(p, STANCES[p["robot"]], FLOOR, GAINS, GAINS)

    def variants(self, stand: Stand) -> Mapping[str, Gains]:
        return VARIANTS

    def made_good(self, answered: Sequence[Outcome], p: Parameters) -> list[Check]:
        """It stands at every moment, near its task, and the answer came soon."""
        n, rms, rough = len(answered), max(o.rms for o in answered), self.stand(p).rough
        return [
            Check("with it, it stands", float(sum(o.stands for o in answered)), "=", float(n), f"of {n}"),
            Check("CoM error with it, rms", rms, "<", 10e-3 if rough else 3e-3, "m"),
            *found_in_time(answered, 20e-3 if rough else 6e-3),
        ]


@final
class QuadrupedJointLoss(QuadrupedFault):
    """A hip's motor dies at ``moments`` moments of the sway; each time without and with an answer.

    ``robot``: go2 (needs example-robot-data) or quadruped; ``joint``: auto, or a joint's name. ``noise``: sensors with
    noise; ``masses``: by what share the controller's masses may be wrong, with ``seed``. ``variants``: also try other
    gains, and a dead knee, which three legs cannot make good.
    """

    name: ClassVar[str] = "quadruped-joint-loss"
    takes = 300.0
    summary: ClassVar[str] = "a quadruped loses a hip's motor: it falls without an answer and sways on with one"
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "robot": "go2", "joint": "auto", "moments": 12, "noise": False, "masses": 0.0, "seed": 0, "variants": True,
    }  # fmt: skip
    joints = JOINTS

    def demand(self, without: Sequence[Outcome], answered: Sequence[Outcome], p: Parameters) -> Sequence[Check]:
        n, fell = len(without), sum(not o.stands for o in without)
        falls = Check("without an answer it falls", float(fell), ">=", float(-(-10 * n // 12)), f"of {n}")
        return [falls, *self.made_good(answered, p)]
