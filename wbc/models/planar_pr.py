"""PlanarPR: a prismatic joint along x that carries a revolute one."""

from __future__ import annotations

from typing import TYPE_CHECKING, Unpack, final

import numpy as np
from numpy.typing import ArrayLike

from wbc.models.chain import Chain
from wbc.models.planar import JointLimits, PlanarRobot
from wbc.types import Mat, Vec

if TYPE_CHECKING:
    from wbc.models.lagrange import Derivation


@final
class PlanarPR(PlanarRobot):
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

    def symbolic(self) -> Derivation:
        """The dynamics derived: sympy expressions, and ``latex()``."""
        from wbc.models.lagrange import derive

        return derive(self.chain)
