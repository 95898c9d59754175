"""The dual form: one Cholesky of the number of *rows*, none of the number of unknowns.

With u eliminated row by row (u = −X [y; 1], X = B_u⁻¹ [B_y | b]) every row becomes Eᵣ [y; 1]. The metric D is
diagonal, so a soft row is a law that gives way: with compliance C = 1/w, laws and active rows having C = 0,

    y = y₀ + D⁻¹ Eᵀ λ ,      (E D⁻¹ Eᵀ + C) λ = −(E y₀ + e)

where E holds the soft rows, the laws and the active rows. y₀ is the centre. An active bound of a variable costs
nothing: its entry of D⁻¹ becomes 0 and its y₀ the bound (a *pin*). An active row is copied into a *slot* behind the
laws, so that E is one contiguous block of G.

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
from scipy.linalg.blas import dgemm, dgemv, dsyrk
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
# Violations up to this may be what the linear system lost, and not a wrong guess.
_LITTLE = 1e-4


@final
class _Views:
    """Everything whose size depends on the number k of occupied slots, cut once for each k."""

    __slots__ = ("E", "Eu_T", "Ey_T", "G", "compliance", "lower", "over", "rows", "scaled", "slots", "soft", "under",
                 "upper", "value")  # fmt: skip

    def __init__(self, p: RowProblem, k: int) -> None:
        first, m = p.soft.start, p.n_soft + p.n_law + k
        last = first + m
        E = p.G[first:last]
        self.E = E
        self.Eu_T, self.Ey_T = E[:, : p.n_u].T, E[:, p.n_u :].T
        self.G = p.G[:last]
        self.slots = p.G[p.n_rows : p.n_rows + k]
        items = p.first_row + last
        self.value, self.lower, self.upper = p.value[:items], p.lower[:items], p.upper[:items]
        self.rows = p.value[p.first_row : items]
        self.soft = p.value[p.item(first) : p.item(first) + p.n_soft]
        self.over, self.under = np.zeros(items), np.zeros(items)
        self.scaled = np.zeros((p.n_y, m), order="F")
        self.compliance: Mat = np.zeros((m, m), order="F")


@final
class DualSolver(RowSolver):
    """Guess and verify on the rows. Needs a real diagonal cost on every y and fewer rows than unknowns to pay."""

    form = "dual"

    def __init__(self, problem: RowProblem, *, tolerance: float = 1e-8, tries: int = 3) -> None:
        super().__init__(problem)
        self.tolerance, self.tries = tolerance, tries
        p = problem
        self._views: dict[int, _Views] = {}
        self._y = p.value[p.n_u : p.n]
        self._y1 = p.value[p.n_u : p.n + 1]
        self._u = p.value[: p.n_u]
        # B in the order LAPACK wants, solved in place: [B_u | B_y b] becomes [· | X].
        self._B = np.zeros((p.n_u, p.n + 1), order="F")
        self._Bu, self._X = self._B[:, : p.n_u], self._B[:, p.n_u :]
        self._y0 = np.zeros(p.n_y + 1)
        self._y0[-1] = 1.0
        self._y0_y = self._y0[:-1]
        self._free_root = np.ones(p.n_y)  # 1/√D
        self._root = np.ones(p.n_y)  # the same, 0 at pins
        self._soft_compliance = np.ones(p.n_soft)
        self._give = np.zeros(p.n_soft)
        self._version, self._weak = -1, False
        self._pivoting = Pivoting()
        self._fallback: Any = None
        self._lam = np.zeros(0)
        self._Er = self._Es = self._factor = np.zeros((0, 0))
        self._foreign: Solution | None = None
        self.reset()

    def reset(self) -> None:
        self._work_on(np.zeros(0, np.intp), np.zeros(0))

    @property
    def active_count(self) -> int:
        return len(self._slot_rows) + len(self._pins)

    def working_set(self) -> tuple[Index, Vec]:
        items = np.concatenate([self._pins + self.problem.n_u, self._slot_items])
        return items, np.concatenate([self._pin_side, self._slot_side])

    def guess(self, items: Index, side: Vec) -> None:
        fits = (items < self.problem.n) | (np.cumsum(items >= self.problem.n) <= self.problem.n_slots)
        self._work_on(items[fits], side[fits])

    # ---- the working set
    def _work_on(self, items: Index, side: Vec) -> None:
        """Take these items as active: variables become pins, rows go into slots. side: +1 upper, −1 lower."""
        p = self.problem
        is_pin = items < p.n
        self._pins, self._pin_side = items[is_pin] - p.n_u, side[is_pin]
        self._slot_items, self._slot_side = items[~is_pin], side[~is_pin]
        self._slot_rows = self._slot_items - p.first_row
        self._pin_items = self._pins + p.n_u
        # Where the bound of each stands in ``p.bounds``, read as one vector.
        self._pin_bounds = self._pin_items + (self._pin_side > 0) * len(p.value)
        self._slot_bounds = self._slot_items + (self._slot_side > 0) * len(p.value)
        k = len(self._slot_rows)
        if k not in self._views:
            self._views[k] = _Views(p, k)
            self._write_compliance(self._views[k])
        self._now = self._views[k]
        self._root[:] = self._free_root
        self._root[self._pins] = 0.0
        self._active = bool(len(items))
        self._plain = not len(self._pins) and bool((self._free_root == 1.0).all())

    def _write_compliance(self, views: _Views) -> None:
        i = np.arange(self.problem.n_soft)
        views.compliance[i, i] = self._soft_compliance

    def _read_weights(self) -> None:
        p = self.problem
        write_compliance(p, self._soft_compliance)
        self._free_root[:] = 1.0 / np.sqrt(p.metric)
        for views in self._views.values():
            self._write_compliance(views)
        self._version = p.version
        self._weak = not fits_dual(p)
        self._work_on(np.concatenate([self._pin_items, self._slot_items]),
                      np.concatenate([self._pin_side, self._slot_side]))  # fmt: skip

    def _place(self) -> None:
        """Copy the active rows into their slots, shifted by their bound, and set y₀."""
        p = self.problem
        self._y0_y[:] = p.centre
        if len(self._pins):
            self._y0[self._pins] = p.bounds.take(self._pin_bounds)
        if len(self._slot_rows):
            slots = self._now.slots
            p.G.take(self._slot_rows, 0, slots, "clip")
            right = slots[:, p.n]
            right -= p.bounds.take(self._slot_bounds)

    # ---- one tick
    def solve(self) -> Status:
        p = self.problem
        if p.version != self._version:
            self._read_weights()
        self._foreign = None
        if self._weak:
            return self._give_up()
        self._place()
        self._pivoting.restart()
        if p.n_u:
            self._B[:] = p.G[: p.n_u]
            if dposv(self._Bu, self._X, 1, 1, 1)[2]:
                return self._give_up()
        for attempt in range(self.tries):
            self.iterations = attempt + 1
            info = self._step()
            if info:
                if not self._leave_out(info):
                    break
                continue
            if self._verify() or self._refined():
                if attempt:
                    self.counts.repaired += 1
                else:
                    self.counts.first += 1
                return Status.SOLVED
            if not self._repair():
                break
        return self._give_up()

    def _step(self) -> int:
        """Solve for the working set. Returns the index of a failing pivot, or 0."""
        p, now = self.problem, self._now
        if len(now.E):
            info = self._pull()
            if info:
                return info
        else:  # nothing pulls y away from y₀, and BLAS refuses empty matrices
            self._lam, self._Er = np.zeros(0), np.zeros((p.n_y + 1, 0))
            self._y[:] = self._y0_y
        self._follow()
        return 0

    def _follow(self) -> None:
        """u and all rows from y."""
        p = self.problem
        if p.n_u:
            dgemv(-1.0, self._X, self._y1, 0.0, self._u, 0, 1, 0, 1, 0, 1)
        np.dot(self._now.G, p.x1, self._now.rows)

    def _pull(self) -> int:
        """y from the multipliers of the rows; returns as :meth:`_step` does."""
        p, now = self.problem, self._now
        Er = dgemm(-1.0, self._X, now.Eu_T, 1.0, now.Ey_T, 1) if p.n_u else now.Ey_T
        E = Er[: p.n_y]
        Es = E if self._plain else np.multiply(E, self._root[:, None], now.scaled)
        K = dsyrk(1.0, Es, 1.0, now.compliance, 1)
        self._factor, lam, info = dposv(K, dgemv(-1.0, Er, self._y0, trans=1), 0, 1, 1)
        if info:
            return int(info)
        step = dgemv(1.0, Es, lam)
        if not self._plain:
            step *= self._root
        np.add(step, self._y0_y, self._y)
        self._lam, self._Er, self._Es = lam, Er, Es
        return 0

    def _refined(self) -> bool:
        """Where little is missing, once more with the residual: forces of long chains lose digits. Then verify."""
        p, now = self.problem, self._now
        if not len(now.E) or not now.over[now.over.argmax()] <= _LITTLE:
            return False
        first = p.item(p.soft.start)
        residual = p.value[first : first + len(now.E)].copy()
        residual[: p.n_soft] += self._give
        change, _ = dpotrs(self._factor, residual)
        step = dgemv(-1.0, self._Es, change)
        if not self._plain:
            step *= self._root
        self._lam -= change
        self._y += step
        self._follow()
        return self._verify()

    def _verify(self) -> bool:
        """All rows and bounds within tolerance in their own units, all multipliers of the right sign."""
        p, now = self.problem, self._now
        np.multiply(self._soft_compliance, self._lam[: p.n_soft], self._give)
        residual = now.soft
        residual += self._give  # zero at the solution of the linear system
        over, under = now.over, now.under
        np.subtract(now.value, now.upper, over)
        np.subtract(now.lower, now.value, under)
        np.maximum(over, under, out=over)
        residual -= self._give
        primal = float(over[over.argmax()])
        dual = gap = 0.0
        if self._active:
            dual = self._largest_wrong()
            slots = len(self._slot_rows)
            gap = p.unit * float(np.abs(self._lam[-slots:]).dot(np.abs(now.rows[-slots:]))) if slots else 0.0
        else:
            self._wrong, self._rounding = _NOTHING, 0.0
        if not primal <= self.tolerance or not dual <= self._rounding:
            return False
        self.certificate = Certificate(max(primal, 0.0), max(dual * p.unit, 0.0), gap)
        return True

    def _largest_wrong(self) -> float:
        """The largest pull the wrong way; what is rounding beside the multipliers is kept in ``_rounding``."""
        lam = self._lam
        self._wrong = wrong = self._wrong_signs()
        worst = float(wrong[wrong.argmax()])
        largest = max(worst, -float(wrong[wrong.argmin()]))
        if len(lam):
            largest = max(largest, float(lam[lam.argmax()]), -float(lam[lam.argmin()]))
        self._rounding = _ROUNDING * largest
        if worst > self._rounding:  # where both bounds are one value, either way is right
            p = self.problem
            items = np.concatenate([self._slot_items, self._pin_items])
            wrong[p.lower[items] == p.upper[items]] = 0.0
            worst = float(wrong[wrong.argmax()])
        return worst

    def _wrong_signs(self) -> Vec:
        """λ · side of each active row, then of each pin: positive means that it pulls the wrong way."""
        p = self.problem
        rows: Vec = self._lam[p.n_soft + p.n_law :] * self._slot_side
        if not len(self._pins):
            return rows
        gradient = self._pull_of_pins()
        gradient *= self._pin_side
        return np.concatenate([rows, gradient]) if len(rows) else gradient

    def _pull_of_pins(self) -> Vec:
        """D (y − c) − Eᵀλ at each pin: minus the multiplier of its bound."""
        p = self.problem
        gradient = self._y - p.centre
        gradient *= p.metric
        if len(self._lam):
            gradient -= dgemv(1.0, self._Er, self._lam)[: p.n_y]
        return gradient.take(self._pins)

    # ---- a wrong guess
    def _repair(self) -> bool:
        """Exchange wrong rows by block principal pivoting. False: nothing to exchange, or no room."""
        p, now = self.problem, self._now
        items = np.concatenate([self._slot_items, self._pin_items])
        side = np.concatenate([self._slot_side, self._pin_side])
        broken = now.over > self.tolerance
        broken[p.item(p.soft.start) :] = False
        broken[p.n : p.item(p.range.start)] = False
        keep = self._wrong <= self._rounding
        following = self._pivoting.exchanged(items, side, keep, broken, over=now.over, under=now.under)
        if following is None or int((following[0] >= p.n).sum()) > p.n_slots:
            return False
        self._work_on(*following)
        self._place()
        return True

    def _leave_out(self, pivot: int) -> bool:
        """A dependent active row shows as a failing pivot: drop it. False: a law is dependent."""
        slot = pivot - 1 - self.problem.n_soft - self.problem.n_law
        if slot < 0:
            return False
        items = np.concatenate([np.delete(self._slot_items, slot), self._pin_items])
        side = np.concatenate([np.delete(self._slot_side, slot), self._pin_side])
        self._work_on(items, side)
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
            if int((items >= self.problem.n).sum()) <= self.problem.n_slots:
                self._work_on(items, side)
        else:
            self.reset()
        return status

    # ---- what explain() and the reports ask for
    def multipliers(self) -> tuple[Vec, Vec, Vec]:
        if self._foreign is not None:
            return self._foreign.y, self._foreign.z, self._foreign.z_box
        return multipliers_of(self.problem, self.working_set()[0], self._lam)


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

    It needs fewer rows than unknowns, and on every unscaled y a cost well above the regularisation: the elimination
    of u leaves the regularisation of u out, which is a relative error of regularisation / cost.
    """
    cost = problem.metric[problem.scale[problem.n_u :] == 1.0] * problem.unit
    rows = problem.n_soft + problem.n_law
    return rows < problem.n_y and float(cost.min(initial=np.inf)) >= 1e3 * problem.regularisation
