"""Planar robots: chains of prismatic and revolute joints in the x-y plane, dynamics by formula.

Kinematics of any point comes from one pass along the chain; what is particular to a robot, M, c, g and so on, is
written in its own file.
"""

from __future__ import annotations

import copy
from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Self, TypedDict, final

import numpy as np
import pinocchio
from numpy.typing import ArrayLike

from wbc import checks
from wbc.errors import InvalidInput, NotSupported
from wbc.models.chain import Chain
from wbc.models.model import FrameState, Limits, RobotModel, RobotState
from wbc.types import Mat, Vec


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
    :class:`~wbc.models.chain.Chain`) and the formulas below. They take any numbers of shape (n,) and return new arrays.

    Args:
        name: what the robot is called.
        chain: its joints.
        parameters: a finite number for each of ``chain.parameters``; masses, lengths and moments of inertia >= 0.
        gravity: acceleration along −y [m/s²]; 0 when the plane is horizontal.
        limits: ``q_min``, ``q_max`` [m, rad], ``v_max`` [m/s, rad/s], ``tau_max`` [N, N m].

    Raises:
        InvalidInput: a parameter that is missing, too many or makes no sense; an M that is not positive definite.
    """

    def __init__(
        self, name: str, chain: Chain, parameters: Mapping[str, float], *, gravity: float, limits: JointLimits
    ) -> None:
        n = len(chain)
        self.name, self.chain = name, chain
        self.parameters = _checked(chain, parameters)
        self.g0 = checks.number("gravity", gravity)
        self.nq = self.nv = self.nj = n
        self.nb = 0
        self.joint_names = tuple(f"q{i + 1}" for i in range(n))
        self.joint_units = chain.units
        self.frame_names = ("base", *(f"link{i + 1}" for i in range(n)), "end_effector")
        self.limits = _limits(n, **limits)
        self.gravity = _frozen(np.array([0.0, -self.g0, 0.0]))
        self.q0 = _frozen(np.zeros(n))
        self.masses, self.lengths, self.offsets, self.inertias = (
            [self.parameters.get(f"{kind}{i + 1}", 0.0) for i in range(n)] for kind in "mldI"
        )
        self.mass = sum(self.masses)

    # ---- the robot's own formulas
    @abstractmethod
    def M(self, q: ArrayLike) -> Mat:
        """Inertia matrix (n, n) [kg, kg m, kg m²]."""

    @abstractmethod
    def c(self, q: ArrayLike, v: ArrayLike) -> Vec:
        """Coriolis and centrifugal forces (n,) [N, N m], quadratic in v."""

    @abstractmethod
    def S(self, q: ArrayLike, v: ArrayLike) -> Mat:
        """The factor (n, n) of c = S v that makes Ṁ − 2S skew-symmetric, from Christoffel's symbols."""

    @abstractmethod
    def g(self, q: ArrayLike) -> Vec:
        """Gravity ∂U/∂q (n,) [N, N m]."""

    @abstractmethod
    def J(self, q: ArrayLike) -> Mat:
        """Jacobian (2, n) of the end effector's position, rows x and y."""

    @abstractmethod
    def Jdot_v(self, q: ArrayLike, v: ArrayLike) -> Vec:
        """J̇ v (2,) [m/s²]: the acceleration of the end effector when q̈ = 0, rows x and y."""

    @abstractmethod
    def momentum(self, q: ArrayLike, v: ArrayLike) -> Vec:
        """p = M v (n,) [N s, N m s]."""

    @abstractmethod
    def beta(self, q: ArrayLike, v: ArrayLike) -> Vec:
        """β = −Sᵀ v + g (n,) [N, N m], so that ṗ = τ − β."""

    @abstractmethod
    def energy(self, q: ArrayLike, v: ArrayLike) -> float:
        """T + U [J]; U is zero when every centre of mass has y = 0."""

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

    # ---- what every robot answers
    def state(self, *, drifts: bool = True) -> PlanarState:
        """A new state at q0, at rest; what nobody reads is not computed, drifts included."""
        del drifts
        return PlanarState(self)

    def integrate(self, q: Vec, dq: Vec) -> Vec:
        """q + dq."""
        return q + dq

    def difference(self, q_from: Vec, q_to: Vec) -> Vec:
        """q_to − q_from."""
        return q_to - q_from

    def random_configuration(self, rng: np.random.Generator) -> Vec:
        """A configuration inside the joint limits; where there are none, within ±π rad or ±1 m."""
        span = np.array([np.pi if unit == "rad" else 1.0 for unit in self.joint_units])
        low, high = self.limits.q_min, self.limits.q_max
        low = np.where(np.isfinite(low), low, np.minimum(high, span) - 2 * span)
        return rng.uniform(low, np.where(np.isfinite(high), high, np.maximum(low, -span) + 2 * span))

    def replace(self, *, q0: ArrayLike | None = None, limits: Limits | None = None) -> Self:
        """The same robot with another reference configuration (n,) or other limits.

        Raises:
            InvalidInput: a wrong size or sign.
        """
        other = copy.copy(self)
        if q0 is not None:
            other.q0 = _frozen(checks.array("q0", q0, (self.nq,)))
        if limits is not None:
            other.limits = _limits(self.nj, limits.q_min, limits.q_max, limits.v_max, limits.tau_max)
        return other

    def vector(self, name: str, value: ArrayLike) -> Vec:
        """``value`` as an array (n,).

        Raises:
            InvalidInput: another shape, or not numbers.
        """
        try:
            vector = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError) as cause:
            raise InvalidInput(f"{name} must be an array of numbers, not {type(value).__name__}") from cause
        if vector.shape != (self.nv,):
            raise InvalidInput(f"{name} must have shape ({self.nv},), not {vector.shape}")
        return vector

    def check_inertia(self) -> None:
        """That M is positive definite at q0.

        Raises:
            InvalidInput: it is not, with the smallest eigenvalue of M scaled to ones on its diagonal.
        """
        M = self.M(self.q0)
        scale = np.sqrt(np.maximum(np.diag(M), 1e-300))
        least = float(np.linalg.eigvalsh(M / np.outer(scale, scale))[0])
        if least <= 1e-12:
            raise InvalidInput(f"the inertia matrix of {self.name} is singular: eigenvalue {least:.1g}, must be > 0")

    def __deepcopy__(self, memo: object) -> Self:
        return self  # a value: all parts of a program may share it

    def __repr__(self) -> str:
        return f"{self.name} ({self.chain}, {self.mass:.1f} kg)"


