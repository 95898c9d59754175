"""Verdict: what is impossible in a frame of a robot's motion, by name and amount."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, final

#: Kinds of faults and the units of their amounts, beyond the limit. What causes others stands first: the forces of a
#: motion that jumps, or whose feet slip, say little.
UNITS = {
    "jump": "°", "slip": "mm", "penetration": "mm", "collision": "mm", "gap": "mm", "speed": "rad/s", "position": "rad",
    "no force": "N", "centre of pressure": "mm", "friction": "N", "torque": "N m",
}  # fmt: skip
KINDS = tuple(UNITS)
#: Those of the forces that a motion asks for, which are less where it is slower.
FORCES = frozenset(KINDS[KINDS.index("no force") :])


class Fault(NamedTuple):
    """What is impossible in a frame: its ``kind``, the ``part`` (a joint, a contact, two links), and by how much, in
    the unit ``UNITS[kind]`` beyond the limit.

    Example:
        >>> from wbc.motion import Fault
        >>> print(Fault("torque", "left_knee", 12.34))
        torque of left_knee, 12.3 N m
    """

    kind: str
    part: str
    amount: float

    def __str__(self) -> str:
        return f"{self.kind}{f' of {self.part}' if self.part else ''}, {self.amount:.3g} {UNITS[self.kind]}"


@final
@dataclass(frozen=True)
class Verdict:
    """Of a frame: the ``faults``, what causes others first; none where forces and torques for it exist, with proof.

    Example:
        >>> from wbc.motion import Fault, Verdict
        >>> Verdict().certified, Verdict((Fault("slip", "left_sole", 30.0),)).certified
        (True, False)
    """

    faults: tuple[Fault, ...] = ()

    @property
    def certified(self) -> bool:
        """Whether nothing is impossible about it."""
        return not self.faults

    def __str__(self) -> str:
        return "; ".join(map(str, self.faults)) or "certified"
