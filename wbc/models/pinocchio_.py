"""Robots through Pinocchio. A state computes what is read from it, in as few calls as can be.

Everything in a ``pinocchio.Data`` is a live view: it is taken once and follows the computation. What an ``update``
calls is learnt: a quantity that is read for the first time is added to the calls of this and of every later update,
so that a velocity controller never computes an inertia matrix.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Literal, final

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from wbc import checks
from wbc.errors import InvalidInput, ModelError
from wbc.models.feet import Foot
from wbc.models.model import FrameState, Limits, RobotModel, RobotState
from wbc.models.urdf import Joint, Urdf
from wbc.types import Mat, Vec

_LOCAL, _WORLD_AXES = pin.ReferenceFrame.LOCAL, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED

#: Frames that Pinocchio adds and no URDF has.
_INTERNAL = {"universe", "root_joint"}


@final
class PinocchioModel(RobotModel):
    """A robot from a URDF. Made by :func:`wbc.models.load`; it does not change once made.

    Beside what every :class:`~wbc.models.model.RobotModel` has: ``base`` "fixed" or "floating"; ``urdf``, the checked
    description with its ``path`` and ``text()``; ``visuals`` and ``collisions``, shapes on links; ``feet`` by frame;
    ``pinocchio``, the model of that library (to be read only), and ``frames``, the index of each frame in it.

    A floating base is the root link of the URDF. Each joint has one position: joints without end count on past π and
    have infinite limits. Mimic joints are joints of their own. The mass is what moves: on a fixed base without the
    links bolted to the world.

    Raises:
        ModelError: Pinocchio cannot make a model of the description.
        InvalidInput: ``base`` is neither "fixed" nor "floating".

    Example:
        >>> from wbc.models import load
        >>> robot = load("quadruped")
        >>> robot.nq, robot.nv, robot.nb, robot.nj
        (19, 18, 6, 12)
        >>> state = robot.state()
        >>> state.update(0.0, robot.q0, 0 * state.v)
        >>> float(state.frame("front_left_foot").position[2].round(3)), state.M.shape
        (0.02, (18, 18))
    """

    def __init__(
        self,
        urdf: Urdf,
        *,
        base: Literal["fixed", "floating"] = "fixed",
        name: str | None = None,
        feet: Sequence[Foot] = (),
    ) -> None:
        if base not in ("fixed", "floating"):
            raise InvalidInput(f"base is {base!r}; it must be 'fixed' or 'floating'")
        self.urdf = urdf
        self.base = base
        self.name = name or urdf.name
        self.visuals, self.collisions = urdf.visuals, urdf.collisions
        self.feet: Mapping[str, Foot] = {foot.frame: foot for foot in feet}
        self.pinocchio = model = _build(urdf, base)
        self.nq, self.nv = model.nq, model.nv
        self.nb = 6 if base == "floating" else 0
        self.nj = self.nv - self.nb
        self.joint_names = tuple(model.names)[-self.nj :]
        by_name = {joint.name: joint for joint in urdf.joints}
        joints = [by_name[joint] for joint in self.joint_names]
        self.joint_units = tuple("m" if joint.kind == "prismatic" else "rad" for joint in joints)
        self.limits = _limits(joints)
        self.mass = float(pin.computeTotalMass(model))
        self.gravity = _frozen(model.gravity.linear.copy())
        self.frames: Mapping[str, int] = _frames(model)
        self.frame_names = tuple(self.frames)
        for foot in self.feet:
            self.check_frame(foot)
        self.q0 = _frozen(pin.neutral(model))
        self.q0 = _frozen(self.configuration({}))

    def state(self) -> PinocchioState:
        """A new state at q0, at rest."""
        return PinocchioState(self)

    def integrate(self, q: Vec, dq: Vec) -> Vec:
        """q ⊕ dq: the configuration reached by the tangent step dq (nv,)."""
        return _vector(pin.integrate(self.pinocchio, q, dq))

    def difference(self, q_from: Vec, q_to: Vec) -> Vec:
        """The step (nv,) with q_from ⊕ step = q_to."""
        return _vector(pin.difference(self.pinocchio, q_from, q_to))

    def random_configuration(self, rng: np.random.Generator) -> Vec:
        """A configuration inside the joint limits (±π or ±1 m where there are none); floating base: any orientation,
        position within 1 m."""
        low, high = _finite_interval(self.limits, np.array([np.pi if u == "rad" else 1.0 for u in self.joint_units]))
        q = np.concatenate([np.zeros(self.nq - self.nj), rng.uniform(low, high)])
        if self.nb:
            quaternion = rng.normal(size=4)
            q[:3] = rng.uniform(-1.0, 1.0, 3) / 3**0.5
            q[3:7] = quaternion / np.linalg.norm(quaternion)
        return q

    def configuration(self, joints: Mapping[str, float]) -> Vec:
        """A configuration (nq,) from joint positions by name [rad, m]; the other joints at rest.

        At rest is zero, or the middle of the limits where zero is not inside them. A floating base stands upright
        above the origin, its lowest foot on the ground; without known feet it is at the origin.

        Raises:
            UnknownJoint: with the names that are near.
            InvalidInput: a position that is not finite.
        """
        q = np.concatenate([np.zeros(self.nq - self.nj), _rest(self.limits)])
        for name, position in joints.items():
            q[self.nq - self.nj + self.joint(name)] = checks.number(f"joints[{name!r}]", position)
        if self.nb:
            q[6] = 1.0
            q[2] = -self._lowest(q) if self.feet else 0.0
        return q

    def replace(self, *, q0: Vec | None = None, limits: Limits | None = None) -> PinocchioModel:
        """The same robot with another reference configuration or other limits.

        Raises:
            InvalidInput: a wrong size, NaN in ``q0``.

        Example:
            >>> from dataclasses import replace
            >>> from wbc.models import load
            >>> robot = load("arm")
            >>> slow = robot.replace(limits=replace(robot.limits, v_max=0.1 * robot.limits.v_max))
            >>> float(slow.limits.v_max[0] / robot.limits.v_max[0])
            0.1
        """
        other = copy.copy(self)
        if q0 is not None:
            other.q0 = _frozen(checks.array("q0", q0, (self.nq,)))
        if limits is not None:
            other.limits = Limits(
                *(
                    _frozen(checks.array(f"limits.{key}", getattr(limits, key), (self.nj,), finite=False))
                    for key in ("q_min", "q_max", "v_max", "tau_max")
                )
            )
        return other

    def _lowest(self, q: Vec) -> float:
        """Height of the lowest point of the feet [m]."""
        state = self.state()
        state.update(0.0, q, np.zeros(self.nv))
        return float(
            min(
                state.frame(foot.frame).placement.act(np.array(point))[2] - below
                for foot in self.feet.values()
                for point, below in foot.lowest()
            )
        )

    def __deepcopy__(self, memo: object) -> PinocchioModel:
        return self  # a value: all parts of a program may share it

    def __repr__(self) -> str:
        base = f", {self.base} base" if self.base == "floating" else ""
        return f"{self.name} ({self.nj} joints{base}, {self.mass:.1f} kg)"


@final
class PinocchioState(RobotState):
    """A moment of a robot, one ``pinocchio.Data``. For one thread at a time.

    ``calls`` says what an update computes. A copy or a pickle is a new state at the same (t, q, v), with memory of
    its own.

    Example:
        >>> from wbc.models import load
        >>> state = load("arm").state()
        >>> J = state.frame("tool").jacobian()
        >>> state.calls
        ('computeJointJacobians', 'updateFramePlacement[tool]')
    """

    model: PinocchioModel

    def __init__(self, model: PinocchioModel) -> None:
        self.model = model
        self.t = 0.0
        self._q, self._v = np.array(model.q0), np.zeros(model.nv)
        self.q, self.v = _view(self._q, self._q), _view(self._v, self._v)
        self.q_joints, self.v_joints = self.q[model.nq - model.nj :], self.v[model.nb :]
        self._zero = np.zeros(model.nv)
        self._data = data = model.pinocchio.createData()
        self._M, self._com_jacobian = _view(data.M, data, model.nv, model.nv), _view(data.Jcom, data, 3, model.nv)
        self._h, self._g = _view(data.nle, data, model.nv), _view(data.g, data, model.nv)
        self._coriolis = _view(data.C, data, model.nv, model.nv)
        self._com, self._com_drift = _view(data.com[0], data), _view(data.acom[0], data)
        self._needs: set[str] = set()
        self._frames: dict[str, PinocchioFrame] = {}
        self._calls: list[Callable[[], object]] = []

    @property
    def calls(self) -> tuple[str, ...]:
        """What an update computes, by the names of Pinocchio's functions: what has been read so far needs it."""
        return tuple(name for name, _ in self._plan())

    def update(self, t: float, q: Vec, v: Vec) -> None:
        """Move to time t [s], configuration q (nq,), velocity v (nv,).

        Raises:
            InvalidInput: q or v has another shape; the state stays as it was.
        """
        # Assignment would stretch a scalar. Attributes, not np.shape: this runs every tick.
        try:
            fits = q.shape == self._q.shape and v.shape == self._v.shape
        except AttributeError:
            fits = False
        if not fits:
            self._refuse(q, v)
        self.t = t
        self._q[:] = q
        self._v[:] = v
        for call in self._calls:
            call()

    def frame(self, name: str) -> PinocchioFrame:
        """The frame called ``name`` in this state; cheap after the first call.

        Raises:
            UnknownFrame: with the names that are near.
        """
        try:
            return self._frames[name]
        except KeyError:
            pass
        self._frames[name] = found = PinocchioFrame(self, name)
        self._learn("kinematics")
        return found

    @property
    def M(self) -> Mat:
        """Inertia matrix (nv, nv) [kg, kg m²]."""
        if "M" not in self._needs:
            self._learn("M")
        return self._M

    @property
    def h(self) -> Vec:
        """Bias C v + g (nv,) [N, N m]."""
        if "h" not in self._needs:
            self._learn("h")
        return self._h

    @property
    def g(self) -> Vec:
        """Gravity torques (nv,) [N, N m]."""
        if "g" not in self._needs:
            self._learn("g")
        return self._g

    @property
    def coriolis(self) -> Mat:
        """The factor C (nv, nv) of h = C v + g with Ṁ = C + Cᵀ."""
        if "coriolis" not in self._needs:
            self._learn("coriolis")
        return self._coriolis

    @property
    def com(self) -> Vec:
        """Centre of mass in the world (3,) [m]."""
        if "com" not in self._needs:
            self._learn("com")
        return self._com

    @property
    def com_jacobian(self) -> Mat:
        """Jacobian of the centre of mass (3, nv)."""
        if "com" not in self._needs:
            self._learn("com")
        return self._com_jacobian

    @property
    def com_drift(self) -> Vec:
        """Acceleration of the centre of mass when a = 0 (3,) [m/s²]."""
        if "com_drift" not in self._needs:
            self._learn("com_drift")
        return self._com_drift

    def _learn(self, need: str) -> None:
        """Compute one thing more, now and in every later update.

        All calls run again, in their fixed order: functions share memory (several write the centre of mass), and so
        the bits that a state gives do not depend on the order in which it is read.
        """
        self._needs.add(need)
        self._calls = [call for _, call in self._plan()]
        for call in self._calls:
            call()

    def _plan(self) -> list[tuple[str, Callable[[], object]]]:
        """The cheapest calls that give what is needed, by name."""
        model, data, q, v, zero = self.model.pinocchio, self._data, self._q, self._v, self._zero
        needs = self._needs
        plan: list[tuple[str, Callable[[], object]]] = []

        def add(name: str, *arguments: object) -> None:
            plan.append((name, partial(getattr(pin, name), model, data, *arguments)))

        placed = with_jacobians = False
        if "coriolis" in needs:
            add("computeCoriolisMatrix", q, v)
        if "M" in needs:
            add("crba", q, pin.Convention.WORLD)  # placements and joint Jacobians come with it
            placed = with_jacobians = True
        if "h" in needs:
            add("nonLinearEffects", q, v)
        if "com_drift" in needs:
            add("centerOfMass", q, v, zero)  # a forward kinematics too
            placed = True
        elif "drift" in needs:
            add("forwardKinematics", q, v, zero)
            placed = True
        if "com" in needs:
            add("jacobianCenterOfMass", *(() if placed else (q,)), False)
        elif "kinematics" in needs and not with_jacobians:
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
        return _restore, (self.model, self.t, np.array(self._q), np.array(self._v))

    def __repr__(self) -> str:
        return f"{self.model.name} at t = {self.t:g} s"


