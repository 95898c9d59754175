"""DerivedRobot: a derived chain with numbers, as a robot."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Unpack, final

import numpy as np
import sympy as sp
from numpy.typing import ArrayLike

from wbc.models.lagrange.equations import Equations
from wbc.models.planar import JointLimits, PlanarRobot
from wbc.types import Mat, Vec


@final
class DerivedRobot(PlanarRobot):
    """A planar chain whose formulas are derived and compiled; see :class:`~wbc.models.planar.PlanarRobot`.

    A formula is compiled at its first use, common subexpressions taken out. Made by
    :meth:`~wbc.models.lagrange.derivation.Derivation.robot`.

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
        self._compiled: dict[str, Callable[..., Any]] = {}
        self.check_inertia()

    def M(self, q: ArrayLike) -> Mat:
        return self._evaluate("M", q=q)

    def c(self, q: ArrayLike, v: ArrayLike) -> Vec:
        return self._evaluate("c", q=q, v=v)[:, 0]

    def S(self, q: ArrayLike, v: ArrayLike) -> Mat:
        return self._evaluate("S", q=q, v=v)

    def g(self, q: ArrayLike) -> Vec:
        return self._evaluate("g", q=q)[:, 0]

    def J(self, q: ArrayLike) -> Mat:
        return self._evaluate("J", q=q)

    def Jdot_v(self, q: ArrayLike, v: ArrayLike) -> Vec:
        return self._evaluate("Jdot_v", q=q, v=v)[:, 0]

    def momentum(self, q: ArrayLike, v: ArrayLike) -> Vec:
        return self._evaluate("momentum", q=q, v=v)[:, 0]

    def beta(self, q: ArrayLike, v: ArrayLike) -> Vec:
        return self._evaluate("beta", q=q, v=v)[:, 0]

    def energy(self, q: ArrayLike, v: ArrayLike) -> float:
        return float(self._evaluate("energy", q=q, v=v)[0, 0])

    @property
    def coefficients(self) -> Vec:
        return self._evaluate("coefficients")[:, 0]

    def regressor(self, q: ArrayLike, v: ArrayLike, v_reference: ArrayLike, a: ArrayLike) -> Mat:
        return self._evaluate("regressor", q=q, v=v, v_reference=v_reference, a=a)

    def _evaluate(self, formula: str, **arguments: ArrayLike) -> Mat:
        """The matrix of a formula, with these arguments in the order it wants them."""
        if formula not in self._compiled:
            self._compiled[formula] = self._compile(formula, tuple(arguments))
        vectors = (self.vector(name, value) for name, value in arguments.items())
        return np.asarray(self._compiled[formula](*vectors), dtype=np.float64)

    def _compile(self, formula: str, arguments: tuple[str, ...]) -> Callable[..., Any]:
        derivation = self._equations
        symbols = {"q": derivation.q, "v": derivation.v, "a": derivation.a}
        if formula == "energy":
            expression = sp.Matrix([derivation.T + derivation.U])
        elif formula == "regressor":
            parametrisation = derivation.parametrisation
            symbols["v_reference"] = parametrisation.v_reference
            expression = parametrisation.Y
        else:
            expression = getattr(derivation, formula)
        numbers = {derivation.parameters[name]: sp.Float(value) for name, value in self.parameters.items()}
        expression = expression.xreplace(numbers | {derivation.g0: sp.Float(self.g0)})
        compiled: Callable[..., Any] = sp.lambdify([symbols[name] for name in arguments], expression, "numpy", cse=True)
        return compiled

    def __getstate__(self) -> dict[str, Any]:
        # Compiled functions cannot be pickled: a copy compiles its own.
        return {**self.__dict__, "_compiled": {}}
