"""The certificate of a level, for answers that are not what the level comes to."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import wbc
from tasks import Position, Posture
from tests.families.hierarchies import FAMILIES, problem
from tests.qp.lexicographic.hierarchies import random_hierarchy
from wbc.qp.answer import Counts
from wbc.qp.certificate import Certificate
from wbc.qp.lexicographic.compiled.rank import decide, prove
from wbc.qp.lexicographic.compiled.space import Size
from wbc.qp.lexicographic.compiled.stage import conclude, fill
from wbc.qp.lexicographic.function import _level, _row_problem
from wbc.qp.lexicographic.parts import Stage
from wbc.qp.lexicographic.solver import LexicographicSolver, Report
from wbc.qp.rows import RowProblem
from wbc.qp.rows.compiled.work import SOLVED
from wbc.types import Status


def rows_of(levels: Any, lb: Any, ub: Any) -> tuple[RowProblem, list[Stage]]:
    """The rows of a hierarchy under bounds, and its levels."""
    named = [_level(i, *level) for i, level in enumerate(levels)]
    A, lo, hi = (np.concatenate([level[i] for level in named]) for i in range(3))
    rows, stages = _row_problem(A, lo, hi, np.cumsum([0] + [len(level[1]) for level in named]))
    rows.lb[: A.shape[1]], rows.ub[: A.shape[1]] = lb, ub
    return rows, [*stages, []]


def first_level(family, index: int) -> LexicographicSolver:
    """The first level of a drawn hierarchy, decided by itself."""
    drawn = problem(family, 77, index)
    levels = LexicographicSolver(*rows_of(drawn.levels, drawn.lb, drawn.ub), budget=40)
    fill(levels.staged.address)
    assert decide(levels._ranking.address, 0, True) == SOLVED
    return levels


def certificate(levels: LexicographicSolver) -> Certificate:
    """The certificate of the first level at the y in memory; once, as it takes the memory of what decided the level."""
    prove(levels._ranking.address, 0)
    return Report(levels.staged, levels._report.copy(), None)()[0].certificate


def residual(levels: LexicographicSolver) -> np.ndarray:
    """What the rows of the first level come to at the y in memory."""
    p = levels.staged.problem
    return p.G[levels.staged.rows[0]] @ p.x1


@pytest.mark.parametrize("family", FAMILIES[:4], ids=lambda family: family.__name__)
def test_an_answer_is_no_farther_from_the_least_than_its_certificate_says(family) -> None:
    """Whatever the answer is moved by, each row stays within the bound."""
    for index in range(25):
        levels = first_level(family, index)
        least = residual(levels)
        assert certificate(levels).ok
        for size in (1e-5, 1e-2):
            levels = first_level(family, index)
            p, rows = levels.staged.problem, levels.staged.rows[0]
            p.x[p.n_u :] += size * np.random.default_rng(index).normal(size=p.n_y)
            p.value[p.item(rows.start) : p.item(rows.stop)] = residual(levels)
            bounds = certificate(levels).bounds
            off = np.abs(residual(levels) - least)
            for name, place in levels.staged.parts[0].items():
                assert off[place].max(initial=0.0) <= bounds[name] * (1.0 + 1e-6) + 1e-9


def test_what_lower_levels_move_of_a_level_counts_in_its_certificate() -> None:
    """They may move a limit that pushes with no more than rounding, and with it the rows of the level."""
    found = 0
    for seed in range(20):
        solver = LexicographicSolver(*rows_of(*random_hierarchy(seed)), budget=40)
        assert solver.solve() in (Status.SOLVED, Status.INACCURATE)
        staged = solver.staged
        p, rng = staged.problem, np.random.default_rng(seed)
        before, moved = Report(staged, solver._report.copy(), None)(), 1e-3 * rng.normal(size=p.n_rows)
        p.value[p.item(0) : p.item(p.n_rows)] += moved
        conclude(staged.address)
        for k in range(solver.began, solver.ended):
            bounds = Report(staged, solver._report.copy(), None)()[k].certificate.bounds
            for name, place in staged.parts[k].items():
                most = np.abs(moved[staged.rows[k]][place]).max(initial=0.0)
                assert bounds[name] >= most + before[k].certificate.bounds[name] * (1.0 - 1e-9) > 0.0
                found += 1
    assert found >= 20


def test_every_level_that_is_decided_counts_once_and_takes_a_step_at_least() -> None:
    """However it is decided: with the first guess, with a few more, or by the finite method."""
    ways = Counts()
    for seed in range(60):
        solver = LexicographicSolver(*rows_of(*random_hierarchy(seed)), budget=40)
        counts, before = solver.counts, 0
        for _ in range(3):
            assert solver.solve() in (Status.SOLVED, Status.INACCURATE)
            assert solver.ended - solver.began < counts.total - before <= solver.iterations
            before = counts.total
        ways = Counts(ways.first + counts.first, ways.repaired + counts.repaired, ways.fallback + counts.fallback)
    assert min(ways.first, ways.repaired, ways.fallback) > 0


def test_the_working_set_that_the_core_finds_is_the_one_of_the_level() -> None:
    """Where guesses do not end, the core is asked, and as a rule once: what it holds is the next guess."""
    finds = [int(first_level(family, i)._memory._arrays[-1][Size.FINDS]) for family in FAMILIES for i in range(60)]
    asked = [count for count in finds if count > 0]
    assert len(asked) >= 15
    assert sum(count == 1 for count in asked) >= 0.85 * len(asked)


@pytest.mark.parametrize("hierarchy", [wbc.Strict(), wbc.Scaled()], ids=lambda hierarchy: type(hierarchy).__name__)
def test_each_row_of_the_stages_has_the_name_of_its_task(hierarchy: Any) -> None:
    """Tasks on joints, which have no rows in the problem of the stack, among them."""
    robot = wbc.load("arm")
    joints = Posture(robot.q0 + 0.3, name="joints")
    stack = wbc.Stack([[joints], [Position("tool", target=[0.4, 0.1, 0.5], name="hand")], [Posture(robot.q0)]])
    controller = wbc.Controller(robot, stack, level=wbc.VelocityLevel(), hierarchy=hierarchy)
    staged = controller.answering.staged
    assert len(staged.problem.rows) == staged.problem.n_rows + staged.problem.n
    for place, name in zip(staged.rows, ("joints", "hand"), strict=False):
        owners = {row.owner.removesuffix(": share") for row in staged.problem.rows[place]}
        assert owners == {name}, owners


@pytest.mark.parametrize("weight", [1.0, 1e-3])
def test_a_posture_that_is_not_at_its_optimum_is_not_certified(weight: float) -> None:
    """A task on joints in the last level has no rows: it is bounded by what is left in the metric."""
    robot = wbc.load("arm")
    crossed = [Position("tool", target=[0.4, y, 0.5], name=f"at {y}") for y in (0.1, 0.2)]
    stack = wbc.Stack([crossed, [Posture(robot.q0 + 0.3, weight=weight)]])
    controller = wbc.Controller(robot, stack, level=wbc.VelocityLevel(lm_damping=0.0), hierarchy=wbc.Strict())
    assert controller.tick(0.0, robot.q0, np.zeros(robot.nv)).certificate.ok
    levels = controller.answering
    p, address = levels.staged.problem, levels._ranking.address
    above = p.G[levels.staged.rows[0], : p.n]
    free = np.linalg.svd(above)[2][np.linalg.matrix_rank(above, tol=1e-9) :].T
    optimum = p.x.copy()
    for size in (1e-3, 1e-1):
        p.x[:] = optimum + free @ np.full(free.shape[1], size)
        prove(address, 1)
        distance = Report(levels.staged, levels._report.copy(), None)()[1].certificate.distance
        assert distance >= np.max(np.abs(p.x - optimum) * p.scale / (1.0 + np.abs(p.x * p.scale))) * (1.0 - 1e-6)


def test_a_level_that_bounds_hold_back_is_not_certified_without_their_pushes() -> None:
    found = 0
    for index in range(60):
        levels = first_level(FAMILIES[0], index)
        if np.abs(levels._push).max() > 1e-3:
            levels._side[:] = 0.0
            assert not certificate(levels).ok
            found += 1
    assert found > 10


def test_a_push_on_a_bound_that_is_not_met_is_no_proof() -> None:
    found = 0
    for index in range(60):
        levels = first_level(FAMILIES[0], index)
        p, held = levels.staged.problem, levels._places[levels._push > 1e-3]
        if len(held):
            p.upper[held] += 1.0
            assert not certificate(levels).ok
            found += 1
    assert found > 5
