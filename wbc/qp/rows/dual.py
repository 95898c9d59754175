"""The dual form: one Cholesky of the number of *rows*, none of the number of unknowns.

With u eliminated row by row (u = −X [y; 1], X = B_u⁻¹ [B_y | b]) every row becomes Eᵣ [y; 1]. The metric D is
diagonal, so a soft row is a law that gives way: with compliance C = 1/w, laws and active rows having C = 0,

    y = y₀ + D⁻¹ Eᵀ λ ,      (E D⁻¹ Eᵀ + C) λ = −(E y₀ + e)

where E holds the soft rows, the laws and the active rows. y₀ is the centre. The right side is what the rows come to at
y₀, and D⁻¹ Eᵀ λ is added in place: a refinement is the same step once more, from where the first one ended. An active
bound of a variable costs nothing: its entry of D⁻¹ becomes 0 and its y₀ the bound (a *pin*). An active row is copied
into a *slot* behind the laws, so that E is one contiguous block of G.

The working set of the last tick is a guess. It is verified: one product G x̂ gives every row, one comparison the
largest violation, and the multipliers their signs. A wrong guess is repaired by block principal pivoting (Júdice and
Pires, 1994): all wrong rows are exchanged at once while their number falls, three more times if it does not, and one
at a time after that. A few tries cost as much as one call of DAQP, so what three do not settle goes to DAQP, whose
answer gives the next guess: no tick takes much longer than the two together.

Signs: here D (y − c) = Eᵀλ, so the multiplier of the standard form is −λ.
"""

from __future__ import annotations

from typing import Any, final

import numpy as np
from scipy.linalg.blas import daxpy, dgemm, dgemv, dsyrk, idamax
from scipy.linalg.lapack import dposv, dpotrs

from wbc.qp.rows.pivoting import Pivoting
from wbc.qp.rows.problem import RowProblem
from wbc.qp.rows.proof import RowProof
from wbc.qp.rows.solver import RowSolver
from wbc.types import Index, Mat, Status, Vec

# A soft row of weight zero: so compliant that it pushes on nothing.
_FREE = 1e30
# Multipliers below this share of the largest are rounding. A larger one of the wrong sign, however small, may hold the
# answer a long way from the minimum where the cost is all but flat.
_ROUNDING = 1e-12
_NOTHING = np.zeros(0)
# Products of numbers that take as long as making the standard form and handing it to DAQP does.
_PAYS = 1e6
# Violations up to this may be what the linear system lost, and not a wrong guess.
_LITTLE = 1e-4


@final
class _Views:
    """Everything whose size depends on the number k of occupied slots, cut once for each k."""

    __slots__ = ("E", "E_T", "Ed", "Eu_T", "Ey_T", "G_T", "beyond", "bounded", "compliance", "lam", "lam_slots",
                 "lam_soft", "lower", "over", "rows", "slots", "slots_right", "soft", "soft_to_slots", "under", "upper",
                 "value")  # fmt: skip

    def __init__(self, p: RowProblem, k: int) -> None:
        first, m = p.soft.start, p.n_soft + p.n_law + k
        last = first + m
        self.E = E = p.G[first:last]
        self.E_T, self.Eu_T, self.Ey_T = E.T, E[:, : p.n_u].T, E[:, p.n_u : p.n].T
        self.Ed = np.zeros((p.n_y, m), order="F")
        self.compliance: Mat = np.zeros((m, m), order="F")
        self.lam = np.zeros(m)
        self.lam_soft, self.lam_slots = self.lam[: p.n_soft], self.lam[m - k :]
        self.G_T = p.G[:last].T
        self.slots = p.G[p.n_rows : p.n_rows + k]
        self.slots_right = self.slots[:, p.n]
        items, soft = p.first_row + last, p.item(first)
        self.value, self.lower, self.upper = p.value[:items], p.lower[:items], p.upper[:items]
        self.beyond = np.zeros(2 * items)
        self.over, self.under = self.beyond[:items], self.beyond[items:]
        self.bounded = np.zeros(items, dtype=bool)  # what may be held at a bound: y and the range rows
        self.bounded[p.n_u : p.n] = self.bounded[p.item(p.range.start) : soft] = True
        self.rows = p.value[p.first_row : items]
        self.soft, self.soft_to_slots = p.value[soft : soft + p.n_soft], p.value[soft:items]


