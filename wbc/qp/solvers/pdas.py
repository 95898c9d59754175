"""Primal-dual active set: guess which rows hold with equality, solve once, let the certificate verify.

With the rows E of a guessed set and the pinned variables removed, the optimality conditions are linear:

    [H  Eᵀ] [x]   [−g]          H = L Lᵀ,  V = L⁻¹Eᵀ,  VᵀV λ = −(e + VᵀL⁻¹g),
    [E  0 ] [λ] = [ e]          x = −L⁻ᵀ(L⁻¹g + V λ)

From one tick of a controller to the next the active set rarely changes, so the last one is nearly always right and
a solve is one Cholesky factorisation. If the certificate refuses the answer, every violated row enters the set and
every row with a multiplier of the wrong sign leaves it (block principal pivoting), a few times while that helps;
after that DAQP answers, and its active set is the next guess.

Bergounioux, Ito, Kunisch: Primal-dual strategy for constrained optimal control problems, SIAM J. Control and
Optimization 37(4), 1999. Júdice, Pires: A block principal pivoting algorithm for large-scale strictly monotone
linear complementarity problems, Computers & Operations Research 21(5), 1994.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Self, final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import dsyrk, dtrsm, dtrsv
from scipy.linalg.lapack import dpotrf, dpotrs

from wbc import checks
from wbc.qp.certificate import Certificate
from wbc.qp.problem import QP, Shape, moderate
from wbc.qp.solver import Answer, Session, Solver
from wbc.qp.solvers.daqp_ import Daqp
from wbc.types import Index, Mat, Status, Vec

#: Multipliers below this share of the largest are rounding.
_ROUNDING = 1e-12


@final
@dataclass(frozen=True)
class Pdas(Solver):
    """Settings of the default solver, for a QP with a dense H (:func:`wbc.solve`).

    A weighted tick of a controller is solved from its rows (:mod:`wbc.qp.rows.core`), and reads none of these.

    Args:
        tries: guesses before DAQP is asked, the first included.
        accuracy: the certificate a guess must reach; ten or a hundred times finer than what is asked of an answer.
        refinements: steps of iterative refinement a guess may take.
        fallback: DAQP's settings.

    Raises:
        InvalidInput: a setting out of its range.

    Example:
        >>> from wbc.qp import QP
        >>> qp = QP([[1.0]], [-3.0], ub=[2.0])
        >>> session = Pdas().open(qp.shape)
        >>> session.solve(qp).x, session.solve(qp).x, session.counts
        (array([2.]), array([2.]), Counts(first=1, repaired=1, fallback=0))
    """

    name = "pdas"
    requires = ("daqp",)
    package = "daqp"

    tries: int = 3
    accuracy: float = 1e-8
    refinements: int = 3
    fallback: Daqp = field(default_factory=Daqp)

    def __post_init__(self) -> None:
        checks.number("tries", self.tries, low=1)
        checks.number("accuracy", self.accuracy, low=0.0, high=self.tolerance, strict=True)
        checks.number("refinements", self.refinements, low=0)

    def open(self, shape: Shape) -> PdasSession:
        self.require()
        return PdasSession(self, shape)

    def _stopping_at(self, tolerance: float) -> Self:
        return replace(self, accuracy=min(self.accuracy, tolerance), fallback=self.fallback.at(tolerance))


@final
class PdasSession(Session):
    """The active set between solves, and what came of the guesses in ``counts``."""

    def __init__(self, solver: Pdas, shape: Shape) -> None:
        super().__init__(solver, shape)
        self._settings = solver
        self._daqp = solver.fallback.open(shape)
        self._guessed = False
        self._kkt = _Kkt(shape)
        self.reset()

    def reset(self) -> None:
        self._hold(np.zeros(self.shape.n_in + self.shape.n))
        self._misses = 0  # wrong first guesses in a row
        self._daqp.reset()

    def _hold(self, side: Vec) -> None:
        """Take as active the two-sided rows and the variables whose ``side`` is −1 (lower) or 1 (upper)."""
        self._side = side
        self._kkt.hold(side)

    def unguarded(self, qp: QP) -> Answer:
        """A guess is nothing without the certificate: DAQP's word where it fails."""
        answer = self._solve(qp)
        proof = self._proof(qp, answer)
        return self._improve(qp, answer, proof) or answer

    def _solve(self, qp: QP) -> Answer:
        answer = None
        if self._misses < 2:  # an active set that keeps changing is not worth a guess; DAQP sees when it has settled
            self._misses += 1  # taken back when the certificate holds
            answer = self._guess(qp)
        self._guessed = answer is not None
        return answer if answer is not None else self._ask_daqp(qp)

    def _guess(self, qp: QP) -> Answer | None:
        """The minimum with the active rows and variables held; ``None`` where that is not one point."""
        with np.errstate(all="ignore"):  # a cost that is all but flat may overflow: then there is no guess
            answer = self._kkt.solve(qp, self._settings.refinements, 1e-2 * self._settings.accuracy)
        return answer if answer is not None and moderate(answer.x) else None

    def _improve(self, qp: QP, answer: Answer, proof: Certificate) -> Answer | None:
        if self._accurate(proof) and not (self._guessed and self._pulls(qp, answer).any()):
            if self._guessed:
                self.counts.first += 1
                self._misses = 0
            return None
        if self._guessed:
            before = self._side
            repaired = self._repair(qp, answer)
            if repaired is not None:
                self.counts.repaired += 1
                return repaired
            self._hold(before)
            answer = self._ask_daqp(qp)
            proof = self._proof(qp, answer)
            if self._accurate(proof):
                return answer
        return self._polished(qp, self._daqp._improve(qp, answer, proof) or answer)

    def _repair(self, qp: QP, answer: Answer) -> Answer | None:
        """Exchange all rows that are wrong until none is; ``None`` if that takes too many tries."""
        for tried in range(1, self._settings.tries):
            self._hold(self._exchange(qp, answer))
            guess = self._guess(qp)
            if guess is None:
                return None
            if self._accurate(self._proof(qp, guess)) and not self._pulls(qp, guess).any():
                guess.iterations = tried + 1
                return guess
            answer = guess
        return None

    def _exchange(self, qp: QP, answer: Answer) -> Vec:
        """The active set with what this answer violates, and without the rows that it pulls instead of pushes."""
        tolerance = 0.5 * self._settings.accuracy
        values = np.concatenate([qp.C.dot(answer.x), answer.x])
        over = values - np.concatenate([qp.cu, qp.ub])
        under = np.concatenate([qp.cl, qp.lb]) - values
        pulls = self._pulls(qp, answer)
        enters = (self._side == 0.0) & (np.maximum(over, under) > tolerance)
        return np.where(pulls, 0.0, np.where(enters, np.where(over > under, 1.0, -1.0), self._side))

    def _pulls(self, qp: QP, answer: Answer) -> NDArray[np.bool_]:
        """Active rows that pull where they may only push, to rounding: where the cost is all but flat a multiplier
        far below any tolerance still holds the answer a long way from the minimum."""
        forces = np.concatenate([answer.z, answer.z_box])
        largest = max(forces[forces.argmax()], -forces[forces.argmin()])
        pulls: NDArray[np.bool_] = self._side * forces < -_ROUNDING * largest
        if pulls.any():  # a row with one value may push either way
            pulls &= np.concatenate([qp.cl < qp.cu, qp.lb < qp.ub])
        return pulls

    def _proof(self, qp: QP, answer: Answer) -> Certificate:
        return answer.certificate(qp, self._settings.tolerance)

    def _accurate(self, proof: Certificate) -> bool:
        """Whether an answer is certified, and its residuals are as small as a factorisation leaves them."""
        return proof.within(self._settings.tolerance) and proof.residual <= self._settings.accuracy

    def _ask_daqp(self, qp: QP) -> Answer:
        """DAQP's answer; its active set is the next guess."""
        self.counts.fallback += 1
        answer = self._daqp._solve(qp)
        if not answer.status.ok:
            self._misses = 0  # nothing is learned: the last active set stays
            return answer
        side = _side(answer)
        if (side == self._side).all():
            self._misses = 0
        self._hold(side)
        return answer

    def _polished(self, qp: QP, answer: Answer) -> Answer:
        """The active set of this answer solved by ourselves, where that is more accurate."""
        if answer.status.ok:
            self._hold(_side(answer))
            polished = self._guess(qp)
            if (
                polished is not None
                and self._accurate(self._proof(qp, polished))
                and not self._pulls(qp, polished).any()
            ):
                return polished
        return answer