@final
class PinocchioFrame(FrameState):
    """One frame of a :class:`PinocchioState`; it follows the state's updates."""

    def __init__(self, state: PinocchioState, name: str) -> None:
        state.model.check_frame(name)
        index = state.model.frames[name]
        model, data = state.model.pinocchio, state._data
        self.name = name
        self._state = state
        self.placement = data.oMf[index]
        self.position = _view(self.placement.translation, data)
        self.rotation = _view(self.placement.rotation, data)
        columns = state.model.nv
        self._jacobian = _matrix(partial(pin.getFrameJacobian, model, data, index, _WORLD_AXES), columns)
        self._jacobian_local = _matrix(partial(pin.getFrameJacobian, model, data, index, _LOCAL), columns)
        # With a = 0 in the kinematics an acceleration is the drift.
        self._drift = partial(pin.getFrameClassicalAcceleration, model, data, index, _WORLD_AXES)
        self._drift_local = partial(pin.getFrameAcceleration, model, data, index, _LOCAL)

    def jacobian(self) -> Mat:
        """(6, nv), world axes."""
        return self._jacobian()

    def drift(self) -> Vec:
        """(6,) J̇ v, world axes, classical."""
        if "drift" not in self._state._needs:
            self._state._learn("drift")
        return self._drift().vector  # type: ignore[no-any-return]

    def jacobian_local(self) -> Mat:
        """(6, nv), the frame's axes."""
        return self._jacobian_local()

    def drift_local(self) -> Vec:
        """(6,) J̇ v, the frame's axes, spatial."""
        if "drift" not in self._state._needs:
            self._state._learn("drift")
        return self._drift_local().vector  # type: ignore[no-any-return]

    def __reduce__(self) -> tuple[Any, ...]:
        return PinocchioState.frame, (self._state, self.name)

    def __repr__(self) -> str:
        return f"{self.name} of {self._state!r}"


