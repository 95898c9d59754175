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
from scipy.linalg.blas import dasum, daxpy, dgemm, dgemv, dsyrk, idamax
from scipy.linalg.lapack import dposv, dpotrs

from wbc.qp.certificate import Certificate
from wbc.qp.rows.pivoting import Pivoting
from wbc.qp.rows.problem import RowProblem
from wbc.qp.rows.solver import RowSolver
from wbc.qp.solver import Solution
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
                 "value", "value_slots")  # fmt: skip

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
        self.value_slots = p.value[items - k : items]


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
        self._Er = self._Ed = self._factor = np.zeros((0, 0))
        self._primal, self._wrong, self._rounding = np.inf, _NOTHING, 0.0
        self._foreign: Solution | None = None
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
        self._weak = not fits_dual(p)
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
        p = self.problem
        if p.version != self._version:
            self._read_weights()
        self._foreign = None
        if self._weak:
            return self._give_up()
        if p.n_u:
            self._B[:] = self._base_rows
            if dposv(self._Bu, self._X, 1, 1, 1)[2]:
                return self._give_up()
        self._place()
        for attempt in range(self.tries):
            self.iterations = attempt + 1
            failing_pivot = self._step()
            if failing_pivot:
                if not self._leave_out(failing_pivot):
                    break
                continue
            if self._verify() or (self.tolerance < self._primal <= _LITTLE and self._refined()):
                if attempt:
                    self.counts.repaired += 1
                else:
                    self.counts.first += 1
                return Status.SOLVED
            if not attempt:
                self._pivoting.restart()
            if not self._repair():
                break
        return self._give_up()

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

    def _refined(self) -> bool:
        """Where little is missing, once more with the residual: forces of long chains lose digits. Then verify."""
        p, now = self.problem, self._now
        if not len(now.E):
            return False
        residual = now.soft_to_slots.copy()
        residual[: p.n_soft] += self._give
        change = -dpotrs(self._factor, residual)[0]
        now.lam += change
        self._pull(change)
        self._read_rows()
        return self._verify()

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
        dual = gap = self._rounding = 0.0
        self._wrong = _NOTHING
        if len(self._items):
            dual = self._largest_wrong()
            if len(self._slot_rows):
                gap = p.unit * float(dasum(now.lam_slots * now.value_slots))
        if not (self._primal <= self.tolerance and dual <= self._rounding):  # NaN is not
            return False
        self.certificate = Certificate(max(self._primal, 0.0), max(dual * p.unit, 0.0), gap)
        return True

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
        """Ask DAQP; its active set is the next guess."""
        from wbc.qp.rows.standard import StandardSolver
        from wbc.qp.solvers import by_name

        self.counts.fallback += 1
        if self._fallback is None:
            self._fallback = StandardSolver(self.problem, by_name("daqp"))
        status: Status = self._fallback.solve()
        self.certificate, self.iterations = self._fallback.certificate, self._fallback.iterations
        self._foreign = self._fallback.solution
        if status.ok:
            items, side = self._fallback.active()
            if np.count_nonzero(items >= self.problem.n) <= self.problem.n_slots:
                self._work_on(items, side)
        else:
            self.reset()
        return status

    # ---- what explain() and the reports ask for
    def multipliers(self) -> tuple[Vec, Vec, Vec]:
        if self._foreign is not None:
            return self._foreign.y, self._foreign.z, self._foreign.z_box
        return multipliers_of(self.problem, self._items, self._now.lam)


def multipliers_of(problem: RowProblem, items: Index, lam: Vec) -> tuple[Vec, Vec, Vec]:
    """y, z and z_box of the standard form, from what the dual form found: λ of the soft rows, laws and held rows.

    ``items`` are the unknowns and rows held at a bound, rows in the order of their λ.
    """
    p, held = problem, items >= problem.n
    rows, pins = items[held] - p.first_row, items[~held]
    m0 = p.n_soft + p.n_law
    E = np.vstack([p.G[p.soft.start : p.n_rows], p.G[rows]])
    z, z_box, y = np.zeros(p.n_range), np.zeros(p.n), np.zeros(p.n_u + p.n_law)
    z[rows - p.range.start] = -p.unit * lam[m0:]
    y[p.n_u :] = -p.unit * lam[p.n_soft : m0]
    pull = p.metric * (p.x[p.n_u :] - p.centre) - E[:, p.n_u : p.n].T @ lam
    if p.n_u:
        # Stationarity in u determines the multipliers of the rows that were eliminated.
        B, push = p.G[: p.n_u, : p.n], E[:, : p.n_u].T @ lam
        forces = np.linalg.solve(B[:, : p.n_u].T, np.column_stack([push, p.regularisation * p.x[: p.n_u]]))
        pull += B[:, p.n_u :].T @ forces[:, 0]
        y[: p.n_u] = p.unit * forces[:, 0] - forces[:, 1]
    z_box[pins] = -p.unit * pull[pins - p.n_u] / p.scale[pins]
    return y, z, z_box


def write_compliance(problem: RowProblem, out: Vec) -> None:
    """How far each soft row gives way to a unit push, unit / w (n_soft,)."""
    np.divide(problem.unit, problem.weights, out=out, where=problem.weights > 0)
    out[problem.weights == 0] = _FREE


def fits_dual(problem: RowProblem) -> bool:
    """Whether the dual form is right and pays.

    It pays with fewer rows than unknowns, and as long as its products stay below what making the standard form costs.
    It needs on every unscaled y a cost well above the regularisation: the elimination of u leaves the regularisation
    of u out, which is a relative error of regularisation / cost.
    """
    cost = problem.metric[problem.scale[problem.n_u :] == 1.0] * problem.unit
    rows = problem.n_soft + problem.n_law
    pays = rows < problem.n_y or rows**2 * (rows / 3.0 + problem.n_y) < _PAYS
    return pays and float(cost.min(initial=np.inf)) >= 1e3 * problem.regularisation
