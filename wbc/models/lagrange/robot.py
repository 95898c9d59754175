"""DerivedRobot: a derived chain with numbers, as a robot."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any, Unpack, final

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike

from wbc.models.lagrange.equations import Equations
from wbc.models.planar import JointLimits, PlanarRobot
from wbc.types import Mat, Vec


@final
class DerivedRobot(PlanarRobot):
    """A planar chain whose regressor is derived, and compiled at its first use; see
    :class:`~wbc.models.planar.PlanarRobot`. Made by :meth:`~wbc.models.lagrange.derivation.Derivation.robot`.

    Raises:
        InvalidInput: a parameter that is missing, too many or makes no sense; an M that is singular at q0.

    Example:
        >>> from wbc.models.lagrange import derive
        >>> robot = derive("RP").robot({"m1": 2, "m2": 1, "l1": 0.5, "d1": 0.2, "d2": 0, "I1": 0.1, "I2": 0.1})
        >>> robot, robot.M([0.0, 0.5]).round(3).tolist()
        (RP (RPx, 3.0 kg), [[1.28, 0.0], [0.0, 1.0]])
    """

    def __init__(
        self,
        equations: Equations,
        parameters: Mapping[str, float],
        *,
        gravity: float = 9.81,
        **limits: Unpack[JointLimits],
    ) -> None:
        self._equations, chain = equations, equations.chain
        super().__init__(str(chain).replace("Px", "P"), chain, parameters, gravity=gravity, limits=limits)

    @property
    def coefficients(self) -> Vec:
        return np.array(self._compiled[0](), dtype=np.float64)[:, 0]

    def regressor(self, q: ArrayLike, v: ArrayLike, v_reference: ArrayLike, a: ArrayLike) -> Mat:
        given = {"q": q, "v": v, "v_reference": v_reference, "a": a}
        vectors = [self.vector(name, value) for name, value in given.items()]
        return np.array(self._compiled[1](*vectors), dtype=np.float64)

    @cached_property
    def _compiled(self) -> list[Callable[..., Any]]:
        """Coefficients, and the regressor as a function of q, v, v_reference and a."""
        d = self._equations
        found = d.parametrisation
        numbers = {d.parameters[name]: sp.Float(value) for name, value in self.parameters.items()}
        numbers[d.g0] = sp.Float(self.g0)
        motion = [d.q, d.v, found.v_reference, d.a]
        return [
            sp.lambdify(symbols, expression.xreplace(numbers), "numpy", cse=True)
            for symbols, expression in (([], found.coefficients), (motion, found.Y))
        ]

    def __getstate__(self) -> dict[str, Any]:
        # Compiled functions cannot be pickled: a copy compiles its own.
        return {key: value for key, value in self.__dict__.items() if key != "_compiled"}