@final
class DualSolver(RowSolver):
    """Guess and verify on the rows. Needs a real diagonal cost on every y and fewer rows than unknowns to pay."""

    form = "dual"

    def __init__(self, problem: RowProblem, *, tolerance: float = 1e-8, tries: int = 3) -> None:
        super().__init__(problem)
        self.tolerance, self.tries = tolerance, tries
        p = problem
        self._views: dict[int, _Views] = {}
        self._u, self._y, self._y1 = p.value[: p.n_u], p.value[p.n_u : p.n], p.value[p.n_u : p.n + 1]
        self._bounds = p.bounds.reshape(-1)
        # B in the order LAPACK wants, solved in place: [B_u | B_y b] becomes [· | X].
        self._base_rows, self._B = p.G[: p.n_u], np.zeros((p.n_u, p.n + 1), order="F")
        self._Bu, self._X, self._Xy = self._B[:, : p.n_u], self._B[:, p.n_u :], self._B[:, p.n_u : p.n]
        self._free_root = np.ones(p.n_y)  # 1/√D
        self._root = np.ones(p.n_y)  # the same, 0 at pins
        self._root_column = self._root[:, None]
        self._soft_compliance, self._give = np.ones(p.n_soft), np.zeros(p.n_soft)
        self._version, self._weak, self._uniform, self._pinned = -1, False, True, False
        self._pivoting = Pivoting()
        self._fallback: Any = None
        self._foreign = False  # whether the last answer is the fallback's
        self._Er = self._Ed = self._factor = np.zeros((0, 0))
        self._primal, self._wrong, self._rounding = np.inf, _NOTHING, 0.0
        self.proof, self._push, self._pushed = RowProof(problem), np.zeros(p.n_rows), np.zeros(0, np.intp)
        self.reset()

    def reset(self) -> None:
        self._work_on(np.zeros(0, np.intp), np.zeros(0))

    @property
    def active_count(self) -> int:
        return len(self._items)

    def working_set(self) -> tuple[Index, Vec]:
        return self._items, self._side

    def guess(self, items: Index, side: Vec) -> None:
        fits = (items < self.problem.n) | (np.cumsum(items >= self.problem.n) <= self.problem.n_slots)
        self._work_on(items[fits], side[fits])

    # ---- the working set
    def _work_on(self, items: Index, side: Vec) -> None:
        """Take these items as active: rows go into slots, variables become pins. side: +1 upper, −1 lower."""
        p = self.problem
        is_row = items >= p.n
        k = int(np.count_nonzero(is_row))
        if k < len(items):  # rows first
            order = np.argsort(~is_row, kind="stable")
            items, side = items[order], side[order]
        self._items, self._side = items, side
        self._slot_rows, self._slot_side = items[:k] - p.first_row, side[:k]
        self._pins, self._pin_side = items[k:] - p.n_u, side[k:]
        # Where the bound of each stands among all lower and then all upper ones.
        bounds = items + (side > 0) * len(p.value)
        self._slot_bounds, self._pin_bounds = bounds[:k], bounds[k:]
        if k not in self._views:
            self._views[k] = _Views(p, k)
            self._write_compliance(self._views[k])
        self._now = self._views[k]
        if len(self._pins) or self._pinned:
            self._root[:] = self._free_root
            self._root[self._pins] = 0.0
        self._pinned = bool(len(self._pins))

    def _write_compliance(self, views: _Views) -> None:
        i = np.arange(self.problem.n_soft)
        views.compliance[i, i] = self._soft_compliance

    def _read_weights(self) -> None:
        p = self.problem
        write_compliance(p, self._soft_compliance)
        self._free_root[:] = 1.0 / np.sqrt(p.metric)
        self._pinned = True  # have the roots copied
        self._uniform = bool((self._free_root == 1.0).all())
        for views in self._views.values():
            self._write_compliance(views)
        self._version = p.version
        self._weak = not has_real_cost(p)
        self._work_on(self._items, self._side)

    def _place(self) -> None:
        """y = y₀, and the active rows in their slots, shifted by their bound."""
        p, now = self.problem, self._now
        self._y[:] = p.centre
        if self._pinned:
            self._y[self._pins] = self._bounds[self._pin_bounds]
        if len(self._slot_rows):
            p.G.take(self._slot_rows, 0, now.slots, "clip")
            now.slots_right -= self._bounds[self._slot_bounds]

    # ---- one tick
    def solve(self) -> Status:
        return Status.SOLVED if self._guessed() else self._give_up()

    def settle(self, items: Index, side: Vec) -> bool:
        """Whether the answer follows from this working set, which is repaired a few times; no other solver is asked."""
        self.guess(items, side)
        return self._guessed()

    def _guessed(self) -> bool:
        """Guess, verify, repair; the answer and its certificate are there where this is True."""
        p = self.problem
        if p.version != self._version:
            self._read_weights()
        self._foreign = False
        if self._weak:
            return False
        if p.n_u:
            self._B[:] = self._base_rows
            if dposv(self._Bu, self._X, 1, 1, 1)[2]:
                return False
        self._place()
        for attempt in range(self.tries):
            self.iterations = attempt + 1
            failing_pivot = self._step()
            if failing_pivot:
                if not self._leave_out(failing_pivot):
                    break
                continue
            if self._verified():
                self.counts.repaired += attempt > 0
                self.counts.first += attempt == 0
                return True
            if not attempt:
                self._pivoting.restart()
            if not self._repair():
                break
        return False

    def _verified(self) -> bool:
        """The working set is right and the answer certified, at once or after a step of refinement."""
        if self._verify():
            return self._certified() or self._refined(self.proof.left)
        return self.tolerance < self._primal <= _LITTLE and self._refined(None)

    def _certified(self) -> bool:
        """Prove the answer from the rows, with what this working set pushes with."""
        p, lam, push = self.problem, self._now.lam, self._push
        if len(self._pushed):
            push[self._pushed] = 0.0
        np.negative(lam[: p.n_soft + p.n_law], push[p.soft.start :])
        if len(self._slot_rows):
            self._pushed = self._slot_rows
            push[self._pushed] = -self._now.lam_slots
        self.certificate = self.proof.certify(push, factor=self._Bu if p.n_u else None)
        return self.certificate.ok

    def _step(self) -> int:
        """From y₀ to the answer for the working set. Returns the index of a failing pivot, or 0."""
        p, now = self.problem, self._now
        if p.n_u:
            dgemv(-1.0, self._X, self._y1, 0.0, self._u, 0, 1, 0, 1, 0, 1)  # u = −X [y; 1]
        if len(now.E):  # BLAS refuses empty matrices
            self._Er = Er = dgemm(-1.0, self._Xy, now.Eu_T, 1.0, now.Ey_T, 1) if p.n_u else now.Ey_T
            self._Ed = now.Ed
            if self._pinned or not self._uniform:
                np.multiply(Er, self._root_column, now.Ed)
            elif p.n_u:
                self._Ed = Er
            else:
                now.Ed[:] = Er  # in one piece, as BLAS wants it
            K = dsyrk(1.0, self._Ed, 1.0, now.compliance, 1)
            dgemv(-1.0, now.E_T, p.x1, 0.0, now.lam, 0, 1, 0, 1, 1, 1)  # the right side, in place
            self._factor, _, info = dposv(K, now.lam, 0, 1, 1)
            if info:
                return int(info)
            self._pull(now.lam)
        self._read_rows()
        return 0

    def _pull(self, lam: Vec) -> None:
        """y += D⁻¹ Eᵀ λ, and u with it."""
        if self._uniform:
            dgemv(1.0, self._Ed, lam, 1.0, self._y, 0, 1, 0, 1, 0, 1)
        else:
            self._y += dgemv(1.0, self._Ed, lam) * self._root
        if self.problem.n_u:
            dgemv(-1.0, self._X, self._y1, 0.0, self._u, 0, 1, 0, 1, 0, 1)

    def _read_rows(self) -> None:
        """All rows, G x̂, into the vector of values."""
        now = self._now
        dgemv(1.0, now.G_T, self.problem.x1, 0.0, now.rows, 0, 1, 0, 1, 1, 1)

    def _refined(self, left: Vec | None) -> bool:
        """Once more with the residual: forces of long chains lose digits. Then verify.

        ``left`` (n_y,) is what is left of the gradient; it has the regularisation of u, which the elimination left out.
        """
        p, now, root = self.problem, self._now, self._root
        if left is not None:
            self._y -= root * root * left
        if len(now.E):
            residual = now.soft_to_slots.copy()
            residual[: p.n_soft] += self._give
            if left is not None:
                residual -= dgemv(1.0, self._Ed, root * left, trans=1)
            change = -dpotrs(self._factor, residual)[0]
            now.lam += change
            self._pull(change)
        elif p.n_u:
            dgemv(-1.0, self._X, self._y1, 0.0, self._u, 0, 1, 0, 1, 0, 1)
        self._read_rows()
        return self._verify() and self._certified()

    def _verify(self) -> bool:
        """All rows and bounds within tolerance in their own units, all multipliers of the right sign."""
        p, now, give = self.problem, self._now, self._give
        # A soft row gives way: at the solution of the linear system its residual and C λ add up to zero.
        if p.n_soft:  # BLAS refuses empty vectors
            np.multiply(self._soft_compliance, now.lam_soft, give)
            daxpy(give, now.soft)
        np.subtract(now.value, now.upper, now.over)
        np.subtract(now.lower, now.value, now.under)
        if p.n_soft:
            daxpy(give, now.soft, p.n_soft, -1.0)
        beyond = now.beyond
        self._primal = beyond.item(beyond.argmax())
        pull = self._rounding = 0.0
        self._wrong = _NOTHING
        if len(self._items):
            pull = self._largest_wrong()
        return self._primal <= self.tolerance and pull <= self._rounding  # NaN is not

    def _largest_wrong(self) -> float:
        """The largest pull the wrong way; what is rounding beside the multipliers is kept in ``_rounding``."""
        self._wrong = wrong = self._wrong_signs()
        worst = float(wrong[wrong.argmax()])
        self._rounding = 0.0
        if not worst <= 0.0:
            lam = self._now.lam
            largest = abs(wrong[idamax(wrong)])
            if len(lam):
                largest = max(largest, abs(lam[idamax(lam)]))
            self._rounding = _ROUNDING * float(largest)
            if worst > self._rounding:  # where both bounds are one value, either way is right
                p = self.problem
                wrong[p.lower[self._items] == p.upper[self._items]] = 0.0
                worst = float(wrong[wrong.argmax()])
        return worst

    def _wrong_signs(self) -> Vec:
        """λ · side of each active row, then of each pin: positive means that it pulls the wrong way."""
        rows: Vec = self._now.lam_slots * self._slot_side
        if not self._pinned:
            return rows
        gradient = self._pull_of_pins()
        gradient *= self._pin_side
        return np.concatenate([rows, gradient]) if len(rows) else gradient

    def _pull_of_pins(self) -> Vec:
        """D (y − c) − Eᵀλ at each pin: minus the multiplier of its bound."""
        p, lam = self.problem, self._now.lam
        gradient = self._y - p.centre
        gradient *= p.metric
        if len(lam):
            gradient -= dgemv(1.0, self._Er, lam)
        return gradient.take(self._pins)

    # ---- a wrong guess
    def _repair(self) -> bool:
        """Exchange wrong rows by block principal pivoting. False: nothing to exchange, or no room."""
        p, now, over, under = self.problem, self._now, self._now.over, self._now.under
        broken = np.maximum(over, under) > self.tolerance
        broken &= now.bounded
        keep = self._wrong <= self._rounding
        following = self._pivoting.exchanged(self._items, self._side, keep, broken, over=over, under=under)
        if following is None or np.count_nonzero(following[0] >= p.n) > p.n_slots:
            return False
        self._work_on(*following)
        self._place()
        return True

    def _leave_out(self, pivot: int) -> bool:
        """A dependent active row shows as a failing pivot: drop it. False: a law is dependent."""
        slot = pivot - 1 - self.problem.n_soft - self.problem.n_law
        if slot < 0:
            return False
        self._work_on(np.delete(self._items, slot), np.delete(self._side, slot))
        self._place()
        return True

    def _give_up(self) -> Status:
        """Ask DAQP. Its active set is settled here, and is the next guess."""
        from wbc.qp.rows.standard import StandardSolver
        from wbc.qp.solvers import by_name

        self.counts.fallback += 1
        if self._fallback is None:
            self._fallback = StandardSolver(self.problem, by_name("daqp"), settler=None if self._weak else self)
        status: Status = self._fallback.solve()
        self.certificate, self.iterations = self._fallback.certificate, self._fallback.iterations
        self._foreign = status.ok and not self._fallback.is_settled
        if not status.ok:
            self.reset()
        elif not self._fallback.is_settled:
            self.guess(*self._fallback.active())
        return status

    # ---- what explain() and the reports ask for
    def multipliers(self) -> tuple[Vec, Vec, Vec]:
        return self._fallback.multipliers() if self._foreign else self.proof.multipliers()


def write_compliance(problem: RowProblem, out: Vec) -> None:
    """How far each soft row gives way to a unit push, unit / w (n_soft,)."""
    np.divide(problem.unit, problem.weights, out=out, where=problem.weights > 0)
    out[problem.weights == 0] = _FREE


def fits_dual(problem: RowProblem) -> bool:
    """Whether the dual form is right and pays.

    It pays with fewer rows than unknowns, and as long as its products stay below what making the standard form costs.
    """
    rows = problem.n_soft + problem.n_law
    pays = rows < problem.n_y or rows**2 * (rows / 3.0 + problem.n_y) < _PAYS
    return pays and has_real_cost(problem)


def has_real_cost(problem: RowProblem) -> bool:
    """Whether every unscaled y costs far more than the regularisation of u, which the elimination of u leaves out.

    It is a relative error of regularisation / cost; without u there is none.
    """
    cost = problem.metric[problem.scale[problem.n_u :] == 1.0] * problem.unit
    return not problem.n_u or float(cost.min(initial=np.inf)) >= 1e3 * problem.regularisation
