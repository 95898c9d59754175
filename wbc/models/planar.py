"""Planar robots: chains of prismatic and revolute joints in the x-y plane, and what makes their dynamics linear.

A chain is a model of Pinocchio, as any robot is. What is particular to a robot, its dynamic coefficients and their
regressor, is written by hand in its own file, or derived.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, TypedDict

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from wbc import checks
from wbc.errors import InvalidInput, NotSupported
from wbc.models.chain import Chain
from wbc.models.limits import Limits
from wbc.models.model import RobotModel, RobotState
from wbc.types import Mat, Vec, read_only

_JOINTS = {"R": pin.JointModelRZ, "Px": pin.JointModelPX, "Py": pin.JointModelPY}
_X, _Y = np.eye(3)[:2]


class JointLimits(TypedDict, total=False):
    """Limits as keywords of a planar robot: a number for all joints or (n,); without them there is no limit."""

    q_min: ArrayLike
    q_max: ArrayLike
    v_max: ArrayLike
    tau_max: ArrayLike


class PlanarRobot(RobotModel):
    """A planar chain on a fixed base. All motion is in the world's x-y plane, z = 0; gravity is along −y.

        M(q) q̈ + c(q, q̇) + g(q) = τ        c = S(q, q̇) q̇,  Ṁ − 2S skew-symmetric

    Frames: "base" at the origin, "link1", "link2", … at each link's origin with its axes, and "end_effector" at the tip
    of the last link. Joints are called q1, q2, …; a prismatic one is in m, m/s and N. What a planar robot cannot do,
    moving along z or turning about x and y, are zero rows of its Jacobians.

    Beside what every :class:`~wbc.models.model.RobotModel` has: ``chain``, ``parameters`` by name (see
    :class:`~wbc.models.chain.Chain`) and the quantities below. They take finite numbers of shape (n,) and return
    new arrays.

    Args:
        name: what the robot is called.
        chain: its joints.
        parameters: a finite number for each of ``chain.parameters``; masses, lengths and moments of inertia >= 0.
        gravity: acceleration along −y [m/s²]; 0 when the plane is horizontal.
        limits: ``q_min``, ``q_max`` [m, rad], ``v_max`` [m/s, rad/s], ``tau_max`` [N, N m].

    Raises:
        InvalidInput: a parameter that is missing, too many or makes no sense; an M that is singular at q0.
    """

    chain: Chain
    parameters: Mapping[str, float]
    g0: float

    def __init__(
        self, name: str, chain: Chain, parameters: Mapping[str, float], *, gravity: float, limits: JointLimits
    ) -> None:
        self.name, self.chain = name, chain
        self.parameters = _checked(chain, parameters)
        self.g0 = checks.number("gravity", gravity)
        self._take(_model(chain, self.parameters, self.g0), 0)
        self.joint_units = chain.units
        self.limits = _limits(len(chain), **limits)
        self.check_inertia()

    def M(self, q: ArrayLike) -> Mat:
        """Inertia matrix (n, n) [kg, kg m, kg m²]."""
        return np.array(self._at(q).M)

    def c(self, q: ArrayLike, v: ArrayLike) -> Vec:
        """Coriolis and centrifugal forces (n,) [N, N m], quadratic in v."""
        state = self._at(q, v)
        return np.asarray(state.coriolis @ state.v)

    def S(self, q: ArrayLike, v: ArrayLike) -> Mat:
        """The factor (n, n) of c = S v that makes Ṁ − 2S skew-symmetric, from Christoffel's symbols."""
        return np.array(self._at(q, v).coriolis)

    def g(self, q: ArrayLike) -> Vec:
        """Gravity ∂U/∂q (n,) [N, N m]."""
        return np.array(self._at(q).g)

    def J(self, q: ArrayLike) -> Mat:
        """Jacobian (2, n) of the end effector's position, rows x and y."""
        return np.array(self._at(q).frame("end_effector").jacobian()[:2])

    def Jdot_v(self, q: ArrayLike, v: ArrayLike) -> Vec:
        """J̇ v (2,) [m/s²]: the acceleration of the end effector when q̈ = 0, rows x and y."""
        return np.array(self._at(q, v).frame("end_effector").drift()[:2])

    def momentum(self, q: ArrayLike, v: ArrayLike) -> Vec:
        """p = M v (n,) [N s, N m s]."""
        state = self._at(q, v)
        return np.asarray(state.M @ state.v)

    def beta(self, q: ArrayLike, v: ArrayLike) -> Vec:
        """β = −Sᵀ v + g (n,) [N, N m], so that ṗ = τ − β."""
        state = self._at(q, v)
        return np.asarray(state.g - state.coriolis.T @ state.v)

    def energy(self, q: ArrayLike, v: ArrayLike) -> float:
        """T + U [J]; U is zero when every centre of mass has y = 0."""
        state, model = self._at(q, v), self.pinocchio
        kinetic = pin.computeKineticEnergy(model, state.data, state.q, state.v)
        return float(kinetic + pin.computePotentialEnergy(model, state.data, state.q))

    @property
    @abstractmethod
    def coefficients(self) -> Vec:
        """Dynamic coefficients (p,): the fewest numbers, linear in masses, first and second moments, that decide M, c
        and g when lengths and gravity are known."""

    @abstractmethod
    def regressor(self, q: ArrayLike, v: ArrayLike, v_reference: ArrayLike, a: ArrayLike) -> Mat:
        """Y (n, p) with Y · coefficients = M(q) a + S(q, v) v_reference + g(q)."""

    def cartesian_inertia(self, q: ArrayLike) -> Mat:
        """M_r = (J M⁻¹ Jᵀ)⁻¹ (2, 2) [kg]: what a force on the end effector has to move.

        Raises:
            InvalidInput: at q the end effector cannot move in two directions.
        """
        J = self.J(q)
        if np.linalg.matrix_rank(J) < 2:
            raise InvalidInput(f"at q = {np.asarray(q).tolist()} the end effector cannot move in two directions")
        inertia: Mat = np.linalg.inv(J @ np.linalg.solve(self.M(q), J.T))
        return inertia

    def possible_coefficients(self) -> tuple[Mat, Vec]:
        """C (k, p) and d (k,): masses that are not negative give coefficients a with C a <= d, and no others.

        Raises:
            NotSupported: the set is not a polyhedron, or is not known.
        """
        raise NotSupported(f"the possible coefficients of {self.name} are not known as a polyhedron")

    def vector(self, name: str, value: ArrayLike) -> Vec:
        """``value`` as an array (n,).

        Raises:
            InvalidInput: another shape, or not finite numbers.
        """
        return checks.array(name, value, (self.nv,))

    def check_inertia(self) -> None:
        """That M is positive definite at q0.

        Raises:
            InvalidInput: it is not; with what no inertia moves.
        """
        if self.weightless:
            named = ", ".join(self.weightless)
            raise InvalidInput(f"the inertia matrix of {self.name} is singular: no inertia moves with {named}")

    def _at(self, q: ArrayLike, v: ArrayLike | None = None) -> RobotState:
        state = self.state()
        state.update(0.0, self.vector("q", q), state.v if v is None else self.vector("v", v))
        return state

    def __repr__(self) -> str:
        return f"{self.name} ({self.chain}, {self.mass:.1f} kg)"