@final
class PlanarState(RobotState):
    """A moment of a planar robot. What has been read once is computed in every later update, into the same memory.

    A copy or a pickle is a new state at the same (t, q, v), with memory of its own.

    Example:
        >>> from wbc.models import Planar4P
        >>> state = Planar4P().state()
        >>> state.M.diagonal().tolist(), state.frame("end_effector").position.tolist()
        ([4.0, 3.0, 2.0, 1.0], [0.0, 0.0, 0.0])
    """

    model: PlanarRobot

    def __init__(self, model: PlanarRobot) -> None:
        self.model = model
        self.t = 0.0
        self._q, self._v = np.array(model.q0), np.zeros(model.nv)
        self.q, self.v = _read_only(self._q), _read_only(self._v)
        self.q_joints, self.v_joints = self.q, self.v
        self._motion: list[LinkMotion] | None = None
        self._views: dict[str, Vec | Mat] = {}
        self._frames: dict[str, PlanarFrame] = {}
        self._refreshes: list[Callable[[], None]] = []

    def update(self, t: float, q: Vec, v: Vec) -> None:
        """Move to time t [s], configuration q (n,), velocity v (n,).

        Raises:
            InvalidInput: q or v has another shape; the state stays as it was.
        """
        for name, value in (("q", q), ("v", v)):
            if not isinstance(value, np.ndarray):
                raise InvalidInput(f"{name} must be an array, not {type(value).__name__}")
            self.model.vector(name, value)
        self.t = t
        self._q[:], self._v[:] = q, v
        self._motion = None
        for refresh in self._refreshes:
            refresh()

    def frame(self, name: str) -> PlanarFrame:
        """The frame called ``name`` in this state; cheap after the first call.

        Raises:
            UnknownFrame: with the names that are near.
        """
        if name not in self._frames:
            self.model.check_frame(name)
            self._frames[name] = frame = PlanarFrame(self, name)
            self._refreshes.append(frame.refresh)
        return self._frames[name]

    @property
    def M(self) -> Mat:
        """Inertia matrix (n, n) [kg, kg m, kg m²]."""
        return self._view("M", lambda: self.model.M(self._q))

    @property
    def h(self) -> Vec:
        """Bias c + g (n,) [N, N m]."""
        return self._view("h", lambda: self.model.c(self._q, self._v) + self.model.g(self._q))

    @property
    def g(self) -> Vec:
        """Gravity forces (n,) [N, N m]."""
        return self._view("g", lambda: self.model.g(self._q))

    @property
    def coriolis(self) -> Mat:
        """The factor S (n, n) of c = S v with Ṁ = S + Sᵀ."""
        return self._view("coriolis", lambda: self.model.S(self._q, self._v))

    @property
    def com(self) -> Vec:
        """Centre of mass in the world (3,) [m]."""
        return self._view("com", lambda: self._mean([m.com.position for m in self.motion]))

    @property
    def com_jacobian(self) -> Mat:
        """Jacobian of the centre of mass (3, n)."""
        return self._view("com_jacobian", lambda: self._mean([m.com.J for m in self.motion]))

    @property
    def com_drift(self) -> Vec:
        """Acceleration of the centre of mass when a = 0 (3,) [m/s²]."""
        return self._view("com_drift", lambda: self._mean([m.com.drift for m in self.motion]))

    @property
    def centroidal_map(self) -> Mat:
        """A_G (6, n): linear momentum, then angular momentum about the centre of mass, per unit of v; rows x, y and
        the last are not zero."""
        return self._view("centroidal_map", lambda: self._momentum([(m.com.J, m.spin) for m in self.motion]))

    @property
    def centroidal_drift(self) -> Vec:
        """Ȧ_G v (6,) [N, N m]: the rate of that momentum when q̈ = 0; links then turn at a constant rate."""
        return self._view("centroidal_drift", lambda: self._momentum([(m.com.drift, 0.0) for m in self.motion]))

    @property
    def motion(self) -> list[LinkMotion]:
        """How each link moves, computed once an update."""
        if self._motion is None:
            self._motion = link_motions(self.model, self._q, self._v)
        return self._motion

    def _mean(self, values: list[Vec]) -> Vec:
        """The mean of vectors or matrices in the plane, weighted by the masses of the links; a row of zeros for z."""
        planar = np.tensordot(self.model.masses, values, axes=1) / self.model.mass
        return np.concatenate([planar, np.zeros((1, *planar.shape[1:]))])

    def _momentum(self, motions: list[tuple[Vec, Any]]) -> Vec:
        """Σ m ẋ and Σ (m (x − c) × ẋ + I ω) for each link's motion (ẋ, ω), six rows."""
        total: Vec = np.zeros((6, *motions[0][0].shape[1:]))
        for link, (velocity, spin), mass, inertia in zip(
            self.motion, motions, self.model.masses, self.model.inertias, strict=True
        ):
            arm = link.com.position - self.com[:2]
            total[:2] += mass * velocity
            total[5] += mass * (arm[0] * velocity[1] - arm[1] * velocity[0]) + inertia * spin
        return total

    def _view(self, name: str, compute: Callable[[], Vec]) -> Vec:
        """A read-only view of a quantity; from its first reading on, updates compute it."""
        if name not in self._views:
            memory = compute()
            self._views[name] = _read_only(memory)
            self._refreshes.append(lambda: np.copyto(memory, compute()))
        return self._views[name]

    def __reduce__(self) -> tuple[Any, ...]:
        return _restore, (self.model, self.t, np.array(self._q), np.array(self._v))

    def __repr__(self) -> str:
        return f"{self.model.name} at t = {self.t:g} s"


