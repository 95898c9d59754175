"""The projected gradient step: what holds for every task, gradient and box, and what the exercise asks for."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

from tests.methods.problems import bare_steps, integer_step, steps
from tests.seeds import generator
from wbc import qp
from wbc.methods import ProjectedGradientStep
from wbc.qp.solvers import usable
from wbc.testing import check_method

INF = np.inf
ANY = st.one_of(steps(), bare_steps())
FROM_GRADIENT = steps()


def changed(step: ProjectedGradientStep, **new: object) -> ProjectedGradientStep:
    """The same step with other arguments."""
    of = step.origin
    assert of is not None
    arguments = {"J": of.J, "task_velocity": of.task_velocity, "gradient": of.gradient, "v_min": step.v_min,
                 "v_max": step.v_max, "alpha_max": step.alpha_max} | new  # fmt: skip
    return ProjectedGradientStep.from_gradient(**arguments)


def unit(step: ProjectedGradientStep) -> float:
    """The step that takes some joint across its range: what a difference of steps is measured by."""
    return step._unit()


# ---- closed form and QP
@given(ANY)
def test_closed_form_and_qp_agree(step: ProjectedGradientStep):
    check_method(step)


def test_closed_form_and_qp_agree_on_integers_and_rows_of_other_units():
    rng = generator("integer steps, step")
    for _ in range(5 * settings().max_examples):
        step = integer_step(rng)
        expected = step.closed_form()
        for solver in ("pdas", "daqp"):
            found = step.difference(step.solve(solver), expected)
            assert max(found.values()) <= 1e-9, (found, step)


@given(ANY)
def test_both_written_qps_have_the_step_as_their_minimum(step: ProjectedGradientStep):
    expected = step.closed_form()
    assume(expected.feasible and expected.alpha > 0.1 * unit(step) and 1e-2 < unit(step) < 1e2)
    for problem in (step.qp(), step.qp_with_velocity()):
        answer = qp.solve(problem, "daqp")
        assert answer.x[-1] == pytest.approx(expected.alpha, rel=1e-6)


@pytest.mark.parametrize("solver", usable())
@pytest.mark.parametrize("v_task", [0.5, 1.0, 1.5])
def test_a_step_that_moves_nothing_is_zero_with_and_without_a_largest_step(solver: str, v_task: float):
    for arguments in ({}, {"alpha_max": 2.0}):
        step = ProjectedGradientStep([v_task], [0.0], v_min=-1.0, v_max=1.0, **arguments)
        for found in (step.closed_form(), step.solve(solver)):
            assert found.feasible == (v_task <= 1.0)
            assert found.alpha == 0.0 or not found.feasible
            assert found.interval == (0.0, step.alpha_max) or not found.feasible


def test_last_bits_and_the_order_of_joints_and_rows_change_nothing_but_last_bits():
    """What another processor does: other last bits in every product, other places for ties to be found first."""
    rng = generator("order of joints")
    for _ in range(20 * settings().max_examples):
        step = integer_step(rng)
        of = step.origin
        assert of is not None
        m, n = of.J.shape
        joints, rows, eps = rng.permutation(n), rng.permutation(m), np.finfo(float).eps
        turned = changed(
            step, J=of.J[np.ix_(rows, joints)], task_velocity=of.task_velocity[rows], gradient=of.gradient[joints],
            v_min=step.v_min[joints], v_max=step.v_max[joints],
        )  # fmt: skip
        bits = [1.0 + 4.0 * eps * rng.integers(-1, 2, size=size) for size in ((m, n), m, n)]
        near = changed(step, J=of.J * bits[0], task_velocity=of.task_velocity * bits[1], gradient=of.gradient * bits[2])
        found = step.closed_form()
        # Last bits move v_task by its rounding, and so the step that takes a joint to its limit.
        known = 1e-9 * unit(step) + of.rounding / np.abs(step.v_null[[*found.active]]).min(initial=np.inf)
        for other, places in ((turned, joints), (near, np.arange(n))):
            again = other.closed_form()
            assert again.feasible == found.feasible, step
            if found.feasible:
                assert again.alpha == pytest.approx(found.alpha, abs=known), step
                assert {int(places[i]) for i in again.active} == set(found.active), step


# ---- properties
@given(FROM_GRADIENT)
def test_the_task_is_met_by_the_shortest_velocity_and_the_step_is_along_the_projected_gradient(
    step: ProjectedGradientStep,
):
    """Properties 1, 10 and 11, by numpy's singular values: v_task = J# ṙ, v_null = (I − J# J) ∇H, so J v_null = 0."""
    assert step.origin is not None
    J, ask, gradient = step.origin.J, step.origin.task_velocity, step.origin.gradient
    U, values, V = np.linalg.svd(J, full_matrices=False)
    kept = values > 1e-12 * values.max(initial=0.0)
    U, values, V = U[:, kept], values[kept], V[kept]
    known = 1e-9 + 1e-13 * values.max(initial=1.0) / values.min(initial=1.0)
    v_task = V.T @ (U.T @ ask / values)
    assert np.linalg.norm(step.v_task - v_task) <= known * (np.linalg.norm(v_task) + 1e-300)
    off = step.v_null - (gradient - V.T @ (V @ gradient))
    assert np.linalg.norm(off) <= known * np.linalg.norm(gradient)