def _restore(model: PinocchioModel, t: float, q: Vec, v: Vec) -> PinocchioState:
    state = model.state()
    state.update(t, q, v)
    return state


def _build(urdf: Urdf, base: str) -> Any:
    """The Pinocchio model; joints without end as revolute ones."""
    text = urdf.text(continuous="revolute")
    try:
        model = (
            pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
            if base == "floating"
            else pin.buildModelFromXML(text)
        )
    except (RuntimeError, ValueError) as cause:
        raise ModelError(f"{urdf.path or urdf.name}: {cause}") from None
    return model


def _frames(model: Any) -> dict[str, int]:
    """Index of each frame by name: links, then joints that no link is called like."""
    found: dict[str, int] = {}
    kinds = (pin.FrameType.BODY, pin.FrameType.JOINT, pin.FrameType.FIXED_JOINT)
    for kind in kinds:
        for index, frame in enumerate(model.frames):
            if frame.type == kind and frame.name not in _INTERNAL:
                found.setdefault(frame.name, index)
    return found


def _limits(joints: Sequence[Joint]) -> Limits:
    fields = ("lower", "upper", "velocity", "effort")
    return Limits(*(_frozen(np.array([getattr(joint, key) for joint in joints])) for key in fields))


def _finite_interval(limits: Limits, span: Vec) -> tuple[Vec, Vec]:
    """Position limits, up to 2 span wide where one of them is infinite; ±span where they make no sense."""
    low, high, sane = limits.q_min, limits.q_max, limits.q_min < limits.q_max
    low = np.where(np.isfinite(low), low, np.minimum(-span, high - 2 * span))
    high = np.where(np.isfinite(high), high, np.maximum(span, low + 2 * span))
    return np.where(sane, low, -span), np.where(sane, high, span)


