"""What Lagrange's equations must say about any planar chain: exactly in symbols, and in numbers as Pinocchio has it."""

from __future__ import annotations

import copy
import pickle
import re
import subprocess
import sys
from functools import cache

import numpy as np
import pinocchio as pin
import pytest
import sympy as sp
from hypothesis import given
from hypothesis import strategies as st

from tests.models.planar_oracle import CHAINS, check_against_derivation, in_pinocchio, some_parameters
from wbc.errors import InvalidInput, NotSupported
from wbc.models import Chain
from wbc.models.lagrange import derive
from wbc.models.lagrange.equations import canonical
from wbc.models.lagrange.robot import DerivedRobot

chains = pytest.mark.parametrize("word", CHAINS)
seeds = st.integers(0, 2**32 - 1)


@cache
def robot_of(word: str) -> DerivedRobot:
    """A robot of this chain."""
    return derive(word).robot(some_parameters(Chain.parse(word)))


def moment(n: int, seed: int, count: int = 2) -> list[np.ndarray]:
    """Random vectors (n,): positions, velocities, accelerations."""
    return list(np.random.default_rng(seed).normal(size=(count, n)))


def is_zero(matrix: sp.Matrix) -> bool:
    """Whether an expression is zero for all values of its symbols."""
    return matrix.applyfunc(canonical) == sp.zeros(*matrix.shape)


# ---- the grammar of chains
@pytest.mark.parametrize(
    ("word", "joints"),
    [("PR", ("Px", "R")), ("pr", ("Px", "R")), ("PxPyPxPy", ("Px", "Py") * 2), ("rpyr", ("R", "Py", "R"))],
)
def test_a_word_spells_a_chain(word: str, joints: tuple[str, ...]):
    assert Chain.parse(word).joints == joints
    assert Chain.parse(str(Chain.parse(word))) == Chain.parse(word)


def test_links_that_cannot_turn_have_neither_offset_nor_inertia():
    assert Chain.parse("PyPRP").parameters == (
        "m1", "m2", "m3", "m4", "l3", "d3", "d4", "I3", "I4",
    )  # fmt: skip
    assert Chain.parse("PyPRP").units == ("m", "m", "rad", "m")


# ---- exact, in symbols


@chains
def test_the_rate_of_M_minus_two_S_is_skew(word: str):
    """Property 56. S of Christoffel's symbols: c = S q̇, Ṁ − 2S skew-symmetric, c quadratic in q̇."""
    d = derive(word)
    skew = d.rate(d.M) - 2 * d.S
    assert is_zero(skew + skew.T)
    assert is_zero(d.S * sp.Matrix(d.v) - d.c)
    k = sp.Symbol("k")
    assert is_zero(d.c.xreplace({v: k * v for v in d.v}) - k**2 * d.c)


@chains
def test_the_momentum_changes_by_torques_minus_beta(word: str):
    """Property 65. ṗ = τ − β with β = −Sᵀ q̇ + g, whichever S: adding a skew W with W q̇ = 0 changes nothing."""
    d = derive(word)
    v = sp.Matrix(d.v)
    torque_minus_inertia = d.c + d.g  # τ = M q̈ + c + g, ṗ = Ṁ q̇ + M q̈
    assert is_zero(d.rate(d.M) * v - (torque_minus_inertia - d.beta))
    half_gradient = sp.Matrix([-(v.T * sp.diff(d.M, q) * v)[0] / 2 for q in d.q]) + d.g
    assert is_zero(half_gradient - d.beta)
    if len(d.q) == 3:
        W = sp.Matrix([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])  # W x = v × x
        assert is_zero(W * v) and is_zero(-(d.S + W).T * v + d.g - d.beta)


@chains
def test_the_end_effector_moves_with_its_jacobian(word: str):
    d = derive(word)
    velocity = d.J * sp.Matrix(d.v)
    assert is_zero(velocity - d.rate(d.position))
    assert is_zero(d.rate(velocity) - d.Jdot_v)


