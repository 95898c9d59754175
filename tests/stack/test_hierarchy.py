"""One stack under three hierarchies: weights add up, strict levels never degrade, scaled tasks keep their course."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tasks as T
import wbc
from tests.families.legs import draw
from tests.stack.conftest import feet, moving
from wbc.methods import NullSpaceSaturation
from wbc.models.pinocchio_ import PinocchioModel

SEEDS = st.integers(0, 10**6)
ARM = wbc.load("arm")
HUMANOID = wbc.load("humanoid")
SPEED = wbc.VelocityLevel()


def tick(robot: PinocchioModel, stack: wbc.Stack, seed: int = 3, **settings: Any) -> tuple[Any, wbc.Controller]:
    controller = wbc.Controller(robot, stack, dt=0.01, **({"level": SPEED} | settings))
    return controller.tick(0.0, *moving(robot, seed)), controller


def residual(controller: wbc.Controller, name: str) -> np.ndarray:
    """Wanted − got of one task's rows, in the last tick."""
    problem = controller.plan.problem
    task = next(task for level in problem.levels for task in level if task.name == name)
    return problem.G[task.rows] @ problem.x1


def two_goals(seed: int, *, heavy: float = 1.0, levels: int = 3) -> wbc.Stack:
    """A tool and an elbow that cannot be where both are wanted, and a posture: below the elbow, or beside it."""
    rng = np.random.default_rng(seed)
    first = T.Position("tool", target=rng.normal(size=3), weight=heavy)
    second = T.Position(ARM.frame_names[-3], target=rng.normal(size=3), name="second")
    limits = [T.JointVelocityLimits(float(rng.uniform(0.3, 3.0)))]
    posture = T.Posture(ARM.q0, weight=1e-4)
    ranked = [[first], [second], [posture]] if levels == 3 else [[first], [second, posture]]
    return wbc.Stack(ranked, subject_to=limits)


# ---- strict
@given(seed=SEEDS)
def test_strict_priority_is_the_limit_of_weights_as_their_ratio_grows(seed: int) -> None:
    """Property 24. What has one weight among the others in the limit has one level in the hierarchy."""
    command, controller = tick(ARM, two_goals(seed, levels=2), hierarchy=wbc.Strict())
    best = np.linalg.norm(residual(controller, "Position[tool]"))
    errors, distances = [], []
    for ratio in (1e0, 1e2, 1e4, 1e6):
        weighted, other = tick(ARM, two_goals(seed, heavy=ratio))
        errors.append(np.linalg.norm(residual(other, "Position[tool]")))
        distances.append(np.abs(weighted.v - command.v).max())
    assert command.status.ok
    assert (np.diff(errors) <= 1e-7).all(), "a heavier task is never done worse"
    assert best <= errors[-1] + 1e-6
    assert errors[-1] - best <= 1e-3 * (errors[0] - best) + 1e-5
    assert distances[-1] <= 1e-2 * distances[0] + 1e-3


@given(seed=SEEDS)
def test_a_stack_is_the_hierarchy_of_its_rows(seed: int) -> None:
    stack = two_goals(seed)
    command, controller = tick(ARM, stack, hierarchy=wbc.Strict())
    problem = controller.plan.problem
    levels = []
    for tasks in problem.levels[:-1]:
        A = np.concatenate([problem.G[task.rows, : problem.n] for task in tasks])
        b = np.concatenate([task.wanted for task in tasks])
        levels.append((A, b, b))
    posture = problem.levels[-1][0].wanted
    levels.append((np.eye(ARM.nj), posture, posture))
    exact = wbc.lexicographic(levels, lb=problem.lb, ub=problem.ub).x
    for A, b, _ in levels[:-1]:
        assert abs(np.linalg.norm(A @ command.v - b) - np.linalg.norm(A @ exact - b)) < 1e-5
    np.testing.assert_allclose(command.v, exact, atol=1e-3)


@pytest.mark.parametrize("solver", ["daqp", "proxqp", "clarabel"])
@pytest.mark.parametrize("seed", range(4))
def test_any_solver_gives_the_same_answer_level_by_level(solver: str, seed: int) -> None:
    mine, _ = tick(ARM, two_goals(seed), hierarchy=wbc.Strict())
    other, controller = tick(ARM, two_goals(seed), hierarchy=wbc.Strict(), solver=solver)
    assert other.status.ok and controller.form == "levels"
    np.testing.assert_allclose(other.v, mine.v, atol=2e-3)