def _rest(limits: Limits) -> Vec:
    """Zero inside the limits, else the middle of the limits."""
    low, high = _finite_interval(limits, np.ones_like(limits.q_min))
    return np.where((low < 0) & (high > 0), 0.0, (low + high) / 2)


def _vector(value: Any) -> Vec:
    return np.asarray(value, dtype=np.float64)


class _Shared:
    """Memory of an owner, offered to numpy: an array made of it keeps the owner alive, and cannot be written."""

    def __init__(self, array: NDArray[np.float64], owner: object) -> None:
        interface = dict(array.__array_interface__)
        interface["data"] = (interface["data"][0], True)
        self.__array_interface__ = interface
        self._owner = owner


def _view(array: NDArray[np.float64], owner: object, *shape: int) -> NDArray[np.float64]:
    """The same memory, read only. What Pinocchio hands out does not always keep its Data alive, and drops an axis
    of length one; this does not."""
    view = np.asarray(_Shared(array, owner))
    return view.reshape(shape) if shape else view


def _matrix(call: Callable[[], Any], columns: int) -> Callable[[], Mat]:
    """A Jacobian; for a robot of one joint Pinocchio gives a vector."""
    return call if columns > 1 else lambda: call().reshape(6, 1)


def _frozen(array: NDArray[np.float64]) -> NDArray[np.float64]:
    array.flags.writeable = False
    return array