@given(ANY)
def test_the_step_is_feasible_and_ends_at_a_limit_and_any_larger_one_is_not(step: ProjectedGradientStep):
    """Properties 2 and 4."""
    found = step.closed_form()
    assume(found.feasible and (found.alpha > 0.0 or step._moving.any()))
    if step._moving.any() and found.alpha < step.alpha_max * (1.0 - 1e-9):
        assert found.active
        for i in found.active:
            limit = step.v_max[i] if step.v_null[i] > 0.0 else step.v_min[i]
            assert found.v[i] == pytest.approx(limit, abs=1e-6 * step._size[i])
    if found.alpha == 0.0:
        return

    def outside(alpha: float) -> float:
        v = step.v_task + alpha * step.v_null
        room = np.maximum(step.v_min - v, v - step.v_max) / (step._size + unit(step) * np.abs(step.v_null) + 1e-300)
        return float(room.max())

    assert outside(found.alpha) <= 1e-9
    assert outside(found.alpha + 1e-3 * unit(step)) > 0.0 or found.alpha == step.alpha_max


@given(ANY)
def test_the_step_is_the_optimum_of_the_linear_program(step: ProjectedGradientStep):
    """Property 3. An oracle that shares no code: scipy's simplex on the rows as they are."""
    found, u = step.closed_form(), unit(step)
    scale = np.where(step._moving, u * np.abs(step.v_null), step._size)
    scale[scale == 0.0] = 1.0
    rows = (np.where(step._moving, step.v_null, 0.0) * u / scale)[:, None]
    up, down = (step.v_max - step.v_task) / scale, (step.v_task - step.v_min) / scale
    up, down = (np.where(np.abs(room) < 1e-11, 0.0, room) for room in (up, down))
    finite = np.isfinite(np.append(up, down))
    moving = bool(step._moving.any())
    answer = linprog(
        [-1.0 if moving else 1.0], A_ub=np.vstack([rows, -rows])[finite], b_ub=np.append(up, down)[finite],
        bounds=[(0.0, step.alpha_max / u)], method="highs-ds",
    )  # fmt: skip
    assert found.feasible == (answer.status == 0)
    if found.feasible:
        assert found.alpha == pytest.approx(u * float(answer.x[0]), abs=1e-9 * u)


@pytest.mark.parametrize("condition", [1e0, 1e3, 1e6])
def test_a_task_velocity_on_a_limit_is_on_it_however_its_joints_are_ordered(condition: float):
    """J# ṙ is known to rounding times the condition of J: a joint that it puts on a limit does not leave by that."""
    rng = np.random.default_rng(4)
    U, V = (np.linalg.qr(rng.normal(size=(k, k)))[0] for k in (3, 4))
    J = (U * [1.0, condition**-0.5, 1.0 / condition]) @ V[:3]
    v = V[:3].T @ [0.6, -0.4, 0.5]
    outwards = V[3] * np.sign(V[3, 0] * v[0])
    limit = np.where(np.arange(4) == 0, np.abs(v[0]), 3.0)
    for order in map(list, permutations(range(4))):
        step = ProjectedGradientStep.from_gradient(
            J[:, order], J @ v, outwards[order], v_min=-limit[order], v_max=limit[order], alpha_max=1e6
        )
        assert step.closed_form().alpha == 0.0 and step.solve().alpha == pytest.approx(0.0, abs=1e-9)


