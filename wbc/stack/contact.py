"""Contact: one object that gives motion rows, force variables, a friction cone and the cost of its force."""

from __future__ import annotations

from abc import abstractmethod
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any, ClassVar, Self, final

import numpy as np
from scipy.linalg import block_diag

from wbc import checks
from wbc.errors import InvalidInput
from wbc.friction import Pyramid
from wbc.models.model import RobotModel, RobotState
from wbc.stack.member import Member, setting
from wbc.stack.task_rows import TaskRows
from wbc.stack.tracking import pose_target
from wbc.types import Index, Mat, Vec

#: What the entries of a motion, and of a wrench, are called.
AXES = ("x", "y", "z", "roll", "pitch", "yaw")
WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")


@final
class Anchor:
    """Where a contact was made: rotation (3, 3) of its surface and position (3,) of its point, both in the world."""

    __slots__ = ("position", "rotation")

    def __init__(self, rotation: Any, position: Any) -> None:
        #: Stored by columns, as compiled code reads it.
        self.rotation: Mat = np.asfortranarray(checks.array("rotation", rotation, (3, 3)))
        self.position: Vec = checks.array("position", position, (3,))

    def move(self, to: Anchor) -> None:
        """The contact is made there now."""
        self.rotation[:], self.position[:] = to.rotation, to.position


class Contact(Member):
    """A frame that must not move, and the wrench that holds it.

    J a + J̇ v = kp e − kd J v keeps it where it was made; Jᵀ f enters the dynamics, so the rows of J are in the
    axes of the contact surface (z the normal), where ``cone`` K f <= 0 is constant. The cost is ½ force_weight ‖f‖²:
    on n contacts a robot of mass m sinks against tasks of weight 1 with force_weight g m² / n, 0.5 m/s² at 450 kg.

    ``friction`` µ; ``target`` the pose the contact holds (default: where the frame is when the contact is made). The
    friction cone is a pyramid of ``sides`` 4 or 8. ``friction_model`` "inner", the default, is inside the circular
    cone: |f_x|, |f_y| <= µ/√2 f_z with 4 sides. "outer" is around it: |f_x|, |f_y| <= µ f_z, so that along the diagonal
    it allows forces that slip, 1.41 µ f_z (with 8 sides 1.08 µ f_z). See :class:`~wbc.friction.Pyramid`.

    ``f_min`` <= f_z <= ``f_max`` [N] bound the normal force exactly (None: only the cone bounds it) at the
    inverse-dynamics level; both may be assigned between ticks. Bounds of a component come first: a schedule that
    unloads the foot lowers ``f_min`` too. A desired force is a task, :class:`~tasks.contact_force.ContactForce`.

    Raises:
        InvalidInput: numbers out of range, ``f_min`` above ``f_max``.
    """

    read_once = frozenset({"friction", "friction_model", "sides", "pyramid", "force_weight"})
    frame: str
    _f_min: float | None = None
    _f_max: float | None = None
    #: A part of the mechanism, which pushes and pulls, and holds whatever a schedule says.
    bilateral: ClassVar[bool] = False
    #: The frame of the robot that carries the other side; None: the world does.
    carrier: str | None = None

    def __init__(
        self,
        frame: str,
        *,
        friction: float,
        friction_model: str = "inner",
        sides: int = 4,
        kp: float = 100.0,
        kd: float | None = None,
        force_weight: float = 1e-6,
        f_min: float | None = None,
        f_max: float | None = None,
        target: Any = None,
        name: str | None = None,
    ) -> None:
        self.frame = self.subject = frame
        self._name = None if name is None else checks.text("name", name)
        self.pyramid = Pyramid(friction, friction_model, sides, name=self.name)
        self.friction, self.friction_model, self.sides = self.pyramid.friction, friction_model, self.pyramid.sides
        self.kp = kp
        self.kd = 2.0 * self.kp**0.5 if kd is None else kd
        self.force_weight = checks.number(f"{self.name}.force_weight", force_weight, low=0.0)
        self.f_max, self.f_min = f_max, f_min
        self.target = target

    def _pose(self, what: str, value: Any) -> Anchor | None:
        if _is_position(value) and self.dim != 3:
            raise InvalidInput(f"{self.name}.{what} is a position; a contact of {self.dim} rows needs a pose")
        return None if value is None else _as_anchor(f"{self.name}.{what}", value)

    def _gain(self, what: str, value: Any) -> float:
        return checks.number(f"{self.name}.{what}", value, low=0.0)

    def _force_bound(self, what: str, value: Any) -> float | None:
        if value is None:
            return None
        if self.bilateral:
            raise InvalidInput(f"{self.name}.{what}: it pushes and pulls; give force_weight")
        found = self._gain(what, value)
        low, high = (found, self._f_max) if what == "f_min" else (self._f_min, found)
        if low is not None and high is not None and low > high and not self._is_copy:
            raise InvalidInput(f"{self.name} is left no normal force: f_min is {low:g} N, above f_max, {high:g} N")
        return found

    target = setting(
        "target", "The pose at which the contact is held, read when it is made; None: that of the frame then.", _pose
    )
    kp = setting("kp", "Gain on what the contact has moved [1/s²].", _gain)
    kd = setting("kd", "Gain on the velocity of the contact [1/s]; critical where none was given at first.", _gain)
    f_min = setting("f_min", "Least normal force [N]; None: the bound of the friction cone, usually 0.", _force_bound)
    f_max = setting("f_max", "Largest normal force [N]; None: no bound.", _force_bound)

    @property
    def short_name(self) -> str:
        """The given name, or the frame: the part in brackets of the names of its rows."""
        return self._name or self.frame

    @property
    def wrench_axes(self) -> tuple[int, ...]:
        """Indices (dim,) of the entries of (fx, fy, fz, mx, my, mz) that the contact transmits, and of held motions."""
        return tuple(range(self.dim))

    def gains(self) -> tuple[Any, Any, Any]:
        """kp, kd and the rate at the velocity level, kp / kd: for all rows, or for each."""
        return self.kp, self.kd, self.kp / self.kd if self.kd > 0.0 else 0.0

    def motion_labels(self) -> Sequence[str]:
        """The name of each motion row."""
        return [AXES[axis] for axis in self.wrench_axes]

    def motion_units(self) -> Sequence[str]:
        """Unit of each motion row."""
        return ["m" if axis < 3 else "rad" for axis in self.wrench_axes]

    def force_labels(self) -> list[tuple[str, str]]:
        """(label, unit) of each number of the force."""
        return [(WRENCH[axis], "N" if axis < 3 else "N m") for axis in self.wrench_axes]

    def prepare(self, model: RobotModel) -> None:
        model.check_frame(self.frame)

    @classmethod
    def samples(cls, model: RobotModel) -> list[Self]:
        return [cls(model.frame_names[-1], friction=0.5)]

    @abstractmethod
    def anchor(self, state: RobotState) -> Anchor:
        """The pose of the contact in this state."""

    @abstractmethod
    def fill(self, state: RobotState, anchor: Anchor, out: TaskRows) -> None:
        """Write J (dim, nv), drift (dim,) and e (dim,) = anchor − actual for this state. Pure.

        What is beside these in a task's rows is zero unless written: surfaces stand still.
        """

    def rows(self, state: RobotState, anchor: Anchor | None = None) -> TaskRows:
        """What ``fill`` writes, in memory of its own; ``anchor`` None: made where it is in this state.

        Example:
            >>> import numpy as np, wbc
            >>> from wbc.tasks import feet
            >>> robot = wbc.load("humanoid", base="floating")
            >>> rows = feet(robot)[0].rows(robot.state())
            >>> rows.J.shape, np.abs(rows.e).max() < 1e-12
            ((6, 36), np.True_)
        """
        out = TaskRows()
        out.J, (out.drift, out.e) = np.zeros((self.dim, state.model.nv)), np.zeros((2, self.dim))
        self.fill(state, self.anchor(state) if anchor is None else anchor, out)
        return out

    @abstractmethod
    def cone(self) -> Mat:
        """K (k, dim) with K f <= 0 exactly the wrenches the surface can give."""

    @abstractmethod
    def cone_labels(self) -> Sequence[tuple[str, str]]:
        """(label, unit) of each row of the cone."""

    def __repr__(self) -> str:
        return f"{self.name}(friction={self.friction:g})"


