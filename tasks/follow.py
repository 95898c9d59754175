"""Follow: a stream of samples at any rate becomes a reference with bounded velocity, acceleration and jerk."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from math import inf
from threading import Lock
from typing import Any, final

import numpy as np
import pinocchio

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.errors import InvalidInput
from wbc.stack.tracking import pose_target, rotation_target
from wbc.types import Mat, Vec

#: Limits of axes that move and of axes that turn, where none are given.
_LINEAR = {"velocity": 0.5, "acceleration": 5.0, "jerk": 100.0}
_ANGULAR = {"angular_velocity": 1.5, "angular_acceleration": 15.0, "angular_jerk": 300.0}
#: No read goes on by more [s].
_PAUSE = 1.0


@final
class Follow(metaclass=TellsArguments):
    """A target that follows samples: at any rate, late, in jumps, or not at all.

    ``start`` is a vector (n,), a rotation (3, 3) or a pose (pinocchio.SE3 or 4x4), and so is every sample. Each axis
    by itself, world axes for turns, keeps |ẋ| <= velocity, |ẍ| <= acceleration and |x⃛| <= jerk, and is the filter

        x⃛ = ω³ (sample − x) − 3 ω² ẋ − 3 ω ẍ,    ω = 3 / lag,

    where these leave room. The point where it would come to rest moves towards the sample and never beyond it. So it
    does not overshoot (by more than jerk (lag/60)³, half a micrometre), and rests at the last sample if no other comes.

    Other targets are functions of time; this one remembers. The same samples and reads give the same reference, to the
    last bit. It serves one controller; a read in the past gives what was given last, time that is set back goes on from
    there, and a pause counts as one second at most. A copy, or a pickle, is another one, at rest where this one is.

    Args:
        start: where it rests until the first sample.
        velocity, acceleration, jerk: a number or (n,) [m, or the unit of the vector, per s, s², s³]: 0.5, 5 and 100.
        angular_velocity, angular_acceleration, angular_jerk: a number or (3,) [rad/s, s², s³]: 1.5, 15 and 300.
        lag: how far behind steady samples [s], 0.005 to 10. Longer is smoother.

    Raises:
        InvalidInput: a start of another shape, a limit that is not positive, or one for what the start has not.

    Example:
        >>> from wbc.tasks import Follow, Position
        >>> hand = Follow([0.4, 0.0, 0.5], velocity=0.3)
        >>> task = Position("tool", target=hand)
        >>> hand.push([0.4, 0.2, 0.5])
        >>> for tick in range(1000):  # as a controller reads it
        ...     value, rate, acceleration = hand(0.002 * tick)
        >>> value.round(6)
        array([0.4, 0.2, 0.5])
    """

    __slots__ = (
        "_back", "_clock", "_follower", "_lag", "_limits", "_lock", "_new", "_read", "_settings", "_stamp", "_value",
        "late", "pushed", "refused",
    )  # fmt: skip

    #: Samples that were taken, that were older than the last one, and that were none.
    pushed: int
    late: int
    refused: int
    _clock: float
    _back: float
    _stamp: float

    def __init__(
        self, start: Any, *, velocity: Any = None, acceleration: Any = None, jerk: Any = None,
        angular_velocity: Any = None, angular_acceleration: Any = None, angular_jerk: Any = None, lag: float = 0.1,
    ) -> None:  # fmt: skip
        self._read, self._value, moves, turns = _kind(start)
        linear = {"velocity": velocity, "acceleration": acceleration, "jerk": jerk}
        angular = {
            "angular_velocity": angular_velocity,
            "angular_acceleration": angular_acceleration,
            "angular_jerk": angular_jerk,
        }
        self._settings = linear | angular
        self._limits = np.vstack([_limits(linear, _LINEAR, moves), _limits(angular, _ANGULAR, turns)])
        self._lag = checks.number("lag", lag, low=0.005, high=10.0)
        self._lock = Lock()
        self._rest(self._read("start", start))

    def push(self, sample: Any, t: float | None = None) -> None:
        """Follow another sample from the next read on; from any thread.

        ``t`` says when it was taken, on any clock [s]: one that is not newer than the last is left out, and counted
        in ``late``. What was taken is counted in ``pushed``.

        Raises:
            InvalidInput: another shape, not finite, not a rotation. It is counted in ``refused``; nothing else changes.
        """
        try:
            place = self._read("sample", sample)
            stamp = None if t is None else checks.number("t", t)
        except InvalidInput:
            with self._lock:
                self.refused += 1
            raise
        with self._lock:
            if stamp is not None:
                if stamp <= self._stamp:
                    self.late += 1
                    return
                self._stamp = stamp
            self.pushed += 1
            self._new.append(place)

    def reset(self, start: Any = None) -> None:
        """Stand still at ``start``, by default where it is, as if it had been made there: for a run that begins anew.

        Raises:
            InvalidInput: as in :meth:`push`.
        """
        self._rest(self._follower.place.copy() if start is None else self._read("start", start))

    def __call__(self, t: float) -> tuple[Any, Vec, Vec]:
        """Value, rate and acceleration at time t [s]; of poses linear before angular, world axes."""
        follower = self._follower
        # A read in the past goes on from another one in the past: time was set back, or this is the second read of all.
        since = self._back if self._back < t < self._clock else self._clock
        if not self.pushed:  # at rest, the clock may be set: a controller reads at 0 and one tick later when it is made
            self._clock = t
        elif t > since:
            follower.advance(min(t - since, _PAUSE))
            self._clock, self._back = t, inf
            if self._new:
                follower.take(self._new.pop())
        elif t < since:
            self._back = t
        return self._value(follower.place), follower.rate.copy(), follower.second.copy()

    def __reduce__(self) -> tuple[Any, tuple[Any]]:
        return partial(Follow, lag=self._lag, **self._settings), (self._value(self._follower.place),)

    def _rest(self, place: Vec) -> None:
        from .follower import Follower  # compiled code is loaded where somebody follows, and not before

        self._follower = Follower(place, self._limits, self._lag)
        self._new = deque[Vec](maxlen=1)
        self._clock = self._back = inf
        self._stamp = -inf
        self.pushed = self.late = self.refused = 0


_Read = Callable[[str, Any], Vec]
_Value = Callable[[Vec], Any]


def _kind(start: Any) -> tuple[_Read, _Value, int, int]:
    """How to read a sample as what a follower takes and how to give it back; how many axes move, and turn.

    A turn is a quaternion x y z w behind the linear axes.
    """
    if isinstance(start, pinocchio.SE3) or (checks.ndim(start) == 2 and np.shape(start) == (4, 4)):
        return _pose, _to_pose, 3, 3
    if checks.ndim(start) == 2:
        return _rotation, _to_rotation, 0, 3
    size = len(checks.array("start", start, (None,)))
    if not size:
        raise InvalidInput("start is empty; there is nothing to follow")
    return partial(_vector, size), np.copy, size, 0


def _vector(size: int, name: str, value: Any) -> Vec:
    return checks.array(name, value, (size,))


def _rotation(name: str, value: Any) -> Vec:
    quaternion: Vec = pinocchio.Quaternion(rotation_target(name, value, True)).coeffs()
    return quaternion / np.linalg.norm(quaternion)


def _pose(name: str, value: Any) -> Vec:
    rotation, position = pose_target(name, value, True)
    return np.concatenate([position, _rotation(name, rotation)])


def _to_rotation(place: Vec) -> Mat:
    rotation: Mat = pinocchio.Quaternion(place).matrix()
    return rotation


def _to_pose(place: Vec) -> Any:
    return pinocchio.SE3(_to_rotation(place[3:]), place[:3])


def _limits(given: Mapping[str, Any], usual: Mapping[str, float], size: int) -> Mat:
    """Velocity, acceleration and jerk of so many axes, (size, 3)."""
    limits = np.zeros((size, 3))
    for i, (name, value) in enumerate(given.items()):
        if value is not None and not size:
            raise InvalidInput(f"{name} is given, and start has nothing that it is the limit of")
        limits[:, i] = column = checks.each(name, usual[name] if value is None else value, size)
        if (column <= 0.0).any():
            j = int(np.argmin(column))
            raise InvalidInput(f"{name}[{j}] is {column[j]:g}; a limit is positive")
    return limits
