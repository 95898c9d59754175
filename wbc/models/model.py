"""Interfaces of a robot: RobotModel (names, sizes, limits), RobotState (one instant), FrameState (a frame in it).

Nothing here knows any rigid-body library; :mod:`wbc.models.pinocchio_` and the planar robots implement it.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cache
from inspect import get_annotations
from typing import TYPE_CHECKING, Any, Protocol, final

import numpy as np

from wbc.errors import UnknownAttribute, UnknownFrame, UnknownJoint
from wbc.types import Mat, Vec


@final
@dataclass(frozen=True, eq=False)
class Limits:
    """Limits of each joint, (nj,) each: position [rad, m], speed [rad/s, m/s], torque [N m, N]; ±inf: none.

    The numbers are the model's own, even where they make no sense (a speed limit of 0 in a URDF):
    the limit that uses them refuses them by joint name.
    """

    q_min: Vec
    q_max: Vec
    v_max: Vec
    tau_max: Vec


class Pose(Protocol):
    """A frame in the world: ``rotation`` (3, 3), ``translation`` (3,), as pinocchio.SE3 has them."""

    @property
    def rotation(self) -> Any: ...
    @property
    def translation(self) -> Any: ...


class FrameState(ABC):
    """One frame of a state. Arrays are views that follow the state: copy what you keep.

    Jacobians are (6, nv), linear rows first, at the frame's origin. ``jacobian`` and ``drift`` are
    in world axes, so that ``jacobian() @ v`` is the velocity of the origin and the angular velocity
    and ``jacobian() @ a + drift()`` their time derivatives (classical acceleration). The ``local``
    ones are in the frame's own axes and spatial: the derivative of the body twist.
    """

    name: str
    placement: Any
    position: Vec
    rotation: Mat

    @abstractmethod
    def jacobian(self) -> Mat:
        """(6, nv), world axes."""

    @abstractmethod
    def drift(self) -> Vec:
        """(6,) J̇ v, world axes, classical."""

    def linear_drift(self) -> Vec:
        """(3,) the acceleration of the origin when a = 0: the first half of ``drift``."""
        return self.drift()[:3]

    def angular_drift(self) -> Vec:
        """(3,) the angular acceleration when a = 0: the second half of ``drift``."""
        return self.drift()[3:]

    @abstractmethod
    def jacobian_local(self) -> Mat:
        """(6, nv), the frame's axes."""

    @abstractmethod
    def drift_local(self) -> Vec:
        """(6,) J̇ v, the frame's axes, spatial."""


@cache
def _attributes(kind: type[Any]) -> frozenset[str]:
    """What objects of a class have."""
    return frozenset(dir(kind)).union(*(get_annotations(base) for base in kind.__mro__))


class _Known:
    """What has the attributes that its class declares, and no others."""

    if not TYPE_CHECKING:  # else any attribute could be assigned

        def __setattr__(self, name: str, value: Any) -> None:
            if name[0] != "_" and name not in _attributes(type(self)):
                known = [one for one in _attributes(type(self)) if one[0] != "_"]
                raise UnknownAttribute(name, known, f"a {type(self).__name__} has none")
            object.__setattr__(self, name, value)


class RobotState(_Known, ABC):
    """A moment of a robot: everything read from it is consistent with (t, q, v).

    M a + h = Sᵀ τ + Jᵀ f. Arrays are read-only views that the next ``update`` overwrites. Quantities
    that nobody reads are not computed.
    """

    model: RobotModel
    #: False where nobody needs drifts (velocities are decided): they may be NaN then, and a task may leave them out.
    drifts: bool = True
    t: float
    q: Vec
    v: Vec
    q_joints: Vec
    v_joints: Vec

    @abstractmethod
    def update(self, t: float, q: Vec, v: Vec) -> None:
        """Move to time t [s], configuration q (nq,), velocity v (nv,)."""

    @abstractmethod
    def frame(self, name: str) -> FrameState:
        """The frame called ``name`` in this state; cheap after the first call.

        Raises:
            UnknownFrame: with the names that are near.
        """

    def pose(self, name: str) -> Any:
        """Where the frame called ``name`` is in this state; no view, so that later updates need not compute it.

        Raises:
            UnknownFrame: with the names that are near.
        """
        return self.frame(name).placement

    @property
    @abstractmethod
    def M(self) -> Mat:
        """Inertia matrix (nv, nv) [kg, kg m²]."""

    @property
    @abstractmethod
    def h(self) -> Vec:
        """Bias C v + g (nv,) [N, N m]."""

    @property
    @abstractmethod
    def g(self) -> Vec:
        """Gravity torques (nv,) [N, N m]."""

    @property
    @abstractmethod
    def coriolis(self) -> Mat:
        """The factor C (nv, nv) of h = C v + g with Ṁ = C + Cᵀ: p = M v changes by ṗ = Sᵀ τ + Jᵀ f + Cᵀ v − g."""

    @property
    @abstractmethod
    def com(self) -> Vec:
        """Centre of mass in the world (3,) [m]."""

    @property
    @abstractmethod
    def com_jacobian(self) -> Mat:
        """Jacobian of the centre of mass (3, nv)."""

    @property
    @abstractmethod
    def com_drift(self) -> Vec:
        """Acceleration of the centre of mass when a = 0 (3,) [m/s²]."""

    @property
    @abstractmethod
    def centroidal_map(self) -> Mat:
        """A_G (6, nv): A_G v is the linear momentum [kg m/s], then the angular momentum about the centre of mass
        [kg m²/s], world axes. Source: Orin, Goswami, Lee, Autonomous Robots 2013."""

    @property
    @abstractmethod
    def centroidal_drift(self) -> Vec:
        """Ȧ_G v (6,) [N, N m]: the rate of that momentum when a = 0."""


class RobotModel(_Known, ABC):
    """A robot: names, sizes, limits, and the integrator of its configuration space.

    ``nb`` floating-base velocities (0 or 6), ``nj`` joints; ``q0`` is the reference configuration
    (a stance where the robot has one); ``mass`` in kg; ``gravity`` (3,) [m/s²], world.
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

    @property
    def weightless(self) -> str:
        """What can move, or one of several that can move together, while nothing of any mass does; "" for nothing."""
        return ""

    @abstractmethod
    def state(self, *, drifts: bool = True) -> RobotState:
        """A new state at q0, at rest. Without ``drifts`` it may leave them NaN: a velocity is decided without them."""

    @abstractmethod
    def integrate(self, q: Vec, dq: Vec) -> Vec:
        """q ⊕ dq: the configuration reached by the tangent step dq (nv,)."""

    @abstractmethod
    def difference(self, q_from: Vec, q_to: Vec) -> Vec:
        """The step (nv,) with q_from ⊕ step = q_to."""

    @abstractmethod
    def random_configuration(self, rng: np.random.Generator) -> Vec:
        """A configuration inside the joint limits (floating base: any orientation, position within 1 m)."""

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
