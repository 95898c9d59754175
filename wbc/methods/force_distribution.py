"""Contact forces that together are a given wrench, of least weighted norm.

    minimise ½ fᵀW f   subject to   G f = wrench,   f in a friction pyramid at every contact,   f_min ≤ f ≤ f_max.

G (m, nf) is the grasp matrix: column by column the wrench of a unit force. Without friction and limits the optimality
conditions W f = Gᵀλ, G f = wrench are linear,

    f = W⁻¹Gᵀλ,   λ = (G W⁻¹ Gᵀ)⁻¹ wrench   (pseudo-inverse where rows of G depend on each other).

With them the finite method of :mod:`wbc.methods.farthest` finds the forces, or multipliers that prove that there are
none.

Kerr, Roth: Analysis of multifingered hands, International Journal of Robotics Research 4(4), 1986.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput
from wbc.friction import Pyramid
from wbc.methods.least_distance import nearest
from wbc.methods.method import Method
from wbc.methods.shared import SMALL, box, factors, inverse_root, largest_known, metric, positive
from wbc.qp.problem import QP, Row
from wbc.qp.solver import Solver
from wbc.types import Mat, Vec


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
            contacts, z along the normal, nf = 3 k.
        friction_model: "inner", the default, a pyramid inside the circular cone: |f_x| and |f_y| ≤ μ/√2 f_z with 4
            sides; or "outer", around it: |f_x| and |f_y| ≤ μ f_z. See :class:`~wbc.friction.Pyramid`.
        sides: of the pyramid, 4 or 8.
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
    friction_model: str
    sides: int
    f_min: Vec
    f_max: Vec

    def __init__(
        self, G: Any, wrench: Any, *, weight: Any = None, friction: Any = None, friction_model: str = "inner",
        sides: int = 4, f_min: Any = None, f_max: Any = None,
    ) -> None:  # fmt: skip
        G = checks.array("G", G, (None, None))
        nf = G.shape[1]
        lower, upper = box(nf, f_min=-np.inf if f_min is None else f_min, f_max=np.inf if f_max is None else f_max)
        self._set(
            G=G, wrench=checks.array("wrench", wrench, (len(G),)),
            weight=metric("weight", 1.0 if weight is None else weight, nf),
            friction=_friction(friction, nf), friction_model=friction_model, sides=sides, f_min=lower,
            f_max=upper,
        )  # fmt: skip
        Pyramid(1.0, friction_model, sides)

    @property
    def _root(self) -> Mat:
        """R with W⁻¹ = R Rᵀ: f = R u has the norm of u."""
        return inverse_root(self.weight)

    def closed_form(self) -> Distribution:
        """The pseudo-inverse of G in the metric of W; with friction or limits, the finite method."""
        if self.friction.size or np.isfinite([self.f_min, self.f_max]).any():
            return self._nearest(None)
        root = self._root
        found = factors(self.G @ root)
        if not found.reaches(self.wrench, self.wrench):
            return self._infeasible()
        return self._result(root @ found.inverse(self.wrench), found.U @ (found.solve(self.wrench) / found.values))

    def _result(self, f: Vec, multipliers: Vec) -> Distribution:
        return Distribution(f, self.G @ f - self.wrench, multipliers, True)

    def _infeasible(self) -> Distribution:
        m, nf = self.G.shape
        return Distribution(np.full(nf, np.nan), np.full(m, np.nan), np.full(m, np.nan), False)

    def qp(self) -> QP:
        """minimise ½ fᵀW f subject to G f = wrench (m rows), 0 ≤ mu f_z − n · (f_x, f_y) (``sides`` rows a contact)."""
        (m, nf), (pyramid, sides) = self.G.shape, self._pyramid()
        return QP(
            self.weight, np.zeros(nf), A=self.G, b=self.wrench, C=pyramid, cl=np.zeros(len(pyramid)),
            lb=self.f_min, ub=self.f_max,
            rows=[
                *(Row("wrench", f"row {i}") for i in range(m)),
                *(Row(f"friction[{k}]", side, "N") for k in range(self.friction.size) for side in sides[k]),
                *(Row("force limits", f"force {i}", "N") for i in range(nf)),
            ],
        )  # fmt: skip

    def _pyramid(self) -> tuple[Mat, list[list[str]]]:
        """Rows (sides k, nf) that are not negative inside friction, and what the sides of each contact are called."""
        rows, names = np.zeros((self.sides * self.friction.size, self.G.shape[1])), []
        for k, mu in enumerate(self.friction):
            pyramid = Pyramid(float(mu), self.friction_model, self.sides)
            rows[self.sides * k : self.sides * (k + 1), 3 * k : 3 * k + 3] = -pyramid.rows
            names.append([f"{name} <= mu fz" for name in pyramid.names])
        return rows, names

    def solve(self, solver: str | Solver = "pdas") -> Distribution:
        """The forces by QP.

        Raises:
            UnknownSolver, SolverMissing: as :func:`wbc.qp.solve`.
            SolverFailed: the solver ended without an answer.
        """
        return self._nearest(solver)

    def _nearest(self, solver: str | Solver | None) -> Distribution:
        found = nearest(self.qp(), np.zeros(self.G.shape[1]), self._root, solver)
        return self._infeasible() if found is None else self._result(found.x, -found.y)

    def difference(self, result: Distribution, reference: Distribution) -> Mapping[str, float]:
        """Forces and the wrench in the metric of W, relative to the forces; multipliers by what they push."""
        if result.feasible != reference.feasible:
            return {"feasible": np.inf}
        if not result.feasible:
            return {"feasible": 0.0}
        factor, root = np.linalg.cholesky(self.weight).T, self._root

        def size(f: Vec) -> float:
            return float(np.linalg.norm(factor @ f))

        known = size(largest_known(self.f_min, self.f_max)) or (0.0 if self.wrench.any() else 1.0)
        scale, reach = max(size(reference.f), SMALL * known) or 1.0, np.linalg.norm(self.G @ root, axis=1)
        inside = np.concatenate([self._pyramid()[0] @ result.f, result.f - self.f_min, self.f_max - result.f])
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
    """Coefficients (k,), checked; none without friction."""
    if friction is None:
        return np.zeros(0)
    if nf % 3:
        raise InvalidInput(f"friction needs forces in threes (f_x, f_y, f_z); G has {nf} columns")
    return positive("friction", checks.each("friction", friction, nf // 3))
