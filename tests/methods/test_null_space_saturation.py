"""Saturation in the null space: largest scale, least norm; of several tasks each takes nothing from those above."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.optimize import linprog, nnls

from tests.methods.problems import check_on_every_solver, scaled_tasks
from wbc import qp
from wbc.errors import SolverFailed
from wbc.methods import NullSpaceSaturation
from wbc.models import PlanarPR
from wbc.qp.solvers import usable
from wbc.testing import check_method
from wbc.testing.strategies import jacobians, magnitudes, vectors
from wbc.tolerances import SHARP

INF = np.inf
ANY = scaled_tasks()
AT_REST = scaled_tasks(drift=False)


def changed(task: NullSpaceSaturation, **new: object) -> NullSpaceSaturation:
    """The same task with other arguments."""
    arguments = {"J": task.J, "target": task.target, "lower": task.lower, "upper": task.upper, "drift": task.drift}
    return NullSpaceSaturation(**(arguments | new))  # type: ignore[arg-type]


def scaled_rows(task: NullSpaceSaturation) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """V x + d = s w with independent rows V of unit length, as scipy's solvers need them."""
    U, values, V = np.linalg.svd(task.J)
    rank = int((values > 1e-12 * values.max(initial=0.0)).sum())
    inverse = U[:, :rank].T / values[:rank, None]
    return V[:rank], inverse @ task.target, inverse @ task.drift


def largest_scale(task: NullSpaceSaturation) -> float | None:
    """By scipy's simplex: shares no code with the method. A task that is small beside its drift may move x by less than
    what it takes for met by default, 1e-7."""
    V, w, d = scaled_rows(task)
    length = float(np.linalg.norm(w)) or 1.0
    n = V.shape[1]
    answer = linprog(
        np.append(np.zeros(n), -1.0), A_eq=np.column_stack([V, -w / length]), b_eq=-d,
        bounds=[*zip(task.lower, task.upper, strict=True), (0.0, length)], method="highs-ds",
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )  # fmt: skip
    return float(answer.x[-1]) / length if answer.status == 0 else None


# ---- closed form and QP
def test_closed_form_and_all_solvers_agree():
    """Property 17, first half."""
    check_on_every_solver(ANY)


@given(AT_REST)
def test_the_scale_is_that_of_the_linear_program(task: NullSpaceSaturation):
    """Property 17, second half: the task is done whole exactly where the linear program says so."""
    expected = largest_scale(task)
    assume(expected is not None)
    for found in (task.closed_form(), task.solve()):
        assert found.feasible
        assert found.scale == pytest.approx(expected, abs=1e-7)


@given(scaled_tasks(drift=True, deficient=False))
def test_with_a_drift_some_tasks_admit_no_scale(task: NullSpaceSaturation):
    """A limit counts as met where it is exceeded by less than 1e-8 of what it limits: beside a large drift a little
    is a large part of a small target, or tells whether there is a scale at all."""
    known = np.where(np.isfinite([task.lower, task.upper]), np.abs([task.lower, task.upper]), 0.0).max(axis=0)
    little = 1e-8 * np.maximum(known, 1e-2 * (np.linalg.norm(known) + np.linalg.norm(scaled_rows(task)[2])))
    found, least = task.closed_form(), largest_scale(task)
    most = largest_scale(changed(task, lower=task.lower - little, upper=task.upper + little))
    if found.feasible:
        assert most is not None
        assert (least or 0.0) - 1e-7 <= found.scale <= most + 1e-7
    else:
        assert least is None
        assert np.isnan(found.x).all() and np.isnan(found.scale) and found.saturated == ()


