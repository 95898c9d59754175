"""Stages in the dual form: one Cholesky of the number of rows for each, and the base is eliminated once for all.

With u eliminated, and E the rows of stage k, of the stages above it, the laws and the active rows (see
:mod:`wbc.qp.rows.dual`, whose notation this is), a step from y₀ is

    (E D⁻¹ Eᵀ + C) λ = −(E y₀ + e) ,      y = y₀ + D⁻¹ Eᵀ λ

The last stage starts at the centre, and C is the compliance of its own rows. A stage above it is ½ Σ wᵢ rᵢ² alone, of
which the metric may only choose among equals: C = δ κ w_max / wᵢ makes the step a proximal one, and some steps, each
from where the last one ended, come to the least squares by a factor of δ each (Rockafellar, SIAM J. Control and
Optimization 14(5), 1976). Rows that hold have C = 0 but for a trace that decides between equal multipliers where rows
depend on each other, as they must where a stage was not met: its gradient is a combination of what held it back. What
the trace leaves of them is taken away by steps in which nothing pulls.

The working set is guessed, verified and repaired as in the dual form. What pushed while a stage above was decided stays
held, and may push either way from then on; else a lower stage could leave the set where the stage above is best.
"""

from __future__ import annotations

from typing import final

import numpy as np
from scipy.linalg.blas import dgemm, dgemv, dsyrk
from scipy.linalg.lapack import dposv, dpotrf, dpotrs

from wbc.qp.certificate import Certificate
from wbc.qp.lexicographic.asked import Box, Rows, Wished, ask_daqp
from wbc.qp.lexicographic.rest import Rest, is_met, multipliers
from wbc.qp.lexicographic.stages import MET, StagedProblem
from wbc.qp.lexicographic.way import Way
from wbc.qp.rows.pivoting import Pivoting
from wbc.qp.solver import Counts
from wbc.types import Index, Mat, Status, Vec

#: The trace on rows that hold, as a share of the diagonal; and δ.
_TRACE, _DELTA = 1e-11, 1e-6
#: Steps that bring rows that hold within tolerance.
_CLEANING = 4
#: Multipliers below this share of the largest are rounding: in the last stage, and above it; above the third one push.
_ROUNDING, _NOTHING, _PUSHES = 1e-12, 1e-9, 1e-8
#: What an answer of DAQP may be off by, and what a stage above may lose by it, as a share of its cost.
_ENOUGH, _LITTLE = 1e-7, 1e-5
#: A soft row of weight zero: so compliant that it pushes on nothing.
_FREE = 1e30
_NONE: Index = np.zeros(0, np.intp)
_NOBODY: Vec = np.zeros(0)


