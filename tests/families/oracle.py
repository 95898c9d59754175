"""An oracle for controllers that shares no solver with them: HiGHS for feasibility; Clarabel, NNLS, numpy for optima.

It reads the rows that a plan has written (dynamics, contacts, limits, wanted accelerations) and nothing of how the
library solves them. A hierarchy is checked level by level, given what the answer under test came to above: the level's
least squares, with all tasks above held where the answer has them, within all constraints.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any, NamedTuple

import clarabel
import numpy as np
from scipy.linalg import null_space
from scipy.optimize import linprog, nnls
from scipy.sparse import csc_matrix

import wbc
from wbc.stack.formulation import Formulation
from wbc.stack.hierarchy import Hierarchy, Weighted
from wbc.types import Mat, Vec

#: Largest violation of a constraint, in its unit.
FEASIBLE = 1e-6
#: A row this near to a bound is at it, in its unit.
ROUNDED = 1e-8
#: An optimum farther away than this many units of the unknowns rests on rows that are rounding, and proves nothing.
FAR = 1e9
#: What a task may be off by, as a share of one unit and what the task asks for.
SHARE = 1e-4
_NONE = np.zeros(0)


class Rows(NamedTuple):
    """The rows of a task that weigh something: ½ Σ w (A x − b)², A (m, n), in the task's unit."""

    name: str
    A: Mat
    b: Vec
    w: Vec
    asked: Vec | None = None
    """What a task that may be done in part asks for, its drift included; None for any other."""
    diagonal: bool = False
    """Whether it is part of the diagonal cost, too."""
    moved: Mat | None = None
    """Of a share: J, by which its task moves. Beside a share a J of 1e-8 of what is asked would be rounding."""


@dataclass(frozen=True)
class Constraints:
    """E x = e, cl ≤ C x ≤ cu (bounds on unknowns included)."""

    E: Mat
    e: Vec
    C: Mat
    cl: Vec
    cu: Vec

    def excess(self, x: Vec) -> float:
        """The largest violation."""
        value = self.C @ x
        parts = [np.abs(self.E @ x - self.e), value - self.cu, self.cl - value]
        return float(np.concatenate(parts).max(initial=0.0))

    def as_met_by(self, x: Vec) -> Constraints:
        """The same, each as far off as x has it: large multipliers make a little rounding there change the optimum.

        That is so on either side: a bound that x pushes on from within is where x is, as in the certificate.
        """
        value = self.C @ x
        lower = np.where(np.abs(value - self.cl) <= ROUNDED, value, np.minimum(self.cl, value))
        upper = np.where(np.abs(value - self.cu) <= ROUNDED, value, np.maximum(self.cu, value))
        fixed = self.cl == self.cu
        return Constraints(self.E, self.E @ x, self.C, np.where(fixed, value, lower), np.where(fixed, value, upper))

    def wider(self, columns: int) -> Constraints:
        """The same with unknowns in [0, 1] appended."""
        n = self.C.shape[1]
        C = np.block([[self.C, np.zeros((len(self.C), columns))], [np.zeros((columns, n)), np.eye(columns)]])
        ends = np.zeros(columns), np.ones(columns)
        E = np.hstack([self.E, np.zeros((len(self.E), columns))])
        return Constraints(E, self.e, C, np.append(self.cl, ends[0]), np.append(self.cu, ends[1]))


class Physical(NamedTuple):
    """A controller's problem in physical units; ``diagonal`` and ``centre``: ½ Σ d (x − c)² of the last level."""

    constraints: Constraints
    levels: list[list[Rows]]
    diagonal: Vec
    centre: Vec
    unit: Vec
    x: Vec


def read(controller: wbc.Controller) -> Physical:
    """The rows of the last tick, and the x that was commanded."""
    p = controller.plan.problem
    n, n_u, m = p.n, p.n_u, p.n_rows
    G, right = p.G[:m, :n] / p.scale, p.G[:m, n]
    E = np.concatenate([G[:n_u], G[p.equal]])
    e = -np.concatenate([right[:n_u], right[p.equal]])
    lower, upper = p.range_bounds()
    C = np.concatenate([G[p.range], np.eye(n)])
    cl = np.concatenate([lower - right[p.range], p.lb * p.scale])
    cu = np.concatenate([upper - right[p.range], p.ub * p.scale])
    levels = [[_rows(task, G, right, n) for task in level] for level in p.levels]
    diagonal, centre = np.full(n, p.regularisation), np.zeros(n)
    diagonal[n_u:] = p.unit * p.metric / p.scale[n_u:] ** 2
    centre[n_u:] = p.centre * p.scale[n_u:]
    x: Vec = np.array(p.x * p.scale)
    unit = np.where(p.scale == 1.0, 1.0, 100.0)
    return Physical(Constraints(E, e, C, cl, cu), levels, diagonal, centre, unit, x)