def _side(answer: Answer) -> Vec:
    """−1 where a row or variable is pushed up from its lower side, 1 where down from its upper, 0 elsewhere."""
    side: Vec = np.sign(np.concatenate([answer.z, answer.z_box]))
    return side


@final
class _Kkt:
    """The linear optimality conditions of an active set: indices kept between ticks, factors of this one."""

    def __init__(self, shape: Shape) -> None:
        self.shape = shape

    def hold(self, side: Vec) -> None:
        _, n_eq, n_in = self.shape
        self.rows: Index = side[:n_in].nonzero()[0]
        self.index: Index = np.concatenate([np.arange(n_eq), n_eq + self.rows])
        self.at_upper = np.concatenate([np.ones(n_eq), side[self.rows]]) > 0.0
        self.pins: Index = side[n_in:].nonzero()[0]
        self.pinned_high = side[n_in + self.pins] > 0.0
        self.gram: Mat = np.zeros((len(self.index), len(self.index)), order="F")

    def solve(self, qp: QP, refinements: int, precision: float) -> Answer | None:
        """The answer with everything held, ``None`` if H (its free part) or the rows do not determine it."""
        system = self._system(qp)
        if system is None:
            return None
        H, g, E, e = system
        if not self._factorise(H, E):
            return None
        x, force = self._step(g, e)
        for _ in range(refinements if len(e) else 0):
            missing = e - E.dot(x)
            if missing.dot(missing) <= precision * precision:
                break
            dx, dforce = self._step(H.dot(x) + g + force.dot(E), missing)
            x += dx
            force += dforce
        n, n_eq, n_in = self.shape
        z, z_box = np.zeros(n_in), np.zeros(n)
        if len(self.rows):
            z[self.rows] = force[n_eq:]
        if len(self.pins):
            gradient = qp.H.dot(x) + qp.g + force.dot(qp.matrix.take(self.index, 0))
            z_box[self.pins] = -gradient[self.pins]
        return Answer(Status.SOLVED, x, force[:n_eq], z, z_box, 1)

    def _system(self, qp: QP) -> tuple[Mat, Vec, Mat, Vec] | None:
        """H, g, E and e of what is held; ``None`` if it is held at a side that is gone."""
        n_eq, pins = self.shape.n_eq, self.pins
        # H is symmetric: its transpose is the same matrix in the order LAPACK wants.
        H, g, E, e = qp.H.T, qp.g, qp.matrix[:n_eq], qp.upper[:n_eq]
        if len(self.rows):
            E = qp.matrix.take(self.index, 0)
            e = np.where(self.at_upper, qp.upper.take(self.index), qp.lower.take(self.index))
            if not moderate(e):
                return None
        if len(pins):
            value = np.where(self.pinned_high, qp.ub.take(pins), qp.lb.take(pins))
            if not moderate(value):
                return None
            # A pinned variable gets a row and column of the identity, so that sizes stay.
            held = np.zeros(qp.n)
            held[pins] = value
            g = g + H.dot(held)
            g[pins] = -value
            e = e - E.dot(held)
            E = E.copy()
            E[:, pins] = 0.0
            H = H.copy(order="F")
            H[pins] = 0.0
            H[:, pins] = 0.0
            H[pins, pins] = 1.0
        return H, g, E, e

    def _factorise(self, H: Mat, E: Mat) -> bool:
        self.L, info = dpotrf(H, 1, 0)
        if info or not len(E):
            return not info
        self.V = dtrsm(1.0, self.L, E.T, 0, 1)
        gram = dsyrk(1.0, self.V, 0.0, self.gram, 1, 1, 1)
        self.R, info = dpotrf(gram, 1, 0)
        if info:
            # Dependent rows: a trace of compliance decides between equal multipliers, refinement takes its effect away.
            # A row whose variables are all pinned is zero, and its multiplier may be anything.
            diagonal = gram.diagonal()
            np.fill_diagonal(gram, np.where(diagonal > 0.0, (1.0 + 1e-11) * diagonal, 1.0))
            self.R, info = dpotrf(gram, 1, 0)
        return not info

    def _step(self, g: Vec, e: Vec) -> tuple[Vec, Vec]:
        """x and λ of  H x + Eᵀλ = −g,  E x = e."""
        y = dtrsv(self.L, g, 1, 0, 1)
        if not len(e):
            return -dtrsv(self.L, y, 1, 0, 1, 1), np.zeros(0)
        force, _ = dpotrs(self.R, -e - y.dot(self.V), 1)
        y += self.V.dot(force)
        return -dtrsv(self.L, y, 1, 0, 1, 1), force