@final
class DualStages(Way):
    """Guess and verify on the rows, stage by stage, ``tries`` times a step before DAQP is asked.

    A stage above the last takes steps until its residual changes by less than ``precision``, as a share of it, or is
    met; at most ``steps``. ``exact``: it goes on to the least squares themselves, however flat they are.
    """

    form = "dual"

    def __init__(
        self, staged: StagedProblem, *, tolerance: float, tries: int, steps: int, precision: float, exact: bool
    ) -> None:
        self.staged, self.tolerance, self.tries = staged, tolerance, tries
        self._pivoting = Pivoting()
        self.steps, self.precision, self.exact = steps, precision, exact
        self.counts, self.iterations = Counts(), 0
        self.problem = p = staged.problem
        self._first, self._m = p.soft.start, p.n_soft + p.n_law
        width = self._m + p.n_slots
        self._Er: Mat = np.zeros((p.n_y + 1, width), order="F")
        self._Es: Mat = np.zeros((p.n_y, width), order="F")
        self._y, self._u = p.value[p.n_u : p.n], p.value[: p.n_u]
        self._y1 = p.value[p.n_u : p.n + 1]
        self._B: Mat = np.zeros((p.n_u, p.n + 1), order="F")
        self._Bu, self._X = self._B[:, : p.n_u], self._B[:, p.n_u :]
        self._free_root, self._root = np.ones(p.n_y), np.ones(p.n_y)
        self._bounded = p.item(self._first)
        self._over, self._under = np.zeros(self._bounded), np.zeros(self._bounded)
        self._version = -1
        self._rest: Rest | None = None  # what is left below a stage that was not met
        self._sharp: Rest | None = None  # the space in which a stage was made exact
        self._least: list[tuple[slice, Vec, Vec]] = []  # such stages: columns, weights and residual
        self._lam = self._wrong = self._give = self._side = self._pinned_at = _NOBODY
        self._items = self._pins = self._slots = _NONE
        self._is_pin = np.zeros(0, bool)
        self._primal = self._off = self._rounding = 0.0
        self._why = Status.FAILED
        self._k = self._column = self._wished = 0
        self.begin_over()

    def begin_over(self) -> None:
        #: Working set of each stage in the last tick: items, and on which side.
        self._memory = [(_NONE, np.zeros(0)) for _ in self.staged.stages]

    # ---- one tick
    def begin(self) -> bool:
        p, m = self.problem, self._m
        if p.version != self._version:
            self._read_weights()
        self._rest, self._sharp, self._least = None, None, []
        if p.n_u:
            self._B[:] = p.G[: p.n_u]
            if dposv(self._Bu, self._X, 1, 1, 1)[2]:
                return False
        self._Er[:, :m] = self._reduced(p.G[self._first : p.n_rows])
        return True

    def _read_weights(self) -> None:
        p = self.problem
        self._free_root[:] = 1.0 / np.sqrt(p.metric)
        self._root[:] = self._free_root
        self._root[self._pins] = 0.0
        self._compliance = np.divide(p.unit, p.weights, out=np.full(p.n_soft, _FREE), where=p.weights > 0)
        self._lightness = [
            np.divide(weights.max(initial=0.0), weights, out=np.full(len(weights), _FREE), where=weights > 0)
            for weights in self.staged.weights
        ]
        self._version = p.version

    def _reduced(self, rows: Mat) -> Mat:
        """E_y − E_u X of some rows, transposed."""
        n_u = self.problem.n_u
        reduced: Mat = dgemm(-1.0, self._X, rows[:, :n_u].T, 1.0, rows[:, n_u:].T, 1) if n_u else rows.T
        return reduced

    def solve(self, k: int) -> Status:
        p, own = self.problem, self.staged.rows[k]
        self._k, self._last = k, k == len(self.staged.stages) - 1
        self._column, self._wished = own.start - self._first, own.stop - own.start
        self._start, self._sharp = p.centre, None
        if self._last:
            self._give = self._compliance
        else:
            E = self._Er[:-1, self._column : self._column + self._wished] * self._free_root[:, None]
            steepest = float(np.einsum("ij,ij->j", E, E).max(initial=0.0))
            self._give = _DELTA * (steepest or 1.0) * self._lightness[k]
        if self._rest is not None:
            return self._solve_rest(self._rest)
        self._work_on(*self._memory[k])
        before = _NOBODY
        for step in range(1 if self._last else self.steps):
            if step:
                self._start = self._y.copy()
            if not self._guess() and not self._ask():
                return self._why
            now = self._missing[: self._wished].copy()
            if step and _largest(now - before) <= self.precision * (MET + _largest(now)):
                break
            if not step:
                self._memory[k] = self._items, self._side
            before = now
        if self.exact and not self._last:
            self._sharpen()
        return Status.SOLVED

    def _sharpen(self) -> None:
        """From near the least squares to them, however little they gain by it."""
        rest = self._rest
        if rest is None:
            rest = self._rest_of(self._values_now())
            rest.narrow(self._Er[:-1, self._column + self._wished : self._m], _NONE, self._Er[:-1, :0], met=True)
        else:
            rest.stay(self._y, self._values_now())
        own = self._Er[:, self._column : self._column + self._wished]
        self._y[:] = rest.least(own[:-1], own[:-1].T @ rest.y + own[-1], self._give)
        self._values()
        self._sharp = rest

    def _guess(self) -> bool:
        """One step, with the working set repaired until it is right; False where that takes too many tries."""
        self._pivoting.restart()
        for attempt in range(self.tries):
            self.iterations += 1
            if not self._decide():
                return False
            if self._verify():
                self.counts.repaired += attempt > 0
                self.counts.first += attempt == 0
                return True
            if not self._repair():
                return False
        return False

    # ---- the working set
    def _work_on(self, items: Index, side: Vec) -> None:
        """Take these items as active: variables become pins, rows go into slots. side: +1 upper, −1 lower."""
        p = self.problem
        if not len(items):
            self._work_on_none()
            return
        value = np.where(side > 0, p.upper[items], p.lower[items])
        keep = np.isfinite(value)
        if not keep.all():
            items, side, value = items[keep], side[keep], value[keep]
        pin = items < p.n
        if len(items) - int(pin.sum()) > p.n_slots:
            self._work_on_none()
            return
        self._items, self._side, self._is_pin = items, side, pin
        self._pins, self._slots = items[pin] - p.n_u, items[~pin] - p.first_row
        self._root[:] = self._free_root
        self._root[self._pins] = 0.0
        self._pinned_at = value[pin]
        self._stop = self._m + len(self._slots)
        self._Ek = self._Er[:, self._column : self._stop]
        if len(self._slots):
            slots = p.G[p.n_rows : p.n_rows + len(self._slots)]
            p.G.take(self._slots, 0, slots, "clip")
            slots[:, p.n] -= value[~pin]
            self._Er[:, self._m : self._stop] = self._reduced(slots)

    def _work_on_none(self) -> None:
        if len(self._items):
            self._items, self._side, self._is_pin = _NONE, _NOBODY, np.zeros(0, bool)
            self._pins, self._slots, self._pinned_at = _NONE, _NONE, _NOBODY
            self._root[:] = self._free_root
        self._stop = self._m
        self._Ek = self._Er[:, self._column : self._stop]

    # ---- the linear system
    def _decide(self) -> bool:
        """y and λ for the working set; False where there is none."""
        self._y[:] = self._start
        if len(self._pins):
            self._y[self._pins] = self._pinned_at
        self._lam = _NOBODY
        if self._column < self._stop:
            if not self._factorise():
                return False
            self._lam = self._step(dgemv(1.0, self._Ek, self._y1, 0.0, trans=1))
        self._values()
        self._off = _largest(self._balance())
        for _ in range(_CLEANING):
            if self._off <= 0.1 * self.tolerance:
                break
            change = self._step(self._unbalanced)
            if self._last:
                self._lam = self._lam + change
            self._values()
            self._off = _largest(self._balance())
        return True

    def _factorise(self) -> bool:
        wished = self._wished
        self._E = np.multiply(self._Ek[:-1], self._root[:, None], self._Es[:, : self._stop - self._column])
        K = dsyrk(1.0, self._E, trans=1)
        diagonal = np.einsum("ii->i", K)
        largest = float(diagonal[diagonal.argmax()])
        diagonal[:wished] += self._give
        holds = diagonal[wished:]
        holds *= 1.0 + _TRACE
        holds += 1e-3 * _TRACE * largest
        self._L, info = dpotrf(K, 0, 0, 1)
        return not info

    def _step(self, missing: Vec) -> Vec:
        """λ that takes away what is missing; y is moved by it."""
        lam, _ = dpotrs(self._L, missing)
        np.negative(lam, lam)
        move = dgemv(1.0, self._E, lam)
        move *= self._root
        self._y += move
        solved: Vec = lam
        return solved

    def _values(self) -> None:
        """u and all rows from y."""
        p = self.problem
        if p.n_u:
            dgemv(-1.0, self._X, self._y1, 0.0, self._u, 0, 1, 0, 1, 0, 1)
        rows = p.n_rows + len(self._slots)
        np.dot(p.G[:rows], p.x1, p.value[p.first_row : p.first_row + rows])
        self._missing = p.value[p.first_row + self._first + self._column : p.first_row + rows]

    def _balance(self) -> Vec:
        """What is missing of the rows of the system: of those that hold, and of the last stage's own with C λ."""
        missing = self._unbalanced = self._missing.copy()
        wished = self._wished
        if not self._last:
            missing[:wished] = 0.0
        elif wished:
            missing[:wished] += self._give * self._lam[:wished]
        return missing

    # ---- is it the answer?
    def _verify(self) -> bool:
        p, n = self.problem, self._bounded
        over, under = self._over, self._under
        np.subtract(p.value[:n], p.upper[:n], over)
        np.subtract(p.lower[:n], p.value[:n], under)
        np.maximum(over, under, out=over)
        self._primal = max(float(over[over.argmax()]), self._off)
        self._wrong, self._rounding = self._wrong_signs()
        if not self._primal <= self.tolerance:
            return False
        return not len(self._items) or bool(self._wrong[self._wrong.argmax()] <= self._rounding)

    def _forces(self) -> Vec:
        """What each item of the working set pushes with, positive down from an upper side."""
        forces = np.empty(len(self._items))
        forces[~self._is_pin] = -self._lam[len(self._lam) - len(self._slots) :]
        pins = self._pins
        if len(pins):
            pull = self.problem.metric[pins] * (self._start[pins] - self._y[pins])
            if len(self._lam):
                pull += self._Ek[pins] @ self._lam
            forces[self._is_pin] = pull
        return forces

    def _wrong_signs(self) -> tuple[Vec, float]:
        """How much each item of the working set pulls instead of pushing, and what of that is rounding."""
        p, items = self.problem, self._items
        if not len(items):
            return _NOBODY, 0.0
        wrong = -self._forces() * self._side
        wrong[p.lower[items] == p.upper[items]] = 0.0  # one value: it may push either way
        share = _ROUNDING if self._last else _NOTHING
        return wrong, share * max(_largest(self._lam), _largest(wrong))

    def _repair(self) -> bool:
        """Exchange what is wrong by block principal pivoting. False: nothing to exchange."""
        p, items, side = self.problem, self._items, self._side
        broken = self._over > self.tolerance
        broken[p.n : p.item(p.range.start)] = False
        keep = self._wrong <= self._rounding
        following = self._pivoting.exchanged(items, side, keep, broken, over=self._over, under=self._under)
        if following is None:
            return False
        self._work_on(*following)
        return True

    # ---- when guessing does not end
    def _ask(self) -> bool:
        """DAQP's answer to this step, sharpened by a solve of our own with its active set."""
        self.counts.fallback += 1
        p, n_u, wished = self.problem, self.problem.n_u, self._wished
        ranges, unknowns = slice(p.item(p.range.start), self._bounded), slice(n_u, p.n)
        behind, wish = (self._Er[:, columns].T for columns in (
            slice(self._column + wished, self._m), slice(self._column, self._column + wished)
        ))  # fmt: skip
        rows, zero = np.concatenate([self._reduced(p.G[p.range]).T, behind]), np.zeros(len(behind))
        bounded = Rows(
            rows[:, :-1], rows[:, -1], np.append(p.lower[ranges], zero), np.append(p.upper[ranges], zero), len(zero)
        )
        box = Box(p.lower[unknowns], p.upper[unknowns], self._free_root, self._start)
        asked = ask_daqp(Wished(wish[:, :-1], wish[:, -1], self._give), bounded, box)
        self.iterations += asked.iterations
        self._why = asked.status
        if not asked.status.ok:
            return False
        side = np.zeros(self._bounded)
        side[unknowns], side[ranges] = np.sign(asked.bounds), np.sign(asked.rows[: p.n_range])
        items = np.flatnonzero(side)
        self._work_on(items, side[items])
        if self._decide() and self._verify():
            return True
        self._y[:] = asked.y
        self._values()
        self._lam = np.concatenate([
            -self._missing[:wished] / self._give, -asked.rows[p.n_range :], -asked.rows[self._slots - p.range.start]
        ])  # fmt: skip
        self._verify()
        self._why = Status.SOLVED if self._primal <= _ENOUGH else Status.INACCURATE
        return self._why.ok

    # ---- on to the next stage
    def hold(self, k: int) -> Vec:
        rows = self.staged.rows[k]
        pushing, values = self._pushing(), self._values_now()
        residual = self.staged.hold(k)
        own = slice(rows.start - self._first, rows.stop - self._first)
        self._Er[-1, own] -= residual
        met, holds = is_met(residual), self._Er[:-1, :0]
        if not met:
            self._least.append((own, self.staged.weights[k], residual))
            if self._rest is None:
                self._rest, holds = self._rest_of(values), self._Er[:-1, own.stop : self._m]
        if self._rest is not None:
            self._rest.stay(self._y, values)
            self._rest.narrow(holds, _NONE if met else pushing, self._Er[:-1, own], met=met)
        return residual

    def _rest_of(self, values: Vec) -> Rest:
        """The whole space, from the present point."""
        p = self.problem
        ranges = slice(p.item(p.range.start), self._bounded)
        low, high = (np.concatenate([side[ranges], side[p.n_u : p.n]]) for side in (p.lower, p.upper))
        rest = Rest(self._reduced(p.G[p.range])[:-1], low, high, self._free_root)
        rest.stay(self._y, values)
        return rest

    def _values_now(self) -> Vec:
        """Values of what Rest counts: range rows, then the unknowns y."""
        p = self.problem
        return np.concatenate([p.value[p.item(p.range.start) : self._bounded], self._y])

    def _pushing(self) -> Index:
        """What held this stage back, as Rest counts: range rows, then bounds on y."""
        rest = self._sharp or self._rest
        if rest is not None:
            return rest.pushing(_largest(self._missing[: self._wished] / self._give))
        if not len(self._items):
            return _NONE
        items = self._items[self._forces() * self._side > _PUSHES * _largest(self._lam)]
        p = self.problem
        is_pin = items < p.n
        return np.where(is_pin, items - p.n_u + p.n_range, items - p.item(p.range.start))

    def _solve_rest(self, rest: Rest) -> Status:
        """The same in what is left free."""
        p, wished = self.problem, self._wished
        self._work_on(_NONE, np.zeros(0))
        own = self._Er[:, self._column : self._column + wished]
        at = own[:-1].T @ rest.y + own[-1]
        steps = 1 if self._last else self.steps
        asked = rest.minimise(own[:-1], at, self._give, p.centre, steps=steps, precision=self.precision)
        self.iterations += asked.iterations
        if not asked.status.ok:
            return asked.status
        self._y[:] = asked.y
        self._values()
        missing = self._missing.copy()
        missing[: self._wished] = 0.0
        for columns, _, _ in self._least:
            missing[columns.start - self._column : columns.stop - self._column] = 0.0
        self._lam, self._off = np.zeros(self._stop - self._column), _largest(missing)
        self._verify()
        if self.exact and not self._last:
            self._sharpen()
        if self._primal > _ENOUGH or self._excess() > _LITTLE:
            return Status.INACCURATE
        if self._last:  # what held a stage back may push either way in the last problem: there it is one value
            kept = self._items_of(rest.kept)
            p.lower[kept] = p.upper[kept] = p.value[kept]
        return Status.SOLVED

    def _items_of(self, numbers: Index) -> Index:
        """Items of what Rest counts: range rows, then bounds on y."""
        p = self.problem
        return np.where(numbers < p.n_range, numbers + p.item(p.range.start), numbers - p.n_range + p.n_u)

    def _excess(self) -> float:
        """By how much stages that were not met are above their least, as a share of it."""
        worst = 0.0
        for columns, weights, residual in self._least:
            now = residual + self._missing[columns.start - self._column : columns.stop - self._column]
            before = (weights * residual).dot(residual)
            worst = max(worst, float((weights * now).dot(now) / before) - 1.0)
        return worst

    # ---- what explain() and the reports ask for
    def certificate(self) -> Certificate:
        slots = len(self._slots)
        if not len(self._items):
            return Certificate(max(self._primal, 0.0), 0.0, 0.0)
        gap = float(np.abs(self._lam[-slots:]).dot(np.abs(self._missing[-slots:]))) if slots else 0.0
        wrong, unit = max(float(self._wrong[self._wrong.argmax()]), 0.0), self.problem.unit
        return Certificate(max(self._primal, 0.0), unit * wrong, unit * gap)

    def active(self) -> tuple[Index, Vec]:
        rest, p = self._rest, self.problem
        if rest is None:
            return self._items, self._side
        numbers = np.union1d(rest.kept, np.flatnonzero(rest.forces))
        items = self._items_of(numbers)
        return items, np.where(p.upper[items] - p.value[items] <= p.value[items] - p.lower[items], 1.0, -1.0)

    def guess(self, items: Index, side: Vec) -> None:
        self._memory = [(items, side) for _ in self._memory]

    def multipliers(self) -> tuple[Vec, Vec, Vec]:
        return self._own_multipliers() if self._rest is None else multipliers(self.problem, self._rest)

    def _own_multipliers(self) -> tuple[Vec, Vec, Vec]:
        p, lam, slots = self.problem, self._lam, len(self._slots)
        z, z_box = np.zeros(p.n_range), np.zeros(p.n)
        forces = p.unit * self._forces()
        z[self._slots - p.range.start] = forces[~self._is_pin]
        pins = self._pins + p.n_u
        z_box[pins] = forces[self._is_pin] / p.scale[pins]
        z_law = -p.unit * lam[p.n_soft : len(lam) - slots]
        z_base: Vec = np.zeros(0)
        if p.n_u:  # stationarity in u determines the multipliers of the rows that were eliminated
            E = p.G[self._first : self._first + len(lam), : p.n_u]
            force = p.unit * (E.T @ lam) - p.regularisation * self._u
            z_base = np.linalg.solve(p.G[: p.n_u, : p.n_u].T, force).astype(np.float64)
        return np.concatenate([z_base, z_law]), z, z_box


def _largest(values: Vec) -> float:
    """The largest magnitude; argmax and argmin cost a fifth of max and min, and find a NaN first."""
    return max(float(values[values.argmax()]), -float(values[values.argmin()])) if len(values) else 0.0
