"""Equations: from positions of the links to the equations of motion, in sympy."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import sympy as sp
from sympy.simplify.fu import TR5, TR8

from wbc.errors import NotSupported
from wbc.models.chain import Chain
from wbc.models.lagrange.parametrisation import Parametrisation, parametrise


class Equations:
    """Everything Lagrange's equations say about a planar chain; expressions and matrices of sympy.

        T = Σ ½ m_i ‖ṗ_ci‖² + ½ I_i ω_i² = ½ q̇ᵀ M q̇        U = Σ m_i g0 y_ci
        M q̈ + c + g = τ        c = S q̇,  S_kj = Σ_i ½ (∂M_ki/∂q_j + ∂M_kj/∂q_i − ∂M_ij/∂q_k) q̇_i,  g = ∂U/∂q

    ``q``, ``v``, ``a``: symbols of positions, velocities and accelerations; ``parameters`` by name and ``g0``: symbols
    of what the chain is made of. ``com`` (per link), ``position`` of the end effector: (2, 1); ``angles`` (per link);
    ``T``, ``U`` and their parts ``T_links``, ``U_links``; ``M``, ``S`` (n, n); ``c``, ``g``, ``momentum`` p = M q̇,
    ``beta`` −Sᵀ q̇ + g: (n, 1); ``J`` (2, n), ``Jdot_v`` (2, 1); ``Y`` (n, p), ``coefficients`` (p, 1): Y · coefficients
    = M q̈ + c + g with the smallest p in the vertical plane. Every expression is a sum of products in which each sine
    or cosine is alone and linear, so that equal expressions are equal trees.

    Source: B. Siciliano et al., Robotics: Modelling, Planning and Control, Springer 2009, chapter 7.
    """

    def __init__(self, chain: Chain) -> None:
        self.chain = chain
        self.g0 = sp.Symbol("g0", real=True)
        self.parameters: dict[str, Any] = {name: sp.Symbol(name, real=True) for name in chain.parameters}
        numbers = range(1, len(chain) + 1)
        self.q = [sp.Symbol(f"q{i}", real=True) for i in numbers]
        self.v = [sp.Symbol(f"qdot{i}", real=True) for i in numbers]
        self.a = [sp.Symbol(f"qddot{i}", real=True) for i in numbers]
        self._place_links()
        self._energies()

    # ---- kinematics
    def _place_links(self) -> None:
        """Centres of mass, angles and the end effector, from the base outwards."""
        tip, angle = sp.zeros(2, 1), sp.Integer(0)
        self.com: list[Any] = []
        self.angles: list[Any] = []
        for i, joint in enumerate(self.chain.joints, start=1):
            q = self.q[i - 1]
            shift: Any = q
            if joint == "R":
                angle, shift = angle + q, sp.Integer(0)
            along = sp.Matrix([sp.cos(angle), sp.sin(angle)])
            if joint == "Py":
                along = sp.Matrix([-along[1], along[0]])
            origin = tip + along * shift
            self.com.append(origin + along * self._parameter("d", i))
            self.angles.append(angle)
            tip = origin + along * self._parameter("l", i)
        self.position = tip

    def _parameter(self, kind: str, joint: int) -> Any:
        """The symbol, or 0 where the chain has no such parameter."""
        return self.parameters.get(f"{kind}{joint}", sp.Integer(0))

    def rate(self, value: Any) -> Any:
        """dx/dt = ∂x/∂q q̇ of a column, or of a matrix entry by entry."""
        result = sp.zeros(*value.shape)
        for q, v in zip(self.q, self.v, strict=True):
            result += sp.diff(value, q) * v
        return result.applyfunc(canonical)

    # ---- energies
    def _energies(self) -> None:
        self.T_links, self.U_links = [], []
        for i, (com, angle) in enumerate(zip(self.com, self.angles, strict=True), start=1):
            mass, inertia = self._parameter("m", i), self._parameter("I", i)
            velocity = self.rate(com)
            omega = self.rate(sp.Matrix([angle]))[0]
            self.T_links.append(mass * canonical(velocity.dot(velocity)) / 2 + inertia * omega**2 / 2)
            self.U_links.append(mass * self.g0 * com[1])
        self.T = canonical(sum(self.T_links))
        self.U = canonical(sum(self.U_links))

    # ---- equations of motion
    @cached_property
    def M(self) -> Any:
        """Inertia matrix ∂²T/∂q̇²."""
        return sp.hessian(self.T, self.v).applyfunc(canonical)

    @cached_property
    def christoffel(self) -> list[Any]:
        """C_k (n, n) with c_k = q̇ᵀ C_k q̇: ½ (∂M_ki/∂q_j + ∂M_kj/∂q_i − ∂M_ij/∂q_k)."""
        n, M, q = len(self.q), self.M, self.q

        def symbol(k: int, i: int, j: int) -> Any:
            return (sp.diff(M[k, i], q[j]) + sp.diff(M[k, j], q[i]) - sp.diff(M[i, j], q[k])) / 2

        return [sp.Matrix(n, n, lambda i, j, k=k: canonical(symbol(k, i, j))) for k in range(n)]

    @cached_property
    def S(self) -> Any:
        """The factor of c = S q̇ whose row k is q̇ᵀ C_k: Ṁ − 2S is skew-symmetric."""
        velocity = sp.Matrix(self.v).T
        return sp.Matrix([velocity * C for C in self.christoffel]).applyfunc(canonical)

    @cached_property
    def c(self) -> Any:
        """Coriolis and centrifugal forces S q̇."""
        return (self.S * sp.Matrix(self.v)).applyfunc(canonical)

    @cached_property
    def g(self) -> Any:
        """Gravity ∂U/∂q."""
        return sp.Matrix([canonical(sp.diff(self.U, q)) for q in self.q])

    @cached_property
    def momentum(self) -> Any:
        """M q̇."""
        return (self.M * sp.Matrix(self.v)).applyfunc(canonical)

    @cached_property
    def beta(self) -> Any:
        """−Sᵀ q̇ + g, what the momentum changes by beside τ."""
        return (-self.S.T * sp.Matrix(self.v) + self.g).applyfunc(canonical)

    # ---- end effector
    @cached_property
    def J(self) -> Any:
        """∂p/∂q of the end effector's position."""
        return self.position.jacobian(self.q)

    @cached_property
    def Jdot_v(self) -> Any:
        """J̇ q̇."""
        return (self.rate(self.J) * sp.Matrix(self.v)).applyfunc(canonical)

    @cached_property
    def cartesian_inertia(self) -> Any:
        """(J M⁻¹ Jᵀ)⁻¹ (2, 2), where it fits on a page: for two joints, and where M and J are constant.

        Raises:
            NotSupported: the end effector cannot move in two directions, or there are too many joints.
        """
        if canonical((self.J * self.J.T).det()) == 0:
            raise NotSupported(f"{self.chain} has no Cartesian inertia: its end effector cannot move in two directions")
        if len(self.q) == 2:
            # J⁻ᵀ M J⁻¹, and one division: determinants of a planar J are short.
            adjugate, determinant = self.J.adjugate(), canonical(self.J.det())
            return (adjugate.T * self.M * adjugate).applyfunc(lambda entry: _short_quotient(entry, determinant**2))
        if self.M.free_symbols.isdisjoint(self.q) and self.J.free_symbols.isdisjoint(self.q):
            return (self.J * self.M.inv() * self.J.T).inv().applyfunc(sp.cancel)
        raise NotSupported(f"the Cartesian inertia of {self.chain} fills pages; evaluate it with numbers")

    # ---- linear parametrisation
    @cached_property
    def parametrisation(self) -> Parametrisation:
        """The smallest linear parametrisation, see :mod:`wbc.models.lagrange.parametrisation`."""
        v_reference = [sp.Symbol(f"qdot_r{i}", real=True) for i in range(1, len(self.q) + 1)]
        forces = self.M * sp.Matrix(self.a) + self.S * sp.Matrix(v_reference) + self.g
        return parametrise(forces, self.a, v_reference, chain=self.chain, parameters=self.parameters, g0=self.g0)

    @property
    def Y(self) -> Any:
        """Regressor (n, p) of q, q̇ and q̈."""
        return self.parametrisation.Y.xreplace(dict(zip(self.parametrisation.v_reference, self.v, strict=True)))

    @property
    def coefficients(self) -> Any:
        """Dynamic coefficients (p, 1)."""
        return self.parametrisation.coefficients


def canonical(expression: Any) -> Any:
    """A sum of products in which every sine or cosine is alone: two expressions are equal when these are."""
    return sp.expand(TR8(sp.expand(expression)))


def _short_quotient(numerator: Any, denominator: Any) -> Any:
    """The shorter of the quotient in lowest terms, and the same with sin² written as 1 − cos²."""
    expanded = sp.expand(numerator)
    return min((sp.factor(n / denominator) for n in (expanded, sp.expand(TR5(expanded)))), key=sp.count_ops)