@chains
def test_the_forces_are_linear_in_the_coefficients(word: str):
    """Property 31. Y a = M q̈ + S q̇_r + g exactly, and Y holds no mass, offset or inertia."""
    d = derive(word)
    p = d.parametrisation
    forces = d.M * sp.Matrix(d.a) + d.S * sp.Matrix(p.v_reference) + d.g
    assert is_zero(p.Y * p.coefficients - forces)
    unknown = {symbol for name, symbol in d.parameters.items() if name[0] != "l"}
    assert p.Y.free_symbols.isdisjoint(unknown)
    assert p.coefficients.free_symbols.isdisjoint({*d.q, *d.v, *d.a, d.g0})
    assert is_zero(d.Y * d.coefficients - (d.M * sp.Matrix(d.a) + d.c + d.g))


@chains
def test_no_parametrisation_is_smaller(word: str):
    """Property 32. Stacked over random motions the regressor has full rank, so every column is needed; and the
    coefficients are independent functions of the parameters, so they can take any values."""
    d, robot = derive(word), robot_of(word)
    rng = np.random.default_rng(1)
    n, p = len(d.q), len(d.coefficients)
    stacked = np.vstack([robot.regressor(*rng.normal(size=(4, n))) for _ in range(10 * p)])
    assert np.linalg.matrix_rank(stacked) == p
    unknown = [symbol for name, symbol in d.parameters.items() if name[0] != "l"]
    slopes = d.coefficients.jacobian(unknown).subs(
        {d.parameters[k]: sp.nsimplify(v) for k, v in robot.parameters.items()}
    )
    assert slopes.rank() == p
    forces = stacked @ robot.coefficients
    for column in range(p):
        without = np.delete(stacked, column, axis=1)
        _, residual, _, _ = np.linalg.lstsq(without, forces, rcond=None)
        assert residual[0] > 1e-6 * (forces @ forces)


@pytest.mark.parametrize("word", ["PR", "RP", "PyR", "RR", "PxPyPxPy", "PyP"])
def test_the_cartesian_inertia_is_what_its_definition_says(word: str):
    d = derive(word)
    robot = d.robot(some_parameters(d.chain))
    numbers = {d.parameters[name]: value for name, value in robot.parameters.items()}
    q = np.linspace(0.4, 1.1, len(d.q))
    exact = np.array(d.cartesian_inertia.subs(numbers | dict(zip(d.q, q, strict=True))), dtype=float)
    assert np.allclose(exact, robot.cartesian_inertia(q), rtol=1e-9)


def test_where_there_is_no_cartesian_inertia_one_is_told():
    with pytest.raises(NotSupported, match="cannot move in two directions"):
        _ = derive("PxPx").cartesian_inertia
    with pytest.raises(NotSupported, match="fills pages"):
        _ = derive("RRR").cartesian_inertia
    with pytest.raises(InvalidInput, match="cannot move in two directions"):
        robot_of("RR").cartesian_inertia([0.3, 0.0])
    assert robot_of("RRR").cartesian_inertia([0.3, 0.4, 0.5]).shape == (2, 2)


# ---- in numbers
@chains
@given(seed=seeds)
def test_the_forces_are_those_of_recursive_newton_euler(word: str, seed: int):
    robot = robot_of(word)
    model = in_pinocchio(robot.chain, robot.parameters, robot.g0)
    data, (q, v, a) = model.createData(), moment(robot.nv, seed, 3)
    forces = pin.rnea(model, data, q, v, a)
    check_against_derivation(robot, q, v, v, a, rtol=1e-10, atol=1e-9)
    assert np.allclose(robot.M(q) @ a + robot.c(q, v) + robot.g(q), forces, rtol=1e-10, atol=1e-9)
    assert np.allclose(robot.regressor(q, v, v, a) @ robot.coefficients, forces, rtol=1e-9, atol=1e-9)
    assert np.allclose(robot.g(q), pin.computeGeneralizedGravity(model, data, q), rtol=1e-10, atol=1e-9)
    assert np.allclose(robot.S(q, v), pin.computeCoriolisMatrix(model, data, q, v), atol=1e-9)
    kinetic = pin.computeKineticEnergy(model, data, q, v)
    assert robot.energy(q, v) == pytest.approx(kinetic + pin.computePotentialEnergy(model, data, q), abs=1e-9)
    assert np.allclose(robot.momentum(q, v), pin.crba(model, data, q) @ v, atol=1e-9)


