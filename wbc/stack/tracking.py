"""What has a target: the property, and the readers that turn what a user gives into what a task reads."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
import pinocchio
from scipy.linalg.blas import dgemm

from wbc import checks
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel
from wbc.stack.objective import Objective
from wbc.stack.target import Convert, Target, floats, shaped
from wbc.types import Index, Mat, Vec, read_only

_SE3, _log3 = pinocchio.SE3, pinocchio.log3
_QUATERNION = "pinocchio.Quaternion(w, x, y, z)"


class Tracking(Objective):
    """A task with a ``target``: a value, or a function of time [s] giving a value or (value, rate, acceleration).

    It may be assigned between ticks and is checked there. Mixed in before the kind of task, with a ``convert``::

        class Position(Tracking, Task):
            dim, units, convert = 3, "m", staticmethod(vector_target(3))

    ``fill`` then reads ``self.reference(state)``: its ``value``, ``rate`` (dim,) and ``second`` (dim,).
    A task whose ``dim`` is only known in ``prepare`` assigns ``self.target = self.target`` there.

    Raises:
        InvalidInput: no target, or one of another shape, or not finite.
    """

    convert: Convert
    #: The same for rates and accelerations, where these may have another shape than (dim,).
    convert_rate: Convert | None = None
    #: Size of the target's rate and acceleration where it is not the task's ``dim``.
    target_dim: int | None = None
    _given: Any = None
    _reference: Target

    @property
    def target(self) -> Any:
        """What the task tracks: a value or a function of time, as it was given."""
        return self._given

    @target.setter
    def target(self, value: Any) -> None:
        if value is None:
            raise InvalidInput(f"{self.name}.target is None; give a value or a function of time (tasks keep no memory)")
        dim = self.target_dim or getattr(self, "dim", None)
        if dim is not None:
            self._reference = Target(f"{self.name}.target", value, dim, self.convert, self.convert_rate)
        if isinstance(value, np.ndarray):  # writing into what was given would go unseen
            value = read_only(value.copy())
        self._given = value

    def reference(self, t: float) -> Target:
        """The target at time t [s]."""
        return self._reference.at(t)

    @property
    def is_target_finite(self) -> bool:
        """Whether the target is, as it was evaluated last."""
        return self._reference.is_finite


def pose_target(name: str, value: Any, strict: bool) -> tuple[Mat, Vec]:
    """Rotation (3, 3) and position (3,) of a pinocchio.SE3 or a 4x4 matrix.

    Raises:
        InvalidInput: another shape; strict: not finite, not a rotation, last row not 0 0 0 1.
    """
    if isinstance(value, _SE3):
        if not strict:
            return value.rotation, value.translation
        value = value.homogeneous
    try:
        matrix = shaped((4, 4), name, value, strict)
    except InvalidInput as refusal:
        if checks.ndim(value) <= 0:  # no numbers, such as a pair of a position and a rotation
            said = f"{name} must be a pinocchio.SE3(rotation, position) or a (4, 4) matrix, not {checks.shown(value)}"
            raise InvalidInput(said) from None
        raise _of_quaternion(refusal, value, 7, f"pinocchio.SE3({_QUATERNION}, position)") from None
    if strict:
        if matrix[3].tolist() != [0.0, 0.0, 0.0, 1.0]:
            raise InvalidInput(f"{name}: the last row of a pose is 0 0 0 1, not {matrix[3]}")
        checks.rotation(name, matrix[:3, :3])
    return matrix[:3, :3], matrix[:3, 3]


def rotation_target(name: str, value: Any, strict: bool) -> Mat:
    """A rotation (3, 3).

    Raises:
        InvalidInput: another shape; strict: not finite, not a rotation.
    """
    try:
        matrix = shaped((3, 3), name, value, strict)
    except InvalidInput as refusal:
        raise _of_quaternion(refusal, value, 4, f"{_QUATERNION}.matrix()") from None
    if strict:
        checks.rotation(name, matrix)
    return matrix


def wrench_target(name: str, value: Any, strict: bool) -> Vec:
    """A wrench (6,), force before moment, of (6,) or of a force alone (3,).

    Raises:
        InvalidInput: another shape; strict: not finite.
    """
    vector = checks.array(name, value, (None,) * checks.ndim(value)) if strict else floats(name, value)
    if vector.shape not in ((3,), (6,)):
        raise InvalidInput(f"{name} must have shape (3,) or (6,), not {vector.shape}")
    return np.concatenate([vector, np.zeros(6 - len(vector))])


def joints_target(model: RobotModel, full: int, chosen: Index | None = None, others: Vec | None = None) -> Convert:
    """Reader of joint vectors: (nj,), or (full,) with the joints last, as q (nq,) and v (nv,) have them.

    Of the joints ``chosen`` alone too, one number each, in their order; the rest is then as ``others`` (nj,), or zero.
    """
    others = np.zeros(model.nj) if others is None else others
    return partial(_joints, (model.nj, full, model.name), None if chosen is None else (chosen, others))


def _joints(sizes: tuple[int, int, str], some: tuple[Index, Vec] | None, name: str, value: Any, strict: bool) -> Vec:
    nj, full, robot = sizes
    if isinstance(value, Mapping):
        raise InvalidInput(f"{name} must be an array of numbers, not by name; robot.configuration({{...}}) makes one")
    vector = checks.array(name, value, (None,) * checks.ndim(value)) if strict else floats(name, value)
    if vector.shape in ((nj,), (full,)):
        return vector[-nj:]
    if some is not None and vector.shape == some[0].shape:
        spread = some[1].copy()
        spread[some[0]] = vector
        return spread
    known = dict.fromkeys([nj, full] if some is None else [len(some[0]), nj, full])
    shapes = " or ".join(f"({size},)" for size in known)
    raise InvalidInput(f"{name} must have shape {shapes} on {robot}, not {vector.shape}")


def rotation_error(target: Mat, actual: Mat) -> Vec:
    """log(target actualᵀ): the rotation vector [rad], world axes, that turns ``actual`` into ``target``."""
    error: Vec = _log3(dgemm(1.0, target, actual, 0.0, None, 0, 1))
    return error


def _of_quaternion(refusal: InvalidInput, value: Any, size: int, way: str) -> InvalidInput:
    """The refusal, with the ``way`` to give what it is where that has the ``size`` of a quaternion."""
    is_one = isinstance(value, pinocchio.Quaternion) or (checks.ndim(value) == 1 and len(value) == size)
    return InvalidInput(f"{refusal}; of a quaternion give {way}") if is_one else refusal
