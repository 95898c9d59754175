"""The nearest inertia that a body can have.

Ten numbers π = (m, m c, I) of a link are those of some distribution of mass exactly when the pseudo-inertia

    J(π) = [[½ tr(I) 1 − I, m c], [m cᵀ, m]]   (4, 4)

is positive semi-definite; a mass that is not negative is far from enough. Lengths are scaled, S J S with
S = diag(1/ℓ, 1/ℓ, 1/ℓ, 1), so that all entries are kilogrammes, and distances of parameters are Frobenius distances of
these matrices,

    |π|² = ‖S J(π) S‖²_F = πᵀ Q π,   Q_kl = tr(B_k B_l),  B_k = S J(e_k) S.

In this metric the nearest possible parameters come from cutting off eigenvalues below ``floor``. The QP that says the
same has one row for each eigenvector u_k of the matrix given,

    minimise ½ (x − π)ᵀ Q (x − π)   subject to   u_kᵀ S J(x) S u_k ≥ floor,  k = 1 … 4:

the matrices u_k u_kᵀ are orthonormal, so its optimum is that of the whole cone.

With the gain Γ = γ Q⁻¹ an adaptive law may project so after each step, and the Lyapunov function of the loop does not
grow by it: the projection is that of its own metric.

Wensing, Kim, Slotine: Linear matrix inequalities for physically consistent inertial parameter identification, IEEE
RA-L 3(1), 2018.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, final

import numpy as np

from wbc import checks
from wbc.methods.least_distance import nearest
from wbc.methods.method import Method
from wbc.methods.shared import inverse_root
from wbc.qp.problem import QP, Row
from wbc.qp.solver import Solver
from wbc.types import Mat, Vec, read_only

#: Where the six numbers of the inertia stand in it.
_PLACES = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))


@final
@dataclass(frozen=True, eq=False)
class Possible:
    """Parameters (10,) that a body can have, and the smallest eigenvalue of their scaled pseudo-inertia [kg]."""

    parameters: Vec
    smallest: float


@final
@dataclass(frozen=True, eq=False, init=False)
class PseudoInertia(Method):
    """The projection of one link's parameters.

    Args:
        parameters: (m, mx, my, mz, Ixx, Ixy, Iyy, Ixz, Iyz, Izz), the inertia about the frame's origin.
        length: ℓ [m], about the size of a link.
        floor: the smallest eigenvalue allowed [kg], positive.

    Raises:
        InvalidInput: another number of parameters, NaN, a length or floor that is not positive.

    Example:
        >>> from wbc.methods import PseudoInertia
        >>> slender = PseudoInertia([1.0, 0, 0, 0, 0.1, 0, 0.01, 0, 0, 0.01])  # Ixx > Iyy + Izz: no body is like that
        >>> bool(slender.smallest < 0.0), slender.closed_form().parameters[[0, 4, 6, 9]].round(4).tolist()
        (True, [1.0, 0.1, 0.05, 0.05])
    """

    parameters: Vec
    length: float
    floor: float

    def __init__(self, parameters: Any, *, length: float = 0.1, floor: float = 1e-6) -> None:
        self._set(
            parameters=checks.array("parameters", parameters, (10,)),
            length=checks.number("length", length, low=0.0, strict=True),
            floor=checks.number("floor", floor, low=0.0, strict=True),
        )

    @staticmethod
    def metric(length: float = 0.1) -> Mat:
        """Q (10, 10): squared distances of parameters are πᵀ Q π [kg²].

        Raises:
            InvalidInput: a length that is not positive.
        """
        return _basis(checks.number("length", length, low=0.0, strict=True))[1]

    @property
    def matrix(self) -> Mat:
        """S J S (4, 4) [kg]."""
        return np.asarray(np.tensordot(self.parameters, _basis(self.length)[0], axes=1))

    @property
    def smallest(self) -> float:
        """The smallest eigenvalue [kg]: negative, and no body is like that."""
        return float(np.linalg.eigvalsh(self.matrix)[0])

    def closed_form(self) -> Possible:
        """Eigenvalues below the floor lifted to it."""
        values, vectors = np.linalg.eigh(self.matrix)
        if values[0] >= self.floor:
            return Possible(self.parameters.copy(), float(values[0]))
        lifted = np.maximum(values, self.floor)
        return Possible(_parameters((vectors * lifted) @ vectors.T, self.length), float(lifted[0]))

    def qp(self) -> QP:
        """The change x − π (10): H = Q, four rows u_kᵀ S J(x − π) S u_k ≥ floor − λ_k."""
        basis, Q = _basis(self.length)
        values, vectors = np.linalg.eigh(self.matrix)
        rows = np.einsum("ik,nij,jk->kn", vectors, basis, vectors)
        return QP(
            Q, np.zeros(10), C=rows, cl=self.floor - values,
            rows=[*(Row("body", f"eigenvector {k}", "kg") for k in range(4)),
                  *(Row("parameters", str(k)) for k in range(10))],
        )  # fmt: skip

    def solve(self, solver: str | Solver = "pdas") -> Possible:
        """The projection on any solver.

        Raises:
            UnknownSolver, SolverMissing: as :func:`wbc.qp.solve`.
            SolverFailed: the solver ended without an answer.
        """
        found = nearest(self.qp(), np.zeros(10), inverse_root(self.metric(self.length)), solver)
        assert found is not None  # the rows are independent
        parameters = self.parameters + found.x
        smallest = np.linalg.eigvalsh(np.tensordot(parameters, _basis(self.length)[0], axes=1))[0]
        return Possible(parameters, float(smallest))

    def difference(self, result: Possible, reference: Possible) -> Mapping[str, float]:
        """Distance relative to the size of the parameters, both in the metric."""
        Q = self.metric(self.length)
        apart, size = result.parameters - reference.parameters, self.parameters
        scale = float(size @ Q @ size) ** 0.5 + self.floor
        return {"parameters": max(float(apart @ Q @ apart), 0.0) ** 0.5 / scale}


def _scaled(parameters: Vec, length: float) -> Mat:
    m, first = parameters[0], parameters[1:4]
    inertia = np.zeros((3, 3))
    for (i, j), value in zip(_PLACES, parameters[4:], strict=True):
        inertia[i, j] = inertia[j, i] = value
    J = np.zeros((4, 4))
    J[:3, :3] = 0.5 * np.trace(inertia) * np.eye(3) - inertia
    J[:3, 3] = J[3, :3] = first
    J[3, 3] = m
    S = np.array([1.0 / length] * 3 + [1.0])
    return np.asarray(S[:, None] * J * S)


def _parameters(scaled: Mat, length: float) -> Vec:
    S = np.array([length] * 3 + [1.0])
    J = S[:, None] * scaled * S
    second = J[:3, :3]
    inertia = np.trace(second) * np.eye(3) - second
    return np.concatenate([[J[3, 3]], J[:3, 3], [inertia[i, j] for i, j in _PLACES]])


@lru_cache(maxsize=8)
def _basis(length: float) -> tuple[Mat, Mat]:
    """B_k (10, 4, 4) and Q (10, 10)."""
    basis = np.array([_scaled(unit, length) for unit in np.eye(10)])
    Q = np.einsum("kij,lij->kl", basis, basis)
    return read_only(basis), read_only(Q)