def standing(reach: float, *, hand: bool = True) -> wbc.Stack:
    """Balance above all, then a hand ``reach`` [m] ahead of where it is, then the stance."""
    state = HUMANOID.state()
    balance = [
        T.CenterOfMass(target=state.com, kp=100),
        T.Orientation("torso", target=np.array(state.frame("torso").rotation), kp=100),
    ]
    goal = state.frame("left_hand").position + np.array([reach, 0.0, 0.0])
    hands = [[T.Position("left_hand", target=goal, kp=100)]] if hand else []
    return wbc.Stack(
        [balance, *hands, [T.Posture(HUMANOID.q0, kp=10, weight=1e-3)]],
        contacts=feet(HUMANOID), subject_to=[T.TorqueLimits(), T.JointVelocityLimits()],
    )  # fmt: skip


@pytest.mark.parametrize("reach", [0.02, 0.5, 3.0])
def test_balance_is_not_given_up_for_a_hand_that_cannot_reach(reach: float) -> None:
    dynamics = {"level": wbc.InverseDynamics(), "hierarchy": wbc.Strict()}
    command, controller = tick(HUMANOID, standing(reach), seed=0, **dynamics)
    alone, without = tick(HUMANOID, standing(reach, hand=False), seed=0, **dynamics)
    assert command.status.ok and alone.status.ok and command.certificate.ok
    for task in ("CenterOfMass", "Orientation[torso]"):
        np.testing.assert_allclose(residual(controller, task), residual(without, task), atol=1e-6)
    assert command.solution.certificate.residual <= 1e-5
    _, other = tick(HUMANOID, standing(3.0), seed=0, level=wbc.InverseDynamics())
    assert np.linalg.norm(residual(other, "CenterOfMass")) > 1.0


def test_levels_that_can_all_be_met_cost_one_qp_and_the_first_guess() -> None:
    controller = wbc.Controller(HUMANOID, standing(0.0), level=wbc.InverseDynamics(), hierarchy=wbc.Strict())
    q, v = HUMANOID.q0, np.zeros(HUMANOID.nv)
    for k in range(20):
        command = controller.tick(1e-3 * k, q, v)
        assert [outcome.how for outcome in command.levels] == ["met", "met", "optimal"]
        assert controller.iterations == 1
        q, v = command.q, command.v
    assert controller.counts.first == 20


def test_a_budget_that_ends_early_leaves_the_lower_levels_where_they_are() -> None:
    hows = {}
    for budget in (1, 2, 3, 9):
        command, controller = tick(ARM, two_goals(2), hierarchy=wbc.Strict(budget=budget))
        hows[budget] = [outcome.how for outcome in command.levels]
        proved = [outcome.certificate.ok for outcome in command.levels]
        decided = [how in ("met", "optimal") for how in hows[budget]]
        assert proved == decided
        assert command.status.ok == all(decided)
        assert command.fallback_level == ("solved" if all(decided) else hows[budget][-1])
        assert (np.abs(command.v) <= controller.plan.problem.ub + 1e-9).all()
        assert str(command.levels[-1]) in controller.explain()
    assert hows[1] == ["weighted fallback"] * 3
    assert "not optimised" in hows[2] or "not optimised" in hows[3]
    assert hows[9] == ["optimal", "optimal", "optimal"] or hows[9][0] == "met"
    exit_, _ = tick(ARM, two_goals(2), hierarchy=wbc.Strict(budget=1))
    weighted, _ = tick(ARM, two_goals(2))
    np.testing.assert_allclose(exit_.v, weighted.v, rtol=0.0, atol=1e-12)


def test_constraints_that_contradict_each_other_are_infeasible_and_braked() -> None:
    constraints = [T.Position("tool", target=np.zeros(3)).exactly(name=name) for name in ("here", "there")]
    constraints[1].task.target = np.ones(3)
    stack = wbc.Stack([[T.Position(ARM.frame_names[-3], target=np.ones(3))],
                       [T.Posture(ARM.q0)]], subject_to=[*constraints, T.JointVelocityLimits()])  # fmt: skip
    command, _ = tick(ARM, stack, hierarchy=wbc.Strict())
    assert command.status is wbc.Status.INFEASIBLE
    assert np.isfinite(command.v).all()


def test_a_posture_above_a_task_is_what_counts() -> None:
    goal = T.Position("tool", target=np.ones(3))
    stack = wbc.Stack([[T.Posture(ARM.q0, rate=2.0)], [goal]])
    command, controller = tick(ARM, stack, hierarchy=wbc.Strict())
    q, _ = moving(ARM, 3)
    np.testing.assert_allclose(command.v, 2.0 * (ARM.q0 - q), atol=1e-6)
    assert [outcome.how for outcome in command.levels] == ["met", "optimal"]
    assert "Posture: met" in controller.explain()


