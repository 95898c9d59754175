"""A quadruped's knee has half its strength, without and with a reaction."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar, final

from wbc.sim.scenario import Check, Parameter, Parameters

from .. import When
from ..components.fault_reaction import TABLE
from .fault_trials import Outcome, Stand
from .quadruped_joint_loss import KNEES, QuadrupedFault

#: How far off the share lost may be taken.
CLOSE = 0.05


@final
class QuadrupedActuatorWeak(QuadrupedFault):
    """A knee's motor delivers ``left`` of what it is sent, from one of ``moments`` moments of the sway on.

    ``robot``: go2 (needs example-robot-data) or quadruped; ``joint``: auto, or a joint's name. ``noise``: sensors with
    noise; ``masses``: by what share the controller's masses may be wrong, with ``seed``. ``variants``: also try other
    gains, and the knee dead, which three legs cannot make good.
    """

    name: ClassVar[str] = "quadruped-actuator-weak"
    takes = 200.0
    summary: ClassVar[str] = "a quadruped's knee loses half its strength: found, measured, and commanded twice as much"
    parameters: ClassVar[Mapping[str, Parameter]] = {
        "robot": "go2", "joint": "auto", "left": 0.5, "moments": 4, "noise": False, "masses": 0.0, "seed": 0,
        "variants": True,
    }  # fmt: skip
    joints = KNEES

    def table(self, stand: Stand) -> Sequence[When]:
        return TABLE

    def left(self, p: Parameters) -> float:
        return p.number("left", low=0.25, high=0.9)

    def demand(self, without: Sequence[Outcome], answered: Sequence[Outcome], p: Parameters) -> Sequence[Check]:
        off = max(abs(float(o.run["signal.FaultReaction.share"][-1].min()) - p["left"]) for o in answered)
        return [
            Check("CoM error without an answer, rms (at least)", min(o.rms for o in without), ">=", 15e-3, "m"),
            *self.made_good(answered, p),
            Check("strength taken for what is left, off by", off, "<=", CLOSE, "share"),
        ]
