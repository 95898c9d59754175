"""The checks find what they are for: each wrong member is one mistake away from a right one."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import pytest

from tasks import Damping, Frame, JointVelocityLimits, Orientation, Point, Position, Sinusoid, Sole
from wbc.control.controller import Controller
from wbc.errors import InvalidInput, UnknownFrame, WbcError
from wbc.stack.constraint import Barrier, JointInterval, LinearConstraint
from wbc.stack.contact import Anchor, Contact
from wbc.stack.formulation import InverseDynamics
from wbc.stack.stack import Stack
from wbc.stack.task import LinearTask, Task
from wbc.testing import CheckFailed, check_constraint, check_contact, check_task, moments, robots

ARM, QUADRUPED, HUMANOID = robots()
FRAME = ARM.frame_names[-1]


class Height(Task):
    """A right task: the height of a frame. Its subclasses each have one thing wrong."""

    def __init__(self, frame: str = FRAME) -> None:
        self.dim, self.units, self.frame = 1, "m", frame
        super().__init__()

    def prepare(self, model: Any) -> None:
        model.check_frame(self.frame)

    def fill(self, state: Any, out: Any) -> None:
        frame = state.frame(self.frame)
        out.e[:] = 0.5 - frame.position[2]
        out.J[:] = frame.jacobian()[2:3]
        out.drift[:] = frame.drift()[2]


def test_a_right_task_passes():
    check_task(Height())


class WrongSign(Height):
    def fill(self, state, out):
        super().fill(state, out)
        out.J[:] *= -1.0


class NoDrift(Height):
    def fill(self, state, out):
        super().fill(state, out)
        out.drift[:] = 0.0


class LeavesNaN(Height):
    def fill(self, state, out):
        frame = state.frame(self.frame)
        out.e[:] = 0.5 - frame.position[2]
        out.J[:] = frame.jacobian()[2:3]


class Remembers(Height):
    ticks = 0

    def fill(self, state, out):
        super().fill(state, out)
        self.ticks += 1
        out.e[:] += 1e-3 * self.ticks


class KeepsAView(Height):
    """Holds on to the first state it sees, and so reads another robot's frame in a second plan."""

    seen = None

    def fill(self, state, out):
        self.seen = self.seen or state.frame(self.frame)
        out.e[:] = 0.5 - self.seen.position[2]
        out.J[:] = self.seen.jacobian()[2:3]
        out.drift[:] = self.seen.drift()[2]


class WritesSometimes(Height):
    """Leaves what another state wrote."""

    def fill(self, state, out):
        super().fill(state, out)
        if state.v[0] > 0.0:
            out.rate_ref[:] = 1.0


class WritesBeside(Height):
    def fill(self, state, out):
        super().fill(state, out)
        out.e.base[0] = 0.0


class PushesTheState(Height):
    def fill(self, state, out):
        super().fill(state, out)
        state._q[0] += 1e-3


class HoldsWhereItWas(Height):
    """Takes its target from the first state that it sees, so that another controller holds another place."""

    start = None

    def fill(self, state, out):
        super().fill(state, out)
        height = state.frame(self.frame).position[2]
        self.start = height if self.start is None else self.start
        out.e[:] = self.start - height


class KeepsByConfiguration(Height):
    """Computes its drift once for each configuration, so that it is that of the velocity seen there first."""

    kept: tuple[bytes, Any] = (b"", None)

    def fill(self, state, out):
        super().fill(state, out)
        if self.kept[0] != state.q.tobytes():
            self.kept = (state.q.tobytes(), out.drift.copy())
        out.drift[:] = self.kept[1]


class NegativeWeight(Height):
    def weights(self):
        return np.full(1, -1.0)


class WrongErrorRate(Height):
    def fill(self, state, out):
        super().fill(state, out)
        out.ed[:] = out.J @ state.v


class WrongUnits(Height):
    def __init__(self):
        super().__init__()
        self.units = ("m", "m")


@pytest.mark.parametrize(
    ("task", "said"),
    [
        (WrongSign, "J for"),
        (NoDrift, "drift is 0"),
        (LeavesNaN, r"left nan in out.drift\[0\]"),
        (Remembers, "not pure"),
        (KeepsAView, "not pure"),
        (WritesSometimes, "not pure"),
        (WritesBeside, "wrote beside out.e"),
        (PushesTheState, "changed the state"),
        (HoldsWhereItWas, "not pure: out.e depends on the state that was filled first"),
        (KeepsByConfiguration, "not pure: out.drift"),
        (NegativeWeight, r"weights\(\) are"),
        (WrongErrorRate, "ed is"),
        (WrongUnits, r"units is \('m', 'm'\)"),
    ],
)
def test_a_wrong_task_is_caught_and_named(task: type[Task], said: str):
    with pytest.raises(CheckFailed, match=f"{task.__name__}.*{said}"):
        check_task(task(), ARM)