def _rows(task: Any, G: Mat, right: Vec, n: int) -> Rows:
    if task.rows is not None:
        A, b = G[task.rows], -right[task.rows]
    else:
        A, b = np.eye(n)[task.unknowns], np.array(task.wanted, dtype=float)
    weights = np.array(task.weights)
    counts = weights > 0.0
    asked = (task.wanted + task.drift)[counts] if task.scaled or task.kinematic else None
    return Rows(task.name, A[counts], b[counts], weights[counts], asked, task.rows is None)


def margin(c: Constraints) -> float:
    """How far inside all inequalities a point can be while the equations hold, at most 1 (HiGHS); below 0: infeasible.

    Rows count in units of their own length.
    """
    n = c.C.shape[1]
    length = np.maximum(np.linalg.norm(c.C, axis=1), 1e-12)
    up, low = np.isfinite(c.cu), np.isfinite(c.cl)
    A = np.vstack([np.hstack([c.C[up], length[up, None]]), np.hstack([-c.C[low], length[low, None]])])
    b = np.concatenate([c.cu[up], -c.cl[low]])
    E = np.hstack([c.E, np.zeros((len(c.E), 1))])
    cost = np.append(np.zeros(n), -1.0)
    found = linprog(cost, A, b, E, c.e, bounds=[*[(None, None)] * n, (None, 1.0)], method="highs")
    return float(found.x[-1]) if found.status == 0 else np.nan


class Optimum(NamedTuple):
    """x of a least squares problem; ``proved``: its optimality conditions were recomputed and hold."""

    x: Vec
    proved: bool


def least_squares(F: Mat, f: Vec, c: Constraints, unit: Vec, start: Vec | None = None) -> Optimum | None:
    """Minimise ½ ‖F x − f‖² within the constraints: others find the active rows, numpy solves for them.

    Clarabel is asked first, and from ``start`` (n,), a point within the constraints, NNLS, which needs no interior.
    ``unit`` (n,) is the size of each unknown. None: neither found anything. Equations that contradict each other by
    less than what counts as met have no common point: where no optimum is proved, e is replaced by the nearest right
    side that can be met.
    """
    found = _least_squares(F, f, c, unit, start)
    if found is not None and found.proved:
        return found
    met = c.E @ np.linalg.lstsq(c.E, c.e, rcond=1e-11)[0] if len(c.E) else c.e
    if np.abs(met - c.e).max(initial=0.0) > 0.1 * FEASIBLE:
        return found
    again = _least_squares(F, f, replace(c, e=met), unit, start)
    return again if again is not None and again.proved else found


def _least_squares(F: Mat, f: Vec, c: Constraints, unit: Vec, start: Vec | None) -> Optimum | None:
    up, low, fixed = np.isfinite(c.cu) & (c.cu > c.cl), np.isfinite(c.cl) & (c.cu > c.cl), c.cu == c.cl
    p = _Problem(
        F, f, np.vstack([c.E, c.C[fixed]]), np.append(c.e, c.cl[fixed]), np.vstack([c.C[up], -c.C[low]]),
        np.concatenate([c.cu[up], -c.cl[low]]), unit,
    )  # fmt: skip
    best: Optimum | None = None
    for x, active in chain(_by_clarabel(p), () if start is None else _by_nnls(p, start)):
        if best is None and c.excess(x) <= FEASIBLE:
            best = Optimum(x, False)
        refined = _refined(p, active, x)
        if refined is None:
            continue
        if c.excess(refined[0]) <= 1e-7 and refined[1] and (np.abs(refined[0]) < FAR * unit).all():
            return Optimum(refined[0], True)
    return best


class _Problem(NamedTuple):
    """½ ‖F x − f‖² where E x = e and A x ≤ a; ``unit`` (n,) is the size of each unknown."""

    F: Mat
    f: Vec
    E: Mat
    e: Vec
    A: Mat
    a: Vec
    unit: Vec


