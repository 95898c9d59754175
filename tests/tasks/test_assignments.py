"""What is assigned to a member of a running controller holds from the next tick on, or is refused."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from typing import Any, ClassVar

import numpy as np
import pytest

import wbc
from tasks import (
    AxisConeLimit,
    CollisionAvoidance,
    ConeLimit,
    HalfSpaceLimit,
    JointVelocityLimits,
    Point,
    Posture,
    Yaw,
    feet,
)
from tests.tasks.test_contract import MEMBERS
from wbc.errors import InvalidInput, WbcError
from wbc.models.model import RobotModel
from wbc.qp.problem import QP
from wbc.stack.constraint import Barrier, Constraint
from wbc.stack.contact import Contact
from wbc.testing import robots

ARM, _, HUMANOID = robots()
LEVEL = wbc.InverseDynamics(lm_damping=0.0)  # which remembers what the tick before left of a task
#: Attributes that are no settings: what ``prepare`` writes, and gains that follow from a stiffness.
OTHERS = {"dim", "units", "labels", "convert", "codes", "note", "name", "target_dim"}
FOLLOW = {"JointAdmittance": {"kp", "kd"}}
#: These need contacts of their own; the rows of the last depend on the ticks before.
LEFT_OUT = {"CenterOfPressure", "ContactForce", "InternalForce", "CollisionAvoidance"}


def another(value: Any) -> Any:
    """Another number, or numbers, of the same kind; None where there is none."""
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float) or (isinstance(value, np.ndarray) and value.dtype == np.float64):
        return 0.5 * value + 0.01
    return None


def settings_of(member: Any) -> list[str]:
    """The public attributes that its constructor set, and properties that may be assigned."""
    properties = {
        name for name in dir(type(member)) if isinstance(p := getattr(type(member), name), property) and p.fset
    }
    others = OTHERS | FOLLOW.get(type(member).__name__, set())
    return sorted(name for name in {*member.__dict__, *properties} - others if not name.startswith("_"))


def controller(robot: RobotModel, member: Any) -> wbc.Controller:
    """With a stack of the member, a posture, and the feet of a robot that has some."""
    rows: dict[str, list[Any]] = {"tasks": [Posture(robot.q0, weight=1e-3, name="beside")]}
    rows["contacts"] = feet(robot) if robot is HUMANOID and not isinstance(member, Contact) else []
    place = "contacts" if isinstance(member, Contact) else "subject_to" if isinstance(member, Constraint) else "tasks"
    rows.setdefault(place, []).append(member)
    return wbc.Controller(robot, wbc.Stack(**rows), level=LEVEL)  # type: ignore[arg-type]


def problem(control: wbc.Controller, t: float) -> QP:
    """Of a tick in a state that is not at rest."""
    robot = control.model
    control.tick(t, robot.integrate(robot.q0, np.full(robot.nv, 0.05)), np.full(robot.nv, 0.1))
    return control.qp


def made_for(robot: RobotModel, kind: Any) -> bool:
    """Whether its samples can stand in a stack for this robot."""
    try:
        for sample in kind.samples(robot):
            controller(robot, sample)
    except WbcError:
        return False
    return bool(kind.samples(robot))


@pytest.mark.parametrize(
    "kind", [kind for kind in MEMBERS if kind.__name__ not in LEFT_OUT], ids=lambda kind: kind.__name__
)
def test_a_setting_is_what_a_new_controller_would_have_or_is_refused(kind: Any) -> None:
    robot = HUMANOID if issubclass(kind, Contact) or not made_for(ARM, kind) else ARM
    for sample in kind.samples(robot):
        for name in settings_of(sample):
            member = copy(sample)
            value = another(getattr(member, name))
            if value is None:
                continue
            control = controller(robot, member)
            problem(control, 0.0)
            try:
                setattr(member, name, value)
                anew = controller(robot, copy(member))
            except WbcError:
                continue
            got, wanted = problem(control, control.dt), problem(anew, control.dt)
            for part in ("H", "g", "A", "b", "C", "cl", "cu", "lb", "ub"):
                np.testing.assert_allclose(
                    getattr(got, part), getattr(wanted, part), rtol=1e-9, atol=1e-12, err_msg=f"{name}: {part}"
                )


def test_what_cannot_be_assigned_is_named_with_a_way_to_change_it() -> None:
    for member, name in ((JointVelocityLimits(), "v_max"), (Point("left_sole", friction=0.5), "friction")):
        before = getattr(member, name)
        with pytest.raises(InvalidInput, match=rf"\.{name} is read once and cannot be assigned.*controller\.replace"):
            setattr(member, name, 0.2)
        assert getattr(member, name) is before


@pytest.mark.parametrize(
    "kind", [kind for kind in MEMBERS if issubclass(kind, Barrier | Contact)], ids=lambda kind: kind.__name__
)
@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf, "fast", None])
def test_a_gain_that_the_constructor_refuses_is_refused_when_it_is_assigned(kind: Any, value: Any) -> None:
    robot = HUMANOID if issubclass(kind, Contact) else next(one for one in (ARM, HUMANOID) if kind.samples(one))
    for sample in kind.samples(robot):
        for name in ("kp", "kd") if issubclass(kind, Contact) else ("rate",):
            before = getattr(sample, name)
            with pytest.raises(InvalidInput, match=rf"\.{name} "):
                setattr(sample, name, value)
            assert getattr(sample, name) == before


@pytest.mark.parametrize("kind", MEMBERS, ids=lambda kind: kind.__name__)
@pytest.mark.parametrize(
    "value", [np.full(17, np.nan), np.nan, "no frame", None, object()], ids=["array", "nan", "text", "none", "object"]
)
def test_nonsense_is_refused_where_it_is_assigned(kind: Any, value: Any) -> None:
    for sample in next(samples for robot in robots() if (samples := kind.samples(robot))):
        for name in settings_of(sample):
            before = getattr(sample, name)
            if isinstance(getattr(kind, name, None), property) or value is before:
                continue
            with pytest.raises(InvalidInput, match=rf"\.{name}"):
                setattr(sample, name, value)
            assert getattr(sample, name) is before


@pytest.mark.parametrize("kind", [HalfSpaceLimit, ConeLimit, AxisConeLimit, Yaw], ids=lambda kind: kind.__name__)
def test_an_assigned_direction_has_length_one_as_one_of_the_constructor(kind: Any) -> None:
    (sample, *_) = kind.samples(ARM)
    for name in {"normal", "axis", "direction"} & {*settings_of(sample)}:
        before = getattr(sample, name)
        setattr(sample, name, (3.0 * before).tolist())
        np.testing.assert_allclose(getattr(sample, name), before, atol=1e-15)


def test_a_margin_that_is_assigned_stays_within_the_reach() -> None:
    constraint = CollisionAvoidance(margin=0.02, reach=0.1)
    with pytest.raises(InvalidInput, match=r"reach is 0\.1 m; it must be more than the margin of 0\.2 m"):
        constraint.margin = 0.2
    assert constraint.margin == 0.02


def height(name: str, value: Any) -> float:
    if not isinstance(value, float):
        raise InvalidInput(f"{name} is no height")
    return value + 1.0


class Ceiling(Barrier):
    """A member of a user's own."""

    dim, units = 1, "m"
    checked: ClassVar[Mapping[str, Any]] = {"z_max": height}
    read_once = frozenset({"axis"})

    def __init__(self, frame: str, z_max: Any) -> None:
        self.frame = self.subject = frame
        super().__init__()
        self.axis, self.colour, self.z_max = 2, "red", z_max

    def fill(self, state: Any, out: Any) -> None:
        frame = state.frame(self.frame)
        out.h[:], out.J[:] = self.z_max - frame.position[2], -frame.jacobian()[2]
        out.drift[:] = -frame.drift()[2]


class Lower(Ceiling):
    """A subclass that declares nothing itself."""


@pytest.mark.parametrize("kind", [Ceiling, Lower])
def test_a_member_of_ones_own_declares_what_is_checked_and_what_is_read_once(kind: Any) -> None:
    with pytest.raises(InvalidInput, match=r"\.z_max is no height"):
        kind("tool", "high")
    limit = kind("tool", 2.0)
    control = wbc.Controller(ARM, wbc.Stack([Posture(ARM.q0)], subject_to=[limit]), level=LEVEL)
    with pytest.raises(InvalidInput, match=r"\.z_max is no height"):
        limit.z_max = "high"
    before = problem(control, 0.0).cl.copy()
    limit.z_max, limit.colour = 3.0, "blue"
    assert limit.z_max == 4.0 and not np.allclose(problem(control, control.dt).cl, before)
    for name in ("axis", "frame", "subject", "slack"):
        with pytest.raises(InvalidInput, match=rf"\.{name} is read once"):
            setattr(limit, name, "elsewhere")
