"""The certificate: by how much an answer exceeds its limits, and how far it can be from the optimum.

Everything is recomputed from the problem's data, and no solver's word is taken. An answer x̂ comes with multipliers
λ of rows and bounds. Each multiplier is used in the one way that is true:

* λ pushes on the right side of a row that x̂ meets to within the tolerance: the row is *held*, and its bound counts as
  moved to R x̂. ``primal`` is the largest such move, or the largest violation of any row, in the row's unit;
* otherwise λ is set to zero.

With what is left, r = H x̂ + g + Rᵀλ, the answer x̂ is *exactly* the optimum of a problem whose slope g is moved by
−r and whose bounds are moved by ``primal`` at most. Let x̃ be the optimum with these bounds and the true slope, and
d = x̂ − x̃. A held row i has λᵢ Rᵢ d ≥ 0, because R x̂ is at its bound and x̃ is inside; the same holds at x̃. Hence

    |d|²_H ≤ rᵀd ≤ |r|_{H⁻¹} |d|_H,      so      |d|_H ≤ |r|_{H⁻¹},      |Sᵢ d| ≤ |Sᵢ|_{H⁻¹} |r|_{H⁻¹}          (1)

for every row Sᵢ of a task, whatever its weight. ``bounds`` holds the right side of (1) for each task, in the task's
unit, and ``distance`` is the largest of them relative to the size of the target, 1 + |target|. A problem that names no
tasks is judged by its variables: S is the identity, and the size of xⱼ is 1 + |x̂ⱼ|.

For a cost given by its rows, H = D + Sᵀ w S with D diagonal, nothing has to be factored: any split
r = r_D + Sᵀ w ρ gives |r|²_{H⁻¹} ≤ |r_D|²_{D⁻¹} + ρᵀ w ρ, and |Sᵢ|_{H⁻¹} ≤ 1/√wᵢ.

**Rounding.** r is a sum of terms that nearly cancel, so it is known to the rounding of them: that is added to |r|.
Where this keeps an answer from being certified, r is summed again and rounded once (:func:`rounded_once`).

**Directions without curvature.** H may be singular, or its curvature along some direction so small that the rounding
of r decides where the optimum is. A Cholesky factorisation with pivots splits the variables into curved and flat ones.
The curvature of a flat one, beside the others, is rounding of the products in H (or, where no tasks say what matters,
less than rounding of r needs to move the optimum by 1e-4 of its size: what regularisations are). r splits with them:
the part in the range of H enters (1), and a rest that acts on the flat variables alone is a slope that the answer
leaves along them. There distance has no meaning, because optima can be any distance apart: ``bounds`` are then those
with the flat variables where they are, and ``slope`` is that rest relative to the largest term that it is the sum of:
the cost, the rows, the bounds. It is zero at an optimum.

An answer is *certified* (``ok``) when primal ≤ 1e-6, distance ≤ 1e-4 and slope ≤ 1e-6. Neither depends on the unit
of the cost. ``dual`` and ``gap`` are the classical residuals ‖H x + g + Rᵀλ‖∞ (and multipliers that push where there
is no bound) and Σ |λ × distance to the bound it pushes on|, in units of the cost. They must be ≤ 1e-6 of their
scales, which grow with the cost.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from math import fsum
from types import MappingProxyType
from typing import Any, NamedTuple, final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.lapack import dpstrf, dtrtri

from wbc.qp.problem import QP, Objective, moderate
from wbc.tolerances import DISTANCE, MET
from wbc.types import Index, Mat, Vec

TOLERANCE = MET
#: The share of a tolerance at which an answer is as good as it need be: it is then as near as the tolerance.
FINE = 1.0 / DISTANCE

#: Curvature below this share of a variable's own, times the number of variables, is rounding of the products in H.
FLAT = 64.0 * float(np.finfo(np.float64).eps)
_EPS = float(np.finfo(np.float64).eps)
#: Rounding of a gradient's terms, four times for each variable, beside a distance of 1e-4: it hides less curvature.
_HIDDEN = 4.0 * _EPS / (DISTANCE * TOLERANCE)
#: Rounding beyond this share of a slope hides it.
_HIDES = 1e-2
_NONE: Mapping[str, float] = MappingProxyType({})


@final
class Certificate(NamedTuple):
    """The error of a solution in numbers that prove its accuracy; see :mod:`wbc.qp.certificate` for the proof.

    ``primal`` is the largest violation [unit of the worst row], ``dual`` and ``gap`` the stationarity and
    complementarity residuals [unit of the cost] with the scales they are compared to. ``bounds`` says for each task
    how far it can be from its optimum [unit of the task], ``distance`` is the largest of these relative to
    1 + |target|, and ``slope`` the relative slope along variables without curvature.
    """

    primal: float
    dual: float
    gap: float
    scale_dual: float = 1.0
    scale_gap: float = 1.0
    distance: float = 0.0
    slope: float = 0.0
    bounds: Mapping[str, float] = _NONE

    def __reduce__(self) -> tuple[type[Certificate], tuple[Any, ...]]:
        return Certificate, (*self[:-1], dict(self.bounds))

    @classmethod
    def none(cls) -> Certificate:
        """The certificate of an answer that is not finite: everything is infinite."""
        inf = float("inf")
        return cls(inf, inf, inf, distance=inf, slope=inf)

    @property
    def level(self) -> float:
        """The smallest tolerance at which the certificate holds; inf where it holds at none."""
        parts = self.residual, self.distance / DISTANCE, self.slope
        return max(parts) if not any(np.isnan(part) for part in parts) else float("inf")

    @property
    def residual(self) -> float:
        """The largest of primal, dual and gap, the last two relative to their scales."""
        return max(self.primal, _share(self.dual, self.scale_dual), _share(self.gap, self.scale_gap))

    def within(self, tolerance: float) -> bool:
        """True if the certificate holds at this tolerance; a certificate with NaN never does."""
        return self.level <= tolerance

    def fault(self, tolerance: float = TOLERANCE) -> str:
        """Why the certificate does not hold at this tolerance; empty where it does."""
        faults = []
        if not self.primal <= tolerance:
            faults.append(f"a bound is missed by {self.primal:.2g} of its unit")
        if not self.distance <= DISTANCE * tolerance:
            faults.append(f"an optimum can be {self.distance:.2g} of its size away")
        if not self.slope <= tolerance:
            faults.append(f"{self.slope:.2g} of the slope is left along a direction without curvature")
        if not faults and not self.within(tolerance):
            faults.append(f"stationarity is missed by {self.dual:.2g} and the gap is {self.gap:.2g}")
        return "; ".join(faults)

    @property
    def ok(self) -> bool:
        """Certified at the library's tolerance, 1e-6."""
        return self.within(TOLERANCE)

    def __str__(self) -> str:
        word = "certified" if self.ok else "not certified"
        text = f"{word}: primal {self.primal:.1e}, dual {self.dual:.1e}, gap {self.gap:.1e}"
        return f"{text}, distance {self.distance:.1e}" + (f", slope {self.slope:.1e}" if self.slope else "")