def test_a_limit_that_costs_the_same_at_two_prices_is_still_priced_away():
    """At the first prices the whole task is worth a way beyond a limit, and the way is the same at both."""
    J = np.array([
        [0.23412811, 0.0661407, -0.35739172, -0.13949336, -0.14821682, 1.0],
        [-0.47252019, 0.04707015, 0.3014942, -0.05870139, -0.2311994, 1.0],
        [0.00441287, -0.0374412, -0.49561017, 0.48182863, 0.27727238, 0.0],
        [-0.13891116, 0.12101784, -0.5825604, 0.20668714, -0.34820353, 1.0],
        [0.51620014, -0.25161551, 0.11268129, 0.2264113, -0.51985734, 0.0],
    ])  # fmt: skip
    target = np.array([-53.50954703, 45.29473501, -74.39768749, -87.2025331, 16.52477088])
    task = NullSpaceSaturation(
        J, target, lower=[-1.0, -1.0, -1.0, -0.1, -1.0, -1.0], upper=[1.0, 1.0, 1000.0, 1.0, 1.0, 1.0]
    )
    assert task.solve().scale == pytest.approx(largest_scale(task), abs=1e-7)


@given(ANY)
def test_limits_hold_and_the_task_is_done_to_scale(task: NullSpaceSaturation):
    """Property 16."""
    V, w, d = scaled_rows(task)
    for found in (task.solve(), task.closed_form()):
        if not found.feasible:
            continue
        range_ = np.where(np.isfinite([task.lower, task.upper]), np.abs([task.lower, task.upper]), 0.0).max(axis=0)
        length = np.linalg.norm(found.x) + np.linalg.norm(d)
        assert (np.maximum(found.x - task.upper, task.lower - found.x) <= 1e-9 * (range_ + length) + 1e-13).all()
        assert np.linalg.norm(V @ found.x + d - found.scale * w) <= 1e-9 * length + 1e-13
        assert 0.0 <= found.scale <= 1.0


@given(ANY)
def test_no_other_way_to_do_the_task_to_its_scale_is_shorter(task: NullSpaceSaturation):
    """Oracle: x = Vᵀ y − up + down with up, down ≥ 0 at limits, found by scipy's non-negative least squares. So every
    other x inside the limits with the same V x is longer: x is off the shortest by no more than is left unexplained."""
    found, (V, w, d) = task.closed_form(), scaled_rows(task)
    length, asked = float(np.linalg.norm(found.x)), float(np.linalg.norm(w) + np.linalg.norm(d))
    assume(found.feasible and length > 1e-9 * asked > 0.0)
    x, eye = found.x / length, np.eye(len(found.x))
    at_upper, at_lower = task.upper / length - x <= 1e-9, x - task.lower / length <= 1e-9
    assert nnls(np.hstack([V.T, -V.T, -eye[:, at_upper], eye[:, at_lower]]), x)[1] <= 1e-7


# ---- acceleration level, time
ROBOT = PlanarPR(m1=1, m2=1, l2=0.5, d2=0.25, I2=0.1)
angles, speeds = st.floats(-1.4, 1.4), st.floats(0.2, 2.0)


def along_x(q: np.ndarray, v: np.ndarray, wanted: float, limit: float) -> NullSpaceSaturation:
    """Accelerations of the planar robot that give its end effector ``wanted`` along x, which is q1 + l2 cos q2."""
    return NullSpaceSaturation(ROBOT.J(q)[:1], [wanted], lower=-limit, upper=limit, drift=ROBOT.Jdot_v(q, v)[:1])


@given(angles, speeds, st.floats(0.5, 20.0), speeds)
def test_the_end_effector_accelerates_by_the_part_that_the_scale_says(angle, v, wanted, limit):
    """Oracle: the way of the end effector in motion, differentiated twice; it knows no Jacobian and no drift."""
    q, rate, h = np.array([0.0, angle]), np.array([0.0, v]), 1e-3
    found = along_x(q, rate, wanted, limit).solve()
    assume(found.feasible)
    ways = [at[0] + 0.5 * np.cos(at[1]) for at in (q + t * rate + 0.5 * t * t * found.x for t in (-h, 0.0, h))]
    assert (ways[0] - 2.0 * ways[1] + ways[2]) / h**2 == pytest.approx(found.scale * wanted, abs=1e-4)


def test_the_drift_is_never_scaled():
    task = NullSpaceSaturation([[1.0, 1.0]], [10.0], lower=-1, upper=1, drift=[-1.0])
    for found in (task.closed_form(), task.solve("daqp")):
        assert found.scale == pytest.approx(0.1) and found.x.sum() - 1.0 == pytest.approx(
            found.scale * 10.0 - 2.0 + 2.0
        )


