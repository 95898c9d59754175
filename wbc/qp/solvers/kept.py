"""What back ends share: a workspace that is made once and updated, one-sided rows, sparse matrices."""

from __future__ import annotations

import re
from abc import abstractmethod
from time import perf_counter
from typing import Any, final

import numpy as np
from scipy.sparse import csc_matrix

from wbc.qp.certificate import Certificate
from wbc.qp.problem import QP, Shape
from wbc.qp.solver import Answer, Session, Solver
from wbc.types import Index, Mat, Status, Vec

#: What back ends in C take for no bound.
INFINITY = 1e30

#: How back ends end, in the words that they share; all other words mean FAILED.
_ENDS = {
    "solved": Status.SOLVED, "max iter": Status.MAX_ITERATIONS,
    "primal infeasible": Status.INFEASIBLE, "dual infeasible": Status.UNBOUNDED,
}  # fmt: skip


def ended(word: str) -> Status:
    """The status that a back end's word for its end means. An answer that is almost one is: the certificate judges it.

    Example:
        >>> ended("OSQP_PRIMAL_INFEASIBLE_INACCURATE").name, ended("AlmostSolved").name, ended("PIQP_UNSOLVED").name
        ('INFEASIBLE', 'SOLVED', 'FAILED')
    """
    said = re.sub("([a-z])([A-Z])", r"\1 \2", word).replace("_", " ").lower()
    core = re.fullmatch("(?:[a-z]+qp )?(?:almost )?(.*?)(?: inaccurate| reached|ations)?", said)
    return _ENDS.get(core[1] if core else "", Status.FAILED)


class KeptSession(Session):
    """A session around a workspace of its back end.

    The workspace is made at the first solve and updated after that. What it remembers can mislead (a warm start
    from another active set, the scaling of older data), so a failure is only believed from a fresh one, and so is an
    answer that is not certified.
    """

    def __init__(self, solver: Solver, shape: Shape) -> None:
        super().__init__(solver, shape)
        self.reset()
        self._data: Any = ()  # the problem in the back end's form
        self._remembers = False  # whether the last answer is that of a workspace with a past

    @abstractmethod
    def _write(self, qp: QP) -> bool:
        """Bring the data into the back end's form, ``_data``; whether the workspace still fits it."""

    @abstractmethod
    def _make(self, qp: QP) -> Any:
        """A new workspace holding the data, ``None`` where the back end refuses them."""

    @abstractmethod
    def _update(self, qp: QP, workspace: Any) -> None:
        """Put the data into the workspace."""

    @abstractmethod
    def _run(self, qp: QP, workspace: Any) -> Answer:
        """Solve what the workspace holds."""

    def _begin(self) -> None:
        """Forget which entries were ever other than zero."""

    @final
    def reset(self) -> None:
        self._workspace: Any = None
        self._begin()

    @final
    def _solve(self, qp: QP) -> Answer:
        start = perf_counter()
        fits = self._write(qp)
        build_time = perf_counter() - start
        answer = Answer.none(qp.shape, Status.FAILED)
        if self._workspace is not None and fits:
            self._update(qp, self._workspace)
            answer = self._run(qp, self._workspace)
        self._remembers = answer.status.ok
        if not answer.status.ok:
            self._workspace = self._make(qp)
            if self._workspace is not None:
                answer = self._run(qp, self._workspace)
        if not answer.status.ok:
            self._workspace = None
        if answer.status in (Status.INFEASIBLE, Status.UNBOUNDED):  # what it iterated on then is no answer
            answer = Answer.none(qp.shape, answer.status, answer.iterations)
        answer.build_time = build_time
        return answer

    def _improved(self, qp: QP, answer: Answer, proof: Certificate) -> tuple[Answer, Certificate]:
        answer, proof = super()._improved(qp, answer, proof)
        if not self._remembers or proof.within(self.solver.tolerance):
            return answer, proof
        self._workspace = None
        fresh = self._answered(qp)
        return super()._improved(qp, fresh, fresh.certificate(qp, self.solver.tolerance))


@final
class OneSided:
    """Rows and bounds as equations G₀ x = h₀ and inequalities G₁ x ≤ h₁: each finite side is one row.

    ``item`` and ``sign`` say which row or variable each row is, and from which side. Where lower and upper side are
    the same number, the row is an equation: two inequalities would have no interior, and multipliers without bound.
    """

    def __init__(self, qp: QP) -> None:
        n_rows, n_items = len(qp.lower), len(qp.lower) + qp.n
        self.kind = self._kind(*qp.sides)
        equal, above, below = ((self.kind & bit).nonzero()[0] for bit in (1, 2, 4))
        self.item: Index = np.concatenate([equal, above, below])
        self.sign: Vec = np.ones(len(self.item))
        self.sign[len(equal) + len(above) :] = -1.0
        self.n_equal = len(equal)
        self._n_rows, self._n_items, self._n_eq = n_rows, n_items, qp.n_eq

    @staticmethod
    def _kind(lower: Vec, upper: Vec) -> Index:
        """Bits: 1 an equation, 2 bounded above, 4 bounded below."""
        equal = lower == upper
        return np.asarray(np.where(equal, 1, 2 * np.isfinite(upper) + 4 * np.isfinite(lower)))

    def fits(self, qp: QP) -> bool:
        """Whether another problem of this shape has the same finite sides and equations."""
        return bool((self._kind(*qp.sides) == self.kind).all())

    def matrix(self, qp: QP) -> Mat:
        """[G₀; G₁]."""
        return np.concatenate([qp.matrix, np.eye(qp.n)])[self.item] * self.sign[:, None]

    def right_side(self, qp: QP) -> Vec:
        """[h₀; h₁]."""
        return np.asarray(np.where(self.sign > 0.0, qp.sides[1, self.item], -qp.sides[0, self.item]))

    def multipliers(self, dual: Vec) -> tuple[Vec, Vec, Vec]:
        """y, z and z_box from the multipliers of [G₀; G₁], those of G₁ not negative."""
        force = np.zeros(self._n_items)
        np.add.at(force, self.item, self.sign * dual)
        return force[: self._n_eq], force[self._n_eq : self._n_rows], force[self._n_rows :]


@final
class Pattern:
    """The entries of a matrix that were ever other than zero: sparse back ends keep their analysis of them."""

    def __init__(self, rows: int, columns: int) -> None:
        self._seen = np.zeros((rows, columns), dtype=bool)
        self._find()

    def _find(self) -> None:
        columns, self._rows = np.nonzero(self._seen.T)
        self._source = self._rows * self._seen.shape[1] + columns
        self._starts = np.concatenate([[0], np.cumsum(self._seen.sum(axis=0))])

    def covers(self, matrix: Mat) -> bool:
        """Whether all entries were seen before; those that were not are from now on."""
        new = (matrix != 0.0) & ~self._seen
        if not new.any():
            return True
        self._seen |= new
        self._find()
        return False

    def entries(self, matrix: Mat) -> Vec:
        """The values that are stored, column by column."""
        return np.asarray(matrix.ravel()[self._source])

    def sparse(self, matrix: Mat) -> csc_matrix:
        """The matrix in compressed columns, in memory of its own."""
        return csc_matrix((self.entries(matrix), self._rows, self._starts), shape=self._seen.shape)
