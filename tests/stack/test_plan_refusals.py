"""What a stack refuses while it is built, each by its name."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tasks as T
import wbc
from tests.stack.conftest import moving
from tests.stack.test_plan import SharedLoad, controller
from wbc.errors import InvalidInput, MemberFailed, NotSupported
from wbc.models.pinocchio_ import PinocchioModel
from wbc.stack.constraint import Barrier, BarrierRows, ConstraintRows, LinearConstraint
from wbc.stack.contact import Anchor
from wbc.stack.task import LinearRows, LinearTask, Task, TaskRows


class Forgetful(Task):
    """Writes no Jacobian."""

    dim, units = 1, "m"

    def fill(self, state: Any, out: TaskRows) -> None:
        out.e[:] = 0.0
        out.drift[:] = 0.0


class ForgetfulLinear(LinearTask):
    """Writes no right side."""

    on, dim, units = "torque", 1, "N m"

    def fill(self, state: Any, out: LinearRows) -> None:
        out.A[:] = 1.0


class HalfLaw(LinearConstraint):
    """Forgets its upper side."""

    on, dim, units = "torque", 1, "N m"

    def fill(self, state: Any, out: ConstraintRows) -> None:
        out.A[:] = 1.0
        out.lo[:] = -1.0


class HalfBarrier(Barrier):
    """Forgets h."""

    dim, units = 1, "m"

    def fill(self, state: Any, out: BarrierRows) -> None:
        out.J[:] = out.drift[:] = 0.0


class Nobody(wbc.Constraint):
    """Of no known kind."""


class Nowhere(LinearConstraint):
    """About positions, which are no unknown at any level."""

    on, dim, units = "position", 1, "rad"

    def fill(self, state: Any, out: ConstraintRows) -> None:
        out.A[:] = out.lo[:] = out.hi[:] = 0.0


class Rowless(Task):
    """Has no rows."""

    dim, units = 0, "m"

    def fill(self, state: Any, out: TaskRows) -> None: ...


class Clumsy(Task):
    """Writes a shape that does not fit."""

    dim, units = 3, "m"

    def fill(self, state: Any, out: TaskRows) -> None:
        out.J[:] = np.zeros((2, 2))


@pytest.mark.parametrize("task", [Forgetful(), ForgetfulLinear(), Rowless(), Clumsy()])
def test_a_task_that_cannot_be_filled_or_leaves_a_row_is_found_by_name(arm: PinocchioModel, task: Any) -> None:
    with pytest.raises(InvalidInput, match=type(task).__name__):
        controller(arm, wbc.Stack([task, T.Posture(arm.q0)]))


@pytest.mark.parametrize("constraint", [HalfLaw(), HalfBarrier(), Nobody(), Nowhere()])
def test_a_constraint_that_says_less_than_it_should_is_refused_by_name(arm: PinocchioModel, constraint: Any) -> None:
    with pytest.raises((InvalidInput, NotSupported), match=type(constraint).__name__):
        controller(arm, wbc.Stack([T.Posture(arm.q0)], subject_to=[constraint]))


class Between(LinearConstraint):
    """The torques of all joints are between two numbers, from a time on."""

    on, dim, units = "torque", 7, "N m"

    def __init__(self, lo: float, hi: float, *, since: float) -> None:
        super().__init__()
        self.lo, self.hi, self.since = lo, hi, since

    def fill(self, state: Any, out: ConstraintRows) -> None:
        out.A[:] = np.eye(7)
        out.lo[:], out.hi[:] = -50.0, 50.0
        if state.t >= self.since:
            out.lo[2], out.hi[2] = self.lo, self.hi


@given(lo=st.floats(-1e3, 1e3), gap=st.floats(1e-6, 1e3), softly=st.booleans())
def test_a_linear_constraint_with_crossed_bounds_is_refused_by_row(lo: float, gap: float, softly: bool) -> None:
    arm = wbc.load("arm")

    def stack(since: float) -> wbc.Stack:
        law = Between(lo, lo - gap, since=since)
        posture = T.Posture(arm.q0)
        return wbc.Stack([posture, law.softly()]) if softly else wbc.Stack([posture], subject_to=[law])

    with pytest.raises(InvalidInput, match=r"Between.* is left nothing: lo\[2\] is .* and hi\[2\] is "):
        controller(arm, stack(-1.0))
    later = controller(arm, stack(0.5))
    assert later.tick(0.0, arm.q0, np.zeros(7)).status.ok
    command = later.tick(0.5, arm.q0, np.zeros(7))
    assert not command.status.ok and np.isfinite(command.tau).all()
    assert "Between" in later.why and "lo[2]" in later.why


class Foot(wbc.Contact):
    """Three rows, and what a test makes of the rest."""

    dim, K = 3, [[1.0, 0.0, -0.5], [-1.0, 0.0, -0.5]]
    labels: Any = (("fx <= mu fz", "N"), ("-fx <= mu fz", "N"))
    units: Any = ("m", "m", "m")

    def anchor(self, state: Any) -> Anchor:
        return Anchor(np.eye(3), state.frame(self.frame).position)

    def fill(self, state: Any, anchor: Anchor, out: TaskRows) -> None:
        frame = state.frame(self.frame)
        out.J[:], out.drift[:] = frame.jacobian()[:3], frame.drift()[:3]
        out.e[:] = anchor.position - frame.position

    def cone(self) -> Any:
        return np.array(self.K)

    def cone_labels(self) -> Any:
        return self.labels

    def motion_units(self) -> Any:
        return self.units


@pytest.mark.parametrize("wrong", [
    {"K": [[1.0, 0.0], [-1.0, 0.0]]}, {"K": [1.0, 0.0, -0.5]}, {"K": [[1.0, 0.0, np.nan]] * 2}, {"K": "cone"},
    {"labels": ()}, {"labels": ("fx", "-fx")}, {"labels": (("fx",), ("-fx",))}, {"labels": None},
    {"units": ("m",)}, {"units": None}, {"motion_labels": lambda self: ["x"]}, {"wrench_axes": (0, 1)}, {"dim": None},
])  # fmt: skip
def test_a_contact_whose_sizes_do_not_agree_is_refused_by_name(arm: PinocchioModel, wrong: dict[str, Any]) -> None:
    for level in (wbc.InverseDynamics(), wbc.VelocityLevel()):
        controller(arm, wbc.Stack([T.Posture(arm.q0)], contacts=[Foot("tool", friction=0.5)]), level=level)
        contact = type("Foot", (Foot,), wrong)("tool", friction=0.5)
        with pytest.raises(InvalidInput, match=r"Foot\[tool\]"):
            controller(arm, wbc.Stack([T.Posture(arm.q0)], contacts=[contact]), level=level)


def test_torque_limits_that_leave_nothing_are_refused_by_joint(arm: PinocchioModel) -> None:
    class AtLeast(T.TorqueLimits.__mro__[1]):  # type: ignore[misc]
        """Every joint gives at least 1.5 N m."""

        quantity = "torque"

        def bounds(self, model: Any) -> Any:
            return np.full(7, 1.5), np.full(7, 2.0)

    with pytest.raises(InvalidInput, match=arm.joint_names[0]):
        controller(arm, wbc.Stack([T.Posture(arm.q0)], subject_to=[T.TorqueLimits(1.0), AtLeast()]))


def test_a_task_without_damping_needs_a_rate_at_the_velocity_level(arm: PinocchioModel) -> None:
    stack = wbc.Stack([T.Position("tool", target=[0.4, 0, 0.4], kd=0.0), T.Posture(arm.q0)])
    with pytest.raises(InvalidInput, match="rate"):
        controller(arm, stack, level=wbc.VelocityLevel())
    controller(arm, stack, level=wbc.AccelerationLevel())


def test_a_target_that_stops_giving_rates_is_at_rest(arm: PinocchioModel) -> None:
    goal = np.array([0.4, 0.1, 0.4])

    def target(t: float) -> Any:
        return (goal, np.ones(3), np.zeros(3)) if t < 1.0 else goal

    q, v = moving(arm, 1)
    commands = []
    for task in (T.Position("tool", target=target), T.Position("tool", target=goal)):
        control = controller(arm, wbc.Stack([task, T.Posture(arm.q0)]), level=wbc.VelocityLevel())
        control.tick(0.0, q, v)
        commands.append(control.tick(2.0, q, v).v)
    np.testing.assert_array_equal(*commands)


def test_what_a_level_cannot_carry_is_refused_by_name(arm: PinocchioModel) -> None:
    posture = T.Posture(arm.q0)
    for level in (wbc.VelocityLevel(), wbc.AccelerationLevel()):
        with pytest.raises(NotSupported, match="TorqueLimits"):
            controller(arm, wbc.Stack([posture], subject_to=[T.TorqueLimits()]), level=level)
        with pytest.raises(NotSupported, match="SharedLoad"):
            controller(arm, wbc.Stack([posture], subject_to=[SharedLoad(1.0)]), level=level)
    with pytest.raises(NotSupported, match="Torque"):
        controller(arm, wbc.Stack([T.Torque(), posture]), level=wbc.AccelerationLevel())


@pytest.mark.parametrize("level", [wbc.VelocityLevel(), wbc.AccelerationLevel()])
@pytest.mark.parametrize("error", [ZeroDivisionError, KeyError, ValueError, RecursionError, MemoryError, OverflowError])
def test_a_target_that_raises_while_a_controller_is_made_is_named(
    arm: PinocchioModel, level: wbc.VelocityLevel | wbc.AccelerationLevel, error: type[Exception]
) -> None:
    """Whichever of the calls that making a controller takes is the first to raise."""
    for make, value in ((T.Posture, arm.q0), (lambda f: T.Position("tool", target=f), np.array([0.4, 0.2, 0.5]))):
        raised = 0
        for sound in range(6):
            calls = iter(range(sound))

            def target(t: float, calls: Any = calls, value: Any = value) -> Any:
                if next(calls, None) is None:
                    raise error("users' code")
                return value

            try:
                wbc.Controller(arm, wbc.Stack([make(target)]), level=level)
            except MemberFailed as refusal:
                raised += 1
                assert "users' code" in str(refusal) and ("Posture" in str(refusal) or "Position" in str(refusal))
        assert raised >= 3