# ---- penalties
@given(st.integers(1, 3), vectors(4, low=0.1, high=10.0), magnitudes(0.1, 100.0), st.data())
def test_a_quadratic_penalty_is_biased_and_a_linear_one_is_not(m: int, x: np.ndarray, mu: float, data: st.DataObject):
    """Property 29. s = mu / (mu + |J# y|^2) although the whole task is possible; linear: s = 1."""
    J = data.draw(jacobians(m, 4, deficient=False, condition=10.0, low=0.1))
    shortest = float(np.linalg.norm(np.linalg.pinv(J) @ J @ x)) ** 2
    assume(0.1 < shortest < 1e3)
    A = np.column_stack([J, -J @ x])
    quadratic = qp.QP(np.diag([1.0] * 4 + [mu]), [0] * 4 + [-mu], A=A, b=np.zeros(m), lb=[-INF] * 4 + [0],
                      ub=[INF] * 4 + [1])  # fmt: skip
    assert qp.solve(quadratic, "daqp").x[-1] == pytest.approx(mu / (mu + shortest), rel=1e-6)
    task = NullSpaceSaturation(J, J @ x, lower=-INF, upper=INF)
    linear = qp.solve(task.qp(), "daqp").x
    assert linear[-1] == pytest.approx(1.0, abs=1e-8)
    np.testing.assert_allclose(linear[:-1], task.closed_form().x, atol=1e-7 * (1.0 + shortest))


# ---- examples
def test_the_joint_that_limits_most_is_saturated_and_the_others_take_over():
    task = NullSpaceSaturation([[1.0, 1.0]], [2.5], lower=[-1, -1], upper=[1, 2])
    for found in (task.closed_form(), *(task.solve(solver) for solver in usable())):
        np.testing.assert_allclose(found.x, [1.0, 1.5], atol=1e-8)
        assert found.scale == pytest.approx(1.0) and found.saturated == (0,)


def test_a_joint_that_was_put_at_its_limit_leaves_it_again_where_that_makes_the_scale_larger():
    """The loop that saturates one joint after another ends at 0.589, with 21 / 32 on its way."""
    task = NullSpaceSaturation([[0, -1, 2], [-2, 0, 1]], [-3.0, 2.0], lower=[-1, -1, -2], upper=[3, 2, 1])
    for found in (task.closed_form(), task.solve("daqp")):
        assert found.scale == pytest.approx(6 / 7, rel=1e-12)


def test_a_joint_at_rest_is_at_a_limit_of_zero_whatever_rounding_makes_of_the_rest():
    """Task and drift cancel, so that x is 0, or 1e-16 of what cancels."""
    for last in (-1, 0, 1):
        task = NullSpaceSaturation(
            [[1.0, 1.0]], [3.0], lower=-INF, upper=[2.0, 0.0], drift=[3.0 * (1.0 + last * np.finfo(float).eps)]
        )
        assert task.closed_form().saturated == task.solve().saturated == (1,)


def test_a_target_out_of_reach_of_the_rows_asks_for_scale_zero():
    task = NullSpaceSaturation([[1.0, 0.0], [1.0, 0.0]], [1.0, 2.0], lower=-1, upper=1)
    for found in (task.closed_form(), task.solve("daqp")):
        assert found.feasible and found.scale == 0.0
        np.testing.assert_allclose(found.x, 0.0, atol=1e-12)


@pytest.mark.parametrize("slope", [1e-3, 1e-5, 1e-6, 1e-7])
@pytest.mark.parametrize("solver", usable())
def test_a_start_on_a_limit_that_the_task_leaves_outwards_asks_for_scale_zero(solver: str, slope: float):
    """x = start + s rate with start₂ on its limit and rate₂ > 0, however small: only s = 0 is inside."""
    start, rate, side = np.array([0.0, 1.0, 0.3]), np.array([1.0, slope, 0.4]), np.array([0.0, 1.0, 0.0])
    J = np.array([[1.0, 2.0, 0.5], [-1.0, 0.5, 0.25], [0.5, 1.0, -2.0]])
    tasks = [
        NullSpaceSaturation(J, J @ rate, lower=-1, upper=1, drift=-J @ (start + away * side))
        for away in (0.0, 1e-6, -0.5 * slope)
    ]
    try:
        on, beyond, inside = (task.solve(solver) for task in tasks)
    except SolverFailed:  # one that iterates may not get near enough to a limit so near to the task, and is named
        assert solver not in ("pdas", "daqp", "quadprog") and slope <= 1e-5
        return
    known = 1e-14 if solver in ("pdas", "daqp", "quadprog") else SHARP  # of x₂: a vertex, or within the accuracy asked
    assert on.feasible and on.scale <= known / slope
    np.testing.assert_allclose(on.x, start, rtol=0, atol=10.0 * known / slope)
    assert not beyond.feasible
    assert inside.scale == pytest.approx(0.5, abs=known / slope)