def certificate(qp: QP, x: Vec, y: Vec, z: Vec, z_box: Vec, *, tolerance: float = TOLERANCE) -> Certificate:
    """The certificate of the answer (x, y, z, z_box); rows met to within ``tolerance`` count as held.

    Shapes: x (n,), y (n_eq,), z (n_in,), z_box (n,). An answer that is not finite has infinite residuals.

    Example:
        >>> import numpy as np, wbc
        >>> from wbc.qp.certificate import certificate
        >>> qp = wbc.QP([[1.0]], [0.0], lb=[2.0])
        >>> certificate(qp, np.array([2.0]), np.zeros(0), np.zeros(0), np.array([-2.0])).ok
        True
    """
    force = np.concatenate([y, z, z_box])
    if not (moderate(x) and moderate(force)):
        return Certificate.none()
    m = len(qp.lower)
    values = np.concatenate([qp.matrix.dot(x), x])
    over, under = values - qp.sides[1], qp.sides[0] - values
    violation = float(np.maximum(over, under).max())
    room = -np.where(force > 0.0, over, np.where(force < 0.0, under, np.inf))  # to the bound that is pushed on
    held = room <= tolerance
    pushing = force != 0.0
    stray = pushing & np.isinf(room)
    met = pushing & ~stray
    primal = max(violation, float(room[held].max(initial=0.0)), 0.0)

    curvature = qp.H.dot(x)
    push = force[:m].dot(qp.matrix)
    stationarity = curvature + qp.g + push + z_box
    kept = np.where(held, force, 0.0)
    kept_push = push if (kept[:m] == force[:m]).all() else kept[:m].dot(qp.matrix)
    size = 1.0 + np.abs(x)
    asked = np.abs(qp.g) + np.abs(qp.H).dot(size)
    tasks = qp.tasks or (Objective("x", np.eye(qp.n), x),)
    terms = np.abs(qp.g) + np.abs(qp.H).dot(np.abs(x)) + np.abs(kept[:m]).dot(np.abs(qp.matrix)) + np.abs(kept[m:])
    resolved = qp.n * FLAT * qp.H.diagonal()
    if not qp.tasks:
        resolved = np.maximum(resolved, qp.n * _HIDDEN * terms / size)
    cost = _Curved(qp.H, resolved)
    bounds, distance = cost.bounds(curvature + qp.g + kept_push + kept[m:], terms, tasks)
    if not distance <= DISTANCE * tolerance and moderate(terms):  # for what is left, or for what rounding could hide
        left = rounded_once(np.hstack([qp.H, qp.matrix.T]), np.concatenate([x, kept[:m]]), qp.g, kept[m:])
        bounds, distance = cost.bounds(left, np.abs(left), tasks)
    return Certificate(
        primal,
        max(_largest(stationarity), _largest(force[stray])),
        float(np.abs(force[met] * room[met]).sum()),
        _largest(asked),
        float(asked.dot(size) + np.abs(force[met]).dot(1.0 + np.abs(values[met]))),
        distance,
        cost.slope(
            np.column_stack([curvature, qp.g, kept_push, kept[m:]]),
            _EPS * terms,
            _EPS * np.abs(qp.H).dot(np.abs(x)),
            _EPS * _largest(np.abs(qp.H).dot(size)),
            float(asked.dot(size)) / size,
        ),
        bounds,
    )