def test_a_task_on_torques_can_rank_above_one_on_motion() -> None:
    tau = np.zeros(ARM.nj)
    stack = wbc.Stack([[T.Torque(tau)], [T.Posture(ARM.q0)]])
    command, _ = tick(ARM, stack, hierarchy=wbc.Strict(), level=wbc.InverseDynamics())
    np.testing.assert_allclose(command.tau, tau, atol=1e-5)


@pytest.mark.parametrize("regularisation", [1e-3, 1e-1])
@pytest.mark.parametrize("name", ["quadruped", "humanoid"])
def test_what_levels_leave_free_has_the_least_cost_of_motion_torques_and_forces(
    name: str, regularisation: float
) -> None:
    """No limit is active, so the last level is a linear system: its cost under the levels above as equalities."""
    robot = wbc.load(name)
    state = robot.state()
    state.update(0.0, robot.q0, np.zeros(robot.nv))
    two = [T.CenterOfMass(target=state.com + np.array([x, 0.0, 0.0]), kp=10.0, name=f"to {x}") for x in (0.01, -0.02)]
    stack = wbc.Stack([two, [T.Posture(robot.q0)]], contacts=feet(robot), subject_to=[T.TorqueLimits()])
    level = wbc.InverseDynamics(regularisation=regularisation)
    controller = wbc.Controller(robot, stack, level=level, hierarchy=wbc.Strict())
    command = controller.tick(0.0, robot.q0, np.zeros(robot.nv))
    assert command.status.ok and not controller.active_count
    qp = controller.qp
    system = np.block([[qp.H, qp.A.T], [qp.A, np.zeros((qp.n_eq, qp.n_eq))]])
    least = np.linalg.lstsq(system, np.concatenate([-qp.g, qp.b]))[0][: qp.n]
    np.testing.assert_allclose(command.solution.x, least, atol=1e-8)


def test_a_soft_constraint_is_an_inequality_at_its_level() -> None:
    goal = T.Position("tool", target=np.array([2.0, 0.0, 0.0]), rate=5.0)
    slow = T.JointVelocityLimits(0.1).softly()
    above, _ = tick(ARM, wbc.Stack([[slow], [goal], [T.Posture(ARM.q0, weight=1e-4)]]), hierarchy=wbc.Strict())
    below, controller = tick(ARM, wbc.Stack([[goal], [slow], [T.Posture(ARM.q0, weight=1e-4)]]), hierarchy=wbc.Strict())
    hard, _ = tick(
        ARM, wbc.Stack([[goal], [T.Posture(ARM.q0, weight=1e-4)]], subject_to=[T.JointVelocityLimits(0.1)]),
        hierarchy=wbc.Strict(),
    )  # fmt: skip
    assert np.abs(above.v).max() <= 0.1 + 1e-6
    np.testing.assert_allclose(above.v, hard.v, atol=1e-4)
    assert np.linalg.norm(residual(controller, "Position[tool]")) < 1e-5
    assert np.abs(below.v).max() > 0.1


# ---- scaled
@given(seed=SEEDS)
def test_scaled_tasks_are_saturation_in_the_null_space_level_by_level(seed: int) -> None:
    rng = np.random.default_rng(seed)
    speed = float(rng.uniform(0.1, 1.0))
    goals = [rng.normal(size=3), rng.normal(size=3)]
    first, second = T.Position("tool", target=goals[0]), T.Position(ARM.frame_names[-3], target=goals[1], name="second")
    stack = wbc.Stack([[first], [second]], subject_to=[T.JointVelocityLimits(speed)])
    command, controller = tick(ARM, stack, hierarchy=wbc.Scaled())
    problem = controller.plan.problem
    rows = [(problem.G[task.rows, : ARM.nv].copy(), task.wanted.copy()) for (task,) in problem.levels]
    known = NullSpaceSaturation.prioritised(rows, lower=-speed, upper=speed).solve("pdas")
    assert command.status.ok
    J, wanted = rows[0]
    np.testing.assert_allclose(J @ command.v, known.scales[0] * wanted, atol=1e-4 * np.linalg.norm(wanted))
    if known.scales[0] == 1.0 and known.scales[1] is not None:
        J, wanted = rows[1]
        np.testing.assert_allclose(J @ command.v, known.scales[1] * wanted, atol=1e-3 * np.linalg.norm(wanted))