def test_rows_of_a_task_in_units_far_apart_cost_no_digits():
    """In metres or micrometres; a joint that the task puts on its limit is on it."""
    J, still = np.array([[-1.0, 0.0, 0.0], [-1.0, -1.0, 0.0]]), np.array([1.0, 0.0, 0.0])
    for unit in 10.0 ** np.arange(-5, 5):
        rows = np.array([[1e-4], [1e3 * unit]]) * J
        step = ProjectedGradientStep.from_gradient(rows, rows @ still, [-2.0, 0.0, -1.0], v_min=-1.0, v_max=[1, 0, 1])
        np.testing.assert_allclose(step.v_task, still, rtol=0, atol=1e-14)
        for found in (step.closed_form(), step.solve()):
            np.testing.assert_allclose(found.v, [1.0, 0.0, -1.0], rtol=0, atol=1e-14)


def test_a_velocity_that_is_rounding_of_a_task_that_contradicts_itself_is_zero():
    """v₁ + v₂ + v₃ is to be 0.6 and −0.6: least squares give 0, which is at the limit of joint 2 and not beyond it."""
    step = ProjectedGradientStep.from_gradient(
        np.ones((2, 3)), [0.1 + 0.5, -0.5 - 0.1], [3.0, 3.0, 3.0], v_min=[-INF, -INF, -1.0], v_max=[2.0, 0.0, 2.0]
    )
    assert step.closed_form().feasible and step.solve().feasible


@given(FROM_GRADIENT)
def test_no_velocity_on_the_task_climbs_more_along_a_line_and_never_less_beyond(step: ProjectedGradientStep):
    """Property 12. Oracle: scipy's linear program max ∇Hᵀv on the task and in the box."""
    assume(step.origin is not None)
    of, found = step.origin, step.closed_form()
    assume(found.feasible and np.isfinite(step.v_min).all() and np.isfinite(step.v_max).all())
    n, rank = step.v_task.size, np.linalg.matrix_rank(of.J, tol=1e-12 * np.abs(of.J).max(initial=1e-300))
    free = changed(step, alpha_max=INF).closed_form() if step._moving.any() else found
    null = np.linalg.svd(of.J)[2][rank:]
    down, up = step.v_min - step.v_task, step.v_max - step.v_task
    size, slope = float(np.abs([down, up]).max()), float(np.linalg.norm(null @ of.gradient))
    assume(len(null) and size > 0.0 and slope > 1e-6 * np.abs(of.gradient).max())
    answer = linprog(
        -(null @ of.gradient) / slope, A_ub=np.vstack([null.T, -null.T]),
        b_ub=np.maximum(np.append(up, -down) / size, 0.0), bounds=[(None, None)] * len(null), method="highs",
    )  # fmt: skip
    assert answer.status == 0
    climbed = free.alpha * slope / size
    assert -answer.fun >= climbed - 1e-7
    if n - rank == 1:
        assert -answer.fun == pytest.approx(climbed, abs=1e-6)


@given(steps(deficient=False), st.floats(0.0, 0.9))
def test_the_qp_over_velocities_without_active_limits_is_the_projected_gradient(
    step: ProjectedGradientStep, part: float
):
    """Property 13."""
    found = step.closed_form()
    assume(
        found.feasible and step.origin is not None and np.linalg.cond(step.origin.J) < 1e3 if step.origin.J.size else 1
    )
    alpha = part * found.alpha
    v = step.v_task + alpha * step.v_null
    size = np.abs(v).max(initial=0.0) + alpha * np.abs(step.origin.gradient).max(initial=0.0)
    assume(((v > step.v_min + 1e-6) & (v < step.v_max - 1e-6)).all() and size < 1e3)
    answer = qp.solve(step.qp_over_velocity(alpha), "daqp")
    assume(answer.status.ok)
    np.testing.assert_allclose(answer.x, v, atol=1e-6 * (1.0 + size))


def test_the_qp_over_velocities_leaves_the_ray_where_that_climbs_more():
    step = ProjectedGradientStep.from_gradient([[1, 1, 1]], [0.0], [3.0, 1.0, -4.0], v_min=[-1] * 3, v_max=[1] * 3)
    along_ray = step.closed_form()
    answer = qp.solve(step.qp_over_velocity(10.0), "daqp")
    gradient = np.array([3.0, 1.0, -4.0])
    assert gradient @ answer.x > gradient @ along_ray.v + 0.1
    assert (np.abs(answer.x) <= 1.0 + 1e-9).all() and abs(answer.x.sum()) < 1e-9