def rounded_once(rows: Mat, factors: Vec, *terms: Vec) -> Vec:
    """``rows`` (n, k) times ``factors`` (k,) plus ``terms`` (n,), rounded once.

    Products of halves of the digits are exact, and so is the sum of them before it is rounded.

    Dekker: A floating-point technique for extending the available precision, Numerische Mathematik 18, 1971.

    Example:
        >>> import numpy as np
        >>> from wbc.qp.certificate import rounded_once
        >>> rounded_once(np.array([[0.1]]), np.array([0.1]), np.array([-0.01])), 0.1 * 0.1 - 0.01
        (array([9.02056208e-19]), 1.734723475976807e-18)
    """
    products = [left * right for left in _halves(rows) for right in _halves(factors)]
    return np.array([fsum(parts) for parts in np.column_stack([*products, *terms]).tolist()])


def _halves(values: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The upper and the lower half of the binary digits of each value; their sum is the value."""
    wide = (2.0**27 + 1.0) * values
    upper = wide - (wide - values)
    return upper, values - upper


@final
class Bounds(Mapping[str, float]):
    """Bounds of tasks that are computed when the first of them is read, and then kept."""

    __slots__ = ("_compute", "_found")

    def __init__(self, compute: Callable[[], Mapping[str, float]]) -> None:
        self._compute = compute
        self._found: Mapping[str, float] | None = None

    @property
    def _all(self) -> Mapping[str, float]:
        if self._found is None:
            self._found = self._compute()
        return self._found

    def __getitem__(self, name: str) -> float:
        return self._all[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._all)

    def __len__(self) -> int:
        return len(self._all)

    def __repr__(self) -> str:
        return repr({name: float(f"{bound:.3g}") for name, bound in self.items()})


@final
class _Curved:
    """H = L Lᵀ with pivots; variables with no more curvature left than ``resolved`` (n,) are flat."""

    def __init__(self, H: Mat, resolved: Vec) -> None:
        self._unit = 1.0 / np.sqrt(np.where(resolved > 0.0, resolved, 1.0))
        factor, pivots, rank, _ = dpstrf(H * np.multiply.outer(self._unit, self._unit), tol=1.0, lower=1)
        self._order: Index = pivots - 1
        self._inverse: Mat = np.tril(dtrtri(factor[:rank, :rank], lower=1)[0]) if rank else np.zeros((0, 0))
        self._below: Mat = factor[rank:, :rank]
        self.rank = int(rank)

    def _split(self, columns: Mat) -> tuple[Mat, Mat]:
        """Coordinates in the range of H (rank, k), in which |·|_{H⁻¹} is the length, and the rest on flat variables."""
        turned = (columns * self._unit[:, None])[self._order]
        inside = self._inverse.dot(turned[: self.rank])
        return inside, turned[self.rank :] - self._below.dot(inside)

    def bounds(self, r: Vec, terms: Vec, tasks: Sequence[Objective]) -> tuple[Mapping[str, float], float]:
        """For each task how far it can be from its optimum, and the largest of these relative to its size.

        r is the sum of numbers whose magnitudes add up to ``terms`` (n,): it is only known to their rounding.
        """
        rounding = np.abs(self._inverse).dot((_EPS * terms * self._unit)[self._order[: self.rank]])
        length = float(np.linalg.norm(self._split(r[:, None])[0]) + np.linalg.norm(rounding))
        found: dict[str, float] = {}
        worst = 0.0
        for task in tasks:
            if not len(task.rows):
                continue
            reach, _ = self._split(task.rows.T)
            off = length * np.sqrt(np.einsum("ij,ij->j", reach, reach))
            found[task.name] = max(found.get(task.name, 0.0), float(off.max()))
            worst = max(worst, float((off / (1.0 + np.abs(task.target))).max()))
        return MappingProxyType(found), worst

    def slope(self, terms: Mat, rounding: Vec, of_x: Vec, least: float, matters: Vec) -> float:
        """The largest sum of ``terms`` (n, k) on a flat variable, relative to the largest term but the first, H x.

        ``rounding`` (n,) is that of the products that the terms are. Where it hides the terms, nothing is known of the
        slope beside them: they are zero but for rounding of large pushes that cancel, as next to a singularity, or x
        and the multipliers are too large to know anything. There the slope counts beside ``matters`` (n,), that which
        changes the cost by all it is the sum of when a variable moves by its size. Where the rounding of H x alone,
        ``of_x`` (n,), hides all other terms, x is so large that it says nothing of them, as on the way to a minimum
        that does not exist: the slope is infinite. ``least`` is what rounding of x by its size makes of H x: pushes
        that are smaller are zero.
        """
        if self.rank == len(self._order):
            return 0.0
        inside, left = self._split(terms)
        flat = self._order[self.rank :]
        hidden = rounding[flat] * self._unit[flat]
        zero = _largest(terms[:, 1:]) * self._unit[flat] + np.abs(self._below).dot(np.abs(inside[:, 1:]).sum(axis=1))
        zero *= len(self._order) * FLAT
        magnitude = np.abs(left[:, 1:]).max(axis=1)
        of_x = (of_x * self._unit)[self._order]
        hiding = of_x[self.rank :] + np.abs(self._below).dot(np.abs(self._inverse).dot(of_x[: self.rank]))
        if ((magnitude > zero) & (hiding > _HIDES * magnitude)).any():
            return float("inf")
        zero += least * self._unit[flat]
        sum_of = np.abs(left.sum(axis=1))
        counts: NDArray[np.bool_] = magnitude > zero
        rest = sum_of - zero - len(flat) * hidden
        hides = counts & (hidden > _HIDES * magnitude)
        rest = np.where(hides, np.maximum(hidden, rest), rest)
        magnitude = np.where(hides, np.maximum(magnitude, matters[flat] * self._unit[flat]), magnitude)
        sloping: NDArray[np.bool_] = rest > 0.0
        with np.errstate(divide="ignore"):
            return float((rest[sloping] / magnitude[sloping]).max(initial=0.0))


def _share(value: float, scale: float) -> float:
    if value == 0.0:
        return 0.0
    return value / scale if scale > 0.0 else float("inf")


def _largest(values: Vec) -> float:
    return float(np.abs(values).max(initial=0.0))
