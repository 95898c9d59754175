"""Planar robots whose regressors are written by hand: PlanarPR and Planar4P."""

from __future__ import annotations

from typing import TYPE_CHECKING, Unpack, final

import numpy as np
from numpy.typing import ArrayLike

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.models.chain import Chain
from wbc.models.planar import JointLimits, PlanarRobot
from wbc.types import Mat, Vec

if TYPE_CHECKING:
    from wbc.models.lagrange import Derivation

#: Coefficients of Planar4P from masses: m1 + m2 + m3 + m4, m2 + m3 + m4, m3 + m4, m4.
_SUMS = np.triu(np.ones((4, 4)))


class _Derivable(PlanarRobot, metaclass=TellsArguments):
    def symbolic(self) -> Derivation:
        """The dynamics derived: sympy expressions, and ``latex()``."""
        from wbc.models.lagrange import derive

        return derive(self.chain)


@final
class PlanarPR(_Derivable):
    """Link 1 slides along x by q1 [m]; link 2 turns about its origin by q2 [rad], counted from x.

        M = [ m1 + m2       −m2 d2 s2     ]   c = [ −m2 d2 c2 q̇2² ]   g = [ 0            ]      s2 = sin q2
            [ −m2 d2 s2     I2 + m2 d2²   ]       [  0             ]       [ m2 d2 g0 c2  ]      c2 = cos q2

    with the end effector at (q1 + l2 c2, l2 s2). In the vertical plane ``gravity`` g0 acts along −y; 0 means the plane
    is horizontal. M is positive definite for every q2 when (m1 + m2)(I2 + m2 d2²) > m2² d2².

    Args:
        m1, m2: masses [kg].
        l2: length of link 2 [m].
        d2: distance of its centre of mass from the joint [m].
        I2: its moment of inertia about the centre of mass [kg m²].
        gravity: along −y [m/s²].
        limits: ``q_min``, ``q_max``, ``v_max``, ``tau_max``: a number or (2,); none by default.

    Raises:
        InvalidInput: a parameter that is not finite or negative (d2 may be), or an M that is singular somewhere.

    Source: A. De Luca, Robotics 2, Sapienza University of Rome, Lagrangian dynamics of a PR robot.

    Example:
        >>> import numpy as np
        >>> from wbc.models import PlanarPR
        >>> robot = PlanarPR(m1=1, m2=1, l2=0.5, d2=0.25, I2=0.1)
        >>> robot.M([0, np.pi / 2]).tolist()
        [[2.0, -0.25], [-0.25, 0.1625]]
        >>> robot.frame_names
        ('base', 'link1', 'link2', 'end_effector')
    """

    def __init__(
        self,
        *,
        m1: float,
        m2: float,
        l2: float,
        d2: float,
        I2: float,
        gravity: float = 9.81,
        **limits: Unpack[JointLimits],
    ) -> None:
        parameters = {"m1": m1, "m2": m2, "l2": l2, "d2": d2, "I2": I2}
        super().__init__("planar_pr", Chain.parse("PR"), parameters, gravity=gravity, limits=limits)
        p = self.parameters
        self._mass = p["m1"] + p["m2"]
        self._first = p["m2"] * p["d2"]
        self._second = p["I2"] + p["m2"] * p["d2"] ** 2
        # s2 = 1 is where the determinant is smallest.
        self.replace(q0=[0.0, np.pi / 2]).check_inertia()

    @property
    def coefficients(self) -> Vec:
        """(m1 + m2, I2 + m2 d2², m2 d2) [kg, kg m², kg m]."""
        return np.array([self._mass, self._second, self._first])

    def regressor(self, q: ArrayLike, v: ArrayLike, v_reference: ArrayLike, a: ArrayLike) -> Mat:
        q, v, a = self.vector("q", q), self.vector("v", v), self.vector("a", a)
        sin, cos = np.sin(q[1]), np.cos(q[1])
        centrifugal = cos * v[1] * self.vector("v_reference", v_reference)[1]
        return np.array([[a[0], 0.0, -sin * a[1] - centrifugal], [0.0, a[1], -sin * a[0] + self.g0 * cos]])


@final
class Planar4P(_Derivable):
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