def test_a_drift_out_of_reach_is_infeasible_unless_one_scale_meets_it():
    never = NullSpaceSaturation([[1.0, 0.0], [0.0, 0.0]], [1.0, 0.0], lower=-1, upper=1, drift=[0.0, 0.3])
    once = NullSpaceSaturation([[1.0, 0.0], [0.0, 0.0]], [1.0, 1.0], lower=-1, upper=1, drift=[0.0, 0.3])
    for how in (NullSpaceSaturation.closed_form, NullSpaceSaturation.solve):
        assert not how(never).feasible
        assert how(once).scale == pytest.approx(0.3) and how(once).x[0] == pytest.approx(0.3)


# ---- several tasks
@st.composite
def two_tasks(draw, *, compatible: bool = False):
    """Two tasks of 4 joints, both of full rank; ``compatible``: one motion inside the limits does both."""
    first, second = draw(jacobians(2, 4, deficient=False, condition=10.0, low=0.1)), draw(
        jacobians(1, 4, deficient=False, condition=10.0, low=0.1))  # fmt: skip
    assume(np.linalg.cond(np.vstack([first, second])) < 1e3)
    limit = np.array(draw(st.lists(st.floats(0.1, 10.0), min_size=4, max_size=4)))
    x = limit * np.array(draw(st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4)))
    fast = 0.99 if compatible else draw(st.sampled_from([0.5, 3.0]))
    return [(first, fast * first @ x), (second, fast * second @ x)], limit


@given(two_tasks())
def test_a_task_below_takes_nothing_from_one_above(drawn):
    """Property 23."""
    tasks, limit = drawn
    alone = NullSpaceSaturation.prioritised(tasks[:1], lower=-limit, upper=limit).solve()
    both = NullSpaceSaturation.prioritised(tasks, lower=-limit, upper=limit).solve()
    assert both.scales[0] == pytest.approx(alone.scales[0], abs=1e-9)
    J, target = tasks[0]
    residual = J @ both.x - both.scales[0] * target
    assert np.linalg.norm(residual) <= 1e-8 * (np.linalg.norm(target) + 1e-9)


@given(two_tasks(compatible=True))
def test_tasks_that_can_all_be_done_are_the_recursive_null_space_solution(drawn):
    """Property 25, where no limit is active: x2 = x1 + (J2 N1)# (y2 - J2 x1) (Siciliano, Slotine)."""
    tasks, _ = drawn
    (J1, y1), (J2, y2) = tasks
    x = np.linalg.pinv(J1) @ y1
    null = np.eye(4) - np.linalg.pinv(J1) @ J1
    x = x + np.linalg.pinv(J2 @ null, rcond=1e-9) @ (y2 - J2 @ x)
    found = NullSpaceSaturation.prioritised(tasks, lower=-INF, upper=INF).solve()
    assert found.scales == (1.0, 1.0)
    np.testing.assert_allclose(found.x, x, atol=1e-9 * (1.0 + np.linalg.norm(x)))


@given(two_tasks(compatible=True))
def test_the_order_of_tasks_that_can_all_be_done_does_not_matter(drawn):
    """Property 26, first half."""
    tasks, limit = drawn
    answers = [NullSpaceSaturation.prioritised(t, lower=-limit, upper=limit).solve() for t in (tasks, tasks[::-1])]
    for answer in answers:
        assert answer.scales == pytest.approx((1.0, 1.0), abs=1e-9)
    np.testing.assert_allclose(answers[0].x, answers[1].x, atol=1e-7 * (1.0 + limit.max()))


