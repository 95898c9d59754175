"""The checks find what they are for: each wrong member is one mistake away from a right one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tasks import Damping, Distance, Frame, JointVelocityLimits, Orientation, Position, RelativePosition, Sinusoid
from wbc.errors import InvalidInput, UnknownFrame, WbcError
from wbc.stack.task import LinearTask, Task
from wbc.testing import CheckFailed, check_constraint, check_task, moments, robots

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


@pytest.mark.parametrize("robot", robots(), ids=str)
def test_a_right_task_that_no_joint_moves_passes(robot: Any):
    """Frames of one link: what moves them against each other, and what differences are, is rounding alone."""
    model = robot.pinocchio
    carriers = [(name, model.frames[model.getFrameId(name)].parentJoint) for name in robot.frame_names]
    rigid = [(a, b) for a, by_a in carriers for b, by_b in carriers if a != b and by_a == by_b]
    for frame, other in rigid[:12]:
        check_task(RelativePosition(frame, reference=other, target=np.zeros(3)), robot)
        check_task(Distance(frame, to=other, target=0.1), robot)


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


class Kept:
    """Of a member that computes its drift once for each configuration: that of the velocity seen there first."""

    kept: tuple[bytes, Any] = (b"", None)

    def fill(self, state, out):
        super().fill(state, out)
        if self.kept[0] != state.q.tobytes():
            self.kept = (state.q.tobytes(), out.drift.copy())
        out.drift[:] = self.kept[1]


class KeepsByConfiguration(Kept, Height):
    pass


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
