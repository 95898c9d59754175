"""Which force at a point explains a residual: least squares, inside the friction cone of a surface.

A force f at a point with Jacobian J (3, n) is seen by the momentum residual as r = −Jᵀ f. The one that explains r best,

    minimise ½ ‖Jᵀ f + r‖²_W   subject to   |f_t1|, |f_t2| ≤ μ f_n,

pushes on a surface with normal n, inwards, and not along it more than friction allows. Without a surface it is the
weighted least-squares solution; with it, a QP in three unknowns.

Haddadin, De Luca, Albu-Schäffer: Robot collisions: a survey on detection, isolation, and identification, IEEE
Transactions on Robotics 33(6), 2017.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput, NoClosedForm
from wbc.methods.least_distance import nearest
from wbc.methods.method import Method
from wbc.methods.shared import inverse_root, metric
from wbc.qp.problem import QP, Row
from wbc.qp.solver import Solver
from wbc.tolerances import ROUNDING, SAME, TINY
from wbc.types import Mat, Vec

#: Directions that no joint feels are given this share of the largest curvature, so that their force is 0.
UNFELT = SAME


@final
@dataclass(frozen=True, eq=False)
class Explained:
    """The force (3,) [N], and how much of the residual it leaves unexplained, 0 to 1, in the metric."""

    force: Vec
    unexplained: float


@final
@dataclass(frozen=True, eq=False, init=False)
class ContactEstimate(Method):
    """A force at one point.

    Args:
        J: linear Jacobian of the point (3, n), world axes.
        residual: r (n,) [N m, N].
        weight: W, a positive number, (n,) or symmetric positive definite (n, n); none: 1. Best 1 / threshold².
        normal: outward normal of the surface (3,), world axes; the force pushes against it. None: any force.
        friction: μ > 0 of the surface, with ``normal``.

    Raises:
        InvalidInput: shapes, NaN, a normal of length zero, μ ≤ 0, a normal without friction or the reverse.

    Example:
        >>> import numpy as np
        >>> from wbc.methods import ContactEstimate
        >>> J = np.eye(3)
        >>> ContactEstimate(J, [-1.0, 2.0, 5.0]).closed_form().force.round(6).tolist()
        [1.0, -2.0, -5.0]
    """

    J: Mat
    residual: Vec
    weight: Mat
    normal: Vec
    friction: float

    def __init__(
        self, J: Any, residual: Any, *, weight: Any = None, normal: Any = None, friction: float | None = None
    ) -> None:
        J = checks.array("J", J, (3, None))
        n = J.shape[1]
        if (normal is None) != (friction is None):
            raise InvalidInput("normal and friction come together: one of them is missing")
        axis = np.zeros(3) if normal is None else checks.array("normal", normal, (3,))
        length = float(np.linalg.norm(axis))
        if normal is not None and length < ROUNDING:
            raise InvalidInput("normal has length 0")
        self._set(
            J=J, residual=checks.array("residual", residual, (n,)),
            weight=metric("weight", 1.0 if weight is None else weight, n),
            normal=axis / length if normal is not None else axis,
            friction=0.0 if friction is None else checks.number("friction", friction, low=0.0, strict=True),
        )  # fmt: skip

    @property
    def _curvature(self) -> Mat:
        H = self.J @ self.weight @ self.J.T
        return np.asarray(0.5 * (H + H.T) + UNFELT * max(float(np.trace(H)), TINY) * np.eye(3))

    @property
    def _free(self) -> Vec:
        return np.asarray(-np.linalg.solve(self._curvature, self.J @ self.weight @ self.residual), dtype=np.float64)

    def closed_form(self) -> Explained:
        """Weighted least squares.

        Raises:
            NoClosedForm: there is a surface.
        """
        if self.friction:
            raise NoClosedForm("a friction cone has no closed form; use solve")
        return self._explained(self._free)

    def qp(self) -> QP:
        """f (3): H = J W Jᵀ, g = J W r; four rows of the friction pyramid."""
        rows = self._pyramid()
        return QP(
            self._curvature, self.J @ self.weight @ self.residual, C=rows, cu=np.zeros(len(rows)),
            rows=[*(Row("friction", str(k), "N") for k in range(len(rows))),
                  *(Row("force", axis, "N") for axis in "xyz")],
        )  # fmt: skip

    def solve(self, solver: str | Solver = "pdas") -> Explained:
        """The force on any solver.

        Raises:
            UnknownSolver, SolverMissing: as :func:`wbc.qp.solve`.
            SolverFailed: the solver ended without an answer.
        """
        found = nearest(self.qp(), self._free, inverse_root(self._curvature), solver)
        assert found is not None  # zero is a force
        return self._explained(found.x)

    def difference(self, result: Explained, reference: Explained) -> Mapping[str, float]:
        """The difference of the joint torques of two forces, relative to the residual."""
        apart = result.force - reference.force
        size = float(self.residual @ self.weight @ self.residual) ** 0.5 or 1.0
        return {"force": max(float(apart @ self._curvature @ apart), 0.0) ** 0.5 / size}

    def _pyramid(self) -> Mat:
        if not self.friction:
            return np.zeros((0, 3))
        inward = -self.normal
        across = np.abs(inward) <= np.abs(inward).min() + SAME
        tangent = np.cross(inward, np.eye(3)[int(across.argmax())])
        tangent /= np.linalg.norm(tangent)
        other = np.cross(inward, tangent)
        return np.array([s * t - self.friction * inward for t in (tangent, other) for s in (1.0, -1.0)])

    def _explained(self, force: Vec) -> Explained:
        left = self.J.T @ force + self.residual
        whole = float(self.residual @ self.weight @ self.residual) or 1.0
        return Explained(force, min((float(left @ self.weight @ left) / whole) ** 0.5, 1.0))
