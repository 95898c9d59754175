"""What the checks of constraints and contacts find, and that they refuse what a stack refuses."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import pytest

from tasks import Damping, JointVelocityLimits, Point, Sole
from tests.testing.test_checks import Height, Kept, WrongSign
from wbc.control.controller import Controller
from wbc.errors import InvalidInput
from wbc.stack.constraint import Barrier, JointInterval, LinearConstraint
from wbc.stack.contact import Anchor, Contact
from wbc.stack.formulation import InverseDynamics
from wbc.stack.stack import Stack
from wbc.testing import CheckFailed, check_constraint, check_contact, robots

ARM = robots()[0]
FRAME = ARM.frame_names[-1]


class Ceiling(Barrier):
    """A right barrier: a frame stays below a height."""

    dim, units = 1, "m"

    def fill(self, state: Any, out: Any) -> None:
        frame = state.frame(FRAME)
        out.h[:] = 1.0 - frame.position[2]
        out.J[:] = -frame.jacobian()[2:3]
        out.drift[:] = -frame.drift()[2]


class CeilingUpsideDown(Ceiling):
    def fill(self, state, out):
        super().fill(state, out)
        out.J[:] *= -1.0


class CeilingWithoutDrift(Ceiling):
    def fill(self, state, out):
        super().fill(state, out)
        out.drift[:] = 0.0


class CeilingWhereItWas(Ceiling):
    """Its height is that of the first state that it sees."""

    start = None

    def fill(self, state, out):
        super().fill(state, out)
        self.start = out.h.copy() if self.start is None else self.start
        out.h[:] -= self.start


class CeilingKeptByConfiguration(Kept, Ceiling):
    pass


class CeilingKeptForEachConfiguration(Ceiling):
    def fill(self, state, out):
        super().fill(state, out)
        kept = self.__dict__.setdefault("kept", {})
        out.drift[:] = kept.setdefault(state.q.tobytes(), out.drift.copy())


class CeilingKeptOnTheClass(Ceiling):
    kept: ClassVar[dict[bytes, Any]] = {}

    def fill(self, state, out):
        super().fill(state, out)
        out.drift[:] = self.kept.setdefault(state.q.tobytes(), out.drift.copy())


class CeilingInMegametres(Ceiling):
    def fill(self, state, out):
        super().fill(state, out)
        for rows in (out.h, out.J, out.drift):
            rows *= 1e-6
        out.J *= self.sign

    sign = 1.0


def test_units_of_a_barrier_hide_no_mistake():
    check_constraint(CeilingInMegametres(), ARM)
    with pytest.raises(CheckFailed, match="dh/dq"):
        check_constraint(type("Wrong", (CeilingInMegametres,), {"sign": -1.0})(), ARM)


class PowerLimit(LinearConstraint):
    """A right linear constraint: the sum of the torques."""

    on, dim, units = "torque", 1, "N m"

    def fill(self, state: Any, out: Any) -> None:
        out.A[:], out.lo[:], out.hi[:] = 1.0, -np.inf, 50.0


@pytest.mark.parametrize("quantity", ["torques", "position", "jerk", "", None, 3])
def test_a_linear_constraint_on_what_no_level_decides_is_caught(quantity: Any):
    with pytest.raises(CheckFailed, match=r"Wrong\.on is "):
        check_constraint(type("Wrong", (PowerLimit,), {"on": quantity})())


@pytest.mark.parametrize("right", [PowerLimit, Ceiling])
@pytest.mark.parametrize("dim", [None, 0, -1, 1.5])
def test_a_constraint_without_rows_is_caught(right: type, dim: Any):
    with pytest.raises(CheckFailed, match=r"Wrong\.dim is .*positive integer"):
        check_constraint(type("Wrong", (right,), {"dim": dim})())


class PowerLimitCrossed(PowerLimit):
    def fill(self, state, out):
        super().fill(state, out)
        out.lo[:] = 60.0


class PowerLimitNowhere(PowerLimit):
    def fill(self, state, out):
        super().fill(state, out)
        out.lo[:] = out.hi[:] = np.inf


class PowerLimitWhereItWas(PowerLimit):
    first = None

    def fill(self, state, out):
        super().fill(state, out)
        self.first = state.t if self.first is None else self.first
        out.hi[:] += self.first


class NoSpeed(JointInterval):
    quantity = "velocity"

    def bounds(self, model: Any) -> Any:
        return np.full(model.nj, 0.5), np.ones(model.nj)


@pytest.mark.parametrize("constraint", [Ceiling(), PowerLimit(), JointVelocityLimits(), Height().exactly()], ids=str)
def test_a_right_constraint_passes(constraint: Any):
    check_constraint(constraint, ARM)


@pytest.mark.parametrize(
    ("constraint", "said"),
    [
        (CeilingUpsideDown(), "dh/dq"),
        (CeilingWithoutDrift(), "drift is 0"),
        (PowerLimitCrossed(), r"left nothing: lo\[0\] is 60 and hi\[0\] is 50"),
        (PowerLimitNowhere(), r"left nothing: lo\[0\] is inf and hi\[0\] is inf"),
        (PowerLimitWhereItWas(), "not pure: out.hi depends on the state that was filled first"),
        (CeilingWhereItWas(), "not pure: out.h depends on the state that was filled first"),
        (CeilingKeptByConfiguration(), "not pure: out.drift"),
        (CeilingKeptForEachConfiguration(), "not pure: out.drift"),
        (CeilingKeptOnTheClass(), "drift is "),
        (NoSpeed(), "must be allowed a velocity of 0"),
        (WrongSign().exactly(), "J for"),
        (Damping(), "is no JointInterval"),
    ],
    ids=str,
)
def test_a_wrong_constraint_is_caught(constraint: Any, said: str):
    with pytest.raises(CheckFailed, match=said):
        check_constraint(constraint, ARM)


def wrong(kind: type, **methods: Any) -> Any:
    """A contact with some methods replaced; the classes are final, so it is made here and not inherited."""
    made = kind(FRAME, friction=0.5, **({"half_size": (0.1, 0.1)} if kind is Sole else {}))
    for name, method in methods.items():
        setattr(made, name, method.__get__(made))
    return made


def _world_axes(self: Any, state: Any, anchor: Anchor, out: Any) -> None:
    Sole.fill(self, state, anchor, out)
    out.J[:] = state.frame(FRAME).jacobian()


def _flipped(self: Any, state: Any, anchor: Anchor, out: Any) -> None:
    Point.fill(self, state, anchor, out)
    out.e[:] *= -1.0


def _kept(self: Any, state: Any, anchor: Anchor, out: Any) -> None:
    Point.fill(self, state, anchor, out)
    kept = self.__dict__.setdefault("kept", {})
    out.drift[:] = kept.setdefault(state.q.tobytes(), out.drift.copy())


@pytest.mark.parametrize(
    ("contact", "said"),
    [
        (wrong(Sole, fill=_world_axes), "J"),
        (wrong(Point, fill=_flipped), "-de/dq"),
        (wrong(Point, cone=lambda self: -Point.cone(self)), "does not let the surface push"),
        (wrong(Point, cone=lambda self: np.zeros((4, 3))), "lets the surface pull"),
        (wrong(Point, cone_labels=lambda self: []), "0 cone labels; it must have 4"),
        (wrong(Sole, motion_units=lambda self: ("m",)), "1 motion units; it must have 6"),
        (wrong(Sole, anchor=lambda self, state: Anchor(np.eye(3), np.zeros(3))), "e at its own anchor"),
        (wrong(Point, fill=_kept), "drift is "),
    ],
)
def test_a_wrong_contact_is_caught(contact: Any, said: str):
    with pytest.raises(CheckFailed, match=said):
        check_contact(contact, ARM)


class Slider(Contact):
    """A right contact that gives lists where arrays do: the frame slides along x and holds y and z."""

    dim = np.int64(2)
    wrench_axes: Any = (1, 2)
    friction_rows: Any = ((1.0, -0.5), (-1.0, -0.5))
    labels: Any = (["fy <= mu fz", "N"], ["-fy <= mu fz", "N"])

    def anchor(self, state: Any) -> Anchor:
        return Anchor(np.eye(3).tolist(), list(state.frame(self.frame).position))

    def fill(self, state: Any, anchor: Anchor, out: Any) -> None:
        frame = state.frame(self.frame)
        out.J, out.drift = frame.jacobian()[1:3].tolist(), list(frame.drift()[1:3])
        out.e = list(anchor.position - frame.position)[1:]

    def cone(self) -> Any:
        return self.friction_rows

    def cone_labels(self) -> Any:
        return self.labels

    def motion_units(self) -> Any:
        return ["m", "m"]


class Slow(JointInterval):
    """A right interval that gives lists where arrays do."""

    quantity = "velocity"
    speed: Any = 1.0

    def bounds(self, model: Any) -> Any:
        return [-self.speed] * model.nj, [self.speed] * model.nj


@pytest.mark.parametrize(
    "member",
    [
        Slow(), Slider(FRAME, friction=0.5), type("Rows", (Ceiling,), {"dim": np.int64(1)})(),
        type("Axes", (Slider,), {"wrench_axes": np.array([1, 2])})(FRAME, friction=0.5),
    ],
    ids=str,
)  # fmt: skip
def test_a_member_that_gives_lists_or_integers_of_numpy_passes_and_works(member: Any):
    is_contact = isinstance(member, Contact)
    (check_contact if is_contact else check_constraint)(member, ARM)
    stack = Stack([Damping()], subject_to=[] if is_contact else [member], contacts=[member] if is_contact else [])
    assert Controller(ARM, stack, level=InverseDynamics()).tick(0.0, ARM.q0, np.zeros(ARM.nv)).status.ok


@pytest.mark.parametrize(
    "member",
    [
        type("Units", (Ceiling,), {"units": ("m", "m")})(),
        type("NoUnits", (PowerLimit,), {"units": None})(),
        PowerLimitNowhere(),
        PowerLimitCrossed(),
        type("OneNumber", (Slow,), {"bounds": lambda self, model: (-1.0, 1.0)})(),
        type("NoNumber", (Slow,), {"speed": np.nan})(),
        type("Long", (Slow,), {"bounds": lambda self, model: np.ones((2, model.nj + 1))})(),
        type("Nothing", (Slow,), {"speed": -1.0})(),
        type("NoLabel", (Slider,), {"labels": ["fy", "-fy"]})(FRAME, friction=0.5),
        type("NoNormal", (Slider,), {"wrench_axes": (0, 1)})(FRAME, friction=0.5),
        type("NoAxis", (Slider,), {"wrench_axes": (2, 6)})(FRAME, friction=0.5),
        type("NoCone", (Slider,), {"friction_rows": np.ones((2, 3))})(FRAME, friction=0.5),
    ],
    ids=str,
)
def test_a_check_refuses_what_a_stack_refuses_in_the_same_words(member: Any):
    is_contact = isinstance(member, Contact)
    with pytest.raises(CheckFailed) as found:
        (check_contact if is_contact else check_constraint)(member, ARM)
    stack = Stack([Damping()], subject_to=[] if is_contact else [member], contacts=[member] if is_contact else [])
    with pytest.raises(InvalidInput) as refused:
        Controller(ARM, stack, level=InverseDynamics())
    assert str(found.value) == str(refused.value) and member.name in str(refused.value)