@final
class PlanarFrame(FrameState):
    """One frame of a :class:`PlanarState`; it follows the state's updates."""

    def __init__(self, state: PlanarState, name: str) -> None:
        self.name = name
        self._state = state
        self.placement = pinocchio.SE3.Identity()
        self._rotation, self._position = self.placement.rotation, self.placement.translation
        self.rotation, self.position = _read_only(self._rotation), _read_only(self._position)
        self._jacobian, self._drift = np.zeros((6, state.model.nv)), np.zeros(6)
        self.refresh()

    def refresh(self) -> None:
        """Take over what the state has become."""
        if self.name == "base":
            return
        link = self._state.motion[-1 if self.name == "end_effector" else int(self.name.removeprefix("link")) - 1]
        point = link.tip if self.name == "end_effector" else link.origin
        self._rotation[:2, :2] = link.axes
        self._position[:2] = point.position
        self._jacobian[:2], self._jacobian[5] = point.J, link.spin
        self._drift[:2] = point.drift

    def jacobian(self) -> Mat:
        """(6, n), world axes."""
        return _read_only(self._jacobian)

    def drift(self) -> Vec:
        """(6,) J̇ v, world axes, classical."""
        return _read_only(self._drift)

    def jacobian_local(self) -> Mat:
        """(6, n), the frame's axes."""
        return np.concatenate([self._rotation.T @ rows for rows in (self._jacobian[:3], self._jacobian[3:])])

    def drift_local(self) -> Vec:
        """(6,) J̇ v, the frame's axes, spatial: Rᵀ (p̈ − ω × ṗ)."""
        velocity = self._jacobian @ self._state.v
        spatial = self._drift[:3] - np.cross(velocity[3:], velocity[:3])
        return np.concatenate([self._rotation.T @ spatial, self._drift[3:]])

    def __reduce__(self) -> tuple[Any, ...]:
        return PlanarState.frame, (self._state, self.name)

    def __repr__(self) -> str:
        return f"{self.name} of {self._state!r}"


