"""A robot (RobotModel), one instant of it (RobotState) and a frame in that (FrameState), through Pinocchio.

Everything in a ``pinocchio.Data`` is a live view: it is taken once and follows the computation. What an ``update``
calls is learnt: a quantity that is read for the first time is added to the calls of this and of every later update,
so that a velocity controller never computes an inertia matrix.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from functools import cached_property, partial
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Protocol, Self, final

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike, NDArray

from wbc import checks
from wbc.errors import InvalidInput, UnknownFrame, UnknownJoint
from wbc.models.limits import Limits, finite_interval
from wbc.models.poses import configuration
from wbc.models.views import JointMemory, Known, matrix, view
from wbc.types import Mat, Vec, read_only

if TYPE_CHECKING:
    from wbc.compiled import Memory

_LOCAL, _WORLD_AXES = pin.ReferenceFrame.LOCAL, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED

#: What a state without drifts says of them.
_NO_DRIFT = read_only(np.full(6, np.nan))
_NO_MOTION = SimpleNamespace(vector=_NO_DRIFT, linear=_NO_DRIFT[:3], angular=_NO_DRIFT[3:])


class Pose(Protocol):
    """A frame in the world: ``rotation`` (3, 3), ``translation`` (3,), as pinocchio.SE3 has them."""

    @property
    def rotation(self) -> Any: ...
    @property
    def translation(self) -> Any: ...


class RobotModel(Known):
    """A robot: names, sizes, limits, and the integrator of its configuration space.

    ``nb`` floating-base velocities (0 or 6), ``nj`` joints of one position each; ``q0`` is the reference configuration
    (a stance where the robot has one); ``mass`` in kg; ``gravity`` (3,) [m/s²], world; ``pinocchio``, the model of that
    library (to be read only: states keep copies), and ``frames``, the index of each frame in it.
    """

    name: str
    nq: int
    nv: int
    nb: int
    nj: int
    joint_names: tuple[str, ...]
    joint_units: tuple[str, ...]
    frame_names: tuple[str, ...]
    limits: Limits
    mass: float
    gravity: Vec
    q0: Vec
    pinocchio: Any
    frames: Mapping[str, int]

    def _take(self, model: Any, nb: int) -> None:
        """What the model says: sizes, names, mass, gravity."""
        self.pinocchio = model
        self.nq, self.nv, self.nb, self.nj = model.nq, model.nv, nb, model.nv - nb
        self.joint_names = tuple(model.names)[-self.nj :]
        self.mass = float(pin.computeTotalMass(model))
        self.gravity = read_only(model.gravity.linear.copy())
        self.frames = _frames(model)
        self.frame_names = tuple(self.frames)
        self.q0 = read_only(pin.neutral(model))

    def state(self, *, drifts: bool = True) -> RobotState:
        """A new state at q0, at rest; without ``drifts`` those of frames and of the centre of mass are NaN."""
        return RobotState(self, drifts=drifts)

    def integrate(self, q: Vec, dq: Vec) -> Vec:
        """q ⊕ dq: the configuration reached by the tangent step dq (nv,)."""
        return np.asarray(pin.integrate(self.pinocchio, q, dq), dtype=np.float64)

    def difference(self, q_from: Vec, q_to: Vec) -> Vec:
        """The step (nv,) with q_from ⊕ step = q_to."""
        return np.asarray(pin.difference(self.pinocchio, q_from, q_to), dtype=np.float64)

    @property
    def weight(self) -> float:
        """What the robot weighs [N]."""
        return self.mass * float(np.linalg.norm(self.gravity))

    @cached_property
    def weightless(self) -> tuple[str, ...]:
        """What can move, by itself or only with others of these, while nothing of any mass does; by name, in q0."""
        M = self.state().M
        scale = np.sqrt(np.maximum(np.diag(M), 1e-300))
        values, directions = np.linalg.eigh(M / np.outer(scale, scale))
        shares = (directions[:, values <= 1e-10] ** 2).sum(axis=1)
        found = np.flatnonzero(shares > 0.5 * max(shares.max(), 1e-10))
        joints = [f"joint {self.joint_names[i]!r}" for i in (found - self.nb).tolist() if i >= 0]
        return tuple(["the base"] * bool((found < self.nb).any()) + joints)

    def random_configuration(self, rng: np.random.Generator) -> Vec:
        """A configuration inside the joint limits, or ±π and ±1 m; a floating base is within 1 m, turned anyhow."""
        low, high = finite_interval(self.limits, np.array([np.pi if u == "rad" else 1.0 for u in self.joint_units]))
        q = np.concatenate([np.zeros(self.nq - self.nj), rng.uniform(low, high)])
        if self.nb:
            quaternion = rng.normal(size=4)
            q[:3] = rng.uniform(-1.0, 1.0, 3) / 3**0.5
            q[3:7] = quaternion / np.linalg.norm(quaternion)
        return q

    def replace(self, *, q0: ArrayLike | None = None, limits: Limits | None = None) -> Self:
        """The same robot with another reference configuration (nq,) or other limits.

        Raises:
            InvalidInput: a wrong size, NaN in ``q0``, or a quaternion in it that is not of length 1.
        """
        other = copy.copy(self)
        if q0 is not None:
            other.q0 = read_only(configuration(self, "q0", q0))
            other.__dict__.pop("weightless", None)
        if limits is not None:
            given = ((key, getattr(limits, key)) for key in ("q_min", "q_max", "v_max", "tau_max"))
            other.limits = Limits(
                *(read_only(checks.array(f"limits.{key}", value, (self.nj,), finite=False)) for key, value in given)
            )
        return other

    def joint(self, name: str) -> int:
        """Index of a joint in (nj,) arrays.

        Raises:
            UnknownJoint: with the names that are near.
        """
        try:
            return self.joint_names.index(name)
        except ValueError:
            raise UnknownJoint(name, self.joint_names) from None

    def check_frame(self, name: str) -> None:
        """That there is a frame called ``name``.

        Raises:
            UnknownFrame: with the names that are near.
        """
        if name not in self.frame_names:
            raise UnknownFrame(name, self.frame_names)

    def __deepcopy__(self, memo: object) -> Self:
        return self  # a value: all parts of a program may share it


@final
class RobotState(Known):
    """A moment of a robot: everything read from it is consistent with (t, q, v). For one thread at a time.

    M a + h = Sᵀ τ + Jᵀ f. Arrays are read-only views that the next ``update`` overwrites. Quantities that nobody reads
    are not computed: ``calls`` says what an update computes. Without ``drifts`` those are NaN: where velocities are
    decided nobody needs them. A copy or a pickle is a new state at the same (t, q, v), with memory of its own.

    Example:
        >>> from wbc.models import load
        >>> state = load("arm").state()
        >>> J = state.frame("tool").jacobian()
        >>> state.calls
        ('computeJointJacobians', 'updateFramePlacement[tool]')
    """

    model: RobotModel
    drifts: bool
    t: float
    q: Vec
    v: Vec
    q_joints: Vec
    v_joints: Vec
    #: The ``pinocchio.Data``; what is in it depends on what has been read from the state.
    data: Any

    def __init__(self, model: RobotModel, *, drifts: bool = True) -> None:
        self.model, self.drifts, self.t = model, drifts, 0.0
        self._moment = np.concatenate([model.q0, np.zeros(model.nv)])
        self._q, self._v = self._moment[: model.nq], self._moment[model.nq :]
        self.q, self.v = view(self._q, self._q), view(self._v, self._v)
        self.q_joints, self.v_joints = self.q[model.nq - model.nj :], self.v[model.nb :]
        self._zero = np.zeros(model.nv)
        self.data = model.pinocchio.createData()
        self._needs: set[str] = set()
        self._frames: dict[str, FrameState] = {}
        self._calls: list[Callable[[], object]] = []
        self._wholes: dict[bool, Memory] = {}

    @property
    def calls(self) -> tuple[str, ...]:
        """What an update computes, by the names of Pinocchio's functions: what has been read so far needs it.

        Beside them "complete" is :func:`wbc.models.compiled.whole.complete`.
        """
        return tuple(name for name, _ in self._plan())

    def update(self, t: float, q: Vec, v: Vec) -> None:
        """Move to time t [s], configuration q (nq,), velocity v (nv,).

        Raises:
            InvalidInput: q or v has another shape; the state stays as it was.
        """
        # Assignment would stretch a scalar.
        if getattr(q, "shape", None) != self._q.shape or getattr(v, "shape", None) != self._v.shape:
            self._refuse(q, v)
        self._q[...] = q
        self._v[...] = v
        self.move(t, self._moment)

    def move(self, t: float, moment: Vec) -> None:
        """Move to time t [s] and the configuration and velocity that are one array, ``moment`` (nq + nv,)."""
        self.__dict__["t"] = t  # no assignment: this runs every tick
        self._moment[...] = moment
        for call in self._calls:
            call()

    def frame(self, name: str) -> FrameState:
        """The frame called ``name`` in this state; cheap after the first call.

        Raises:
            UnknownFrame: with the names that are near.
        """
        try:
            return self._frames[name]
        except KeyError:
            pass
        self._frames[name] = found = FrameState(self, name)
        self._learn("kinematics")
        return found

    def pose(self, name: str) -> Any:
        """Where the frame called ``name`` is in this state; no view, so that later updates need not compute it.

        Raises:
            UnknownFrame: with the names that are near.
        """
        joint, placement = self._carrier(name)
        return self.data.oMi[joint] * placement

    @cached_property
    def joint_columns(self) -> Mat:
        """Spatial velocity (6, nv) about the world's origin that each velocity gives what its joint moves; with it the
        joints are placed, ``data.oMi``."""
        return self._learnt("kinematics", self.data.J, 6, self.model.nv)

    @cached_property
    def M(self) -> Mat:
        """Inertia matrix (nv, nv) [kg, kg m²]."""
        return self._learnt("M", self.data.M, self.model.nv, self.model.nv)

    @cached_property
    def h(self) -> Vec:
        """Bias C v + g (nv,) [N, N m]."""
        return self._learnt("h", self.data.nle, self.model.nv)

    @cached_property
    def g(self) -> Vec:
        """Gravity torques (nv,) [N, N m]."""
        return self._learnt("g", self.data.g, self.model.nv)

    @cached_property
    def coriolis(self) -> Mat:
        """The factor C (nv, nv) of h = C v + g with Ṁ = C + Cᵀ: p = M v changes by ṗ = Sᵀ τ + Jᵀ f + Cᵀ v − g."""
        return self._learnt("coriolis", self.data.C, self.model.nv, self.model.nv)

    @cached_property
    def com(self) -> Vec:
        """Centre of mass in the world (3,) [m]."""
        return self._learnt("com", self.data.com[0])

    @cached_property
    def com_jacobian(self) -> Mat:
        """Jacobian of the centre of mass (3, nv)."""
        return self._learnt("com", self.data.Jcom, 3, self.model.nv)

    @cached_property
    def com_drift(self) -> Vec:
        """Acceleration of the centre of mass when a = 0 (3,) [m/s²]."""
        if not self.drifts:
            return _NO_DRIFT[:3]
        return self._learnt("com_drift", self.data.acom[0])

    @cached_property
    def centroidal_map(self) -> Mat:
        """A_G (6, nv): A_G v is the linear momentum [kg m/s], then the angular momentum about the centre of mass
        [kg m²/s], world axes. Source: Orin, Goswami, Lee, Autonomous Robots 2013."""
        return self._learnt("centroidal_map", self.data.Ag, 6, self.model.nv)

    @cached_property
    def centroidal_drift(self) -> Vec:
        """Ȧ_G v (6,) [N, N m]: the rate of the centroidal momentum when a = 0."""
        if not self.drifts:
            return _NO_DRIFT
        return self._learnt("centroidal_drift", self.data.dhg.vector)

    def joint_memory(self, frame: str) -> JointMemory:
        """The memory of the joint that carries a frame, for compiled code."""
        joint, placement = self._carrier(frame)
        if self.drifts and "drift" not in self._needs:
            self._learn("drift")
        model, data = self.model.pinocchio, self.data
        columns = [
            column
            for carrier in model.supports[joint]
            for column in range(model.joints[carrier].idx_v, model.joints[carrier].idx_v + model.joints[carrier].nv)
            if carrier
        ]
        where = data.oMi[joint]
        arrays = (where.rotation, where.translation, data.v[joint].np, data.a[joint].np)
        place = np.concatenate([placement.rotation.ravel(), placement.translation])
        return JointMemory(place, columns, arrays, (data, where))

    def _learnt(self, need: str, array: NDArray[np.float64], *shape: int) -> NDArray[np.float64]:
        """A view of what is computed from now on."""
        self._learn(need)
        return view(array, self.data, *shape)

    @cached_property
    def _weightless(self) -> Any:
        """The robot without gravity. What holds it at a = 0 gives C v, by the accelerations that are the drifts: one
        pass for both. Gravity is then added by the map of the linear momentum."""
        model = self.model.pinocchio.copy()
        model.gravity = pin.Motion.Zero()
        return model

    def _carrier(self, frame: str) -> tuple[int, Any]:
        """The joint that carries a frame, placed from now on, and where the frame is in it."""
        self.model.check_frame(frame)
        if "kinematics" not in self._needs:
            self._learn("kinematics")
        found = self.model.pinocchio.frames[self.model.frames[frame]]
        return found.parentJoint, found.placement

    def _learn(self, need: str) -> None:
        """Compute one thing more, now and in every later update.

        All calls run again, in their fixed order: functions share memory (several write the centre of mass), and so
        the bits that a state gives depend on what is read from it, and not on the order.
        """
        self._needs.add(need)
        self._calls = [call for _, call in self._plan()]
        for call in self._calls:
            call()

    def _plan(self) -> list[tuple[str, Callable[[], object]]]:
        """The cheapest calls that give what is needed, by name."""
        model, data, q, v, zero = self.model.pinocchio, self.data, self._q, self._v, self._zero
        needs = self._needs
        plan: list[tuple[str, Callable[[], object]]] = []

        def add(name: str, *arguments: object, of: Any = model) -> None:
            plan.append((name, partial(getattr(pin, name), of, data, *arguments)))

        has_inertia, has_h = bool({"M", "h"} & needs), "h" in needs
        placed = has_inertia
        if "coriolis" in needs:
            add("computeCoriolisMatrix", q, v)
        if has_inertia:
            add("crba", q, pin.Convention.WORLD)  # placements, joint Jacobians, the centre of mass and A_G come with it
        elif "centroidal_map" in needs:
            add("ccrba", q, v)
        if has_h:
            add("nonLinearEffects", q, v, of=self._weightless)
        elif {"drift", "com_drift", "centroidal_drift"} & needs:
            add("forwardKinematics", q, v, zero)
            placed = True
        if "com_drift" in needs and not has_h:
            add("centerOfMass", pin.KinematicLevel.ACCELERATION, False)
        if has_h or (has_inertia and "com" in needs):
            from wbc.models.compiled import whole  # numba is slow to import

            memory = self._wholes.setdefault(has_h, whole.memory(model, data, has_h=has_h))
            plan.append(("complete", partial(whole.complete, memory.address)))
        if "centroidal_drift" in needs:
            add("computeCentroidalMomentumTimeVariation")
        if not has_inertia and "com" in needs:
            add("jacobianCenterOfMass", *(() if placed else (q,)), False)
        elif not has_inertia and "kinematics" in needs:
            add("computeJointJacobians", *(() if placed else (q,)))
        if "g" in needs:
            add("computeGeneralizedGravity", q)
        for name in self._frames:
            add("updateFramePlacement", self.model.frames[name])
            plan[-1] = (f"updateFramePlacement[{name}]", plan[-1][1])
        return plan

    def _refuse(self, q: object, v: object) -> None:
        for name, value, own in (("q", q, self._q), ("v", v, self._v)):
            if not isinstance(value, np.ndarray):
                raise InvalidInput(f"{name} must be an array, not {type(value).__name__}")
            if value.shape != own.shape:
                raise InvalidInput(f"{name} must have shape {own.shape}, not {value.shape}")

    def __reduce__(self) -> tuple[Any, ...]:
        # Views belong to one Data: a copy makes its own.
        return _restore, (self.model, self.t, np.array(self._q), np.array(self._v), self.drifts)

    def __repr__(self) -> str:
        return f"{self.model.name} at t = {self.t:g} s"


@final
class FrameState:
    """One frame of a state. Arrays are views that follow the state: copy what you keep.

    Jacobians are (6, nv), linear rows first, at the frame's origin. ``jacobian`` and ``drift`` are in world axes, so
    that ``jacobian() @ v`` is the velocity of the origin and the angular velocity and ``jacobian() @ a + drift()``
    their time derivatives (classical acceleration). The ``local`` ones are in the frame's own axes and spatial: the
    derivative of the body twist.
    """

    def __init__(self, state: RobotState, name: str) -> None:
        state.model.check_frame(name)
        index = state.model.frames[name]
        model, data = state.model.pinocchio, state.data
        self.name = name
        self._state, self._index = state, index
        self.placement = data.oMf[index]
        self.position = view(self.placement.translation, data)
        self.rotation = view(self.placement.rotation, data)
        columns = state.model.nv
        self._jacobian = matrix(partial(pin.getFrameJacobian, model, data, index, _WORLD_AXES), columns)
        self._jacobian_local = matrix(partial(pin.getFrameJacobian, model, data, index, _LOCAL), columns)

    def jacobian(self) -> Mat:
        """(6, nv), world axes."""
        return self._jacobian()

    def drift(self) -> Vec:
        """(6,) J̇ v, world axes, classical."""
        return self._classical().vector  # type: ignore[no-any-return]

    def linear_drift(self) -> Vec:
        """(3,) the acceleration of the origin when a = 0."""
        return self._classical().linear  # type: ignore[no-any-return]

    def angular_drift(self) -> Vec:
        """(3,) the angular acceleration when a = 0."""
        return self._classical().angular  # type: ignore[no-any-return]

    def jacobian_local(self) -> Mat:
        """(6, nv), the frame's axes."""
        return self._jacobian_local()

    def drift_local(self) -> Vec:
        """(6,) J̇ v, the frame's axes, spatial."""
        return self._spatial().vector  # type: ignore[no-any-return]

    @cached_property
    def _classical(self) -> Callable[[], Any]:
        return self._drifting(pin.getFrameClassicalAcceleration, _WORLD_AXES)

    @cached_property
    def _spatial(self) -> Callable[[], Any]:
        return self._drifting(pin.getFrameAcceleration, _LOCAL)

    def _drifting(self, acceleration: Callable[..., Any], axes: Any) -> Callable[[], Any]:
        """An acceleration of the frame: with a = 0 in the kinematics, which the state learns to compute, the drift."""
        state = self._state
        if not state.drifts:
            return lambda: _NO_MOTION
        state._learn("drift")
        return partial(acceleration, state.model.pinocchio, state.data, self._index, axes)

    def __reduce__(self) -> tuple[Any, ...]:
        return RobotState.frame, (self._state, self.name)

    def __repr__(self) -> str:
        return f"{self.name} of {self._state!r}"


def _restore(model: RobotModel, t: float, q: Vec, v: Vec, drifts: bool) -> RobotState:
    state = RobotState(model, drifts=drifts)
    state.update(t, q, v)
    return state


def _frames(model: Any) -> dict[str, int]:
    """Index of each frame by name: links, then joints that no link is called like; not what Pinocchio adds itself, the
    universe and the joint of a floating base."""
    found: dict[str, int] = {}
    kinds = (pin.FrameType.BODY, pin.FrameType.OP_FRAME, pin.FrameType.JOINT, pin.FrameType.FIXED_JOINT)
    for kind in kinds:
        for index, frame in enumerate(model.frames):
            own = frame.type == pin.FrameType.JOINT and model.nvs[frame.parentJoint] == 6
            if index and frame.type == kind and not own:
                found.setdefault(frame.name, index)
    return found