def _by_clarabel(p: _Problem) -> Iterator[tuple[Vec, Any]]:
    """Its answer, and which rows may be active there (a mask): those whose multiplier is a share of their slack."""
    n, m = p.F.shape[1], len(p.F)
    top = float(np.abs(p.F * p.unit).max(initial=0.0)) or 1.0
    # unknowns [x / unit; r]: r = F x − f, so that nothing is squared
    equal = np.block([[p.E * p.unit, np.zeros((len(p.E), m))], [p.F * p.unit / top, -np.eye(m)]])
    P = np.zeros((n + m, n + m))
    P[range(n, n + m), range(n, n + m)] = 1.0
    rows = np.vstack([equal, np.hstack([p.A * p.unit, np.zeros((len(p.A), m))])])
    right = np.concatenate([p.e, p.f / top, p.a])
    length = np.maximum(np.abs(rows).max(axis=1), 1e-12)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = 1e-11
    settings.max_iter = 200
    cones = [clarabel.ZeroConeT(len(equal)), clarabel.NonnegativeConeT(len(p.A))]
    found = clarabel.DefaultSolver(
        csc_matrix(np.triu(P)), np.zeros(n + m), csc_matrix(rows / length[:, None]), right / length, cones, settings
    ).solve()
    if str(found.status) not in ("Solved", "AlmostSolved", "InsufficientProgress", "MaxIterations"):
        return
    x = np.array(found.x)[:n] * p.unit
    z, s = np.array(found.z)[len(equal) :], np.array(found.s)[len(equal) :]
    for share in (1.0, 1e-3, 1e3):
        yield x, z > share * s


def _by_nnls(p: _Problem, x: Vec) -> Iterator[tuple[Vec, Any]]:
    """Points from x within the constraints on, and which rows push there (a mask).

    Least distance problems (Lawson and Hanson, Solving Least Squares Problems, 1974, chapter 23). Each has a small cost
    on the distance from the point before, so that every direction has curvature.
    """
    N = null_space(p.E * p.unit)
    W, B = (p.F * p.unit) @ N, (p.A * p.unit) @ N
    U, size, V = np.linalg.svd(W, full_matrices=True)
    if not len(B) or not size.max(initial=0.0) > 0.0:
        return
    stretch = np.full(N.shape[1], 1e-6 * size.max())
    stretch[: len(size)] = np.maximum(size, stretch[0])
    for _ in range(4):
        wanted = np.zeros(N.shape[1])
        wanted[: len(size)] = (U.T @ (p.f - p.F @ x))[: len(size)]
        wanted[: len(size)][size < stretch[: len(size)]] = 0.0
        # z = V' (w + wanted) / stretch; B z ≤ room becomes G w ≥ h
        G = -(B @ V.T) / stretch
        h = -np.maximum(p.a - p.A @ x, 0.0) - G @ wanted
        length = np.maximum(np.hypot(np.linalg.norm(G, axis=1), h), 1e-300)
        M, goal = np.vstack([G.T, h]) / length, np.append(np.zeros(len(stretch)), 1.0)
        try:
            u, _ = nnls(M, goal, maxiter=30 * len(length))
        except RuntimeError:
            return
        left = goal - M @ u
        if not left[-1] > 0.0:
            return
        x = x + p.unit * (N @ (V.T @ ((wanted - left[:-1] / left[-1]) / stretch)))
        yield x, u > 0.0