@given(seed=SEEDS)
def test_what_a_scaled_task_gives_up_costs_its_weight_and_nothing_more(seed: int) -> None:
    """min ½ w (1 − s)² ‖t‖² + ½ ω ‖v − p‖²  subject to  J v = s t, 0 ≤ s ≤ 1, by the conditions of optimality alone."""
    rng = np.random.default_rng(seed)
    heavy, light = 10.0 ** rng.uniform(-2.0, 2.0, 2)
    goal = T.Position("tool", target=rng.normal(size=3), weight=heavy).scaled()
    command, controller = tick(ARM, wbc.Stack([goal, T.Posture(rng.normal(size=ARM.nj), weight=light)]))
    problem, n = controller.plan.problem, ARM.nv
    (reach, posture) = problem.levels[0]
    J, t, p = problem.G[reach.rows, :n], reach.wanted, posture.wanted
    found = np.zeros(n + 1)
    for fixed in (None, 0.0, 1.0):  # the cost is convex in s: where its least is outside, the nearer end is
        held = np.zeros((0 if fixed is None else 1, n + 1))
        held[:, n] = 1.0
        rows, sides = np.vstack([np.column_stack([J, -t]), held]), np.append(np.zeros(3), [fixed] * len(held))
        H = np.diag(np.append(np.full(n, light), heavy * t @ t))
        g = -np.append(light * p, heavy * t @ t)
        system = np.block([[H, rows.T], [rows, np.zeros((len(rows), len(rows)))]])
        end = np.linalg.solve(system, np.append(-g, sides.astype(float)))[: n + 1]
        if fixed is None:
            found, wanted = end, float(np.clip(end[n], 0.0, 1.0))
        elif found[n] != wanted and fixed == wanted:
            found = end
    assert command.status.ok
    np.testing.assert_allclose(command.v, found[:n], atol=1e-5 * (1.0 + np.abs(found[:n]).max()))
    assert {"Posture", "share of Position[tool]"} <= {*command.certificate.bounds}


@pytest.mark.parametrize("hierarchy", [wbc.Weighted(), wbc.Strict(), wbc.Scaled()], ids=str)
@pytest.mark.parametrize("level", [SPEED, wbc.AccelerationLevel(), wbc.InverseDynamics()], ids=lambda level: level.name)
def test_a_scaled_task_keeps_its_direction_at_every_level_under_every_hierarchy(hierarchy, level) -> None:
    goal = T.Position("tool", target=np.array([1.0, 1.0, 1.0]), kp=400).scaled()
    limits = [T.JointVelocityLimits(0.3), T.JointPositionLimits()]
    stack = wbc.Stack([goal, T.Posture(ARM.q0, weight=1e-4)], subject_to=limits)
    command, controller = tick(ARM, stack, hierarchy=hierarchy, level=level)
    task = controller.plan.problem.levels[0][0]
    asked = task.wanted + task.drift
    got = residual(controller, goal.name) + asked
    share = got @ asked / (asked @ asked)
    assert command.status.ok
    assert -1e-9 < share < 0.9
    np.testing.assert_allclose(got, share * asked, atol=1e-5 * np.linalg.norm(asked))
    assert "scaled" in repr(stack)


def test_within_reach_the_three_hierarchies_do_the_same_task() -> None:
    stack = wbc.Stack([[T.Position("tool", target=[0.5, 0.1, 0.4], rate=0.1)], [T.Posture(ARM.q0, weight=1e-6)]])
    for hierarchy in (wbc.Weighted(), wbc.Strict(), wbc.Scaled()):
        _, controller = tick(ARM, stack, hierarchy=hierarchy)
        assert np.linalg.norm(residual(controller, "Position[tool]")) < 1e-3


@pytest.mark.parametrize("level", [wbc.VelocityLevel(lm_damping=0.0), wbc.InverseDynamics(lm_damping=0.0)])
@given(seed=SEEDS, exponents=st.tuples(*[st.floats(-14.0, 6.0)] * 2))
def test_the_weight_of_a_task_that_is_alone_at_its_level_changes_nothing(level, seed: int, exponents) -> None:
    """Neither the command nor what is said of each level: a light task that is done in part is not met."""
    found = []
    for first, second in ((1.0, 1.0), tuple(10.0**exponent for exponent in exponents)):
        rng = np.random.default_rng(seed)
        limits = [T.JointVelocityLimits(float(rng.uniform(0.1, 1.0)))]
        levels = [
            [T.Position("tool", target=rng.normal(size=3), kp=float(10.0 ** rng.uniform(0, 2)), weight=first)],
            [T.Position(ARM.frame_names[-3], target=rng.normal(size=3), name="second", weight=second)],
            [T.Posture(ARM.q0)],
        ]
        stack = wbc.Stack(levels, subject_to=limits)
        command, controller = tick(ARM, stack, hierarchy=wbc.Scaled(), level=level)
        assert command.status.ok
        found.append((command.v, [outcome.how for outcome in controller.levels]))
    (v, how), (lighter, of_lighter) = found
    np.testing.assert_allclose(lighter, v, atol=1e-6 * (1.0 + np.abs(v).max()))
    assert of_lighter == how


