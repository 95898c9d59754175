"""Stages in the dual form: one Cholesky of the number of rows while all can be met, and the base is eliminated.

With u eliminated, and E the rows of the last stage, of the stages above it, the laws and the active rows (see
:mod:`wbc.qp.rows.dual`, whose notation this is), a step from the centre y₀ is

    (E D⁻¹ Eᵀ + C) λ = −(E y₀ + e) ,      y = y₀ + D⁻¹ Eᵀ λ

where C is the compliance of the last stage's own rows. Rows that hold have C = 0 but for a trace that decides between
equal multipliers where rows depend on each other; what it leaves of them is taken away by steps in which nothing pulls.

A stage above the last is least squares in what the rows above it leave (:mod:`wbc.qp.lexicographic.rest`): of the
metric only a share of 1e-12 of the steepest row is added, so that the answer is one point. The same holds for all
stages below one that was not met. What pushed while a stage was decided stays held, and may push either way from then
on; else a lower stage could leave the set where the stage above is best.

The working set of each stage is that of the last tick, verified and repaired by block principal pivoting.
"""

from __future__ import annotations

from typing import final

import numpy as np
from scipy.linalg.blas import dgemm, dgemv, dsyrk
from scipy.linalg.lapack import dposv, dpotrf, dpotrs

from wbc.qp.certificate import Certificate
from wbc.qp.lexicographic.asked import Answer, Box, Finder, Rows, Wished
from wbc.qp.lexicographic.least import largest
from wbc.qp.lexicographic.proof import Above, certified, met
from wbc.qp.lexicographic.rest import Asked, Rest, multipliers
from wbc.qp.lexicographic.stages import MET, StagedProblem
from wbc.qp.rows.pivoting import Pivoting
from wbc.qp.rows.proof import RowProof
from wbc.qp.solver import Counts
from wbc.types import Index, Mat, Status, Vec

#: The trace on rows that hold, as a share of the diagonal.
_TRACE = 1e-14
#: Steps that bring rows that hold within tolerance.
_CLEANING = 4
#: Multipliers below this share of the largest are rounding.
_ROUNDING = 1e-12
#: What an answer may be off by, and what a stage above may lose by it.
_ENOUGH, _LITTLE = 1e-7, 1e-5
#: A soft row of weight zero: so compliant that it pushes on nothing.
_FREE = 1e30
_NONE: Index = np.zeros(0, np.intp)
_NOBODY: Vec = np.zeros(0)