def test_a_copy_computes_the_same():
    robot = robot_of("RPyR")
    q, v = moment(3, 5)
    assert np.array_equal(pickle.loads(pickle.dumps(robot)).M(q), robot.M(q))
    moved = robot.replace(q0=q)
    assert np.array_equal(moved.c(q, v), robot.c(q, v)) and np.array_equal(moved.q0, q)
    assert copy.deepcopy(robot) is robot
    assert derive("rpyr") is derive(robot.chain)


# ---- on paper
@pytest.mark.parametrize("word", ["PR", "PxPyPxPy", "RP", "RRR"])
def test_the_text_shows_every_step(word: str):
    text = derive(word).text(100)
    titles = re.findall(r"^\d+\. (.*)$", text, re.MULTILINE)
    assert titles == [step.title for step in derive(word).steps()] and len(titles) == 11
    assert max(len(line) for line in text.splitlines()) < 200


def test_text_and_latex_read_as_one_writes():
    """What fills pages is counted instead."""
    text = derive("PR").text(120)
    for line in (
        "T₁ = m₁ q̇₁²/2",
        "⎡ m₁ + m₂    −m₂ d₂ s₂ ⎤",
        "c₁ = −m₂ d₂ c₂ q̇₂²",
        "τ₂ = −m₂ d₂ s₂ q̈₁ + q̈₂ (m₂ d₂² + I₂) + m₂ d₂ g₀ c₂",
        "a₂ = m₂ d₂² + I₂",
        "β₂ = m₂ d₂ c₂ q̇₁ q̇₂ + m₂ d₂ g₀ c₂",
    ):
        assert line in text, line
    assert "cos(" not in text
    assert r"c_{1} = - m_{2} d_{2} c_{2} \dot{q}_{2}^{2}" in derive("PR").latex()
    assert re.search(r"c₁ = a sum of \d+ terms", derive("RRRR").text(100))


@pytest.mark.parametrize("word", ["PR", "PxPyPxPy", "RPyR", "RRRR"])
def test_the_latex_is_well_formed(word: str):
    document = derive(word).latex()
    assert document.startswith(r"\documentclass") and document.endswith("\\end{document}\n")
    assert document.isascii() and r"\section{Inertia matrix}" in document
    begun, ended = (re.findall(rf"\\{word}{{(\w+\*?)}}", document) for word in ("begin", "end"))
    assert sorted(begun) == sorted(ended)
    depth = 0
    for brace in re.findall(r"(?<!\\)[{}]", document):
        depth += 1 if brace == "{" else -1
        assert depth >= 0
    assert depth == 0
    assert not re.search(r"_\{[^{}]*\}_|_\w_", document), "two indices on one symbol"
    assert document.count(r"\left") == document.count(r"\right")
    assert document.count(r"\[") == document.count(r"\]")


# ---- cost
def test_planar_robots_work_without_sympy():
    script = (
        "import sys, wbc, wbc.models\n"
        "robot = wbc.models.PlanarPR(m1=1, m2=1, l2=1, d2=0.5, I2=0.1)\n"
        "state = robot.state(); state.M, state.h, state.frame('end_effector').jacobian()\n"
        "wbc.models.lagrange.derive\n"
        "assert 'sympy' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", script], check=True)