@given(bare_steps(), st.floats(0.0, 100.0))
def test_where_nothing_moves_every_step_is_the_same(step: ProjectedGradientStep, alpha: float):
    """Property 14."""
    still = ProjectedGradientStep(
        step.v_task, np.zeros_like(step.v_task), v_min=step.v_min, v_max=step.v_max, alpha_max=step.alpha_max
    )
    found = still.closed_form()
    inside = ((step.v_task >= step.v_min - 1e-12) & (step.v_task <= step.v_max + 1e-12)).all()
    if found.feasible:
        assert found.alpha == 0.0 and found.active == () and found.interval == (0.0, step.alpha_max)
        np.testing.assert_array_equal(found.v, step.v_task)
        np.testing.assert_array_equal(found.v, still.v_task + alpha * still.v_null)
    else:
        assert not inside and found.interval[0] > found.interval[1]


@given(bare_steps())
def test_an_infeasible_start_is_flagged_or_restored_and_never_clipped(step: ProjectedGradientStep):
    """Property 15."""
    found = step.closed_form()
    low, high = found.interval
    if not found.feasible:
        assert low > high and np.isnan(found.alpha) and np.isnan(found.v).all() and found.active == ()
        return
    np.testing.assert_array_equal(found.v, step.v_task + found.alpha * step.v_null)
    assert 0.0 <= low <= high <= step.alpha_max and found.alpha in (high, 0.0)
    scale = step._size + unit(step) * np.abs(step.v_null) + 1e-300
    for alpha in (low, 0.5 * (low + min(high, 1e9))):
        v = step.v_task + alpha * step.v_null
        assert (np.maximum(v - step.v_max, step.v_min - v) / scale <= 1e-7).all()


# ---- edge cases


def test_rounding_at_a_limit_decides_nothing():
    step = ProjectedGradientStep([1.0 + 1e-16, 0.0], [1e-17, 1.0], v_min=[-1, -1], v_max=[1, 1])
    assert step.closed_form().alpha == step.solve().alpha == 1.0


def test_a_locked_joint_that_would_move_stops_everything():
    step = ProjectedGradientStep([0.0, 0.0], [1.0, 1.0], v_min=[0, -1], v_max=[0, 1])
    alone = ProjectedGradientStep([0.0, 0.0], [1.0, 0.0], v_min=[0, -1], v_max=[0, 1])
    for each in (step, alone):
        assert each.closed_form().alpha == 0.0 == each.solve("daqp").alpha


def test_the_null_motion_may_restore_feasibility():
    step = ProjectedGradientStep([1.5, 0.0], [-1.0, 0.1], v_min=[-1, -1], v_max=[1, 1])
    assert step.closed_form().interval == pytest.approx((0.5, 2.5))
    assert step.solve("daqp").interval == pytest.approx((0.5, 2.5))


@pytest.mark.parametrize("exponent", [-250, -100, -30, -13, 13])
def test_the_unit_of_the_gradient_scales_the_step_and_changes_nothing_else(exponent: int) -> None:
    """A criterion in another unit: the step is in that unit too, and the velocities are the same."""
    rng, factor = generator("units of the gradient"), 10.0**exponent
    for _ in range(6):
        v_task, v_null = rng.uniform(-0.9, 0.9, 3), rng.uniform(0.1, 1.0, 3) * rng.choice([-1.0, 1.0], 3)
        usual = ProjectedGradientStep(v_task, v_null, v_min=-1.0, v_max=1.0).solve()
        scaled = ProjectedGradientStep(v_task, factor * v_null, v_min=-1.0, v_max=1.0).solve()
        assert scaled.alpha * factor == pytest.approx(usual.alpha, rel=1e-7)
        assert scaled.v == pytest.approx(usual.v, abs=1e-7) and scaled.active == usual.active


@pytest.mark.parametrize("alpha_max", [1.0, 1e6, 1e12, INF])
@pytest.mark.parametrize("speed", [1e-6, 1.0, 1e3])
def test_a_task_outside_its_limits_stays_infeasible_whatever_alpha_max_is(alpha_max: float, speed: float):
    """The joint must move forward, and the gradient takes it backward."""
    step = ProjectedGradientStep([0.0], [-0.005], v_min=3.0 * speed, v_max=4.0 * speed, alpha_max=alpha_max)
    assert not step.closed_form().feasible
    answer = step.solve()
    assert not answer.feasible and np.isnan(answer.alpha)
