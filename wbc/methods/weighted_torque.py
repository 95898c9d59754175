"""The torque that does a task and is nearest to a preferred one, in a weighted norm.

With  M a + n = τ + τ_ext  and the task  J a + drift = ÿ,

    minimise ½ (τ − τ₀)ᵀ W (τ − τ₀)   subject to   A τ = b,   A = J M⁻¹,   b = ÿ − drift + J M⁻¹ (n − τ_ext).

n holds Coriolis and centrifugal terms and, where gravity acts, gravity; τ_ext is what the environment does to the
robot, Jᵀ F for a wrench F measured at the end effector. With Λ = (A W⁻¹ Aᵀ)⁻¹ the optimum has three forms that say the
same:

    τ = τ₀ + M J# (ÿ − drift − J a₀),   a₀ = M⁻¹ (τ₀ + τ_ext − n)       "pseudo_inverse", J# in the metric M W M
      = τ₀ + W⁻¹ Aᵀ Λ (b − A τ₀)                                        "multiplier"
      = W⁻¹ Aᵀ Λ b + (I − W⁻¹ Aᵀ Λ A) τ₀                                "null_space"

W = M⁻¹ is Gauss' principle: independent of coordinates and units, and W⁻¹ Aᵀ = Jᵀ. W = I and W = M⁻² mix newtons with
newton metres on robots with prismatic joints. Motion in the null space of the task is not damped by W; τ₀ = −D v does.

Khatib: A unified approach for motion and force control of robot manipulators: the operational space formulation, IEEE
J. Robotics and Automation 3(1), 1987. Peters, Mistry, Udwadia, Nakanishi, Schaal: A unifying framework for robot
control with redundant DOFs, Autonomous Robots 24, 2008. Hollerbach, Suh: Redundancy resolution of manipulators through
torque optimization, IEEE J. Robotics and Automation 3(4), 1987.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidInput, NoClosedForm
from wbc.methods.least_distance import Nearest, nearest
from wbc.methods.method import Method
from wbc.methods.shared import Factors, box, factors, inverse_root, metric, root
from wbc.qp.problem import QP, Row
from wbc.qp.solver import Solver
from wbc.tolerances import SAME
from wbc.types import Mat, Vec

FORMS = ("torque", "acceleration", "joint")
CLOSED_FORMS = ("pseudo_inverse", "multiplier", "null_space")
#: Differences of torques are judged beside tau − tau_0, but not beside less than this part of the torques that cancel.
_CANCELLING = 1e-4

WEIGHTS = ("inverse_inertia", "identity", "inverse_inertia_squared")


@final
@dataclass(frozen=True, eq=False)
class Torque:
    """tau (n,), a (n,), multipliers (m + k,) of the task and the equalities, cost ½ |tau − tau_0|²_W, scale, feasible.

    Not feasible: J a + drift = scale · task_acceleration at the largest scale in [0, 1], tau its optimum; everything is
    NaN where there is no such scale.
    """

    tau: Vec
    a: Vec
    multipliers: Vec
    cost: float
    scale: float
    feasible: bool


@final
@dataclass(frozen=True, eq=False, init=False)
class WeightedTorque(Method):
    """One instant of a robot with n joints and m task rows.

    Args:
        M: inertia matrix (n, n), symmetric positive definite [kg m², kg on prismatic joints].
        n: bias (n,): M a + n = tau + tau_external [N m, N].
        J: task Jacobian (m, n), of any rank.
        task_acceleration: commanded ÿ (m,), feed-forward plus kd ė + kp e [unit of the task / s²].
        drift: J̇ v (m,), or 0.
        tau_0: preferred torque (n,), or a number for all.
        tau_external: what the environment adds (n,), or a number for all.
        weight: W by name, or an array: positive (n,) or symmetric positive definite (n, n).
        tau_min, tau_max: limits (n,), a number for all, ±inf or None where there is none.
        equalities: (E, e) with E a = e (k rows), met whatever happens to the task; contacts, for example.
        damping: d ≥ 0. Positive: the task is an objective, ½ |A τ − b|² / d² is added to the cost, and the torque stays
            bounded through singularities; d → ∞ gives tau_0. In units of (A W⁻¹ Aᵀ)^½.

    Raises:
        InvalidInput: shapes, NaN, M or weight not symmetric positive definite, crossed limits, negative damping.

    Example:
        >>> from wbc.methods import WeightedTorque
        >>> M, J = [[2.0, -0.25], [-0.25, 0.1625]], [[1.0, -0.5]]
        >>> task = WeightedTorque(M, [0, 0], J, [9.0], tau_0=[-1, 2], tau_external=[-1, 0.5])
        >>> print(task.closed_form().tau, task.solve("daqp").scale)
        [ 9.45454545 -3.22727273] 1.0
    """

    M: Mat
    n: Vec
    J: Mat
    task_acceleration: Vec
    drift: Vec
    tau_0: Vec
    tau_external: Vec
    W: Mat
    tau_min: Vec
    tau_max: Vec
    E: Mat
    e: Vec
    damping: float

    def __init__(
        self,
        M: Any,
        n: Any,
        J: Any,
        task_acceleration: Any,
        *,
        drift: Any = 0.0,
        tau_0: Any = 0.0,
        tau_external: Any = 0.0,
        weight: Any = "inverse_inertia",
        tau_min: Any = None,
        tau_max: Any = None,
        equalities: tuple[Any, Any] | None = None,
        damping: float = 0.0,
    ) -> None:
        n = checks.array("n", n, (None,))
        size = len(n)
        M = metric("M", checks.array("M", M, (size, size)), size)
        J = checks.array("J", J, (None, size))
        E, e = _equalities(equalities, size)
        low, high = box(
            size, tau_min=-np.inf if tau_min is None else tau_min, tau_max=np.inf if tau_max is None else tau_max
        )
        inverse = np.linalg.inv(M)
        W, root_tau = _weight(weight, M, 0.5 * (inverse + inverse.T))
        wanted = checks.array("task_acceleration", task_acceleration, (len(J),))
        self._set(
            M=M, n=n, J=J, task_acceleration=wanted,
            drift=checks.each("drift", drift, len(J)), tau_0=checks.each("tau_0", tau_0, size),
            tau_external=checks.each("tau_external", tau_external, size), W=W, tau_min=low, tau_max=high,
            E=E, e=e, damping=checks.number("damping", damping, low=0.0),
            _inverse=inverse, _root=root_tau,
        )  # fmt: skip

    _inverse: Mat
    _root: Mat

    # ---- what all forms share
    @property
    def _rows(self) -> Mat:
        """[J; E], the rows on the acceleration."""
        return np.concatenate([self.J, self.E])

    @property
    def _wanted(self) -> Vec:
        """Right side of the rows on the acceleration."""
        return np.concatenate([self.task_acceleration - self.drift, self.e])

    @property
    def _torque_rows(self) -> tuple[Mat, Vec]:
        """A and b: the same rows on the torque."""
        A = self._rows @ self._inverse
        return A, self._wanted + A @ (self.n - self.tau_external)

    def _terms(self, A: Mat) -> Vec:
        """Sizes of what the right side of the rows A on the torque is a sum of."""
        rows = np.concatenate([np.abs(self.task_acceleration) + np.abs(self.drift), np.abs(self.e)])
        return np.asarray(rows + np.abs(A) @ (np.abs(self.n) + np.abs(self.tau_external)))

    def _acceleration(self, tau: Vec) -> Vec:
        return np.asarray(self._inverse @ (tau + self.tau_external - self.n))

    def _cost(self, tau: Vec) -> float:
        away = tau - self.tau_0
        return float(0.5 * away @ self.W @ away)

    # ---- closed form
    def closed_form(self, form: str = "pseudo_inverse") -> Torque:
        """The optimum by formula, in any of the three forms. Where rows depend on each other Λ is a pseudo-inverse.

        With damping d, Λ = (A W⁻¹ Aᵀ + d² I)⁻¹ for the task rows. W⁻¹ Aᵀ Λ is one matrix, computed from the singular
        values of the rows, so that no form squares the condition of the task.

        Raises:
            NoClosedForm: there are torque limits.
            InvalidInput: no such form.
        """
        checks.one_of("form", form, CLOSED_FORMS)
        if np.isfinite(self.tau_min).any() or np.isfinite(self.tau_max).any():
            raise NoClosedForm("with torque limits there is no closed form; use solve")
        A, b = self._torque_rows
        found = self._factors(A)
        half = (found.U / found.values) / found.length[:, None]
        Lambda, scale = half @ half.T, self._reachable_scale(A, b, found)
        feasible = scale == 1.0
        if np.isnan(scale):
            return self._none()
        b = b - (1.0 - scale) * np.concatenate([self.task_acceleration, np.zeros(len(self.e))])
        missing = b - A @ self.tau_0
        away = self._root @ found.V[:, : len(self.n)].T @ half.T  # W⁻¹ Aᵀ Λ
        if form == "multiplier":
            tau = self.tau_0 + away @ missing
        elif form == "null_space":
            tau = away @ b + (self.tau_0 - away @ (A @ self.tau_0))
        else:
            tau = self.tau_0 + self.M @ ((self._inverse @ away) @ missing)  # M⁻¹ away is J# in the metric M W M
        return Torque(tau, self._acceleration(tau), Lambda @ missing, self._cost(tau), scale, feasible)

    def _factors(self, A: Mat) -> Factors:
        """Of A R, R Rᵀ = W⁻¹, and of the slacks beside it: Λ = half halfᵀ with half = U / values / length."""
        slacks = np.eye(len(A), len(self.J)) * self.damping
        return factors(np.hstack([A @ self._root, slacks]), of_unit_length=True)

    def _reachable_scale(self, A: Mat, b: Vec, found: Factors) -> float:
        """1 where all rows can be met, the only s in [0, 1] that can be where there is one, else NaN."""
        magnitude = np.maximum(self._terms(A), np.abs(A) @ np.abs(self.tau_0))
        rounding = SAME * float(np.linalg.norm(magnitude / found.length))
        unmet = found.unreached(b - A @ self.tau_0)
        if np.linalg.norm(unmet) <= rounding:
            return 1.0
        task = found.unreached(np.append(self.task_acceleration, np.zeros(len(self.e))))
        if np.linalg.norm(task) <= rounding:
            return np.nan
        scale = float(np.clip(1.0 - task @ unmet / (task @ task), 0.0, 1.0))
        return scale if np.linalg.norm(unmet - (1.0 - scale) * task) <= rounding else np.nan

    def _none(self) -> Torque:
        nothing = np.full(len(self.n), np.nan)
        return Torque(nothing, nothing, np.full(len(self.J) + len(self.E), np.nan), np.nan, np.nan, False)

    # ---- QP
    def qp(self, form: str = "torque") -> QP:
        """The same as a QP, in one of three sets of unknowns; with damping, m slacks w beside them.

        * "torque", τ (n): H = W, g = −W τ₀; A τ + d w = b; limits are bounds.
        * "acceleration", a (n): H = M W M, g = −M W (τ₀ + τ_ext − n); J a + d w = ÿ − drift; limits are rows M a.
        * "joint", (a, τ) (2 n): H = blkdiag(0, W); M a − τ = τ_ext − n and the rows on a; limits are bounds.

        Equalities are rows below the task's. w = (b − A τ) / d costs ½ |w|².

        Raises:
            InvalidInput: no such form.
        """
        checks.one_of("form", form, FORMS)
        size, zero, M = len(self.n), np.zeros_like(self.M), self.M
        free, gap = np.full(size, np.inf), self.tau_external - self.n
        A, b, C, cl, cu = self._rows, self._wanted, None, None, None
        lb, ub = self.tau_min, self.tau_max
        if form == "torque":
            (A, b), H, g = self._torque_rows, self.W, -self.W @ self.tau_0
        elif form == "acceleration":
            H = M @ self.W @ M
            H, g = 0.5 * (H + H.T), -M @ (self.W @ (self.tau_0 + gap))
            C, cl, cu, lb, ub = M, lb + gap, ub + gap, -free, free
        else:
            A, b = np.block([[A, np.zeros_like(A)], [M, -np.eye(size)]]), np.concatenate([b, gap])
            H, g = np.block([[zero, zero], [zero, self.W]]), np.concatenate([np.zeros(size), -self.W @ self.tau_0])
            lb, ub = np.concatenate([-free, lb]), np.concatenate([free, ub])
        rows = self._row_names(form)
        if self.damping:
            slack = len(self.J)
            H = np.block([[H, np.zeros((len(H), slack))], [np.zeros((slack, len(H))), np.eye(slack)]])
            g, A = np.append(g, np.zeros(slack)), np.hstack([A, self.damping * np.eye(len(A), slack)])
            C = None if C is None else np.hstack([C, np.zeros((len(C), slack))])
            lb, ub = np.append(lb, np.full(slack, -np.inf)), np.append(ub, np.full(slack, np.inf))
        return QP(H, g, A=A, b=b, C=C, cl=cl, cu=cu, lb=lb, ub=ub, rows=rows)

    def _row_names(self, form: str) -> list[Row]:
        def named(owner: str, label: str, count: int, unit: str = "") -> list[Row]:
            return [Row(owner, f"{label} {i}", unit) for i in range(count)]

        size = len(self.n)
        rows = named("task", "row", len(self.J)) + named("equalities", "row", len(self.E))
        tau = named("torque", "joint", size, "N m")
        rows += {
            "torque": tau,
            "acceleration": tau + named("acceleration", "joint", size),
            "joint": named("dynamics", "joint", size, "N m") + named("acceleration", "joint", size) + tau,
        }[form]
        return rows + (named("slack", "row", len(self.J)) if self.damping else [])

    def solve(self, solver: str | Solver = "pdas", form: str = "torque") -> Torque:
        """The optimum on any solver, in any of the three sets of unknowns (:meth:`qp`).

        Raises:
            InvalidInput: no such form.
            UnknownSolver, SolverMissing: as :func:`wbc.qp.solve`.
            SolverFailed: the solver ended without an answer.
        """
        qp = self.qp(form)
        centre, root_x = self._metric(form)
        terms = self._terms(self._torque_rows[0])
        terms = np.append(terms, np.abs(self.n) + np.abs(self.tau_external)) if form == "joint" else terms
        found, scale, feasible = nearest(qp, centre, root_x, solver, terms=terms), 1.0, True
        if found is None and self.damping == 0.0:
            feasible = False
            found, scale = self._scaled(qp, centre, root_x, solver, terms)
        return self._none() if found is None else self._result(found, form, scale, feasible)

    def _scaled(
        self, qp: QP, centre: Vec, root_x: Mat, solver: str | Solver, terms: Vec
    ) -> tuple[Nearest | None, float]:
        """The optimum at the largest s in [0, 1] for which the rows can be met, and s: in (x, s) farthest along s."""
        n, m = qp.n, len(self.J)
        column = np.zeros((qp.n_eq, 1))
        column[:m, 0] = -self.task_acceleration
        extended = QP(
            np.eye(n + 1), np.zeros(n + 1), A=np.hstack([qp.A, column]), b=qp.b + column[:, 0],
            C=np.hstack([qp.C, np.zeros((len(qp.C), 1))]), cl=qp.cl, cu=qp.cu,
            lb=np.append(qp.lb, 0.0), ub=np.append(qp.ub, 1.0),
        )  # fmt: skip
        rows = factors(qp.A @ root_x, of_unit_length=True)
        wide = np.zeros((n + 1, n + 1))
        wide[:n, :n], wide[n, n] = root_x, 1.0 / (rows.size(column[:, 0]) or 1.0)
        found = nearest(
            extended, np.append(centre, 0.0), wide, solver, terms=terms, along=np.append(np.zeros(n), 1.0)
        )  # fmt: skip
        if found is None:
            return None, np.nan
        return replace(found, x=found.x[:n], z_box=found.z_box[:n]), float(np.clip(found.x[n], 0.0, 1.0))

    def _metric(self, form: str) -> tuple[Vec, Mat]:
        """Where the cost of the form is zero, and R with cost = ½ |R⁻¹ (x − centre)|²."""
        start, R = self._acceleration(self.tau_0), self._root
        if form == "torque":
            centre, root_x = self.tau_0, R
        elif form == "acceleration":
            centre, root_x = start, self._inverse @ R
        else:
            # The dynamics hold, so ½ |M a − τ + n − τ_ext|²_W may be added: the cost is then strictly convex.
            centre = np.concatenate([start, self.tau_0])
            root_x = np.block([[self._inverse @ R, self._inverse @ R], [np.zeros_like(R), R]])
        slack = len(self.J) if self.damping else 0
        extended = np.eye(len(centre) + slack)
        extended[: len(centre), : len(centre)] = root_x
        return np.append(centre, np.zeros(slack)), extended

    def _result(self, found: Nearest, form: str, scale: float, feasible: bool) -> Torque:
        size, x = len(self.n), found.x
        if form == "acceleration":
            a = x[:size]
            tau = self.M @ a + self.n - self.tau_external
        elif form == "joint":
            a, tau = x[:size], x[size : 2 * size]
        else:
            tau = x[:size]
            a = self._acceleration(tau)
        multipliers = -found.y[: len(self.J) + len(self.E)]
        return Torque(tau, a, multipliers, self._cost(tau), scale, feasible)

    def difference(self, result: Torque, reference: Torque) -> Mapping[str, float]:
        """tau and cost relative to tau − tau_0 in the weighted norm, rows relative to their terms, scale in [0, 1].

        A scaled solution is judged by its rows and its cost, because tau may depend strongly on degenerate limits.
        """
        if np.isnan(result.scale) or np.isnan(reference.scale):
            return {"feasible": 0.0 if np.isnan(result.scale) and np.isnan(reference.scale) else np.inf}
        torques = np.abs(self.tau_0) + np.abs(self.n) + np.abs(self.tau_external) + np.abs(self.M) @ np.abs(reference.a)
        rounding = _CANCELLING * float(np.sqrt(self.W.diagonal() @ torques**2))
        size = max(np.sqrt(2.0 * result.cost), np.sqrt(2.0 * reference.cost), rounding) or 1.0
        apart = np.sqrt(2.0 * self._cost(self.tau_0 + result.tau - reference.tau))
        torques += np.abs(result.tau)
        over = np.maximum(result.tau - self.tau_max, self.tau_min - result.tau).max(initial=0.0)
        dynamics = self.M @ result.a + self.n - result.tau - self.tau_external
        differences = {
            "scale": abs(result.scale - reference.scale),
            "cost": abs(result.cost - reference.cost) / size**2,
            "limits": max(0.0, float(over)) / (torques.max(initial=0.0) or 1.0),
            "dynamics": _part(dynamics, torques),
        }
        if min(result.scale, reference.scale) == 1.0:
            differences["tau"] = apart / size
        if self.damping == 0.0:
            wanted = np.concatenate([result.scale * self.task_acceleration - self.drift, self.e])
            terms = np.abs(self._rows) @ (np.abs(self._inverse) @ torques) + np.abs(wanted)
            differences["task"] = _part(self._rows @ result.a - wanted, terms)
        return differences


def _equalities(given: tuple[Any, Any] | None, size: int) -> tuple[Mat, Vec]:
    if given is None:
        return np.zeros((0, size)), np.zeros(0)
    rows, values = checks.pair("equalities", given, "E, e")
    E = checks.array("equalities[0]", rows, (None, size))
    return E, checks.array("equalities[1]", values, (len(E),))


def _weight(weight: Any, M: Mat, inverse: Mat) -> tuple[Mat, Mat]:
    """W and R with R Rᵀ = W⁻¹."""
    if not isinstance(weight, str):
        W = metric("weight", weight, len(M))
        return W, inverse_root(W)
    if weight == "inverse_inertia":
        return inverse, root(M)
    if weight == "inverse_inertia_squared":
        return inverse @ inverse, M
    if weight == "identity":
        return np.eye(len(M)), np.eye(len(M))
    raise InvalidInput(f"weight is {weight!r}; it must be an array or one of {', '.join(WEIGHTS)}")


def _part(rest: Vec, terms: Vec) -> float:
    """What is left of a sum, relative to its terms."""
    return float(np.linalg.norm(rest) / (np.linalg.norm(terms) or 1.0))
