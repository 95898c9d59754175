"""Overrides: the changes that a component makes in one tick, as a value."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, final

import numpy as np

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.errors import InvalidInput
from wbc.types import Vec, read_only

#: Quantities of a joint whose bounds may be narrowed or lifted.
QUANTITIES = ("torque", "position", "velocity", "acceleration")
_MAPPINGS = ("lifted", "normal_limits", "normal_floors", "motors", "tasks")


class Motor(NamedTuple):
    """A motor that turns the command u into the torque τ = share u − offset [N m, N]; sound: share 1, offset 0.

    A motor of share 0 gives nothing whatever it is sent, and is sent 0.
    """

    share: float = 1.0
    offset: float = 0.0


@final
class Actuators:
    """Motor i turns the command u_i into the torque τ_i = share_i u_i − offset_i [N m, N]; sound: share 1, offset 0.

    A component reports faulty motors as ``Overrides(motors=...)``. The controller then sends the command that gives the
    wanted torque, u = (τ + offset) / share. A motor of share 0 gives no torque and gets the command 0.

    Args:
        share: (nj,), each between 0 and 1.
        offset: (nj,) [N m, N].

    Example:
        >>> import numpy as np
        >>> from wbc.stack.overrides import Actuators
        >>> motors = Actuators(np.array([1.0, 0.5]), np.array([0.0, 1.0]))
        >>> motors.command(np.array([3.0, 3.0])), motors.torque(np.array([3.0, 8.0]))
        (array([3., 8.]), array([3., 3.]))
    """

    def __init__(self, share: Vec, offset: Vec) -> None:
        self.share, self.offset = read_only(share), read_only(offset)
        gives = self.share > 0.0
        self._inverse = np.divide(1.0, self.share, out=np.zeros_like(self.share), where=gives)
        #: Whether all are.
        self.is_sound = bool((self.share == 1.0).all() and (self.offset == 0.0).all())

    def command(self, tau: Vec) -> Vec:
        """u (nj,) that gives the torques ``tau`` (nj,); the same array where all motors are sound."""
        if self.is_sound:
            return tau
        return read_only((tau + self.offset) * self._inverse)

    def torque(self, command: Vec) -> Vec:
        """τ (nj,) that ``command`` (nj,) gives; the same array where all motors are sound."""
        return command if self.is_sound else self.share * command - self.offset


@final
class _Values(dict[Any, Any]):
    """A mapping that stays as it was made."""

    def __reduce__(self) -> tuple[type[Any], tuple[dict[Any, Any]]]:
        return _Values, (dict(self),)

    def _refuse(self, *_: Any, **__: Any) -> Any:
        raise InvalidInput("overrides are a value; make other ones")

    __setitem__ = __delitem__ = __ior__ = update = setdefault = pop = popitem = clear = _refuse


_NONE = _Values()


def _nothing() -> Mapping[Any, Any]:
    return _NONE


@final
@dataclass(frozen=True, kw_only=True, eq=False)
class Overrides(metaclass=TellsArguments):
    """What ``Component.before`` returns. It holds for this tick and is forgotten: nothing has to be undone.

    The plan checks it before anything changes. It refuses values that are not finite, cross or have another shape, and
    names the component; the tick then gives a bounded fallback command with a status that is not ok.

    Args:
        torque, position, velocity, acceleration: bounds (lower, upper) [N m or N, rad or m, and per s and s²], a number
            or (nj,) each; ±inf where there is none. They only narrow: the limits of the stack hold beside them.
        lifted: of a quantity ("torque", "position", "velocity", "acceleration") the indices of joints whose limits in
            the stack do not hold in this tick. Bounds of components hold all the same.
        bias: generalised force (nv,) added to h [N, N m].
        inertia: (nv, nv), symmetric, added to M; the sum has no negative eigenvalue.
        normal_limits, normal_floors: upper and lower bounds on the normal force [N] of contacts, by name or frame.
            Floors need a schedule in the stack.
        motors: the :class:`Motor` of a joint, by joint index. Torque bounds are the torques that commands within the
            torque limits can give; the command makes the motor deliver the decided torque.
        tasks: settings of members by the member's name: ``{"Posture": {"weight": 0.1, "target": q}}``; of a task
            ``target``, ``weight``, ``active``, ``kp``, ``kd`` and ``rate``.

    Of several components: bounds intersect, biases and inertias add up, a joint is lifted if one lifts it, and of
    motors and settings the later component's hold. Torques and motors need the level ``InverseDynamics()``; bias,
    inertia and normal forces have no effect on the other levels.

    Example:
        >>> import wbc
        >>> tired = wbc.Overrides(torque=(-20.0, 20.0), tasks={"Posture": {"kp": 10.0}})
        >>> tired.torque[1].item(), dict(tired.tasks["Posture"])
        (20.0, {'kp': 10.0})
    """

    torque: Any = None
    position: Any = None
    velocity: Any = None
    acceleration: Any = None
    lifted: Mapping[str, Collection[int]] = field(default_factory=_nothing)
    bias: Any = None
    inertia: Any = None
    normal_limits: Mapping[str, float] = field(default_factory=_nothing)
    normal_floors: Mapping[str, float] = field(default_factory=_nothing)
    motors: Mapping[int, Motor] = field(default_factory=_nothing)
    tasks: Mapping[str, Mapping[str, Any]] = field(default_factory=_nothing)

    def __post_init__(self) -> None:
        """Copies: what is written later into an array that was given does not reach the plan."""
        given = self.__dict__
        for name, value in given.items():
            if name in _MAPPINGS:
                if type(value) is not _Values:
                    given[name] = _frozen(name, value)
            elif value is not None and name in QUANTITIES:
                given[name] = _bounds(name, value)
            elif isinstance(value, np.ndarray) and value.flags.writeable:
                given[name] = read_only(value.copy())


def _frozen(name: str, value: Any) -> Mapping[Any, Any]:
    checks.instance(name, value, Mapping, "a mapping")
    return _Values({key: _kept(name, key, one) for key, one in value.items()}) if value else _NONE


def _kept(name: str, key: Any, value: Any) -> Any:
    if name == "lifted" and not isinstance(value, str) and hasattr(value, "__iter__"):
        return tuple(value)
    if name != "tasks":
        return value
    checks.instance(f"tasks[{checks.shown(key)}]", value, Mapping, "a mapping, such as {'weight': 1.0}")
    return _Values({k: read_only(v.copy()) if isinstance(v, np.ndarray) else v for k, v in value.items()})


def _bounds(name: str, value: Any) -> Any:
    if not isinstance(value, tuple | list) or len(value) != 2:
        raise InvalidInput(f"{name} is {checks.shown(value)}; it must be (lower, upper)")
    if isinstance(value, tuple) and all(isinstance(v, np.ndarray) and not v.flags.writeable for v in value):
        return value
    return tuple(read_only(np.array(side)) for side in value)
