"""Derivation: the equations of a chain, told step by step and with numbers."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, Unpack, final

from wbc.models.chain import Chain
from wbc.models.lagrange import writing
from wbc.models.lagrange.equations import Equations
from wbc.models.lagrange.robot import DerivedRobot
from wbc.models.lagrange.steps import Step, steps
from wbc.models.planar import JointLimits


@final
class Derivation(Equations):
    """Everything of :class:`~wbc.models.lagrange.equations.Equations`, on paper and as a robot.

    Made by :func:`~wbc.models.lagrange.derive`.

    Example:
        >>> from wbc.models.lagrange import derive
        >>> arm = derive("RR")
        >>> print(arm.M[1, 1], "|", arm.c[1], "|", arm.g[1])
        I2 + d2**2*m2 | d2*l1*m2*qdot1**2*sin(q2) | d2*g0*m2*cos(q1 + q2)
    """

    def steps(self) -> list[Step]:
        """The derivation step by step, as data."""
        return steps(self)

    def text(self, width: int = 100) -> str:
        """The derivation for a terminal of so many columns."""
        return writing.text(self.steps(), width)

    def latex(self) -> str:
        """The derivation as a LaTeX document."""
        return writing.latex(self.steps(), str(self.chain))

    def robot(
        self, parameters: Mapping[str, float], *, gravity: float = 9.81, **limits: Unpack[JointLimits]
    ) -> DerivedRobot:
        """The chain with numbers for its parameters: a robot like any other.

        Raises:
            InvalidInput: a parameter that is missing, too many or makes no sense.

        Example:
            >>> from wbc.models.lagrange import derive
            >>> cart = derive("Px").robot({"m1": 2.0})
            >>> cart.M([0.0]).tolist()
            [[2.0]]
        """
        return DerivedRobot(self, parameters, gravity=gravity, **limits)

    def __reduce__(self) -> tuple[Any, ...]:
        return derived, (self.chain,)  # a copy, or a pickle, is derived anew where its process has not

    def __repr__(self) -> str:
        return f"Derivation({self.chain})"


@lru_cache(maxsize=32)
def derived(chain: Chain) -> Derivation:
    """The derivation of a chain, made once."""
    return Derivation(chain)