def _refined(p: _Problem, active: Any, x: Vec) -> tuple[Vec, bool] | None:
    """From x the shortest step to the minimum with the active rows as equations; whether these push the right way."""
    E, F, f, unit = p.E, p.F, p.f, p.unit
    A, a = p.A[active], p.a[active]
    try:
        held, right = np.vstack([E, A]) * unit, np.append(p.e, a)
        length = np.maximum(np.linalg.norm(held, axis=1), 1e-12)
        held, right = held / length[:, None], right / length
        y = x / unit
        _, size, V = np.linalg.svd(held, full_matrices=True)
        rank = int((size > 1e-11 * size.max(initial=1.0)).sum())
        N, W = V[rank:].T, F * unit
        for _ in range(2):
            y = y + np.linalg.lstsq(held, right - held @ y, rcond=1e-11)[0]
            y = y + N @ np.linalg.lstsq(W @ N, f - W @ y, rcond=1e-13)[0]
        y = y + np.linalg.lstsq(held, right - held @ y, rcond=1e-11)[0]  # what rounding in N has left
        gradient = W.T @ (W @ y - f)
        force = np.linalg.lstsq(held.T, -gradient, rcond=1e-11)[0]
    except np.linalg.LinAlgError:
        return None
    # Where nothing is left of the task, a gradient is rounding.
    rounding = 1e-13 * (np.abs(W) @ np.abs(y) + np.abs(f)).max(initial=0.0)
    scale = np.abs(W).max(initial=0.0) * (1e-8 * np.abs(W @ y - f).max(initial=0.0) + rounding) + 1e-20
    # multipliers of dependent rows are not unique: a wrong sign may be exchanged against others
    left = held.T @ force + gradient
    # E y = e has a solution. One that misses it by more than rounding has dropped a row that counts.
    missed = np.abs(held[: len(E)] @ y - right[: len(E)]) - 1e-13 * (np.abs(held) @ np.abs(y) + np.abs(right))[: len(E)]
    if np.abs(left).max(initial=0.0) > scale or (missed > 0.0).any():
        return y * unit, False
    if len(A) and force[len(E) :].min() < -scale:
        free = held[: len(E)]
        columns = np.hstack([free.T, -free.T, held[len(E) :].T])
        try:
            _, distance = nnls(columns, -gradient, maxiter=30 * columns.shape[1])
        except RuntimeError:
            return y * unit, False
        return y * unit, bool(distance <= 10.0 * scale)
    return y * unit, True


def undamped(level: Formulation, hierarchy: Hierarchy) -> Formulation:
    """The level without damping where levels are ranked: this oracle judges their tasks alone.

    Damped levels have an oracle of their own in tests/stack/test_damped.py.
    """
    return level if isinstance(hierarchy, Weighted) else replace(level, lm_damping=0.0)


class Verdict(NamedTuple):
    """``word`` is "right", "undecided" or "wrong"; ``why`` says which task, and by how much."""

    word: str
    why: str = ""


def _compare(x: Vec, best: Optimum, tasks: list[Rows], F: Mat, f: Vec, place: str) -> Verdict:
    """Each task of the answer against the oracle's; an answer that costs less is not wrong."""
    mine, other = np.linalg.norm(F @ x - f), np.linalg.norm(F @ best.x - f)
    for task in tasks:
        off = float(np.abs(task.A @ (x - best.x)).max(initial=0.0))
        if off > SHARE * (1.0 + float(np.abs(task.b).max(initial=0.0))):
            if not best.proved or mine <= other * (1.0 + 1e-12):
                return Verdict("undecided", f"{place} {task.name}")
            return Verdict(
                "wrong", f"{place} {task.name} is {off:.3g} from its optimum, cost {mine:.9g} for {other:.9g}"
            )
    return Verdict("right")


def judge_weighted(p: Physical) -> Verdict:
    """One least squares problem of all tasks and the diagonal cost."""
    tasks = [task for level in p.levels for task in level]
    F, f = _stack(tasks, p)
    best = least_squares(F, f, p.constraints, p.unit, p.x)
    if best is None:
        return Verdict("undecided", "no reference")
    return _compare(p.x, best, tasks, F, f, "weighted")


def judge_strict(p: Physical) -> Verdict:
    """Level by level, what is above held where the answer has it."""
    return _judge_levels(p, [list(level) for level in p.levels])


def judge_scaled(p: Physical) -> Verdict:
    """The same with a share for each kinematic task: first the directions, then the shares, then the others."""
    n = len(p.x)
    k = sum(task.asked is not None for level in p.levels for task in level)
    given_up, at = np.zeros(k), n
    stages: list[list[Rows]] = []
    for i, level in enumerate(p.levels):
        directions, shares, others = [], [], []
        for task in level:
            wide = task._replace(A=np.hstack([task.A, np.zeros((len(task.b), k))]))
            if task.asked is None:
                others.append(wide)
                continue
            # J x + drift = (1 − σ) asked, so that J x − wanted + σ asked = 0
            wide.A[:, at] = task.asked
            length = max(float((task.w * task.asked**2).sum()), 1e-12)
            left = task.A @ p.x - task.b
            given_up[at - n] = np.clip(-float((task.w * task.asked) @ left) / length, 0.0, 1.0)
            directions.append(wide._replace(name=f"direction of {task.name}"))
            # In the unit of the task beside one: any share is right of a task that asks for next to nothing.
            most = float(np.abs(task.asked).max(initial=0.0))
            unit = max(most / (1.0 + most), FEASIBLE)
            row, J = unit * np.eye(n + k)[[at]], np.hstack([task.A, np.zeros((len(task.b), k))])
            shares.append(Rows(f"share of {task.name}", row, np.zeros(1), np.array([length / unit**2]), moved=J))
            at += 1
        if directions:
            stages += [directions, shares]
        if others or i == len(p.levels) - 1:
            stages.append(others)
    zero, one = np.zeros(k), np.ones(k)
    return _judge_levels(
        Physical(
            p.constraints.wider(k), p.levels, np.append(p.diagonal, zero), np.append(p.centre, zero),
            np.append(p.unit, one), np.append(p.x, given_up),
        ),
        stages,
    )  # fmt: skip


