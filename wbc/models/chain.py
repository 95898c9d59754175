"""Chain: which joints a planar robot has, in which order and along which axes, and what it is described by."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal, final, get_args

from wbc.errors import InvalidInput

#: A revolute joint, or a prismatic one along an axis of the link before it.
Joint = Literal["R", "Px", "Py"]

#: More joints than this make expressions that nobody reads and that take minutes.
MAX_JOINTS = 6

_GRAMMAR = "a chain is a word of R (revolute), Px and Py (prismatic; P is Px), such as PR, RRPy or PxPyPxPy"


@final
@dataclass(frozen=True)
class Chain:
    """Joints from the base to the end effector, each followed by its link; all motion is in the world's x-y plane.

    Joint i starts at the tip of link i − 1 (the first at the origin), with the axes of that link:

        R    turns link i by q_i about z; its tip is l_i further along its own x axis
        Px   shifts link i by q_i along the x axis of the link before; its tip is its origin
        Py   the same along y

    The centre of mass of link i is d_i from its origin, along the link (R) or along the axis (Px, Py). Parameters are
    named by joint, counted from 1: masses m_i [kg]; lengths l_i [m] of revolute joints; offsets d_i [m] and moments of
    inertia about the centre of mass I_i [kg m²] of links that can turn. Those of other links have no effect.

    Raises:
        InvalidInput: no joint, more than six, or one that is none of the three.

    Example:
        >>> from wbc.models import Chain
        >>> pr = Chain.parse("PR")
        >>> str(pr), pr.parameters, pr.units
        ('PxR', ('m1', 'm2', 'l2', 'd2', 'I2'), ('m', 'rad'))
    """

    joints: tuple[Joint, ...]

    def __post_init__(self) -> None:
        if not 1 <= len(self.joints) <= MAX_JOINTS:
            raise InvalidInput(f"a chain of {len(self.joints)} joints; it must have 1 to {MAX_JOINTS}")
        for i, joint in enumerate(self.joints):
            if joint not in get_args(Joint):
                raise InvalidInput(f"joints[{i}] is {joint!r}; it must be one of {', '.join(get_args(Joint))}")

    @classmethod
    def parse(cls, word: str) -> Chain:
        """The chain that a word such as "PRR" or "PxPyR" spells; upper and lower case mean the same.

            chain = joint { joint }     joint = "R" | "P" | "Px" | "Py"     "P" is "Px"

        Raises:
            InvalidInput: a word that is no chain, with the place where it stops to be one.

        Example:
            >>> from wbc.models import Chain
            >>> Chain.parse("prpy").joints
            ('Px', 'R', 'Py')
        """
        if not isinstance(word, str):
            raise InvalidInput(f"a chain is spelled by a word, not by {type(word).__name__}")
        rest = re.sub("^(R|P[XY]?)*", "", word, flags=re.IGNORECASE)
        if rest:
            raise InvalidInput(f"chain {word[:40]!r} makes no sense at {rest[:10]!r}; {_GRAMMAR}")
        if not word:
            raise InvalidInput(f"the chain has no joint; {_GRAMMAR}")
        spelled: dict[str, Joint] = {"R": "R", "P": "Px", "PX": "Px", "PY": "Py"}
        return cls(tuple(spelled[joint] for joint in re.findall("R|P[XY]?", word.upper())))

    @property
    def units(self) -> tuple[str, ...]:
        """Unit of each joint, "rad" or "m"."""
        return tuple("rad" if joint == "R" else "m" for joint in self.joints)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the parameters: masses, lengths, offsets, moments of inertia."""
        numbers = range(1, len(self.joints) + 1)
        turning = [i for i in numbers if self.turns(i - 1)]
        return (
            *(f"m{i}" for i in numbers),
            *(f"l{i}" for i in numbers if self.joints[i - 1] == "R"),
            *(f"d{i}" for i in turning),
            *(f"I{i}" for i in turning),
        )

    def turns(self, link: int) -> bool:
        """Whether the orientation of ``link``, counted from 0, depends on q."""
        return "R" in self.joints[: link + 1]

    def __len__(self) -> int:
        return len(self.joints)

    def __str__(self) -> str:
        return "".join(self.joints)
