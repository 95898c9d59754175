"""Stages in the dual form: one Cholesky of the number of rows for each, and the base is eliminated once for all.

With u eliminated, and E the rows of stage k, of the stages above it, the laws and the active rows (see
:mod:`wbc.qp.rows.dual`, whose notation this is),

    (E D⁻¹ Eᵀ + C + R) λ = −(E y + e) ,      y ← y + D⁻¹ Eᵀ λ

C is the compliance of the last stage's own rows, which are weighed against the metric; nothing else gives way. R is a
trace that makes the matrix definite, and repeating the step takes its effect away:

* on rows that hold exactly R is 1e-11 of the diagonal. It decides between equal multipliers where rows depend on each
  other, as they must where a stage was not met: its gradient is a combination of what held it back.
* on the rows of a stage above the last R is δ κ w_max / wᵢ. The step is then the method of multipliers on equations
  that may contradict each other: y converges to the least squares ½ Σ wᵢ rᵢ², by a factor δ per step, and λ to what is
  left of r in units of R; the rows that hold push against it, so R takes effect there on what changes only (Spingarn, Numerische Mathematik 1987: proximal steps to least-squares solutions).

The working set is guessed, verified and repaired as in the dual form. What pushed while a stage above was decided stays
held, and may push either way from then on; else a lower stage could leave the set where the stage above is best.
"""

from __future__ import annotations

from typing import final

import numpy as np
from scipy.linalg.blas import dgemm, dgemv, dsyrk
from scipy.linalg.lapack import dposv, dpotrf, dpotrs

from wbc.qp.certificate import Certificate
from wbc.qp.lexicographic.stages import MET, StagedProblem
from wbc.qp.lexicographic.standard import StandardStages
from wbc.qp.lexicographic.way import Way
from wbc.qp.solver import Counts
from wbc.qp.solvers import by_name
from wbc.types import Index, Mat, Status, Vec

#: R on rows that hold, and δ: on the rows of a stage above the last.
_TRACE, _DELTA = 1e-11, 1e-6
#: Steps after the first at a stage above the last, and what a residual may still change by in the last of them.
_LEAST, _MOST, _SETTLED = 2, 12, 1e-4
#: Multipliers below this share of the largest are rounding: in the last stage, and above it. There it is also what a
#: residual of this size makes; and above the third number a multiplier pushes.
_ROUNDING, _NOTHING, _PUSHES = 1e-12, 1e-9, 1e-7
#: A soft row of weight zero: so compliant that it pushes on nothing.
_FREE = 1e30
_NONE: Index = np.zeros(0, np.intp)