def keys(contacts: Sequence[Contact]) -> Iterator[tuple[str, str]]:
    """(key, name) for what each contact may be called: its name, and its frame where no other contact has the same."""
    frames = Counter(contact.frame for contact in contacts)
    for contact in contacts:
        yield contact.name, contact.name
        if frames[contact.frame] == 1:
            yield contact.frame, contact.name


def cones(contacts: Sequence[Contact], *, lever: float = 1.0) -> tuple[Mat, Index]:
    """K (m, n) with K f <= 0 for the wrenches f (n,) of contacts, one behind the other, and which of f are normal.

    First a row for each contact, which presses, then the rows of all cones. Those of moments are divided by ``lever``
    [m], and so are forces [N].

    Example:
        >>> import wbc
        >>> from wbc.stack.contact import cones
        >>> from wbc.tasks import feet
        >>> K, normals = cones(feet(wbc.load("humanoid", base="floating")))
        >>> K.shape[1], normals
        (12, array([2, 8]))
    """
    levers = [[[lever if unit == "N m" else 1.0] for _, unit in contact.cone_labels()] for contact in contacts]
    cone = block_diag(*(contact.cone() / scale for contact, scale in zip(contacts, levers, strict=True)))
    normals = np.cumsum([0, *(contact.dim for contact in contacts[:-1])]) + 2
    return np.vstack([-np.eye(cone.shape[1])[normals], cone]), normals


def _is_position(value: Any) -> bool:
    return checks.ndim(value) == 1 and len(value) == 3


def _as_anchor(name: str, target: Any) -> Anchor:
    """From a pinocchio.SE3, a 4x4 pose, or for a point a position (3,)."""
    if isinstance(target, Anchor):
        return target
    if _is_position(target):
        return Anchor(np.eye(3), checks.array(name, target, (3,)))
    return Anchor(*pose_target(name, target, True))
