"""Planar4P: four prismatic joints, two along x and two along y."""

from __future__ import annotations

from typing import TYPE_CHECKING, Unpack, final

import numpy as np
from numpy.typing import ArrayLike

from wbc import checks
from wbc.models.chain import Chain
from wbc.models.planar import JointLimits, PlanarRobot
from wbc.types import Mat, Vec

if TYPE_CHECKING:
    from wbc.models.lagrange import Derivation

#: Coefficients from masses: m1 + m2 + m3 + m4, m2 + m3 + m4, m3 + m4, m4.
_SUMS = np.triu(np.ones((4, 4)))


@final
class Planar4P(PlanarRobot):
    """Joints 1 and 3 slide along x, joints 2 and 4 along y, upwards. M is constant, so c = 0 and S = 0.

        M = [ a1  0   a3  0  ]      g = [ 0     ]      Y(q̈) = [ q̈1  0        q̈3       0            ]
            [ 0   a2  0   a4 ]          [ a2 g0 ]             [ 0   q̈2 + g0  0        q̈4           ]
            [ a3  0   a3  0  ]          [ 0     ]             [ 0   0        q̈1 + q̈3  0            ]
            [ 0   a4  0   a4 ]          [ a4 g0 ]             [ 0   0        0        q̈2 + q̈4 + g0 ]

    with a = (m1 + m2 + m3 + m4, m2 + m3 + m4, m3 + m4, m4) and M q̈ + g = Y(q̈) a.
    The end effector is at (q1 + q3, q2 + q4). M is positive definite when m1 + m2, m2 + m3, m3 + m4 and m4 are > 0.

    Args:
        m: masses of the links (4,) [kg].
        gravity: along −y [m/s²]; 0 when the plane is horizontal.
        limits: ``q_min``, ``q_max`` [m], ``v_max`` [m/s], ``tau_max`` [N]: a number or (4,); none by default.

    Raises:
        InvalidInput: a mass that is negative or not finite, or an M that is singular.

    Source: J.-J. E. Slotine, W. Li, Applied Nonlinear Control, 1991, for the linear parametrisation.

    Example:
        >>> import numpy as np
        >>> from wbc.models import Planar4P
        >>> robot = Planar4P(m=(4, 3, 2, 1))
        >>> robot.coefficients.tolist(), robot.cartesian_inertia(np.zeros(4)).round(12).tolist()
        ([10.0, 6.0, 3.0, 1.0], [[3.0, 0.0], [0.0, 1.0]])
    """

    def __init__(
        self, *, m: ArrayLike = (1.0, 1.0, 1.0, 1.0), gravity: float = 9.81, **limits: Unpack[JointLimits]
    ) -> None:
        masses = checks.array("m", m, (4,))
        parameters = {f"m{i + 1}": checks.number(f"m[{i}]", mass, low=0.0) for i, mass in enumerate(masses)}
        super().__init__("planar_4p", Chain.parse("PxPyPxPy"), parameters, gravity=gravity, limits=limits)
        self._a = _SUMS @ masses

    @property
    def coefficients(self) -> Vec:
        """(m1 + m2 + m3 + m4, m2 + m3 + m4, m3 + m4, m4) [kg]."""
        return self._a.copy()

    def possible_coefficients(self) -> tuple[Mat, Vec]:
        """a1 >= a2 >= a3 >= a4 >= 0: every mass is a difference of neighbours, m = T⁻¹ a >= 0."""
        return np.diag(np.ones(3), 1) - np.eye(4), np.zeros(4)

    def Y(self, a: ArrayLike) -> Mat:
        """Y (4, 4) with Y · coefficients = M a + g, for the acceleration a (4,) [m/s²]."""
        a1, a2, a3, a4 = self.vector("a", a)
        Y = np.diag([a1, a2 + self.g0, a1 + a3, a2 + a4 + self.g0])
        Y[0, 2], Y[1, 3] = a3, a4
        return Y

    def Y_masses(self, a: ArrayLike) -> Mat:
        """Y_m (4, 4) with Y_m · m = M a + g, for the acceleration a (4,) [m/s²]."""
        a1, a2, a3, a4 = self.vector("a", a)
        x, y, below = a1 + a3, a2 + a4 + self.g0, a2 + self.g0
        return np.array([[a1, a1, x, x], [0.0, below, below, y], [0.0, 0.0, x, x], [0.0, 0.0, 0.0, y]])

    def regressor(self, q: ArrayLike, v: ArrayLike, v_reference: ArrayLike, a: ArrayLike) -> Mat:
        for name, value in (("q", q), ("v", v), ("v_reference", v_reference)):
            self.vector(name, value)  # nothing depends on these; a wrong shape is refused all the same
        return self.Y(a)

    def symbolic(self) -> Derivation:
        """The dynamics derived: sympy expressions, and ``latex()``."""
        from wbc.models.lagrange import derive

        return derive(self.chain)