def _judge_levels(p: Physical, levels: list[list[Rows]]) -> Verdict:
    c, x, found = p.constraints, p.x, Verdict("right")
    for k, level in enumerate(levels):
        if k == len(levels) - 1:
            F, f = _stack(level, p)
        else:
            heaviest = max(task.w.max(initial=0.0) for task in level) or 1.0
            roots = [np.sqrt(task.w / heaviest) for task in level]
            F = np.concatenate([root[:, None] * task.A for root, task in zip(roots, level, strict=True)])
            f = np.concatenate([root * task.b for root, task in zip(roots, level, strict=True)])
        best, place = least_squares(F, f, c, p.unit, x), f"level {k + 1}"
        verdict = Verdict("undecided", f"{place}: no reference") if best is None else _compare(
            x, best, level, F, f, place)  # fmt: skip
        if verdict.word == "wrong":
            return verdict
        if verdict.word == "undecided":
            found = verdict
        kept = [task.A for task in level] + [task.moved for task in level if task.moved is not None]
        E = np.concatenate([c.E, *kept])
        c = Constraints(E, np.concatenate([c.e, *(A @ x for A in kept)]), c.C, c.cl, c.cu)
    return found


def _stack(tasks: list[Rows], p: Physical) -> tuple[Mat, Vec]:
    """Rows and right sides of tasks and the diagonal cost; tasks on unknowns are in that already."""
    root = np.sqrt(p.diagonal)
    tasks = [task for task in tasks if not task.diagonal]
    F = np.concatenate([*(np.sqrt(task.w)[:, None] * task.A for task in tasks), np.diag(root)])
    f = np.concatenate([*(np.sqrt(task.w) * task.b for task in tasks), root * p.centre])
    return F, f


JUDGES = {"Weighted": judge_weighted, "Strict": judge_strict, "Scaled": judge_scaled}


def judge(control: wbc.Controller, command: wbc.Command, *, optimum: bool = True) -> Verdict:
    """One word for the table, and why: a tick keeps its limits and its certificate, and says so when it does not.

    An answer that is ok is compared with the oracle's if ``optimum``; else it is "certified". One that is not ok is
    called by its fallback level, with "feasible" where a point lies within all constraints.
    """
    level = control.level
    decided = command.v if level.order == 1 else command.tau if level.dynamics else command.a
    if not np.isfinite(np.concatenate([decided, command.q, command.v])).all():
        return Verdict("wrong", "not finite")
    if level.dynamics:
        low, high = control.plan.torque_range
        beyond = float(np.maximum(command.tau - high, low - command.tau).max(initial=0.0))
        if beyond > FEASIBLE:
            return Verdict("wrong", f"torque {beyond:.2g} N m beyond its limit")
    problem = read(control)
    if not command.status.ok:
        room = margin(problem.constraints)
        if command.status.name == "INFEASIBLE" and room > FEASIBLE:
            return Verdict("wrong", f"called infeasible, and a point is {room:.2g} inside all limits")
        feasible = ", feasible" if room > FEASIBLE else ""
        return Verdict(f"not ok: {command.fallback_level}{feasible}", f"{command.status}: {control.why}")
    if not command.certificate.ok:
        return Verdict("uncertified", str(command.certificate))
    excess = problem.constraints.excess(problem.x)
    if excess > FEASIBLE:
        return Verdict("wrong", f"a constraint is violated by {excess:.2g}")
    if not optimum:
        return Verdict("certified")
    c, rows = problem.constraints, control.plan.problem.n_range
    width = (c.cu - c.cl)[:rows]
    if ((width > 0.0) & (width < FEASIBLE)).any():  # the optimum depends on what is left open
        return Verdict("undecided", "a row is narrower than what counts as met")
    problem = problem._replace(constraints=c.as_met_by(problem.x))
    return JUDGES[type(control.hierarchy).__name__](problem)