def _model(chain: Chain, parameters: Mapping[str, float], g0: float) -> Any:
    """The chain in Pinocchio."""
    model = pin.Model()
    model.gravity.linear = -g0 * _Y
    still = pin.SE3.Identity()
    model.addFrame(pin.Frame("base", 0, still, pin.FrameType.OP_FRAME))
    link, tip = 0, still
    for i, joint in enumerate(chain.joints, start=1):
        mass, length, offset, inertia = (parameters.get(f"{kind}{i}", 0.0) for kind in "mldI")
        along = _Y if joint == "Py" else _X
        link = model.addJoint(link, _JOINTS[joint](), tip, f"q{i}")
        model.appendBodyToJoint(link, pin.Inertia(mass, offset * along, np.diag([0.0, 0.0, inertia])), still)
        model.addFrame(pin.Frame(f"link{i}", link, still, pin.FrameType.OP_FRAME))
        tip = pin.SE3(np.eye(3), length * along)
    model.addFrame(pin.Frame("end_effector", link, tip, pin.FrameType.OP_FRAME))
    return model


def _checked(chain: Chain, parameters: Mapping[str, float]) -> dict[str, float]:
    """Every parameter of the chain as a number, in their order."""
    for name in parameters:
        if name not in chain.parameters:
            raise InvalidInput(f"chain {chain} has no parameter {name!r}; it has {', '.join(chain.parameters)}")
    for name in chain.parameters:
        if name not in parameters:
            raise InvalidInput(f"parameter {name!r} of chain {chain} is missing")
    free = {name: -np.inf if name[0] == "d" else 0.0 for name in chain.parameters}
    return {name: checks.number(name, parameters[name], low=free[name]) for name in chain.parameters}


def _limits(
    n: int,
    q_min: ArrayLike = -np.inf,
    q_max: ArrayLike = np.inf,
    v_max: ArrayLike = np.inf,
    tau_max: ArrayLike = np.inf,
) -> Limits:
    low, high = (checks.each(name, value, n, finite=False) for name, value in (("q_min", q_min), ("q_max", q_max)))
    for i in np.flatnonzero(low > high):
        raise InvalidInput(f"q_min[{i}] is {low[i]:g} and q_max[{i}] is {high[i]:g}; the lower must not be greater")
    v, tau = checks.limit("v_max", v_max, n), checks.limit("tau_max", tau_max, n)
    return Limits(read_only(low), read_only(high), read_only(v), read_only(tau))
