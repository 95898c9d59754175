"""Parametrisation: equations of motion that are linear in as few numbers as there can be.

Forces are linear in the inertial parameters of the links, m_i, m_i d_i and I_i + m_i d_i². Written with sines and
cosines that stand alone, every force is a sum of different functions of (q, q̇, q̈), each times a combination of those
parameters. Functions are independent, so the number of independent combinations is the smallest number of coefficients.
Combinations are taken as they appear in M, first on its diagonal, then beside it, then in g.

Source: M. Gautier, W. Khalil, Direct calculation of minimum set of inertial parameters of serial robots, IEEE
Transactions on Robotics and Automation 6(3), 1990.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, final

import sympy as sp
from sympy.polys.matrices import DomainMatrix

from wbc.models.chain import Chain


@final
@dataclass(frozen=True)
class Parametrisation:
    """Y (n, p) of q, q̇, ``v_reference`` and q̈, ``coefficients`` (p, 1): Y · coefficients = M q̈ + S v_reference + g."""

    Y: Any
    coefficients: Any
    v_reference: list[Any]


class Term(NamedTuple):
    """In the force of one joint: a function of the motion times a combination of inertial parameters."""

    joint: int
    function: Any
    factor: Any  # of the combination, known: lengths, g0 and a number
    combination: tuple[Any, ...]  # of the inertial parameters, without common factor


def parametrise(
    forces: Any, a: list[Any], v_reference: list[Any], *, chain: Chain, parameters: Mapping[str, Any], g0: Any
) -> Parametrisation:
    """The smallest linear parametrisation of forces M q̈ + S v_reference + g of a chain, lengths and gravity known."""
    n = len(a)
    values, inverse = _inertial(chain, parameters)
    known = {*parameters.values(), g0}
    terms = [term for joint in range(n) for term in _terms(joint, forces[joint], known, list(values), inverse)]
    terms.sort(key=lambda term: _place(term, a))
    candidates = list(dict.fromkeys(term.combination for term in terms))
    chosen, shares = _basis(candidates)

    Y = sp.zeros(n, len(chosen))
    for term in terms:
        for column, share in enumerate(shares[term.combination]):
            Y[term.joint, column] += term.factor * share * term.function
    coefficients = [sp.expand(sum(x * y for x, y in zip(c, values.values(), strict=True))) for c in chosen]
    return Parametrisation(Y.applyfunc(sp.expand), sp.Matrix(coefficients), v_reference)


def _inertial(chain: Chain, p: Mapping[str, Any]) -> tuple[dict[Any, Any], dict[Any, Any]]:
    """The inertial parameters of every link, mass, first and second moment about its origin: what each is in terms of
    the chain's parameters; and offsets and moments of inertia in terms of them."""
    values: dict[Any, Any] = {}
    inverse: dict[Any, Any] = {}
    for i in range(1, len(chain) + 1):
        mass = p[f"m{i}"]
        values[mass] = mass
        if chain.turns(i - 1):
            first, second = sp.symbols(f"first{i} second{i}")
            offset, inertia = p[f"d{i}"], p[f"I{i}"]
            values |= {first: mass * offset, second: inertia + mass * offset**2}
            inverse |= {offset: first / mass, inertia: second - first**2 / mass}
    return values, inverse


def _terms(joint: int, force: Any, known: set[Any], unknowns: list[Any], inverse: dict[Any, Any]) -> list[Term]:
    """The force of one joint, by function of the motion."""
    collected: dict[Any, Any] = {}
    for product in sp.Add.make_args(sp.expand(force)):
        factors = sp.Mul.make_args(product)
        constant = sp.Mul(*(f for f in factors if f.free_symbols <= known))
        function = sp.Mul(*(f for f in factors if not f.free_symbols <= known))
        collected[function] = collected.get(function, 0) + constant
    terms = []
    for function, expression in collected.items():
        linear = sp.expand(expression.xreplace(inverse))
        combination = [linear.coeff(symbol) for symbol in unknowns]
        if any(combination):
            common = sp.gcd_list(combination)
            if next(x for x in combination if x != 0).could_extract_minus_sign():
                common = -common
            terms.append(Term(joint, function, common, tuple(sp.cancel(x / common) for x in combination)))
    return terms


def _place(term: Term, accelerations: list[Any]) -> tuple[Any, ...]:
    """Where a term stands: the diagonal of M, beside it, the rest; constants before functions of q."""
    moved = [i for i, a in enumerate(accelerations) if a in term.function.free_symbols]
    kind = 2 if not moved else 0 if moved == [term.joint] else 1
    return kind, term.joint, sp.count_ops(term.function), str(term.function)


def _basis(candidates: list[tuple[Any, ...]]) -> tuple[list[tuple[Any, ...]], dict[tuple[Any, ...], list[Any]]]:
    """The first candidates that are independent, and every candidate as a combination of those; exact."""
    columns = DomainMatrix.from_Matrix(sp.Matrix(candidates).T).to_field()
    reduced, pivots = columns.rref()
    entries = reduced.to_Matrix()
    shares = {c: [entries[row, j] for row in range(len(pivots))] for j, c in enumerate(candidates)}
    return [candidates[j] for j in pivots], shares