# ---- settings
@pytest.mark.parametrize("seed", [301000947, *range(6)])
def test_levels_remember_no_bound_of_the_tick_before(seed: int) -> None:
    """What held a level back is one value in the last level's problem, and in that of this tick alone."""
    controller, q, v, _ = draw(seed)
    hierarchy = wbc.Scaled()
    solver = hierarchy.open(controller.plan.problem, controller.solver)
    for k in range(3):
        command = controller.tick(1e-3 * k, q, v)
        fresh = hierarchy.open(controller.plan.problem, controller.solver)
        if fresh.solve().ok and solver.solve().ok:
            for mine, other in zip(solver.report(), fresh.report(), strict=True):
                assert mine.residual == pytest.approx(other.residual, rel=1e-6, abs=1e-6)
        q, v = command.q, command.v


def test_one_level_is_a_weighted_sum_under_every_hierarchy() -> None:
    stack = wbc.Stack([T.Posture(ARM.q0)], subject_to=[T.JointVelocityLimits()])
    answers = [tick(ARM, stack, hierarchy=hierarchy)[0] for hierarchy in (wbc.Weighted(), wbc.Strict(), wbc.Scaled())]
    assert all(answer.levels == () for answer in answers)
    for answer in answers[1:]:
        np.testing.assert_array_equal(answer.v, answers[0].v)


# ---- long runs
@pytest.mark.slow
@pytest.mark.parametrize("reach", [0.8, 1.0, 1.3])
def test_thousands_of_ticks_of_conflict_without_one_failure(reach: float) -> None:
    controller = wbc.Controller(HUMANOID, standing(reach), level=wbc.InverseDynamics(), hierarchy=wbc.Strict())
    q, v = HUMANOID.q0, np.zeros(HUMANOID.nv)
    conflicts = 0
    for k in range(3_000):
        command = controller.tick(1e-3 * k, q, v)
        assert command.status.ok, f"tick {k}: {command.status}\n{controller.explain()}"
        conflicts += any(outcome.how != "met" for outcome in command.levels[:-1])
        q, v = command.q, command.v
    assert conflicts > 1_500


@pytest.mark.parametrize("hierarchy", [wbc.Strict(), wbc.Scaled()], ids=["strict", "scaled"])
@pytest.mark.parametrize("switched_off", [{"active": False}, {"weight": 0.0}, {"weight": [0.0] * 7}])
def test_a_task_without_weight_asks_for_nothing_at_its_level(hierarchy, switched_off):
    """Above others it was held as if it had one; in both orders, and from one tick to the next."""
    robot = ARM
    posture, tool = T.Posture(robot.q0 + 0.3), T.Position("tool", target=[0.4, 0.2, 0.4])
    alone = wbc.Controller(robot, wbc.Stack([[tool], [T.Damping()]]), level=SPEED, hierarchy=hierarchy)
    wanted = alone.tick(0.0, robot.q0, np.zeros(7)).v
    for levels in ([[posture], [tool], [T.Damping()]], [[tool], [posture], [T.Damping()]]):
        posture.active, posture.weight = True, 1.0
        controller = wbc.Controller(robot, wbc.Stack(levels), level=SPEED, hierarchy=hierarchy)
        assert np.abs(controller.tick(0.0, robot.q0, np.zeros(7)).v - wanted).max() > 0.1
        for name, value in switched_off.items():
            setattr(posture, name, value)
        controller.reset()  # the damping of what could not be reduced before
        command = controller.tick(0.0, robot.q0, np.zeros(7))
        assert command.status.ok
        np.testing.assert_allclose(command.v, wanted, atol=1e-6)


def test_what_a_scaled_task_gives_up_is_said_in_percent() -> None:
    start = ARM.state().frame("tool").position
    forward, back = (T.Position("tool", target=start + way * np.eye(3)[0], name=name)
                     for name, way in (("forward", 0.1), ("back", -0.1)))  # fmt: skip
    stack = wbc.Stack([[forward], [back], [T.Posture(ARM.q0)]], subject_to=[T.JointVelocityLimits()])
    controller = wbc.Controller(ARM, stack, level=SPEED, dt=0.01, hierarchy=wbc.Scaled())
    controller.tick(0.0, ARM.q0, np.zeros(7))
    assert "  back: 100 % of what its gains ask for is given up; multiplier 0.759 per 100 %" in controller.explain()
