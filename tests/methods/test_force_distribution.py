"""Forces that add up to a wrench with the least norm, inside friction and limits."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from scipy.optimize import linprog, minimize

from tests.methods.problems import distributions
from tests.seeds import generator
from wbc import qp
from wbc.errors import SolverFailed
from wbc.methods import ForceDistribution
from wbc.qp.solvers import usable
from wbc.testing import check_method
from wbc.tolerances import ROUNDING

ANY = distributions()
FREE = distributions(limited=False)
LIMITED = distributions(limited=True)


@given(ANY)
def test_closed_form_and_qp_agree_on_every_solver(problem: ForceDistribution):
    """Multipliers are compared by the forces that they push, beside the forces there are.

    λ itself is as sensitive as rows of G are near to dependent; G'λ is not, but it is a sum that cancels. Of what two λ
    push differently, what its evaluation in floating point explains is left out: |fl(Aλ) − Aλ| <= k ε |A| |λ| entry by
    entry, k terms. That is the backward error of any λ stored in doubles, so no solver can be asked for less.
    """
    check_method(problem)


def test_multipliers_that_push_otherwise_are_a_difference():
    """Also where rows of G nearly depend on each other and multipliers are large: nine digits of forces are held."""
    nearly = ForceDistribution([[1.0, 1.0, 0.0], [1.0, 1.0 + 1e-5, 1e-5]], [1.0, 2.0])
    found = nearly.closed_form()
    assert np.abs(found.multipliers).max() > 1e4 * np.abs(found.f).max()
    off = replace(found, multipliers=found.multipliers + 1e-8 * np.abs(found.f).max())
    assert nearly.difference(off, found)["multipliers"] > 1e-9 > nearly.difference(found, found)["multipliers"]


@given(FREE)
def test_forces_add_up_to_the_wrench_or_it_is_out_of_reach(problem: ForceDistribution):
    found = problem.closed_form()
    rank = np.linalg.matrix_rank(problem.G, tol=1e-12 * np.linalg.norm(problem.G, 2))
    augmented = np.column_stack([problem.G / (np.linalg.norm(problem.G, 2) or 1.0),
                                 problem.wrench / (np.linalg.norm(problem.wrench) or 1.0)])  # fmt: skip
    if np.linalg.matrix_rank(augmented, tol=1e-6) > rank:
        assert not found.feasible
    if found.feasible:
        allowed = 1e-9 * (np.linalg.norm(problem.G, 2) * np.linalg.norm(found.f) + np.linalg.norm(problem.wrench))
        assert np.linalg.norm(found.residual) <= allowed
        np.testing.assert_array_equal(found.residual, problem.G @ found.f - problem.wrench)
    else:
        assert np.isnan(found.f).all() and np.isnan(found.multipliers).all() and np.isnan(found.residual).all()


@given(FREE)
def test_the_multipliers_are_the_optimality_conditions(problem: ForceDistribution):
    found = problem.closed_form()
    assume(found.feasible)
    gradient, push = problem.weight @ found.f, problem.G.T @ found.multipliers
    size = np.linalg.norm(problem.weight, 2) * np.linalg.norm(found.f)
    assert np.linalg.norm(gradient - push) <= 1e-7 * (size or 1.0)


@given(LIMITED)
def test_a_linear_program_knows_whether_the_wrench_can_be_had(problem: ForceDistribution):
    """Oracle: scipy's simplex on the largest part of the wrench, at least one half more or less than all of it."""
    U, values, V = np.linalg.svd(problem.G)
    rank = int((values > 1e-12 * values.max()).sum())
    wrench = (U[:, :rank].T @ problem.wrench) / values[:rank]
    assume(rank and np.abs(wrench).max() > 1e-6)
    nf = problem.G.shape[1]
    pyramid = np.column_stack([-problem.qp().C, np.zeros(len(problem.qp().C))])
    answer = linprog(
        np.append(np.zeros(nf), -1.0), A_eq=np.column_stack([V[:rank], -wrench / np.linalg.norm(wrench)]),
        b_eq=np.zeros(rank), A_ub=pyramid, b_ub=np.zeros(len(pyramid)),
        bounds=[(-150.0, 150.0)] * nf + [(0.0, None)], method="highs-ds",
    )  # fmt: skip
    part = answer.x[-1] / np.linalg.norm(wrench)
    assume(abs(part - 1.0) > 1e-6)
    assert problem.solve().feasible == (part > 1.0)


