"""A humanoid that sways on its feet loses a leg motor, without and with a reaction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar, final

from wbc.sim.scenario import Check, Parameter, Parameters

from .fault_scenario import FaultScenario, found_in_time
from .fault_trials import GAINS, Gains, Outcome, Stand
from .humanoid_stand import STANCES

JOINTS: Mapping[str, str] = {"g1": "left_knee_joint", "talos": "leg_left_5_joint", "humanoid": "left_knee"}
#: What the answer does not mend: the waist carries the body alone.
LOST: Mapping[str, Sequence[str]] = {"g1": ["waist_roll_joint"], "talos": [], "humanoid": []}
#: Least threshold with noise or wrong masses [N m].
FLOOR: Mapping[str, float] = {"g1": 0.5, "talos": 1.0, "humanoid": 0.5}
#: Where sensors have no noise. The stiffer usual gains hold Talos longer, but no better, without an answer.
CLEAN_GAINS: Mapping[str, Gains] = {"g1": {}, "talos": GAINS, "humanoid": GAINS}
#: Amplitude of the sway where it is not the stance's [m]. A little further forward Talos needs its ankle; else it may
#: slide about for a quarter of a metre without falling, as chance has it.
SWAY: Mapping[str, tuple[float, float, float]] = {"talos": (0.025, 0.05, 0.03)}
#: From the fault to the answer, without noise, and with, where a joint that carries next to nothing shows it later [s].
SOON, LATER = 4e-3, 20e-3
FIRST, BETWEEN = 2.2, 0.3


def variants(upright: str) -> dict[str, Gains]:
    """Other gains, as somebody might have chosen them."""
    orientation = f"Orientation[{upright}]"
    return {
        "CoM kp 100, posture kp 10 weight 1e-3": GAINS,
        "CoM kp 400, posture kp 100 weight 1e-4": {
            "CenterOfMass": {"kp": 400.0}, "Posture": {"kp": 100.0, "weight": 1e-4},
        },
        "CoM kp 30": {"CenterOfMass": {"kp": 30.0}},
        "upright kp 25": {orientation: {"kp": 25.0}},
        "upright kp 400": {orientation: {"kp": 400.0}},
        "upright weight 0.1": {orientation: {"weight": 0.1}},
        "posture kp 100": {"Posture": {"kp": 100.0, "weight": 1e-3}},
        "posture kp 400, weight 1e-2": {"Posture": {"kp": 400.0, "weight": 1e-2}},
        "contacts kp 100": {"contacts": {"kp": 100.0}},
    }  # fmt: skip


@final
class HumanoidJointLoss(FaultScenario):
    """The motor of one leg joint dies at ``moments`` moments of the sway; each time without and with an answer.

    ``robot``: g1, talos (both need example-robot-data) or humanoid; ``joint``: auto, or a joint's name. ``noise``:
    sensors with noise; ``masses``: by what share the controller's masses may be wrong, with ``seed``. ``variants``:
    also try other gains.
    """

    name: ClassVar[str] = "humanoid-joint-loss"
    takes = 400.0
    summary: ClassVar[str] = "a humanoid loses a leg's motor: it falls or slides without an answer, and stands with one"
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "robot": "g1", "joint": "auto", "moments": 8, "noise": False, "masses": 0.0, "seed": 0, "variants": True,
    }  # fmt: skip
    robots = STANCES
    first, between = FIRST, BETWEEN
    joints, hopeless = JOINTS, LOST
    duration = 8.0  # Talos takes up to 6 s to fall

    def stand(self, p: Parameters) -> Stand:
        name = p["robot"]
        stance = replace(STANCES[name], sway=SWAY.get(name, STANCES[name].sway))
        return Stand.of(p, stance, FLOOR[name], GAINS, CLEAN_GAINS[name])

    def variants(self, stand: Stand) -> Mapping[str, Gains]:
        return variants(stand.stance.upright)

    def demand(self, without: Sequence[Outcome], answered: Sequence[Outcome], p: Parameters) -> Sequence[Check]:
        rough = self.stand(p).rough
        n, spare = len(answered), 1 if len(answered) >= 8 else 0
        lost, kept = sum(not o.kept for o in without), sum(o.kept for o in answered)
        standing = [o.rms for o in answered if o.stands]
        rms, bound = max(standing, default=float("inf")), 10e-3 if rough else 2e-3
        enough = n - spare if rough else n
        return [
            Check("without an answer it falls or slides away", float(lost), ">=", float(n - spare), f"of {n}"),
            Check("with it, it stands on its spot", float(kept), ">=", float(enough), f"of {n}"),
            Check("CoM error of those that stand, rms", rms, "<", bound, "m"),
            *found_in_time(answered, LATER if rough else SOON),
        ]  # fmt: skip