# ---- kinematics along the chain
class PointMotion(NamedTuple):
    """A point of a link in the plane: position (2,), Jacobian (2, n), drift J̇ v (2,)."""

    position: Vec
    J: Mat
    drift: Vec

    def shifted(self, arm: Vec, spin: Vec, omega: float) -> PointMotion:
        """The point at ``arm`` (2,) from this one on the same link, which turns with ω = spin · v."""
        normal = np.array([-arm[1], arm[0]])
        return PointMotion(self.position + arm, self.J + np.outer(normal, spin), self.drift - omega**2 * arm)


class LinkMotion(NamedTuple):
    """A link: axes (2, 2) in the world, spin (n,) with ω = spin · v, and its origin, centre of mass and tip."""

    axes: Mat
    spin: Vec
    origin: PointMotion
    com: PointMotion
    tip: PointMotion


def link_motions(model: PlanarRobot, q: Vec, v: Vec) -> list[LinkMotion]:
    """How each link moves, from the base outwards; q, v (n,).

    A prismatic joint shifts its link by u q: p̈ gains u q̈ and Coriolis' 2 ω × u q̇ beside what any point of the link
    before has.
    """
    n = model.nv
    tip = PointMotion(np.zeros(2), np.zeros((2, n)), np.zeros(2))
    axes, spin, omega = np.eye(2), np.zeros(n), 0.0
    links = []
    for i, joint in enumerate(model.chain.joints):
        along = axes[:, 1 if joint == "Py" else 0]
        if joint == "R":
            cos, sin = np.cos(q[i]), np.sin(q[i])
            axes = axes @ np.array([[cos, -sin], [sin, cos]])
            spin, omega = spin.copy(), omega + v[i]
            spin[i] = 1.0
            origin, along = tip, axes[:, 0]
        else:
            origin = tip.shifted(along * q[i], spin, omega)
            origin.J[:, i] += along
            origin.drift[:] += 2.0 * omega * v[i] * np.array([-along[1], along[0]])
        com = origin.shifted(along * model.offsets[i], spin, omega)
        tip = origin.shifted(along * model.lengths[i], spin, omega)
        links.append(LinkMotion(axes, spin, origin, com, tip))
    return links


# ---- arguments
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
    return Limits(_frozen(low), _frozen(high), _frozen(v), _frozen(tau))


def _read_only(array: Vec) -> Vec:
    view = array.view()
    view.flags.writeable = False
    return view


def _frozen(array: Vec) -> Vec:
    array.flags.writeable = False
    return array


def _restore(model: PlanarRobot, t: float, q: Vec, v: Vec) -> PlanarState:
    state = model.state()
    state.update(t, q, v)
    return state