def stiff_and_slippery(rng: np.random.Generator) -> ForceDistribution:
    """Weights twelve decades apart, friction down to 1e-6, limits on some sides, wrenches within and out of reach."""
    contacts, m = int(rng.integers(1, 7)), int(rng.choice([2, 3, 6]))
    places = rng.integers(-1, 2, (contacts, 3)) if rng.uniform() < 0.5 else rng.normal(size=(contacts, 3))
    G = np.hstack([np.vstack([np.eye(3), np.cross(place, np.eye(3)).T]) for place in places])[:m]
    mu, nf = 10.0 ** rng.uniform(-6, 0, contacts), 3 * contacts
    slopes = np.column_stack([rng.uniform(-0.5, 0.5, (contacts, 2)) * mu[:, None], np.ones(contacts)])
    f = (slopes * rng.exponential(1.0, (contacts, 1))).ravel()
    room = rng.choice([0.0, 0.1, 1.0, np.inf, np.inf, np.inf], (2, nf))
    return ForceDistribution(
        G, G @ f * 10.0 ** rng.uniform(-1, 8), weight=10.0 ** rng.uniform(-6, 6, nf), friction=mu,
        friction_model=str(rng.choice(["inner", "outer"])), sides=int(rng.choice([4, 8])),
        f_min=np.minimum(f, 0.0) - room[0], f_max=np.maximum(f, 0.0) + room[1],
    )  # fmt: skip


def test_verdicts_hold_with_weights_and_friction_decades_apart():
    """Infeasible: HiGHS finds no forces whose violation is rounding. Forces: within limits to their own rounding."""
    seen: Counter[str] = Counter()
    for case in range(400):
        problem = stiff_and_slippery(generator("stiff and slippery", case))
        for form in ("finite", "pdas"):
            try:
                found = problem.closed_form() if form == "finite" else problem.solve()
            except SolverFailed:
                seen[f"{form} gave up"] += 1
                continue
            C, f = problem.qp().C, found.f
            seen[f"{form} {found.feasible}"] += 1
            if found.feasible:
                size = np.linalg.norm(f)
                assert (C @ f >= -1e-7 * size).all(), case
                assert (np.maximum(f - problem.f_max, problem.f_min - f) <= 1e-7 * size).all(), case
                assert np.linalg.norm(found.residual) <= 1e-7 * size * np.linalg.norm(problem.G, 2), case
                continue
            limits = list(zip(problem.f_min, problem.f_max, strict=True))
            other = linprog(np.zeros(len(problem.f_min)), -C, np.zeros(len(C)), problem.G, problem.wrench, limits)
            if other.status == 0:
                over = np.maximum(other.x - problem.f_max, problem.f_min - other.x)
                beyond = max(float(over.max()), float(-(C @ other.x).min()))
                missing = np.abs(problem.G @ other.x - problem.wrench).max()
                assert max(beyond, float(missing)) > 1e-12 * np.abs(problem.wrench).max(), case
    assert seen["finite True"] > 50 and seen["finite False"] > 50 and seen["pdas gave up"] <= 4, seen


@given(LIMITED)
def test_no_random_change_inside_the_limits_is_cheaper(problem: ForceDistribution):
    """Oracle: scipy's general minimiser, started from the answer, finds nothing smaller."""
    found = problem.solve()
    assume(found.feasible and 1e-3 < np.abs(found.f).max() and np.linalg.cond(problem.weight) < 1e3)
    G = np.linalg.svd(problem.G)[2][: np.linalg.matrix_rank(problem.G, tol=1e-12 * np.linalg.norm(problem.G, 2))]
    target, C, W = G @ found.f, problem.qp().C, problem.weight / np.linalg.norm(problem.weight, 2)
    other = minimize(
        lambda f: 0.5 * f @ W @ f, found.f, jac=lambda f: W @ f, method="SLSQP",
        bounds=[(-150.0, 150.0)] * found.f.size,
        constraints=[{"type": "eq", "fun": lambda f: G @ f - target, "jac": lambda f: G},
                     {"type": "ineq", "fun": lambda f: C @ f, "jac": lambda f: C}],
        options={"maxiter": 50},
    )  # fmt: skip
    met = np.abs(G @ other.x - target).max() < 1e-6 and (C @ other.x > -1e-6).all()
    if met:
        assert found.f @ W @ found.f <= other.x @ W @ other.x * (1.0 + 1e-5) + 1e-5 * np.abs(found.f).max()


@pytest.mark.parametrize(
    ("settings", "press"),
    [({}, 5 * 2**0.5 / 0.5), ({"sides": 8}, 5 / np.cos(np.pi / 8) / 0.5), ({"friction_model": "outer"}, 5 / 0.5)],
    ids=["inside the cone", "inside with 8 sides", "around the cone"],
)
def test_friction_pulls_normal_forces_up(settings: dict[str, Any], press: float):
    """Two fingers hold a weight between them: each carries half, and presses with half / μ, or the pyramid's less."""
    G = np.array([[1, 0, 0, 1, 0, 0], [0, 1, 0, 0, 1, 0], [0, 0, 1, 0, 0, -1]])
    free = ForceDistribution(G, [10.0, 0.0, 0.0]).closed_form()
    np.testing.assert_allclose(free.f, [5, 0, 0, 5, 0, 0], atol=1e-12)
    for solver in usable():
        held = ForceDistribution(G, [10.0, 0.0, 0.0], friction=0.5, **settings).solve(solver)
        np.testing.assert_allclose(held.f, [5, 0, press, 5, 0, press], atol=1e-6)


