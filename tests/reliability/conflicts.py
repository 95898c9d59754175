"""Infeasible stacks made on purpose: with one conflict that is known, or with several; and an oracle for both.

One conflict: some rows of a feasible stack, their sides and positive factors λ are drawn. A linear program finds x̄
where these rows stand at their sides and all others have room. A constraint then asks for δ more of Σ λᵢ (side of row
i) than it is at x̄. With all chosen rows it cannot be met. Without one of them, say j, go from x̄ along a direction
that changes no equality and no chosen row but j: the constraint gains λⱼ for each unit, and is met before the other
rows have used up their room as long as δ < λⱼ · (room along that direction). So for a δ smaller than all of these,
every conflict holds all chosen rows and the constraint: it is the only one. How far each row must give follows too: δ
/ λᵢ, and δ.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, final

import numpy as np
from scipy.optimize import linprog

import wbc
from tasks import JointAccelerationLimits, JointPositionLimits, JointVelocityLimits, Orientation, Posture, TorqueLimits
from tests.stack.conftest import feet, moving
from wbc.models.model import RobotModel, RobotState
from wbc.qp.problem import QP
from wbc.stack.constraint import ConstraintRows, Quantity
from wbc.stack.plan import Plan
from wbc.types import Index, Mat, Vec

ROBOTS = ("arm", "quadruped", "humanoid")
LEVEL = wbc.InverseDynamics()
#: Rows whose equality is an equation of motion; they are not in question.
PHYSICS = "base dynamics"


@final
class Demand(wbc.LinearConstraint):
    """A y >= lo, constant."""

    dim = 1
    units = "N m"
    on: ClassVar[Any] = "torque"

    def __init__(self, on: Quantity | str, A: Vec, lo: float, *, contact: str = "", name: str = "demand") -> None:
        super().__init__(name=name)
        self.on, self._A, self._lo = on, A, lo  # type: ignore[misc]
        self.contact = contact or None  # type: ignore[assignment]

    def fill(self, state: RobotState, out: ConstraintRows) -> None:
        out.A[0], out.lo[0], out.hi[0] = self._A, self._lo, np.inf


@dataclass
class Case:
    """A stack at a state, the items of its only conflict (indices into ``qp.rows``), and how much each must give."""

    robot: RobotModel
    stack: wbc.Stack
    q: Vec
    v: Vec
    expected: dict[int, float]


def quiet(robot: RobotModel, *extra: Any) -> wbc.Stack:
    """A stack that can be met near the stance: contacts or an exact task, and all limits."""
    if robot.nb:
        demands, contacts = [], feet(robot)  # type: ignore[arg-type]
    else:
        demands, contacts = [Orientation("tool", target=np.eye(3), kp=1.0, name="level").exactly()], []
    limits = [TorqueLimits(), JointVelocityLimits(), JointPositionLimits(), JointAccelerationLimits(200.0)]
    return wbc.Stack([Posture(robot.q0, kp=10.0)], contacts=contacts, subject_to=[*demands, *limits, *extra])


def sides(qp: QP) -> tuple[Mat, Vec, Vec]:
    """All rows and bounds as lower <= R x <= upper."""
    return (np.vstack([qp.matrix, np.eye(qp.n)]), np.concatenate([qp.lower, qp.lb]), np.concatenate([qp.upper, qp.ub]))


def can_be_met(qp: QP, items: Any) -> bool:
    """Whether physics and these items can hold together, by the simplex method of HiGHS.

    Each side may be missed by 1e-7: the answer is about conflicts, not about rounding.
    """
    R, lower, upper = sides(qp)
    held = [i for i in range(qp.n_eq) if qp.rows[i].owner == PHYSICS]
    items = np.array(sorted({*held, *items}), dtype=np.intp)
    if not len(items):
        return True
    size = np.linalg.norm(R[items], axis=1)
    size[size == 0.0] = 1.0
    A, low, high = R[items] / size[:, None], lower[items] / size - 1e-7, upper[items] / size + 1e-7
    above, below = np.isfinite(high), np.isfinite(low)
    rows, right = np.vstack([A[above], -A[below]]), np.concatenate([high[above], -low[below]])
    for method in ("highs-ds", "highs-ipm"):
        for presolve in (True, False):
            found = linprog(np.zeros(qp.n), rows, right, bounds=(None, None), method=method,
                            options={"presolve": presolve})  # fmt: skip
            if found.status in (0, 2):
                return bool(found.status == 0)
    raise AssertionError(f"no answer from the oracle: {found.message}")


def one_conflict(name: str, seed: int) -> Case:
    """A stack with exactly one conflict of 2 to 6 rows. States and rows are drawn until there is room enough."""
    rng = np.random.default_rng([seed, ROBOTS.index(name)])
    robot = wbc.load(name)
    while True:
        case = _try(robot, rng)
        if case is not None:
            return case


def _try(robot: RobotModel, rng: np.random.Generator) -> Case | None:
    q, v = moving(robot, int(rng.integers(1 << 30)))  # type: ignore[arg-type]
    stack = quiet(robot)
    qp, plan = lowered(robot, stack, q, v)
    chosen, side = _choose(plan, rng)
    factor = rng.uniform(0.5, 2.0, len(chosen))
    R, lower, upper = sides(qp)
    found = _roomy(qp, chosen, side)
    if found is None:
        return None
    x, room = found
    gain = _gain(R, lower == upper, chosen, side, room)
    if gain is None:
        return None
    delta = 0.5 * float((factor * gain).min())
    if not 1e-3 < delta:
        return None
    delta = min(delta, 10.0)
    row = (factor * side) @ R[chosen]
    demand = _demand(plan, chosen, factor * side, row, x, delta)
    shifted = {int(i): float(delta / f * s) for i, f, s in zip(chosen, factor, side, strict=True)}
    full = wbc.Stack(stack.tasks, contacts=stack.contacts, subject_to=[*stack.subject_to, demand])
    # The constraint is the last two-sided row; the bounds move behind it by one.
    last = len(qp.lower)
    expected = {i + (i >= last): amount for i, amount in shifted.items()}
    expected[last] = -delta
    return Case(robot, full, q, v, expected)


def lowered(robot: RobotModel, stack: wbc.Stack, q: Vec, v: Vec) -> tuple[QP, Any]:
    """The standard form of a stack at a state, as a controller has it in its first tick.

    The plan is made without the look for contradictions: some of these stacks have them in every state.
    """
    plan = Plan(robot, stack, LEVEL, 1e-3, robot.state(), hierarchy=wbc.Weighted())
    state = robot.state()
    state.update(0.0, q, v)
    plan.start(state)
    plan.fill(state)
    return plan.qp.copy(), plan


def _choose(plan: Any, rng: np.random.Generator) -> tuple[Index, Vec]:
    """One to five rows that a constraint on one quantity can combine, and the side (±1) of each."""
    layout, model, shape = plan.layout, plan.model, plan.problem.qp_shape
    first_range, first_bound = shape.n_eq, shape.n_eq + shape.n_in
    kind = rng.choice(["torque", "acceleration", "force"] if layout.contacts else ["torque", "acceleration"])
    if kind == "torque":
        pool = np.arange(first_range, first_range + model.nj)
    elif kind == "force":
        contact = layout.contacts[0].member
        pool = np.arange(first_range + model.nj, first_range + model.nj + len(contact.cone()))
    else:
        equalities = np.arange(layout.n_u, shape.n_eq)
        joints = np.arange(first_bound + model.nb, first_bound + model.nv)
        pool = np.concatenate([rng.permutation(equalities)[:3], rng.permutation(joints)[:4]])
    count = int(rng.integers(1, 6 if kind != "force" else 3))
    chosen = rng.choice(pool, size=min(count, len(pool)), replace=False)
    side = np.ones(len(chosen)) if kind == "force" else rng.choice([-1.0, 1.0], size=len(chosen))
    return np.sort(chosen), side


def _roomy(qp: QP, chosen: Index, side: Vec) -> tuple[Vec, Vec] | None:
    """x̄ where the chosen rows stand at their sides and the least room of the others is largest; the room of each."""
    R, lower, upper = sides(qp)
    equal = lower == upper
    at = np.where(side > 0, upper[chosen], lower[chosen])
    fixed = equal.copy()
    fixed[chosen] = True
    target = upper.copy()
    target[chosen] = at
    size = np.linalg.norm(R, axis=1)
    above, below = np.flatnonzero(np.isfinite(upper) & ~fixed), np.flatnonzero(np.isfinite(lower) & ~fixed)
    A = np.vstack([np.column_stack([R[above], size[above]]), np.column_stack([-R[below], size[below]])])
    found = linprog(
        np.concatenate([np.zeros(qp.n), [-1.0]]), A_ub=A, b_ub=np.concatenate([upper[above], -lower[below]]),
        A_eq=np.column_stack([R[fixed], np.zeros(fixed.sum())]), b_eq=target[fixed],
        bounds=[(None, None)] * qp.n + [(0.0, 10.0)], method="highs-ds",
    )  # fmt: skip
    if found.status != 0 or found.x[-1] < 1e-2:
        return None
    x = found.x[:-1]
    room = np.minimum(upper - R @ x, R @ x - lower)
    room[fixed] = np.inf
    return x, room


def _gain(R: Mat, equal: Any, chosen: Index, side: Vec, room: Vec) -> Vec | None:
    """How far each chosen row can be passed while equalities and other chosen rows stay and the rest has room."""
    others = equal.copy()
    others[chosen] = False
    gains = []
    for j in range(len(chosen)):
        E = np.vstack([R[others], R[chosen]])
        e = np.zeros(len(E))
        e[others.sum() + j] = side[j]
        direction, *_ = np.linalg.lstsq(E, e, rcond=None)
        if np.abs(E @ direction - e).max() > 1e-9:
            return None  # it depends on the others
        change = np.abs(R @ direction)
        gains.append(float((room[change > 1e-12] / change[change > 1e-12]).min()))
    return np.array(gains)


def _demand(plan: Any, chosen: Index, factors: Vec, row: Vec, x: Vec, delta: float) -> Demand:
    """The constraint on the quantity that the chosen rows are about: δ more of their combination than there is at x."""
    model, layout, shape = plan.model, plan.layout, plan.problem.qp_shape
    first_range, first_bound = shape.n_eq, shape.n_eq + shape.n_in
    if first_range <= chosen[0] < first_range + model.nj:
        A = np.zeros(model.nj)
        A[chosen - first_range] = factors
        G, nb = plan.problem.G, model.nb
        torques = (G[nb : nb + model.nj, : plan.problem.n] / plan.problem.scale) @ x + G[nb : nb + model.nj, -1]
        return Demand("torque", A, float(A @ torques) + delta)
    if first_range + model.nj <= chosen[0] < first_bound:
        columns = layout.contacts[0].unknowns
        return Demand("force", row[columns], float(row @ x) + delta, contact=layout.contacts[0].member.frame)
    return Demand("acceleration", row[: model.nv], float(row @ x) + delta)


def several_conflicts(name: str, seed: int) -> Case:
    """A stack with two to four conflicts, some of them sharing rows; which, only the oracle knows."""
    rng = np.random.default_rng([seed, 7 + ROBOTS.index(name)])
    robot = wbc.load(name)
    q, v = moving(robot, int(rng.integers(1 << 30)))  # type: ignore[arg-type]
    demands = []
    for k in range(int(rng.integers(2, 5))):
        on = str(rng.choice(["torque", "acceleration"]))
        size = robot.nj if on == "torque" else robot.nv
        A = rng.normal(size=size) * (rng.uniform(size=size) < 0.3)
        A[int(rng.integers(size))] = 1.0
        demands.append(Demand(on, A, float(10.0 ** rng.uniform(2, 6)), name=f"demand {k}"))
    return Case(robot, quiet(robot, *demands), q, v, {})
