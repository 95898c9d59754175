"""Weak motors and wild goals: what strict priorities come to where torques, friction and joints are at their limits.

Nothing is damped here: what a level comes to with its damping is judged in :mod:`tests.stack.test_damped`.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

import wbc
from tasks import CenterOfMass, JointVelocityLimits, Orientation, Position, Posture, Sole, TorqueLimits
from tests.families.oracle import Constraints, least_squares
from tests.seeds import generator
from tests.stack.conftest import feet
from wbc.models.pinocchio_ import PinocchioModel
from wbc.qp.rows import RowProblem

#: How much more than the least may be left of a level above the last, and of the last, beside 1 and what is left.
MORE, MORE_OF_THE_LAST = 1e-5, 1e-4
#: Who keeps the constraints and the levels above to no more than this is no witness: 1e-8 of them was seen to be worth
#: a sixth of the last level.
EXACT = 1e-9


def wild(robot: PinocchioModel, rng: np.random.Generator) -> wbc.Stack:
    """Two to four levels in random order, goals up to metres away, a part of the torque that there is."""
    state = robot.state()
    balance = [CenterOfMass(target=state.com + rng.normal(size=3) * rng.choice([0.02, 0.2, 1.0]), kp=100)]
    if rng.random() < 0.6:
        balance.append(Orientation(robot.frame_names[0], target=np.eye(3), kp=100))
    levels = [balance]
    for i in range(int(rng.integers(1, 3))):
        frame = robot.frame_names[int(rng.integers(len(robot.frame_names)))]
        away = rng.normal(size=3) * rng.choice([0.05, 0.5, 2.0])
        levels.append([Position(frame, target=state.frame(frame).position + away, kp=100, name=f"goal {i}")])
    levels = [levels[i] for i in rng.permutation(len(levels))]
    weak = TorqueLimits(float(rng.choice([0.2, 0.35, 0.6])) * robot.limits.tau_max)
    return wbc.Stack(
        [*levels, [Posture(robot.q0, kp=50, weight=1e-2)]],
        contacts=feet(robot), subject_to=[weak, JointVelocityLimits()],
    )  # fmt: skip


def rows_of_levels(problem: RowProblem) -> list[tuple[np.ndarray, np.ndarray]]:
    """‖A x − b‖ of each level: soft rows, and for the last one its metric too."""
    levels = []
    for tasks in problem.levels:
        rows = [problem.G[task.rows] * np.sqrt(task.weights)[:, None] for task in tasks if task.rows is not None]
        levels.append(np.concatenate(rows) if rows else np.zeros((0, problem.n + 1)))
    metric = np.zeros((problem.n_y, problem.n + 1))
    metric[:, problem.n_u : problem.n] = np.diag(np.sqrt(problem.metric))
    metric[:, problem.n] = -np.sqrt(problem.metric) * problem.centre
    levels[-1] = np.concatenate([levels[-1] / np.sqrt(problem.unit), metric])
    return [(rows[:, : problem.n], -rows[:, problem.n]) for rows in levels]


def cascade(problem: RowProblem, levels: list[tuple[np.ndarray, np.ndarray]]) -> list[float]:
    """The least that can be left of each level where those above come out as in the answer, r = A x − b an unknown.

    Solved level by level by methods that are not ours, ∞ where they find no proven answer. The first level has nothing
    above it, so if none is beyond its least, each is that of the exact cascade. Where a level above were what a method
    finds, 3e-9 of it that rounding leaves open can be worth 1e-5 of the level below.
    """
    n, G = problem.n, problem.G
    equal = np.concatenate([G[problem.base], G[problem.equal]])
    known, right, left = [equal[:, :n]], [-equal[:, n]], []
    low, high = problem.range_bounds()
    offset, unit = G[problem.range, n], 1.0 + np.abs(problem.x)
    bounded = np.vstack([G[problem.range, :n], np.eye(n)])
    sides = np.append(low - offset, problem.lb), np.append(high - offset, problem.ub)
    for A, b in levels:
        kept = Constraints(np.concatenate(known), np.concatenate(right), bounded, *sides)
        best = least_squares(A, b, kept.as_met_by(problem.x), unit, problem.x)
        exact = best is not None and best.proved and kept.excess(best.x) <= EXACT
        left.append(float(np.linalg.norm(A @ best.x - b)) if best is not None and exact else np.inf)
        known.append(A)
        right.append(A @ problem.x)
    return left


def more(mine: list[float], least: list[float]) -> list[int]:
    """At which levels more is left than the least."""
    shares = [*[MORE] * (len(mine) - 1), MORE_OF_THE_LAST]
    beyond = [got - best - share * (1.0 + best) for got, best, share in zip(mine, least, shares, strict=True)]
    return [i for i, excess in enumerate(beyond) if excess > 0.0]


def compare(
    robot: PinocchioModel, seeds: range, *, ticks: int, every: int, without: list[tuple[int, int]] | None = None
) -> tuple[int, list[tuple[object, ...]]]:
    """Let wild stacks run, and set them against the cascade now and then: how many levels that tells of, and which of
    them have more left than the least. ``without`` gets the ticks without a certificate; where it is None, there must
    be none."""
    told, beyond = 0, list[tuple[object, ...]]()
    for seed in seeds:
        for k, mine, known in _levels_of_a_run(robot, seed, ticks, every, without):
            told += int(np.isfinite(known).sum())
            beyond += [(seed, k, level, mine, known) for level in more(mine, known)]
    return told, beyond


def _levels_of_a_run(
    robot: PinocchioModel, seed: int, ticks: int, every: int, without: list[tuple[int, int]] | None = None
) -> Iterator[tuple[int, list[float], list[float]]]:
    stack, level = wild(robot, np.random.default_rng(seed)), wbc.InverseDynamics(lm_damping=0.0)
    controller = wbc.Controller(robot, stack, level=level, hierarchy=wbc.Strict())
    q, v = robot.q0, np.zeros(robot.nv)
    for k in range(ticks):
        command = controller.tick(1e-3 * k, q, v)
        if command.status is wbc.Status.INFEASIBLE:
            break  # the joints are too fast for motors this weak
        if not command.status.ok and without is not None:
            without.append((seed, k))
            q, v = command.q, command.v
            continue
        assert command.status.ok and command.certificate.ok, (seed, k)
        assert {level.how for level in command.levels} <= {"optimal", "met"}, (seed, k, command.levels)
        problem = controller.plan.problem
        levels = rows_of_levels(problem)
        if k % every == 0:
            yield k, [float(np.linalg.norm(A @ problem.x - b)) for A, b in levels], cascade(problem, levels)
        q, v = command.q, command.v


def test_a_saturated_quadruped_keeps_its_ranks_as_exactly_as_the_cascade(quadruped: PinocchioModel) -> None:
    told, beyond = compare(quadruped, range(16), ticks=6, every=5)
    assert told >= 45 and not beyond, beyond


def test_a_saturated_humanoid_keeps_its_ranks_as_exactly_as_the_cascade(humanoid: PinocchioModel) -> None:
    told, beyond = compare(humanoid, range(16), ticks=4, every=3)
    assert told >= 24 and not beyond, beyond


def test_rounding_of_hard_pushes_leaves_no_level_at_its_optimum_without_a_certificate(
    quadruped: PinocchioModel,
) -> None:
    """Seed 1131: limits push with thousands, and the optimum of a level is a thousand from its centre."""
    for seed in range(1120, 1140):
        for _ in _levels_of_a_run(quadruped, seed, ticks=1, every=2):
            pass  # it asserts that each tick is certified


def test_a_level_whose_rows_hardly_move_is_certified_whatever_rounding_makes_of_its_slope(
    humanoid: PinocchioModel,
) -> None:
    """Seed 1123, tick 7: along what the level above hardly takes, a slope of 1e-7 beside a residual of 133."""
    for _ in _levels_of_a_run(humanoid, 1123, ticks=9, every=9):
        pass  # it asserts that each tick is certified


def test_a_limit_that_pushes_a_little_holds_its_level_back(humanoid: PinocchioModel) -> None:
    """Seed 1124: thirty limits are held, one of them with a millionth of what others push; let go, it moves far."""
    told, beyond = compare(humanoid, range(1124, 1125), ticks=1, every=1)
    assert told == 3 and not beyond, beyond


def test_a_level_that_costs_those_above_is_decided_again(humanoid: PinocchioModel) -> None:
    """Seed 1030: limits that push with little more than rounding are let go, and held where that costs too much."""
    for _ in _levels_of_a_run(humanoid, 1030, ticks=21, every=21):
        pass  # it asserts that each tick is certified


def test_soles_that_slide_or_tip_hardly_ever_leave_strict_levels_without_an_answer(humanoid: PinocchioModel) -> None:
    """Corners without force are where five rows of friction meet; rounding must not lead in circles."""
    rng, robot, without = generator("soles that slide or tip"), humanoid, 0
    level = wbc.InverseDynamics(lm_damping=0.0)
    for side in ([0.3, 0.2, 0.1], [-0.5, 0.1, 0.0]):
        away = CenterOfMass(target=robot.state().com + side, kp=100)
        stands = [Sole(frame, half_size=(0.11, 0.05), friction=0.5, friction_model="outer") for frame in robot.feet]
        stack = wbc.Stack(
            [[away], [Posture(robot.q0, kp=10, weight=1e-2)]],
            contacts=stands, subject_to=[TorqueLimits(), JointVelocityLimits()],
        )  # fmt: skip
        controller = wbc.Controller(robot, stack, level=level, hierarchy=wbc.Strict())
        for _ in range(300):
            turn = rng.normal(size=robot.nv) * ([0.01] * 6 + [0.1] * robot.nj)
            controller.reset()
            command = controller.tick(0.0, robot.integrate(robot.q0, turn), 0.1 * rng.normal(size=robot.nv))
            without += command.fallback_level != "solved"
    assert without <= 3


@pytest.mark.deep
@pytest.mark.parametrize("name", ["quadruped", "humanoid"])
def test_of_a_thousand_saturated_levels_at_most_one_has_more_left_than_the_least(name: str) -> None:
    """One tick in three thousand has no certificate: limits meet in a point, and rounding decides which ones push."""
    without = list[tuple[int, int]]()
    told, beyond = compare(wbc.load(name), range(1000, 1150), ticks=31, every=10, without=without)
    assert told > 1700 and len(beyond) <= 1, beyond
    assert len(without) <= 2, without
