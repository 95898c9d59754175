"""The certificate of a row problem, recomputed from its rows whichever way the answer was found.

The cost of a row problem has a diagonal D and the rows of its tasks, so that nothing is factored to bound the distance
from the optimum (:func:`wbc.qp.certificate.spread`). A push πᵢ on each row, in units of the cost over ``unit``, splits
the gradient into what is left of the unknowns and of the rows of the tasks:

    r_D = D (y − c) + Gᵀ π + z ,      ρ = S x̂ − π / w ,      |x̂ − x̃|_H ≤ √( r_Dᵀ D⁻¹ r_D + ρᵀ w ρ )

Every split is true; a solver gives the one it has. The rest is decided here, so that no solver's word counts:

* a range row that pushes on a bound that is not met within 1e-6, or on no bound, does not push;
* the rows that determine u push with what makes r_D zero on u, B_uᵀ π_B = −(G_uᵀ π + ε u): one solve and one
  refinement;
* a bound that an unknown meets takes the part of r_D that it can push against, z.

An unknown that belongs to no task, and that the regularisation alone determines, has next to no curvature: pushes of
1e6 leave a gradient there whose rounding moves it by more than its size, whichever solver made it. So what rounding
hides counts for the tasks, and does not count for these unknowns.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import inf, sqrt
from typing import final

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotrs

from wbc.qp.certificate import DISTANCE, TOLERANCE, Certificate
from wbc.qp.rows.problem import RowProblem
from wbc.types import Index, Mat, Vec

#: An unknown whose cost is at most this many times the regularisation belongs to no task. No task asks for its value,
#: so it is only demanded that it can be no farther from its optimum than its own size (1 + |y|), as far as one knows.
_ALONE = 1.5
#: What each product of a gradient loses, as a share of itself.
_ROUNDING = 4.0 * float(np.finfo(np.float64).eps)


@final
class Bounds(Mapping[str, float]):
    """How far each task can be from its optimum [unit of the task]; computed when it is read.

    ``reach`` (rows,) is how far a row moves per unit of ``spread``; ``owners`` says whose row it is.
    """

    __slots__ = ("_owners", "_reach", "_spread")

    def __init__(self, spread: float, reach: Vec, owners: Mapping[str, list[int]]) -> None:
        self._spread, self._reach, self._owners = spread, reach, owners

    def __getitem__(self, name: str) -> float:
        return self._spread * float(self._reach[self._owners[name]].max(initial=0.0))

    def __iter__(self) -> Iterator[str]:
        return iter(self._owners)

    def __len__(self) -> int:
        return len(self._owners)

    def __repr__(self) -> str:
        return repr({name: float(f"{bound:.3g}") for name, bound in self.items()})


@final
class RowProof:
    """Certifies answers to one row problem; reads metric and weights again where ``version`` has changed.

    The cost has the regularisation of u, as the standard form does.
    """

    def __init__(self, problem: RowProblem) -> None:
        self.problem = p = problem
        self._owners = _owners(p)
        self._version = -1
        #: Multipliers of the last answer over ``unit``: of rows [B; R; S; L], and of the bounds on x.
        self.push, self.z = np.zeros(p.n_rows), np.zeros(p.n)
        #: What is left of its gradient in y.
        self.left, self._rho, self._free = np.zeros(p.n_y), np.zeros(p.n_soft), np.ones(p.n_y, bool)
        #: Weights over ``unit`` and their inverse, and what a unit of spread is in each task's and unknown's unit.
        self.weights, self.compliance = np.ones(p.n_soft), np.ones(p.n_soft)
        self.reach, self._reach = np.ones(p.n_soft + p.n_y), np.zeros(0)
        self._alone: Index = np.zeros(0, np.intp)
        self.read()

    def read(self) -> None:
        """Read weights and metric again, if they have changed."""
        p = self.problem
        if p.version == self._version:
            return
        np.divide(p.weights, p.unit, out=self.weights)
        weightless = p.weights == 0.0
        with np.errstate(divide="ignore"):
            self._reach = np.concatenate([1.0 / np.sqrt(p.weights), p.scale[p.n_u :] / np.sqrt(p.unit * p.metric)])
            np.divide(1.0, self.weights, out=self.compliance)
        self._reach[: p.n_soft][weightless] = self.compliance[weightless] = (
            0.0  # a task without weight asks for nothing
        )
        self.reach[:] = self._reach
        self._alone = np.flatnonzero(p.unit * p.metric <= _ALONE * p.regularisation)
        self.reach[p.n_soft + self._alone] *= DISTANCE * TOLERANCE
        self._inverse = 1.0 / p.metric
        self._version = p.version

    def certify(self, push: Vec, *, factor: Mat | None = None) -> Certificate:
        """The certificate of the answer in ``problem.value``, with the rows' values.

        ``push`` (n_rows,) holds the pushes of range rows, tasks and laws. ``factor`` is the lower Cholesky factor of
        B_u, where it is known.
        """
        p = self.problem
        self.read()
        self.push[:] = push
        push, n, n_u = self.push, p.n, p.n_u
        value = p.value[p.first_row : p.first_row + p.n_rows]
        low, high = p.range_bounds()
        at, force = value[p.range], push[p.range]
        over, under = at - high, low - at
        slack = np.where(force > 0.0, over, under)
        force[(slack < -TOLERANCE) | ((force > 0.0) & (high == inf)) | ((force < 0.0) & (low == -inf))] = 0.0
        outside = np.maximum(p.x - p.ub, p.lb - p.x)
        outside *= p.scale
        primal = _largest(over, under, outside, np.abs(value[p.base]), np.abs(value[p.law]))

        # what is left of the gradient: u by the base's rows, y by bounds that push
        rows = p.G[: p.n_rows, :n]
        push[p.base] = 0.0
        if n_u:
            if factor is None:
                factor = dpotrf(p.G[:n_u, :n_u], 1)[0]
            regular = p.regularisation / p.unit * p.x[:n_u]
            for _ in range(2):
                push[p.base] -= dpotrs(factor, push @ rows[:, :n_u] + regular, 1)[0]
        left = push @ rows[:, n_u:]
        away = p.x[n_u:] - p.centre
        away *= p.metric
        left += away
        y, lb, ub, scale = p.x[n_u:], p.lb[n_u:], p.ub[n_u:], p.scale[n_u:]
        least = np.where((ub - y) * scale <= TOLERANCE, -inf, 0.0)  # z pushes down from an upper bound, is positive
        most = np.where((y - lb) * scale <= TOLERANCE, inf, 0.0)
        held = np.clip(left, least, most)
        left -= held
        self.z[n_u:] = -held

        rho = value[p.soft] - push[p.soft] * self.compliance
        self.left, self._rho, self._free = left, rho, held == 0.0
        spread = sqrt(p.unit * (float(left * left @ self._inverse) + float(rho * rho @ self.weights)))
        asked = np.concatenate([p.G[p.soft, n], y * scale])
        share = self.reach / (1.0 + np.abs(asked))
        distance = spread * float(share.max(initial=0.0))
        if distance > DISTANCE * TOLERANCE and len(self._alone):
            known, alone = self._known_spread(), p.n_soft + self._alone
            distance = known * float(share[alone].max())
            share[alone] = 0.0
            distance = max(distance, spread * float(share.max(initial=0.0)))
        pushing, acting = held != 0.0, force != 0.0
        room = np.maximum(np.where(held < 0.0, ub - y, y - lb), 0.0)[pushing]
        gap = float(np.abs(force[acting]) @ np.abs(slack[acting])) + float(np.abs(held[pushing]) @ room)
        largest = float(np.abs(push).max(initial=0.0)) + float(np.abs(away).max(initial=0.0))
        cost = float(np.abs(push) @ (1.0 + np.abs(value))) + float(np.abs(held[pushing]) @ (1.0 + np.abs(y[pushing])))
        dual = p.unit * float(np.abs(left).max(initial=0.0))
        scales = 1.0 + p.unit * largest, 1.0 + p.unit * cost
        return self.found((primal, dual, p.unit * gap, *scales, distance, spread), self._reach)

    def _known_spread(self) -> float:
        """The spread of what is left of the gradient beyond the rounding of the products that it is the sum of."""
        p, n_u, n = self.problem, self.problem.n_u, self.problem.n
        rows = np.abs(p.G[: p.n_rows])
        terms = np.abs(self.push)
        terms[p.soft] += self.weights * (rows[p.soft] @ np.abs(p.x1))
        rounding = terms @ rows[:, n_u:n] + p.metric * (np.abs(p.x[n_u:]) + np.abs(p.centre))
        left = np.maximum(np.abs(self.left) - _ROUNDING * rounding, 0.0)
        return sqrt(p.unit * (float(left * left @ self._inverse) + float(self._rho * self._rho @ self.weights)))

    def sharpened(self) -> Vec:
        """The pushes certified last, those of the tasks changed so that the bound is the least.

        (S D⁻¹ Sᵀ + W⁻¹) δπ = ρ − S D⁻¹ r_D, with u eliminated from S, for an answer that comes without pushes of tasks.
        """
        p, n, n_u = self.problem, self.problem.n, self.problem.n_u
        rows = p.G[p.soft, n_u:n]
        if n_u:
            rows = rows - p.G[p.soft, :n_u] @ np.linalg.solve(p.G[:n_u, :n_u], p.G[:n_u, n_u:n])
        shifted = rows * (self._inverse * self._free)
        push = self.push.copy()
        K = shifted @ rows.T
        K.flat[:: len(K) + 1] += np.maximum(self.compliance, 1e-300)
        push[p.soft] += np.linalg.lstsq(K, self._rho - shifted @ self.left, rcond=None)[0]
        return push

    def found(self, numbers: Sequence[float], reach: Vec) -> Certificate:
        """The certificate of primal, dual, gap, the scales of these two, distance and spread."""
        primal, dual, gap, scale_dual, scale_gap, distance, spread = numbers
        bounds = Bounds(spread, reach, self._owners)
        return Certificate(primal, dual, gap, scale_dual, scale_gap, -1, distance, 0.0, bounds)

    def multipliers(self) -> tuple[Vec, Vec, Vec]:
        """y, z and z_box of the standard form for the answer certified last."""
        p, push = self.problem, self.problem.unit * self.push
        return np.concatenate([push[p.base], push[p.law]]), push[p.range], p.unit * self.z / p.scale


def _owners(p: RowProblem) -> dict[str, list[int]]:
    """Rows of each task among the soft rows and the unknowns y; without tasks, whose rows and unknowns they are."""
    found: dict[str, list[int]] = {}
    for level in p.levels:
        for wish in level:
            at = wish.rows or wish.unknowns
            assert at is not None
            first = at.start - p.soft.start if wish.rows else p.n_soft + at.start - p.n_u
            found.setdefault(wish.name, []).extend(range(first, first + wish.dim))
    if not found:
        names = [*p.rows[p.soft], *p.rows[p.n_rows + p.n_u :]]
        for i, row in enumerate(names):
            found.setdefault(row.owner, []).append(i)
    return found


def _largest(*parts: Vec) -> float:
    """The largest of all values and zero; NaN where one is."""
    worst = 0.0
    for part in parts:
        if len(part):
            value = float(part[part.argmax()])
            worst = value if not value <= worst else worst
    return worst