@final
class DualStages:
    """Guess and verify, stage by stage, ``tries`` times before the finder or a descent finds the answer.

    In one tick: ``begin`` once, then ``solve(k)``, ``certificate(k)`` and ``hold(k)`` for stages in order of rank.
    ``solve(k)`` takes the stages above k as laws, whether they were solved in this tick and are held, or are only hoped
    to be met. Without ``guesses`` every stage is asked of the finder first.
    """

    def __init__(
        self, staged: StagedProblem, finder: Finder, *, tolerance: float, tries: int, guesses: bool = True
    ) -> None:
        self.staged, self.tolerance, self.tries = staged, tolerance, tries
        self._finder, self._guesses = finder, guesses
        self._pivoting = Pivoting()
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
        self._free_root, self._root, self._is_uniform = np.ones(p.n_y), np.ones(p.n_y), True
        self._G_T, self._bounded = p.G.T, p.item(self._first)
        self._over, self._under = np.zeros(self._bounded), np.zeros(self._bounded)
        self._version = -1
        self._proof, self._above = RowProof(p), Above(staged)
        self._rest: Rest | None = None  # what is left below a stage that was not met, or is not known to be
        self._unmet: list[tuple[slice, Vec, Vec]] = []  # such stages: columns, weights and residual
        self._lam = self._wrong = self._give = self._side = self._pinned_at = _NOBODY
        self._items = self._pins = self._slots = _NONE
        self._is_pin = np.zeros(0, bool)
        self._primal = self._off = self._rounding = 0.0
        self._why = Status.FAILED
        self._column = self._wished = 0
        self.begin_over()

    def begin_over(self) -> None:
        """Forget all earlier ticks."""
        #: Working set of each stage in the last tick: items, and on which side.
        self._memory = [(_NONE, np.zeros(0)) for _ in self.staged.stages]
        self._finder.reset()

    # ---- one tick
    def begin(self) -> bool:
        """Take over what the problem's memory says now. False: the base cannot be eliminated."""
        p, m = self.problem, self._m
        if p.version != self._version:
            self._read_weights()
        self._rest, self._unmet = None, []
        self._above = Above(self.staged)
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
        self._is_uniform = bool((self._free_root == 1.0).all())
        self._compliance = np.divide(p.unit, p.weights, out=np.full(p.n_soft, _FREE), where=p.weights > 0)
        self._weigh = [
            *(np.sqrt(weights / (weights.max(initial=0.0) or 1.0)) for weights in self.staged.weights[:-1]),
            np.sqrt(p.weights / p.unit),
        ]
        self._version = p.version

    def _reduced(self, rows: Mat) -> Mat:
        """E_y − E_u X of some rows, transposed."""
        n_u = self.problem.n_u
        reduced: Mat = dgemm(-1.0, self._X, rows[:, :n_u].T, 1.0, rows[:, n_u:].T, 1) if n_u else rows.T
        return reduced

    def solve(self, k: int) -> Status:
        """Minimise stage k; what stands above it holds."""
        own = self.staged.rows[k]
        self._last = k == len(self.staged.stages) - 1
        self._column, self._wished = own.start - self._first, own.stop - own.start
        if not self._last or self._rest is not None:
            return self._solve_least(k)
        self._give = self._compliance
        self._work_on(*self._memory[k])
        if not (self._guesses and self._guess()) and not self._ask():
            return self._why
        self._memory[k] = self._items, self._side
        return Status.SOLVED

    def _guess(self) -> bool:
        """The last stage, with the working set repaired until it is right; False where that takes too many tries."""
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
        self._y[:] = self.problem.centre
        if len(self._pins):
            self._y[self._pins] = self._pinned_at
        self._lam = _NOBODY
        if self._column < self._stop:
            if not self._factorise():
                return False
            self._lam = self._step(dgemv(1.0, self._Ek, self._y1, 0.0, trans=1))
        self._values()
        self._off = largest(self._balance())
        for _ in range(_CLEANING):
            if self._off <= 0.1 * self.tolerance:
                break
            self._lam = self._lam + self._step(self._unbalanced)
            self._values()
            self._off = largest(self._balance())
        return True

    def _factorise(self) -> bool:
        wished = self._wished
        self._E = self._Es[:, : self._stop - self._column]
        if self._is_uniform and not len(self._pins):
            self._E[:] = self._Ek[:-1]
        else:
            np.multiply(self._Ek[:-1], self._root[:, None], self._E)
        K = dsyrk(1.0, self._E, 0.0, None, 1)
        diagonal = K.T.reshape(-1)[:: len(K) + 1]
        steepest = float(diagonal[diagonal.argmax()])
        diagonal[:wished] += self._give
        holds = diagonal[wished:]
        holds *= 1.0 + _TRACE
        holds += 1e-3 * _TRACE * steepest
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
        dgemv(1.0, self._G_T[:, :rows], p.x1, 0.0, p.value[p.first_row : p.first_row + rows], 0, 1, 0, 1, 1, 1)
        self._missing = p.value[p.first_row + self._first + self._column : p.first_row + rows]

    def _balance(self) -> Vec:
        """What is missing of the rows of the system, with C λ."""
        missing = self._unbalanced = self._missing.copy()
        wished = self._wished
        if wished:
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
            pull = self.problem.metric[pins] * (self.problem.centre[pins] - self._y[pins])
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
        return wrong, _ROUNDING * max(largest(self._lam), largest(wrong))

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
        """The finder's answer to the last stage, sharpened by solves of our own from its active set."""
        p, wished = self.problem, self._wished
        asked = self._found()
        if not asked.status.ok:
            return False
        self._work_on(*self._active_in(asked))
        if self._guess():
            return True
        self._work_on(*self._active_in(asked))
        self._y[:] = asked.y
        self._values()
        self._lam = np.concatenate([
            -self._missing[:wished] / self._give, -asked.rows[p.n_range :], -asked.rows[self._slots - p.range.start]
        ])  # fmt: skip
        self._verify()
        self._why = Status.SOLVED if self._primal <= _ENOUGH else Status.INACCURATE
        return self._why.ok

    def _found(self) -> Answer:
        """The stage as the finder answers it, from the centre."""
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
        box = Box(p.lower[unknowns], p.upper[unknowns], self._free_root, p.centre)
        asked = self._finder.ask(Wished(wish[:, :-1], wish[:, -1], self._give), bounded, box)
        self.iterations += asked.iterations
        self._why = asked.status
        return asked

    def _active_in(self, asked: Answer) -> tuple[Index, Vec]:
        """Items at a bound in an answer of the finder, and on which side."""
        p, side = self.problem, np.zeros(self._bounded)
        side[p.n_u : p.n] = np.sign(asked.bounds)
        side[p.item(p.range.start) :] = np.sign(asked.rows[: p.n_range])
        items = np.flatnonzero(side)
        return items, side[items]

    # ---- least squares in what is left free
    def _solve_least(self, k: int) -> Status:
        p, rest, inside = self.problem, self._rest, self._rest is not None
        self._work_on_none()
        own = self._Er[:, self._column : self._column + self._wished]
        guess = self._numbers(*self._memory[k])
        asked = Asked(own[:-1], own[-1], self._weigh[k], p.centre, self._last, *guess)
        if rest is None:
            rest = self._open()
        before = rest.iterations, rest.fallbacks
        status, y = rest.least(asked, inside=inside)
        self.iterations += rest.iterations - before[0]
        self.counts.fallback += rest.fallbacks - before[1]
        if not status.ok:
            return status
        if not self._is_there(y):
            return Status.INACCURATE if inside else Status.INFEASIBLE
        if self._excess() > _LITTLE:
            return Status.INACCURATE
        self._rest = rest
        self._memory[k] = self._items_of(rest.rows), rest.side
        self._lam = np.zeros(self._stop - self._column)
        if self._last:  # what held a stage back may push either way in the last problem: there it is one value
            kept = self._items_of(rest.kept)
            p.lower[kept] = p.upper[kept] = p.value[kept]
        return Status.SOLVED

    def _open(self) -> Rest:
        """The space in which the laws and all stages above hold."""
        p = self.problem
        ranges = slice(p.item(p.range.start), self._bounded)
        low, high = (np.concatenate([side[ranges], side[p.n_u : p.n]]) for side in (p.lower, p.upper))
        rest = Rest(self._reduced(p.G[p.range])[:-1], low, high, self._free_root, self._finder,
                    tolerance=self.tolerance, tries=self.tries, guesses=self._guesses)  # fmt: skip
        firm = self._Er[:, self._column + self._wished : self._m]
        rest.open(firm[:-1], firm[-1], p.centre)
        rest.stay(rest.y, self._values_at(rest.y))
        return rest

    def _values_at(self, y: Vec) -> Vec:
        """Values at y of what Rest counts: range rows, then the unknowns y."""
        p = self.problem
        self._y[:] = y
        self._values()
        return np.concatenate([p.value[p.item(p.range.start) : self._bounded], y])

    def _is_there(self, y: Vec) -> bool:
        """Go to y: whether all holds there that must."""
        self._y[:] = y
        self._values()
        missing = self._missing.copy()
        missing[: self._wished] = 0.0
        for columns, _, _ in self._unmet:
            missing[columns.start - self._column : columns.stop - self._column] = 0.0
        self._off = largest(missing)
        self._verify()
        return self._primal <= _ENOUGH

    # ---- on to the next stage
    def hold(self, k: int) -> Vec:
        """From here on stage k keeps what it has; its residual (rows of the stage,)."""
        rows, rest = self.staged.rows[k], self._rest
        assert rest is not None  # all stages above the last are solved there
        residual = self.staged.hold(k)
        own = slice(rows.start - self._first, rows.stop - self._first)
        self._Er[-1, own] -= residual
        if largest(residual) > MET:
            self._unmet.append((own, self.staged.weights[k], residual))
        p = self.problem
        rest.stay(self._y, np.concatenate([p.value[p.item(p.range.start) : self._bounded], self._y]))
        self._above.add(self._Er[:-1, own])
        rest.narrow(self._Er[:-1, own], residual)
        return residual

    def _items_of(self, numbers: Index) -> Index:
        """Items of what Rest counts: range rows, then bounds on y."""
        if not len(numbers):
            return _NONE
        p = self.problem
        return np.where(numbers < p.n_range, numbers + p.item(p.range.start), numbers - p.n_range + p.n_u)

    def _numbers(self, items: Index, side: Vec) -> tuple[Index, Vec]:
        """Items as Rest counts them, with their sides."""
        if not len(items):
            return items, side
        p = self.problem
        return np.where(items < p.n, items - p.n_u + p.n_range, items - p.item(p.range.start)), side

    def _excess(self) -> float:
        """By how much stages that were not met are above their least √Σ w r², as a share of it and 1."""
        worst = 0.0
        for columns, weights, residual in self._unmet:
            now = residual + self._missing[columns.start - self._column : columns.stop - self._column]
            before = float((weights * residual).dot(residual)) ** 0.5
            worst = max(worst, (float((weights * now).dot(now)) ** 0.5 - before) / (before + 1.0))
        return worst

    # ---- what explain() and the reports ask for
    def met(self, k: int, residual: Vec) -> Certificate:
        """The certificate of a stage whose residual is next to nothing: there is none smaller than zero."""
        return met(self.staged, k, residual)

    def certificate(self, k: int) -> Certificate:
        """The certificate of stage k, which was solved last."""
        if self._rest is not None:
            own = slice(self._column, self._column + self._wished)
            return certified(self._above, k, self._Er[:-1, own], self._weigh[k], rest=self._rest, primal=self._primal)
        p, lam, slots, push = self.problem, self._lam, len(self._slots), np.zeros(self.problem.n_rows)
        push[p.soft.start :] = -lam[: len(lam) - slots]
        push[self._slots] = -lam[len(lam) - slots :]
        return self._proof.certify(push, factor=self._Bu if p.n_u else None)

    def active(self) -> tuple[Index, Vec]:
        """Items at a bound in the last answer, and on which side."""
        rest, p = self._rest, self.problem
        if rest is None:
            return self._items, self._side
        numbers = np.union1d(rest.kept, rest.rows)
        items = self._items_of(numbers)
        return items, np.where(p.upper[items] - p.value[items] <= p.value[items] - p.lower[items], 1.0, -1.0)

    def guess(self, items: Index, side: Vec) -> None:
        """Take these as active in the next answers."""
        self._memory = [(items, side) for _ in self._memory]

    def multipliers(self) -> tuple[Vec, Vec, Vec]:
        """y, z and z_box of the last answer in the standard form of its own problem."""
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