@final
class DualStages(Way):
    """Guess and verify on the rows, stage by stage. ``tries`` guesses a stage before DAQP is asked."""

    form = "dual"

    def __init__(self, staged: StagedProblem, *, tolerance: float = 1e-8, tries: int = 3) -> None:
        self.staged, self.tolerance, self.tries = staged, tolerance, tries
        self.counts, self.iterations = Counts(), 0
        self.problem = p = staged.problem
        self._first, self._m = p.soft.start, p.n_soft + p.n_law
        width = self._m + p.n_slots
        self._Er: Mat = np.zeros((p.n_y + 1, width), order="F")
        self._Es: Mat = np.zeros((p.n_y, width), order="F")
        self._y, self._u = p.value[p.n_u : p.n], p.value[: p.n_u]
        self._y1 = p.value[p.n_u : p.n + 1]
        self._Bu, self._By = p.G[: p.n_u, : p.n_u], p.G[: p.n_u, p.n_u :]
        self._X: Mat = np.zeros((p.n_u, p.n_y + 1))
        self._free_root, self._root = np.ones(p.n_y), np.ones(p.n_y)
        self._bounded = p.item(self._first)
        self._over, self._under = np.zeros(self._bounded), np.zeros(self._bounded)
        self._version = -1
        #: Working set of each stage in the last tick: items, and on which side.
        self._memory = [(_NONE, np.zeros(0)) for _ in staged.stages]
        self._asked: StandardStages | None = None
        self._foreign: StandardStages | None = None  # whose answer it is, where it is not our own
        self._trace_of: list[Vec] = []
        self.begin_over()

    def begin_over(self) -> None:
        self._memory = [(_NONE, np.zeros(0)) for _ in self._memory]

    # ---- one tick
    def begin(self) -> bool:
        p, m = self.problem, self._m
        if p.version != self._version:
            self._read_weights()
        self._held, self._held_at = _NONE, np.zeros(0)
        self._wrong = self._lam = self._scale = np.zeros(0)
        if p.n_u:
            _, self._X, info = dposv(self._Bu, self._By, 1)
            if info:
                return False
        self._Er[:, :m] = self._reduced(p.G[self._first : p.n_rows])
        return True

    def _read_weights(self) -> None:
        p = self.problem
        self._free_root[:] = 1.0 / np.sqrt(p.metric)
        self._compliance = np.divide(p.unit, p.weights, out=np.full(p.n_soft, _FREE), where=p.weights > 0)
        self._trace_of = [
            np.divide(weights.max(initial=0.0), weights, out=np.full(len(weights), _FREE), where=weights > 0)
            for weights in self.staged.weights
        ]
        self._version = p.version

    def _reduced(self, rows: Mat) -> Mat:
        """E_y − E_u X of some rows, transposed."""
        n_u = self.problem.n_u
        reduced: Mat = dgemm(-1.0, self._X, rows[:, :n_u].T, 1.0, rows[:, n_u:].T, 1) if n_u else rows.T
        return reduced

    def solve(self, k: int, *, sure: bool) -> Status:
        self._k, self._last = k, k == len(self.staged.stages) - 1
        self._foreign = None
        self._column = self.staged.rows[k].start - self._first
        self._work_on(*self._memory[k])
        self._fewest, self._chances = 1 << 30, 3
        for attempt in range(self.tries):
            self.iterations += 1
            if self._decide() and self._verify():
                self._count(attempt)
                return Status.SOLVED
            if not self._repair():
                break
        return self._ask(k) if sure else Status.FAILED

    def _count(self, attempt: int) -> None:
        if attempt:
            self.counts.repaired += 1
        else:
            self.counts.first += 1
        self._memory[self._k] = self._items[len(self._held) :], self._side[len(self._held) :]

    # ---- the working set: first what is held from the stages above, then what is guessed
    def _work_on(self, items: Index, side: Vec) -> None:
        p = self.problem
        if len(self._held):
            new = ~np.isin(items, self._held)
            items, side = np.concatenate([self._held, items[new]]), np.concatenate([np.ones(len(self._held)), side[new]])
        value = np.where(side > 0, p.upper[items], p.lower[items])
        value[: len(self._held)] = self._held_at
        keep = np.isfinite(value)
        if not keep.all():
            items, side, value = items[keep], side[keep], value[keep]
        pin = items < p.n
        if len(items) - int(pin.sum()) > p.n_slots:
            items, side, value, pin = self._held, np.ones(len(self._held)), self._held_at, self._held < p.n
        self._items, self._side, self._is_pin = items, side, pin
        self._pins, self._slots = items[pin] - p.n_u, items[~pin] - p.first_row
        self._root[:] = self._free_root
        self._root[self._pins] = 0.0
        self._pinned_at = value[pin]
        self._stop = self._m + len(self._slots)
        if len(self._slots):
            slots = p.G[p.n_rows : p.n_rows + len(self._slots)]
            p.G.take(self._slots, 0, slots, "clip")
            slots[:, p.n] -= value[~pin]
            self._Er[:, self._m : self._stop] = self._reduced(slots)

    # ---- the linear system
    def _decide(self) -> bool:
        """y and λ for the working set; False where there is none."""
        p = self.problem
        self._y[:] = p.centre
        self._y[self._pins] = self._pinned_at
        self._Ek = self._Er[:, self._column : self._stop]
        if self._column == self._stop:
            self._lam = self._scale = np.zeros(0)
            self._values()
            return True
        self._wrong = np.zeros(0)
        if not self._factorise():
            return False
        missing = dgemv(1.0, self._Ek, self._y1, 0.0, trans=1)
        self._lam, self._move = self._step(missing)
        self._scale = self._lam
        self._y += self._move
        self._values()
        if self._last:
            self._refine_last()
        else:
            self._refine(missing)
        return True

    def _factorise(self) -> bool:
        size = self._stop - self._column
        self._E = np.multiply(self._Ek[:-1], self._root[:, None], self._Es[:, :size])
        K = dsyrk(1.0, self._E, trans=1)
        diagonal = np.einsum("ii->i", K)
        own = self.staged.rows[self._k]
        wished = own.stop - own.start
        largest = float(diagonal[diagonal.argmax()])
        if self._last:
            diagonal[:wished] += self._compliance
        elif wished:
            steepest = float(diagonal[diagonal[:wished].argmax()])
            self._give = _DELTA * (steepest or 1.0) * self._trace_of[self._k]
            diagonal[:wished] += self._give
        diagonal[wished:] *= 1.0 + _TRACE
        diagonal += 1e-3 * _TRACE * largest
        self._L, info = dpotrf(K, 0, 0, 1)
        return not info

    def _step(self, missing: Vec) -> tuple[Vec, Vec]:
        """λ that takes away what is missing, and how it moves y."""
        lam, _ = dpotrs(self._L, missing)
        np.negative(lam, lam)
        move = dgemv(1.0, self._E, lam)
        move *= self._root
        return lam, move

    def _values(self) -> None:
        """u and all rows from y."""
        p = self.problem
        if p.n_u:
            dgemv(-1.0, self._X, self._y1, 0.0, self._u, 0, 1, 0, 1, 0, 1)
        rows = p.n_rows + len(self._slots)
        np.dot(p.G[:rows], p.x1, p.value[p.first_row : p.first_row + rows])
        self._missing = p.value[p.first_row + self._first + self._column : p.first_row + rows]

    def _refine(self, before: Vec) -> None:
        """The same step again: towards the least squares, and onto the rows that hold.

        λ is large where a stage is not met, and what it moves cancels. So only its change is computed: with rows r
        before and r' after a step that moved y by m, E m = r' − r, and K λ = E m says what the step was meant to do.
        """
        wished = self._wished
        for step in range(_MOST):
            missing = self._missing.copy()
            if step >= _LEAST and _largest(missing[wished:]) <= 0.1 * self.tolerance:
                left = _largest(missing[:wished])
                if _largest(missing[:wished] - before[:wished]) <= max(_SETTLED * left, 1e-2 * MET):
                    break
            off = 2.0 * missing - before
            off[:wished] += self._give * self._lam[:wished]
            change, move = self._step(off)
            before = missing
            self._lam, self._move = self._lam + change, self._move + move
            self._y += self._move
            self._values()

    def _refine_last(self) -> None:
        """The same for the last stage, whose own rows give way by their compliance."""
        n_soft = self.problem.n_soft
        for _ in range(_MOST):
            missing = self._missing.copy()
            missing[:n_soft] += self._compliance * self._lam[:n_soft]
            if not _largest(missing) > 0.1 * self.tolerance:
                break
            change, move = self._step(missing)
            self._lam = self._lam + change
            self._y += move
            self._values()

    # ---- is it the answer?
    def _verify(self) -> bool:
        p, n = self.problem, self._bounded
        over, under = self._over, self._under
        np.subtract(p.value[:n], p.upper[:n], over)
        np.subtract(p.lower[:n], p.value[:n], under)
        np.maximum(over, under, out=over)
        held = self._missing[self._wished :]
        if self._last:  # its own rows must balance, too
            held = self._missing.copy()
            held[: p.n_soft] += self._compliance * self._lam[: p.n_soft]
        self._primal = max(float(over[over.argmax()]), _largest(held))
        self._wrong = self._wrong_signs()
        if not self._primal <= self.tolerance:
            return False
        return not len(self._wrong) or bool(self._wrong[self._wrong.argmax()] <= self._rounding)

    @property
    def _wished(self) -> int:
        own = self.staged.rows[self._k]
        return own.stop - own.start

    def _forces(self) -> Vec:
        """What each item of the working set pushes with, positive down from an upper side."""
        forces = np.empty(len(self._items))
        forces[~self._is_pin] = -self._lam[len(self._lam) - len(self._slots) :]
        pins = self._pins
        if len(pins):
            pull = self._Ek[pins] @ self._lam
            if self._last:
                pull -= self.problem.metric[pins] * (self._y[pins] - self.problem.centre[pins])
            forces[self._is_pin] = pull
        return forces

    def _wrong_signs(self) -> Vec:
        """How much each item of the working set pulls instead of pushing; those that may do either count as right."""
        p, items = self.problem, self._items
        if not len(items):
            return np.zeros(0)
        wrong = -self._forces() * self._side
        if self._last:
            self._rounding = _ROUNDING * max(_largest(self._lam), _largest(wrong))
        else:
            self._rounding = _NOTHING * self._size()
        wrong[: len(self._held)] = 0.0
        wrong[p.lower[items] == p.upper[items]] = 0.0
        return wrong

    def _size(self) -> float:
        """Size of the multipliers of a stage above the last: what residuals of 1, or of the pull to the centre, make."""
        give = self._give[: self._wished].min() if self._wished else 1.0
        return max(_largest(self._scale), 1.0 / float(give))

    def _repair(self) -> bool:
        """Exchange what is wrong by block principal pivoting. False: nothing to exchange."""
        p, items, side = self.problem, self._items, self._side
        if len(self._wrong) != len(items):  # the system had no answer
            return False
        broken = self._over > self.tolerance
        broken[p.n : p.item(p.range.start)] = False
        broken[items] = False
        new = np.flatnonzero(broken)
        keep = self._wrong <= self._rounding if len(items) else np.zeros(0, bool)
        wrong = len(new) + int((~keep).sum())
        if wrong == 0:
            return False
        if wrong < self._fewest:
            self._fewest, self._chances = wrong, 3
        elif self._chances:
            self._chances -= 1
        else:
            last = max(new[-1] if len(new) else -1, items[~keep].max() if not keep.all() else -1)
            keep, new = items != last, new[new == last]
        new_side = np.where(self._under[new] >= self._over[new], -1.0, 1.0)
        first = len(self._held)
        self._work_on(
            np.concatenate([items[first:][keep[first:]], new]).astype(np.intp),
            np.concatenate([side[first:][keep[first:]], new_side]),
        )
        return True

    # ---- when guessing does not end
    def _ask(self, k: int) -> Status:
        """DAQP's answer, sharpened by a solve of our own with its active set, which is the next guess."""
        self.counts.fallback += 1
        if self._asked is None:
            self._asked = StandardStages(self.staged, by_name("daqp"))
        asked = self._asked
        asked.hold_at(self._held, self._held_at)
        asked.iterations = 0
        status = asked.solve(k, sure=True)
        self.iterations += asked.iterations
        if not status.ok:
            return status
        answer = self.problem.value.copy()
        self._memory[k] = asked.active()
        self._work_on(*asked.active())
        if not (self._decide() and self._verify()):
            self.problem.value[:] = answer
            self._foreign = asked
        return status

    # ---- on to the next stage
    def hold(self, k: int) -> Vec:
        p, rows = self.problem, self.staged.rows[k]
        pushing = self._pushing()
        residual = self.staged.hold(k)
        self._Er[-1, rows.start - self._first : rows.stop - self._first] -= residual
        self._held = np.concatenate([self._held, pushing[~np.isin(pushing, self._held)]])
        self._held_at = p.value[self._held].copy()
        return residual

    def _pushing(self) -> Index:
        """Items that held this stage back: they stay where they are."""
        if self._foreign is not None:
            return self._foreign.pushing()
        if not len(self._items):
            return _NONE
        held_back: Index = self._items[self._forces() * self._side > _PUSHES * self._size()]
        return held_back

    # ---- what explain() and the reports ask for
    def certificate(self) -> Certificate:
        if self._foreign is not None:
            return self._foreign.certificate()
        gap = 0.0
        if len(self._slots):
            gap = float(np.abs(self._lam[-len(self._slots) :] * self._missing[-len(self._slots) :]).sum())
        wrong = max(float(self._wrong.max(initial=0.0)), 0.0)
        return Certificate(max(self._primal, 0.0), self.problem.unit * wrong, self.problem.unit * gap)

    def active(self) -> tuple[Index, Vec]:
        return self._items, self._side

    def guess(self, items: Index, side: Vec) -> None:
        self._memory = [(items, side) for _ in self._memory]

    def multipliers(self) -> tuple[Vec, Vec, Vec]:
        if self._foreign is not None:
            return self._foreign.multipliers()
        p, lam, slots = self.problem, self._lam, len(self._slots)
        z, z_box = np.zeros(p.n_range), np.zeros(p.n)
        forces = p.unit * self._forces() if len(self._items) else np.zeros(0)
        z[self._slots - p.range.start] = forces[~self._is_pin]
        pins = self._pins + p.n_u
        z_box[pins] = forces[self._is_pin] / p.scale[pins]
        # What is held may push either way: as one value, lower and upper side are the same.
        p.lower[self._held] = p.upper[self._held] = self._held_at
        z_law = -p.unit * lam[p.n_soft : len(lam) - slots]
        z_base: Vec = np.zeros(0)
        if p.n_u and len(lam):  # stationarity in u determines the multipliers of the rows that were eliminated
            E = p.G[self._first : self._first + len(lam), : p.n_u]
            force = p.unit * (E.T @ lam) - p.regularisation * self._u
            z_base = np.linalg.solve(self._Bu.T, force).astype(np.float64)
        elif p.n_u:
            z_base = np.linalg.solve(self._Bu.T, -p.regularisation * self._u).astype(np.float64)
        return np.concatenate([z_base, z_law]), z, z_box


def _largest(values: Vec) -> float:
    return float(np.abs(values).max()) if len(values) else 0.0
