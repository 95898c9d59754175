"""Steps: a derivation as a person would write it, as data. How it looks is the writer's business."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, final

import sympy as sp

from wbc.errors import NotSupported
from wbc.models.chain import Chain
from wbc.models.lagrange.equations import Equations

_JOINTS = {"R": "revolute", "Px": "prismatic along x", "Py": "prismatic along y"}


@final
@dataclass(frozen=True)
class Formula:
    """``left`` = ``value``; left in plain text and in LaTeX. Without a value the two are the whole formula."""

    left: str
    tex: str
    value: Any = None


@final
@dataclass(frozen=True)
class Step:
    """A title, what is done in plain words, and the formulas it leads to."""

    title: str
    sentence: str
    formulas: tuple[Formula, ...] = ()


def steps(d: Equations) -> list[Step]:
    """The derivation of a chain from its joints to its momentum."""
    return [
        _chain(d.chain),
        _positions(d),
        _kinetic_energy(d),
        _inertia(d),
        _gravity(d),
        _coriolis(d),
        _equations(d),
        _end_effector(d),
        _cartesian_inertia(d),
        _parametrisation(d),
        _momentum(d),
    ]


def _chain(chain: Chain) -> Step:
    joints = ", ".join(f"joint {i} is {_JOINTS[joint]}" for i, joint in enumerate(chain.joints, start=1))
    sentence = f"The planar chain {chain}: {joints}. Gravity g0 is along -y. Its parameters are the masses m"
    if "R" in chain.joints:
        sentence += (
            ", the lengths l of links behind revolute joints, and of links that turn the offsets d of the centres of "
            "mass and the moments of inertia I about them. A cosine is written c with the numbers of the joints whose "
            "angles are added, a sine s: c12 is the cosine of q1 + q2"
        )
    return Step("The chain", sentence + ".")


def _positions(d: Equations) -> Step:
    formulas = [Formula(f"p_c{i}", rf"p_{{c{i}}}", com) for i, com in _numbered(d.com)]
    formulas.append(Formula("p", "p", d.position))
    return Step("Positions", "The centre of mass of each link, and the end effector p.", tuple(formulas))


def _kinetic_energy(d: Equations) -> Step:
    formulas = [
        Formula(
            "T_i = ½ m_i |ṗ_ci|² + ½ I_i ω_i²",
            r"T_i = \tfrac12 m_i \|\dot p_{ci}\|^2 + \tfrac12 I_i \omega_i^2",
        )
    ]
    for i, com in _numbered(d.com):
        formulas.append(Formula(f"ṗ_c{i}", rf"\dot p_{{c{i}}}", d.rate(com)))
        if d.chain.turns(i - 1):
            formulas.append(Formula(f"ω{_low(i)}", rf"\omega_{{{i}}}", d.rate(sp.Matrix([d.angles[i - 1]]))[0]))
        formulas.append(Formula(f"T{_low(i)}", f"T_{{{i}}}", d.T_links[i - 1]))
    return Step("Kinetic energy", "Differentiate the positions; the energy of each link follows.", tuple(formulas))


def _inertia(d: Equations) -> Step:
    sentence = "The kinetic energy of all links is a quadratic form of the velocities, and M is its matrix."
    law = Formula("T = Σ T_i = ½ q̇ᵀ M q̇", r"T = \sum_i T_i = \tfrac12 \dot q^T M \dot q")
    return Step("Inertia matrix", sentence, (law, Formula("M", "M", d.M)))


def _gravity(d: Equations) -> Step:
    potentials = [Formula(f"U{_low(i)}", f"U_{{{i}}}", U) for i, U in _numbered(d.U_links)]
    law = Formula("g = ∂U/∂q", r"g = \left(\partial U / \partial q\right)^T")
    sentence = "The potential energy of each link, up to a constant; its gradient is what gravity asks of the joints."
    return Step("Gravity", sentence, (*potentials, law, *_rows("g", d.g)))


def _coriolis(d: Equations) -> Step:
    law = (
        Formula(
            "c_k = q̇ᵀ C_k q̇,  (C_k)_ij = ½ (∂M_ki/∂q_j + ∂M_kj/∂q_i − ∂M_ij/∂q_k)",
            r"c_k = \dot q^T C_k \dot q, \quad (C_k)_{ij} = \tfrac12 \left(\frac{\partial M_{ki}}{\partial q_j}"
            r" + \frac{\partial M_{kj}}{\partial q_i} - \frac{\partial M_{ij}}{\partial q_k}\right)",
        ),
    )
    if not any(d.S):
        return Step("Coriolis and centrifugal forces", "M is constant, so there are none: c = 0 and S = 0.", law)
    matrices = [Formula(f"C{_low(k)}", f"C_{{{k}}}", C) for k, C in _numbered(d.christoffel) if any(C)]
    skew = (d.rate(d.M) - 2 * d.S).applyfunc(sp.expand)
    sentence = "Christoffel's symbols, here those that are not zero. The rows of S are the velocities times C_k; then "
    sentence += "c is S times the velocities, and the rate of M minus 2 S is skew-symmetric."
    formulas = (*law, *matrices, *_rows("c", d.c), Formula("S", "S", d.S), Formula("Ṁ − 2S", r"\dot M - 2S", skew))
    return Step("Coriolis and centrifugal forces", sentence, formulas)


def _equations(d: Equations) -> Step:
    law = Formula("M q̈ + c + g = τ", r"M \ddot q + c + g = \tau")
    forces = d.M * sp.Matrix(d.a) + d.c + d.g
    rows = tuple(Formula(f"τ{_low(i)}", rf"\tau_{{{i}}}", force) for i, force in _numbered(forces))
    return Step("Equations of motion", "Inertia, Coriolis and gravity together, one row a joint.", (law, *rows))


def _end_effector(d: Equations) -> Step:
    formulas = (Formula("J = ∂p/∂q", r"J = \partial p / \partial q", d.J), Formula("J̇ q̇", r"\dot J \dot q", d.Jdot_v))
    sentence = "How the end effector moves, and its acceleration while the joints do not accelerate."
    return Step("Jacobian of the end effector", sentence, formulas)


def _cartesian_inertia(d: Equations) -> Step:
    title = "Cartesian inertia"
    law = Formula("M_r = (J M⁻¹ Jᵀ)⁻¹", r"M_r = (J M^{-1} J^T)^{-1}")
    sentence = "What a force on the end effector has to move."
    try:
        return Step(title, sentence, (law, Formula("M_r", "M_r", d.cartesian_inertia)))
    except NotSupported as reason:
        return Step(title, f"{sentence} Without symbols here: {reason}.", (law,))


def _parametrisation(d: Equations) -> Step:
    count = len(d.coefficients)
    sentence = (
        f"With lengths and gravity known, the forces are linear in {count} dynamic coefficients a, and in no fewer: "
        "the columns of Y are independent functions of the motion."
    )
    law = Formula("M q̈ + c + g = Y(q, q̇, q̈) a", r"M \ddot q + c + g = Y(q, \dot q, \ddot q)\, a")
    return Step("Linear parametrisation", sentence, (law, *_rows("a", d.coefficients), Formula("Y", "Y", d.Y)))


def _momentum(d: Equations) -> Step:
    laws = (
        Formula("p = M q̇,  β = −Sᵀ q̇ + g", r"p = M \dot q, \quad \beta = -S^T \dot q + g"),
        Formula("ṗ = τ − β", r"\dot p = \tau - \beta"),
    )
    rows = tuple(Formula(f"p{_low(i)}", f"p_{{{i}}}", p) for i, p in _numbered(d.M * sp.Matrix(d.v)))
    beta = tuple(Formula(f"β{_low(i)}", rf"\beta_{{{i}}}", b) for i, b in _numbered(d.beta))
    sentence = "The momentum p changes by what the motors do beyond beta: no accelerations and no inverse of M needed."
    return Step("Momentum", sentence, (*laws, *rows, *beta))


def _rows(name: str, column: Any) -> tuple[Formula, ...]:
    return tuple(Formula(f"{name}{_low(i)}", f"{name}_{{{i}}}", value) for i, value in _numbered(column))


def _numbered(values: Any) -> Any:
    return enumerate(values, start=1)


def _low(number: int) -> str:
    """A number as an index below the line."""
    return str(number).translate(str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉"))