def test_the_qp_in_standard_form_has_the_same_answer():
    problem = ForceDistribution(np.hstack([np.eye(3)] * 2), [1.0, 0.0, 10.0], friction=[0.3, 0.6], f_max=20.0)
    np.testing.assert_allclose(qp.solve(problem.qp(), "daqp").x, problem.solve("daqp").f, atol=1e-8)
    assert "friction[1]: -fx <= mu fz" in [str(row) for row in problem.qp().rows]


def thin(rng: np.random.Generator) -> tuple[ForceDistribution, bool]:
    """Points with little friction or much, and a wrench that forces inside it give, or forces that pull."""
    count, mu = int(rng.integers(1, 5)), float(10.0 ** rng.uniform(-6, 0))
    G = rng.normal(size=(int(rng.integers(1, 7)), 3 * count))
    if rng.random() < 0.5:
        G = np.round(G)
    normal = rng.choice([0.0, 10.0, 20.0, 37.0], size=count)
    tangential = mu * normal[:, None] * rng.choice([-1.0, 0.0, 0.5, 1.0], size=(count, 2))
    push = rng.random() < 0.7
    f = np.column_stack([tangential, normal]).ravel() * (1.0 if push else -1.0)
    options = {"f_min": -150.0, "f_max": 150.0} if rng.random() < 0.5 else {}
    return ForceDistribution(G, G @ f, friction=mu, friction_model="outer", **options), push


def test_a_wrench_that_forces_inside_a_thin_pyramid_give_is_never_out_of_reach():
    """Oracle: HiGHS on forces in units of the pyramid: its tolerance is then beside friction and not beside force.

    Last bits of a force f are ε |f| sideways, which takes ε |f| / μ of a normal force elsewhere; where the wrench turns
    that sideways at f again, f grows by ε / μ² of itself: a ten thousandth at μ = 1e-6. There, too, rows of friction
    are told apart by μ² of their length. What is below ROUNDING counts as no difference, and then some pulls have no
    forces: one of 8,000 problems, μ = 1.05e-6.
    """
    rng, kinds = generator("thin pyramids"), {True: 0, False: 0}
    for _ in range(8 * settings().max_examples):
        problem, push = thin(rng)
        found, nf = problem.closed_form(), problem.G.shape[1]
        if push:
            assert found.feasible
        unit = np.tile([problem.friction[0], problem.friction[0], 1.0], nf // 3)
        rows = -problem.qp().C * unit / problem.friction[0]
        answer = linprog(
            np.zeros(nf), A_eq=problem.G * unit, b_eq=problem.wrench, A_ub=rows, b_ub=np.zeros(len(rows)),
            bounds=[*zip(problem.f_min / unit, problem.f_max / unit, strict=True)], method="highs-ds",
        )  # fmt: skip
        exact = answer.status == 0 and np.abs(problem.G @ (unit * answer.x) - problem.wrench).max() <= 1e-10
        assert found.feasible or not exact or problem.friction[0] ** 2 < 4.0 * ROUNDING
        kinds[found.feasible] += 1
        if found.feasible:
            size = np.abs(found.f).max()
            assert np.abs(found.residual).max() <= 1e-8 * (1.0 + size)
            assert (problem.qp().C @ found.f).min() >= -1e-8 * size
            if exact:
                known = 1e-6 + 4.0 * np.finfo(float).eps / problem.friction[0] ** 2
                assert np.linalg.norm(found.f) <= np.linalg.norm(unit * answer.x) * (1.0 + known) + 1e-9
    assert min(kinds.values()) >= settings().max_examples // 4


def test_a_wrench_on_the_edge_of_friction_is_not_out_of_reach_by_rounding():
    """Forces that slide, or pull with no normal force at all, are within friction but for the last bit."""
    rng = generator()
    for _ in range(60):
        k, mu = int(rng.integers(1, 6)), 10.0 ** rng.uniform(-7.0, 0.0)
        normal = rng.uniform(0.0, 100.0, k) * (rng.uniform(size=k) < 0.8)
        sideways = rng.choice([-1.0, 0.5, 1.0], (k, 2)) * normal[:, None] * mu / np.sqrt(2.0)
        forces = np.column_stack([sideways, normal])
        arms = rng.normal(size=(k, 3)) * [1.0, 1.0, rng.choice([0.0, 1e-3, 1.0])]
        turning = np.hstack([np.cross(arm, np.eye(3)).T for arm in arms])
        G = np.vstack([np.tile(np.eye(3), k), turning])
        found = ForceDistribution(G, G @ forces.ravel(), friction=mu).closed_form()
        assert found.feasible
        assert np.abs(found.residual).max() <= 1e-7


@pytest.mark.parametrize("beyond", [-10.0, 0.0, 10.0, 40.0])
def test_a_force_beyond_its_limit_is_a_difference_by_as_much_of_the_largest_force(beyond: float):
    task = ForceDistribution(np.eye(3), [0.0, 0.0, 50.0], friction=0.5, f_min=-150.0, f_max=150.0)
    right = task.closed_form()
    wrong = replace(right, f=np.array([0.0, 0.0, 150.0 + beyond]))
    assert task.difference(right, right)["limits"] == 0.0
    assert task.difference(wrong, right)["limits"] == pytest.approx(max(0.0, beyond) / 50.0)