def test_the_order_of_tasks_that_exclude_each_other_matters():
    """Property 26, second half."""
    up, down = ([[1.0, 1.0]], [1.0]), ([[1.0, 1.0]], [-1.0])
    first = NullSpaceSaturation.prioritised([up, down], lower=-1, upper=1).solve()
    second = NullSpaceSaturation.prioritised([down, up], lower=-1, upper=1).solve()
    np.testing.assert_allclose(first.x, -second.x, atol=1e-12)
    assert first.scales == second.scales == (1.0, None)


def test_a_level_that_admits_no_scale_is_dropped_and_the_next_one_kept():
    tasks = [([[1, 0, 0]], [5.0]), ([[1, 0, 0]], [1.0], [3.0]), ([[0, 1, 1]], [1.0])]
    for solver in usable():
        found = NullSpaceSaturation.prioritised(tasks, lower=-1, upper=1).solve(solver)
        assert found.scales[0] == pytest.approx(0.2, abs=1e-8)
        assert found.scales[1] is None and found.scales[2] == pytest.approx(1.0, abs=1e-8)
        np.testing.assert_allclose(found.x, [1.0, 0.5, 0.5], atol=1e-7)


@given(st.integers(0, 10_000), st.booleans())
def test_a_level_that_those_above_meet_already_is_kept_whole(seed: int, at_rest: bool):
    """It asks for combinations of their rows to be what they are, zero among them: a residual is rounding of x."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 8))
    m = int(rng.integers(1, n))
    J, x = rng.standard_normal((m, n)) * 10.0 ** rng.uniform(-3, 3, (m, 1)), rng.standard_normal(n)
    if at_rest:
        x -= np.linalg.pinv(J) @ J @ x
    lower, upper = np.full(n, -INF), np.full(n, INF)
    lower[0] = upper[0] = x[0]
    target = np.zeros(m) if at_rest else J @ x
    mixed = rng.integers(-2, 3, (m, m)).astype(float)
    levels = NullSpaceSaturation.prioritised(
        [(J, target), (J, target), (mixed @ J, mixed @ target)], lower=lower, upper=upper
    )
    assert levels.closed_form().scales == pytest.approx((1.0, 1.0, 1.0), abs=1e-9)


def test_several_tasks_agree_on_every_solver():
    tasks = [([[1.0, 0.5, -0.2, 0.1], [0.3, 1.0, 0.7, -0.4]], [2.0, 1.0]), ([[0.0, 0.1, 1.0, 1.0]], [0.5])]
    prioritised = NullSpaceSaturation.prioritised(tasks, lower=-1.1, upper=1.2)
    check_method(prioritised)


def test_the_drift_of_a_level_above_is_kept_too():
    tasks = [([[1, 1, 0]], [1.0], [0.5]), ([[0, 1, 1]], [1.0], [-0.5])]
    found = NullSpaceSaturation.prioritised(tasks, lower=-3, upper=3).solve("daqp")
    assert found.scales == (1.0, 1.0)
    np.testing.assert_allclose([found.x[0] + found.x[1] + 0.5, found.x[1] + found.x[2] - 0.5], [1.0, 1.0], atol=1e-9)


def test_no_level_may_be_kept():
    nothing = NullSpaceSaturation.prioritised([([[1.0]], [1.0], [5.0])], lower=-1, upper=1).solve()
    assert not nothing.feasible and nothing.scales == (None,) and np.isnan(nothing.x).all()


@pytest.mark.parametrize("solver", ["pdas", "daqp"])
def test_a_task_that_the_one_above_has_decided_otherwise_has_no_scale_and_costs_it_nothing(solver: str):
    J = np.eye(2, 3)
    answer = NullSpaceSaturation.prioritised([(J, [1.0, 0.0]), (J, [0.0, 1.0])], lower=[-2.0] * 3, upper=[2.0] * 3)
    found = answer.solve(solver)
    assert found.scales == (1.0, None)
    np.testing.assert_allclose(found.x, [1.0, 0.0, 0.0], atol=1e-12)