class Scaled(Height):
    """The position of a frame, each row in a unit of its own; ``wrong`` says what is wrong with the second row."""

    def __init__(self, scale: tuple[float, ...], wrong: str = "") -> None:
        super().__init__()
        self.dim, self.scale, self.wrong = 3, np.array(scale), wrong

    def fill(self, state: Any, out: Any) -> None:
        frame, second = state.frame(self.frame), np.array([1.0, 0.0 if self.wrong else 1.0, 1.0])
        out.e[:] = -self.scale * frame.position
        out.J[:] = (self.scale * frame.jacobian()[:3].T).T
        out.drift[:] = self.scale * frame.drift()[:3] * (1.0 if self.wrong == "J" else second)
        if self.wrong == "J":
            out.J[1] *= -1.0


@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (1e-6, 1e-6, 1e-6), (1e6, 1e-3, 1.0), (1e-9, 1.0, 1e3)], ids=str)
def test_units_of_rows_hide_no_mistake(scale: tuple[float, ...]):
    check_task(Scaled(scale), ARM)
    for wrong in ("J", "drift"):
        with pytest.raises(CheckFailed, match=f"row 1: {wrong}"):
            check_task(Scaled(scale, wrong), ARM)


def test_a_wrong_row_is_named_with_both_numbers():
    with pytest.raises(CheckFailed, match=r"row 0: J for '\w+' is -?[\d.e-]+, -de/dq is -?[\d.e-]+"):
        check_task(WrongSign(), ARM)


def test_a_target_that_moves_must_say_how_fast():
    with pytest.raises(CheckFailed, match=r"rate_ref is 0.*must give \(value, rate, acceleration\)"):
        check_task(Position(FRAME, target=lambda t: np.array([t, 0.0, 0.0])), ARM)


def test_a_wrong_acceleration_of_a_target_is_caught():
    moving = Sinusoid([0.0, 0.0, 0.5], amplitude=0.1, frequency=0.5)
    with pytest.raises(CheckFailed, match="acc_ref is"):
        check_task(Position(FRAME, target=lambda t: (*moving(t)[:2], np.zeros(3))), ARM)


def test_a_rotation_error_in_the_wrong_axes_is_caught():
    class BodyAxes(Task):
        dim, units = 3, "rad"

        def fill(self, state: Any, out: Any) -> None:
            Orientation(FRAME).fill(state, out)
            out.J[:] = state.frame(FRAME).jacobian_local()[3:]
            out.drift[:] = state.frame(FRAME).drift_local()[3:]

    with pytest.raises(CheckFailed, match="J for"):
        check_task(BodyAxes(), ARM)


def test_a_task_is_checked_where_its_frame_exists_and_must_exist_somewhere():
    check_task(Height("pelvis"))
    with pytest.raises(CheckFailed, match="fits none of our robots"):
        check_task(Height("nowhere"))
    with pytest.raises(UnknownFrame):
        check_task(Height("nowhere"), ARM)


@pytest.mark.parametrize("wrong", [False, True])
def test_a_member_that_looks_for_its_frame_in_fill_alone_is_checked_where_that_exists(wrong: bool):
    class Unprepared(Height):
        def prepare(self, model: Any) -> None: ...

        def fill(self, state: Any, out: Any) -> None:
            super().fill(state, out)
            out.J[:] += wrong

    if wrong:
        with pytest.raises(CheckFailed, match="on humanoid, row 0: J"):
            check_task(Unprepared("pelvis"))
    else:
        check_task(Unprepared("pelvis"))
    with pytest.raises(
        CheckFailed, match="none of our robots, so give yours as the second argument; arm: there is no frame 'nowhere'"
    ):
        check_task(Unprepared("nowhere"))
    with pytest.raises(UnknownFrame):
        check_task(Unprepared("pelvis"), ARM)


def test_a_velocity_task_needs_no_position_error():
    check_task(Damping())


def test_moments_may_be_chosen():
    check_task(Frame(FRAME, target=np.eye(4)), ARM, moments(ARM, count=1, seed=7))


@pytest.mark.parametrize(("check", "member"), [(check_task, Height()), (check_constraint, JointVelocityLimits())])
def test_a_check_of_no_states_is_refused(check: Any, member: Any):
    with pytest.raises(InvalidInput, match="states is empty"):
        check(member, ARM, [])


def test_failures_are_assertions_and_ours():
    assert issubclass(CheckFailed, AssertionError)
    assert issubclass(CheckFailed, WbcError)


def test_a_linear_task_on_an_unknown_quantity_is_caught():
    class OnJerk(LinearTask):
        on, dim, units = "jerk", 1, "N"

        def fill(self, state: Any, out: Any) -> None:
            out.A[:], out.b[:] = 0.0, 0.0

    with pytest.raises(CheckFailed, match="on is 'jerk'"):
        check_task(OnJerk(), ARM)


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


class CeilingKeptByConfiguration(Ceiling):
    kept: tuple[bytes, Any] = (b"", None)

    def fill(self, state, out):
        super().fill(state, out)
        if self.kept[0] != state.q.tobytes():
            self.kept = (state.q.tobytes(), out.drift.copy())
        out.drift[:] = self.kept[1]


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
