"""Contact forces that together are a given wrench, of least weighted norm.

    minimise ½ fᵀW f   subject to   G f = wrench,   |f_x| ≤ μ f_z, |f_y| ≤ μ f_z at every contact,   f_min ≤ f ≤ f_max.

G (m, nf) is the grasp matrix: column by column the wrench of a unit force. Without friction and limits the optimality
conditions W f = Gᵀλ, G f = wrench are linear,

    f = W⁻¹Gᵀλ,   λ = (G W⁻¹ Gᵀ)⁻¹ wrench   (pseudo-inverse where rows of G depend on each other).

Kerr, Roth: Analysis of multifingered hands, International Journal of Robotics Research 4(4), 1986.
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
from wbc.methods.metric import inverse_root, metric
from wbc.methods.shared import answered, box, factors
from wbc.qp.problem import QP, Row
from wbc.qp.solver import Solver
from wbc.types import Mat, Vec

#: Part of a wrench, relative to the whole, that may be out of the range of G.
REACHED = 1e-9


@final
@dataclass(frozen=True, eq=False)
class Distribution:
    """Forces f (nf,), what is missing of the wrench, G f − wrench (m,), and the multipliers λ of the wrench (m,).

    W f = Gᵀλ where neither friction nor a limit is active; λ is the one of least norm where rows of G depend on each
    other. Infeasible: no forces within friction and limits give this wrench, and all arrays are NaN.
    """

    f: Vec
    residual: Vec
    multipliers: Vec
    feasible: bool


@final
@dataclass(frozen=True, eq=False, init=False)
class ForceDistribution(Method):
    """Forces of least norm ½ fᵀW f with G f = wrench, inside friction pyramids and limits.

    Args:
        G: grasp matrix (m, nf), of any rank.
        wrench: what the forces must add up to (m,) [N, N m].
        weight: W, a positive number, the diagonal (nf,) or a symmetric positive definite matrix (nf, nf); none: 1.
        friction: coefficient μ > 0, one for all contacts or one each; the forces are then (f_x, f_y, f_z) of point
            contacts, z along the normal, nf = 3 k. The pyramid is the one outside the cone: |f_x| and |f_y| ≤ μ f_z.
        f_min: lower limits (nf,), or a number for all [N].
        f_max: upper limits (nf,), or a number for all [N].

    Raises:
        InvalidInput: shapes, NaN, crossed limits, μ ≤ 0, a weight that is not symmetric positive definite.

    Example:
        >>> from wbc.methods import ForceDistribution
        >>> two = ForceDistribution([[1.0, 1.0]], [3.0], weight=[1.0, 2.0])
        >>> print(two.closed_form().f, two.closed_form().multipliers)
        [2. 1.] [2.]
    """

    G: Mat
    wrench: Vec
    weight: Mat
    friction: Vec
    f_min: Vec
    f_max: Vec

    def __init__(
        self, G: Any, wrench: Any, *, weight: Any = None, friction: Any = None, f_min: Any = None, f_max: Any = None
    ) -> None:
        G = checks.array("G", G, (None, None))
        nf = G.shape[1]
        lower, upper = box(nf, f_min=-np.inf if f_min is None else f_min, f_max=np.inf if f_max is None else f_max)
        fields = {
            "G": G, "wrench": checks.array("wrench", wrench, (len(G),)),
            "weight": metric("weight", 1.0 if weight is None else weight, nf),
            "friction": _friction(friction, nf), "f_min": lower, "f_max": upper,
        }  # fmt: skip
        for name, value in fields.items():
            object.__setattr__(self, name, value)

    @property
    def _root(self) -> Mat:
        """R with W⁻¹ = R Rᵀ: f = R u has the norm of u."""
        return inverse_root(self.weight)

    def closed_form(self) -> Distribution:
        """The pseudo-inverse of G in the metric of W.

        Raises:
            NoClosedForm: there is friction, or a limit that is not infinite.
        """
        if self.friction.size or np.isfinite([self.f_min, self.f_max]).any():
            raise NoClosedForm("friction and force limits have no closed form; use solve")
        root = self._root
        found = factors(self.G @ root)
        u = found.inverse(self.wrench)
        missing = found.rest.T @ self.wrench
        if np.linalg.norm(missing) > REACHED * np.linalg.norm(self.wrench):
            return self._infeasible()
        return self._result(root @ u, found.U @ (found.solve(self.wrench) / found.values))

    def _result(self, f: Vec, multipliers: Vec) -> Distribution:
        return Distribution(f, self.G @ f - self.wrench, multipliers, True)

    def _infeasible(self) -> Distribution:
        m, nf = self.G.shape
        return Distribution(np.full(nf, np.nan), np.full(m, np.nan), np.full(m, np.nan), False)

    def qp(self) -> QP:
        """minimise ½ fᵀW f subject to G f = wrench (m rows), 0 ≤ μ f_z ∓ f_x, 0 ≤ μ f_z ∓ f_y (4 rows a contact)."""
        (m, nf), pyramid = self.G.shape, self._pyramid()
        sides = ("μ f_z − f_x", "μ f_z + f_x", "μ f_z − f_y", "μ f_z + f_y")
        return QP(
            self.weight, np.zeros(nf), A=self.G, b=self.wrench, C=pyramid, cl=np.zeros(len(pyramid)),
            lb=self.f_min, ub=self.f_max,
            rows=[
                *(Row("wrench", f"row {i}") for i in range(m)),
                *(Row(f"friction[{k}]", side, "N") for k in range(self.friction.size) for side in sides),
                *(Row("force limits", f"force {i}", "N") for i in range(nf)),
            ],
        )  # fmt: skip

    def _pyramid(self) -> Mat:
        """Rows (4 k, nf) that are not negative inside friction."""
        rows = np.zeros((4 * self.friction.size, self.G.shape[1]))
        for k, mu in enumerate(self.friction):
            rows[4 * k : 4 * k + 4, 3 * k : 3 * k + 3] = [[-1, 0, mu], [1, 0, mu], [0, -1, mu], [0, 1, mu]]
        return rows

    def solve(self, solver: str | Solver = "pdas") -> Distribution:
        """The forces by QP.

        Raises:
            UnknownSolver, SolverMissing: as :func:`wbc.qp.solve`.
            SolverFailed: the solver ended without an answer.
        """
        found = answered(nearest(self.qp(), np.zeros(self.G.shape[1]), self._root, solver), solver)
        return self._result(found.x, -found.y) if found.status.ok else self._infeasible()

    def difference(self, result: Distribution, reference: Distribution) -> Mapping[str, float]:
        """Forces and the wrench in the metric of W, relative to the forces; multipliers by what they push."""
        if result.feasible != reference.feasible:
            return {"feasible": np.inf}
        if not result.feasible:
            return {"feasible": 0.0}
        factor, root = np.linalg.cholesky(self.weight).T, self._root

        def size(f: Vec) -> float:
            return float(np.linalg.norm(factor @ f))

        scale, reach = size(reference.f) or 1.0, np.linalg.norm(self.G @ root, axis=1)
        inside = np.concatenate([self._pyramid() @ result.f, result.f - self.f_min, self.f_max - result.f])
        found = {
            "force": size(result.f - reference.f) / scale,
            "cost": abs(size(result.f) ** 2 - size(reference.f) ** 2) / scale**2,
            "residual": float((np.abs(result.residual) / (reach * scale + (reach == 0.0))).max(initial=0.0)),
            "limits": max(0.0, -float(inside.min(initial=0.0)) / (np.abs(reference.f).max(initial=0.0) or 1.0)),
        }
        if not self.friction.size and not np.isfinite([self.f_min, self.f_max]).any():
            apart, terms = result.multipliers - reference.multipliers, np.abs(reference.multipliers)
            push = float(np.linalg.norm(root.T @ (self.G.T @ apart)))
            # Rows that nearly depend on each other have large multipliers, and a sum of k large terms is known to k ε
            # of their sizes (Higham: Accuracy and stability of numerical algorithms, 2002, section 3.1).
            sums = np.abs(root.T) @ (np.abs(self.G.T) @ terms)
            rounding = sum(self.G.shape) * np.finfo(float).eps * float(np.linalg.norm(sums))
            found["multipliers"] = max(0.0, push - rounding) / scale
        return found


def _friction(friction: Any, nf: int) -> Vec:
    """Coefficients (k,), checked; none where friction is not asked for."""
    if friction is None:
        return np.zeros(0)
    if nf % 3:
        raise InvalidInput(f"friction needs forces in threes (f_x, f_y, f_z); G has {nf} columns")
    return checks.limit("friction", friction, nf // 3)
