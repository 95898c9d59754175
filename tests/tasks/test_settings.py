"""Joints, weights and gains by name are the same as by number; what is assigned holds from the next tick on."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from typing import Any, ClassVar

import numpy as np
import pytest
from pinocchio import SE3

import wbc
from tasks import (
    AxisConeLimit,
    CollisionAvoidance,
    ConeLimit,
    Damping,
    FrozenJoints,
    HalfSpaceLimit,
    JointAdmittance,
    JointVelocity,
    JointVelocityLimits,
    LowAcceleration,
    MidRange,
    Obstacle,
    Point,
    Position,
    Posture,
    ProjectedGradient,
    Sinusoid,
    Torque,
    TorqueLimits,
    Yaw,
    feet,
)
from tests.stack.conftest import Saying
from tests.tasks.test_contract import MEMBERS
from wbc.errors import InvalidInput, UnknownJoint, WbcError
from wbc.models.geometry import Sphere
from wbc.models.model import RobotModel
from wbc.qp.problem import QP
from wbc.stack.constraint import Barrier, Constraint, JointInterval
from wbc.stack.contact import Contact
from wbc.stack.member import bound
from wbc.stack.task import Objective
from wbc.testing import robots

ARM, _, HUMANOID = robots()
NAMES = list(ARM.joint_names)
WRISTS = [name.startswith("wrist") for name in NAMES]
PARTS = list(zip(NAMES, WRISTS, strict=True))
LEVELS = [wbc.VelocityLevel(), wbc.AccelerationLevel(), wbc.InverseDynamics()]
TARGET = ARM.q0 + 0.3
each_level = pytest.mark.parametrize("level", LEVELS, ids=lambda level: level.name)
each_hierarchy = pytest.mark.parametrize(
    "hierarchy", [wbc.Weighted(), wbc.Strict(), wbc.Scaled()], ids=["weighted", "strict", "scaled"]
)


def decided(task: Any, level: Any, *, hierarchy: Any = None, **more: Any) -> np.ndarray:
    """What a tick decides with this task beside a light one on all joints."""
    v = np.linspace(-0.2, 0.3, ARM.nv)
    levels = [[task], [Posture(ARM.q0, weight=1e-2, name="rest")]]
    chosen = {} if hierarchy is None else {"hierarchy": hierarchy}
    command = wbc.Controller(ARM, wbc.Stack(levels, **more), level=level, **chosen).tick(0.1, ARM.q0, v)
    assert command.status.ok
    return command.v if level.order == 1 else command.a


def on(weight: float = 1.0) -> np.ndarray:
    """This weight for the wrists, none for other joints."""
    return np.where(WRISTS, weight, 0.0)


PAIRS: dict[str, tuple[Callable[[], Any], Callable[[], Any]]] = {
    "posture": (lambda: Posture(TARGET, joints=["wrist_.*"]), lambda: Posture(TARGET, weight=on())),
    "one weight": (lambda: Posture(TARGET, joints=["wrist_.*"], weight=3), lambda: Posture(TARGET, weight=on(3.0))),
    "weights": (
        lambda: Posture(TARGET, weight={".*": 0.5, "wrist_.*": 0.0, "wrist_roll": 2.0}),
        lambda: Posture(TARGET, weight=[2.0 if n == "wrist_roll" else 0.0 if wrist else 0.5 for n, wrist in PARTS]),
    ),
    "gains": (
        lambda: Posture(TARGET, kp={"elbow": 25.0}, kd={"wrist_.*": 7.0}, rate={"elbow": 3.0}),
        lambda: Posture(
            TARGET, kp=[25.0 if name == "elbow" else 100.0 for name in NAMES],
            kd=[7.0 if wrist else 10.0 if name == "elbow" else 20.0 for name, wrist in PARTS],
            rate=[3.0 if name == "elbow" else 100.0 / 7.0 if wrist else 5.0 for name, wrist in PARTS],
        ),
    ),
    "target of some": (
        lambda: Posture(TARGET[[6, 2]], joints=[NAMES[6], NAMES[2]], weight=[1.0, 4.0]),
        lambda: Posture(TARGET, weight=np.array([0, 0, 4.0, 0, 0, 0, 1.0])),
    ),
    "moving": (
        lambda: Posture(Sinusoid([0.5], amplitude=0.2, frequency=1.0), joints=[NAMES[3]]),
        lambda: Posture(Sinusoid([0.5] * 7, amplitude=0.2, frequency=1.0), weight=np.eye(7)[3]),
    ),
    "velocity": (lambda: JointVelocity([0.2], joints=["elbow"]), lambda: JointVelocity(0.2 * np.ones(7), weight=(
        [float(name == "elbow") for name in NAMES]))),
    "damping": (lambda: Damping(joints=["wrist_.*"], kd={"wrist_roll": 3.0}), lambda: Damping(
        weight=on(), kd=[3.0 if name == "wrist_roll" else 10.0 for name in NAMES])),
    "acceleration": (lambda: LowAcceleration(joints=["wrist_.*"]), lambda: LowAcceleration(weight=on())),
    "gradient": (
        lambda: ProjectedGradient(MidRange(), joints=["wrist_.*"]), lambda: ProjectedGradient(MidRange(), weight=on())
    ),
    "admittance": (
        lambda: JointAdmittance(
            TARGET, joints=["wrist_.*"], inertia={".*": 2.0}, damping={".*": 9.0}, stiffness=20.0, torque=1.0
        ),
        lambda: JointAdmittance(TARGET, inertia=2.0, damping=9.0, stiffness=20.0, torque=1.0, weight=on()),
    ),
    "frozen": (
        lambda: FrozenJoints({"wrist_.*": 0.2, "wrist_roll": 0.1}, kd={"wrist_pitch": 9.0}),
        lambda: Posture(np.where(np.array(NAMES) == "wrist_roll", 0.1, 0.2), weight=on(), kd=(
            [9.0 if name == "wrist_pitch" else 20.0 for name in NAMES])),
    ),
}  # fmt: skip


@pytest.mark.parametrize("pair", PAIRS)
@each_hierarchy
@each_level
def test_by_name_is_as_by_numbers(pair: str, level: Any, hierarchy: Any):
    named, numbered = (decided(make(), level, hierarchy=hierarchy) for make in PAIRS[pair])
    np.testing.assert_allclose(named, numbered, atol=1e-8 * (1.0 + np.abs(numbered).max()))


def test_torques_by_pattern():
    named = decided(Torque(2.0, joints=["wrist_.*"], weight={"wrist_roll": 0.5}), LEVELS[2])
    weights = [0.5 if name == "wrist_roll" else 1.0 for name in NAMES if name.startswith("wrist")]
    numbered = Torque(2.0, joints=[name for name in NAMES if name.startswith("wrist")], weight=weights)
    np.testing.assert_array_equal(named, decided(numbered, LEVELS[2]))


@pytest.mark.parametrize("make", [JointVelocityLimits, TorqueLimits])
def test_limits_by_pattern(make: Any):
    _, upper = make({".*": 5.0, "wrist_.*": 0.5}).bounds(ARM)
    np.testing.assert_array_equal(upper, np.where(WRISTS, 0.5, 5.0))


@each_level
def test_a_weight_by_name_assigned_between_ticks_is_in_force_in_the_next(level: Any):
    task = Posture(TARGET)
    stack = wbc.Stack([task, Posture(ARM.q0, weight=1e-2, name="rest")])
    controller = wbc.Controller(ARM, stack, level=level)
    v = np.linspace(-0.2, 0.3, ARM.nv)
    controller.tick(0.0, ARM.q0, v)
    task.weight, task.kp = {"wrist_.*": 0.0}, {"elbow": 4.0}
    command = controller.tick(0.1, ARM.q0, v)
    fresh = decided(Posture(TARGET, weight={"wrist_.*": 0.0}, kp={"elbow": 4.0}), level)
    np.testing.assert_allclose(command.v if level.order == 1 else command.a, fresh, atol=1e-5 * np.abs(fresh).max())


@each_level
@pytest.mark.parametrize("constraint", ["exactly", "within", "with_reaction"])
def test_a_constraint_on_some_joints_has_rows_for_these_alone(level: Any, constraint: str):
    if constraint == "with_reaction" and not level.dynamics:
        pytest.skip("reactions are forces")
    task = Posture(TARGET, joints=["wrist_.*"], kp=0.0 if constraint != "within" else 100.0)
    place = {"contacts": [task.with_reaction()]} if constraint == "with_reaction" else {
        "subject_to": [task.exactly() if constraint == "exactly" else task.within(1.0)]
    }  # fmt: skip
    still = decided(JointVelocity(np.ones(7)), level, **place)
    free = decided(JointVelocity(np.ones(7)), level)
    others = ~np.array(WRISTS)
    if constraint == "within":
        np.testing.assert_allclose(still, free, atol=1e-6)
        name = place["subject_to"][0].name
        controller = wbc.Controller(ARM, wbc.Stack([Posture(ARM.q0)], **place), level=level)
        assert controller.plan.margins()[name][0].dim == 2 * sum(WRISTS)
    else:
        assert np.abs(still[WRISTS] - free[WRISTS]).min() > 0.01
        if level.order == 1:
            np.testing.assert_allclose(still[others], free[others], atol=1e-6)


def test_joints_that_are_not_named_have_no_error():
    stack = wbc.Stack([Posture(TARGET, joints=["wrist_.*"])])
    controller = wbc.Controller(ARM, stack, level=LEVELS[0])
    controller.tick(0.0, ARM.q0, np.zeros(7))
    np.testing.assert_allclose(controller.plan.errors()["Posture[wrist_.*]"], np.where(WRISTS, 0.3, 0.0))


def test_a_tick_with_names_is_compiled_as_one_with_numbers_is():
    task = Posture(Sinusoid(ARM.q0, amplitude=0.2, frequency=1.0), joints=["wrist_.*"], weight={"wrist_roll": 0.1})
    assert wbc.Controller(ARM, wbc.Stack([task]), level=LEVELS[0]).plan.is_compiled


@pytest.mark.parametrize("member", [one for one in MEMBERS if issubclass(one, Objective)], ids=lambda one: one.__name__)
def test_every_task_takes_weights_by_the_labels_of_its_rows(member: Any):
    for sample in member.samples(ARM):
        if "TaskRows" in str(type(sample).fill.__annotations__) or sample.labels:
            own = bound(sample, ARM)
            if any(own.label(i) for i in range(own.dim)):
                own.__dict__["_role"] = type(own)._role
                own.weight = {".*": 3.0}
                assert set(own.weights()) <= {0.0, 3.0} and own.weights().any()


def test_an_assignment_that_matches_nothing_is_refused_and_changes_nothing():
    task = Posture(TARGET, weight=2.0)
    controller = wbc.Controller(ARM, wbc.Stack([task]), level=LEVELS[0])
    with pytest.raises(UnknownJoint, match="wheel"):
        task.weight = {"wheel_.*": 0.0}
    assert task.weight == 2.0 and controller.tick(0.0, ARM.q0, np.zeros(7)).status.ok


def test_a_weight_by_name_is_to_be_read():
    task = Posture(TARGET, weight={"elbow": 0.5})
    with pytest.raises(TypeError):
        task.weight["elbow"] = 1.0
    assert task.weight == {"elbow": 0.5}


# ---- what is assigned to a member of a running controller
FORGETFUL = wbc.InverseDynamics(lm_damping=0.0)  # which remembers what the tick before left of a task
#: Attributes that are no settings: what ``prepare`` writes.
OTHERS = {"dim", "units", "labels", "convert", "codes", "note", "name", "target_dim"}
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
    return sorted(name for name in {*member.__dict__, *properties} - OTHERS if not name.startswith("_"))


def controller(robot: RobotModel, member: Any) -> wbc.Controller:
    """With a stack of the member, a posture, and the feet of a robot that has some."""
    rows: dict[str, list[Any]] = {"tasks": [Posture(robot.q0, weight=1e-3, name="beside")]}
    rows["contacts"] = feet(robot) if robot is HUMANOID and not isinstance(member, Contact) else []
    place = "contacts" if isinstance(member, Contact) else "subject_to" if isinstance(member, Constraint) else "tasks"
    rows.setdefault(place, []).append(member)
    return wbc.Controller(robot, wbc.Stack(**rows), level=FORGETFUL)  # type: ignore[arg-type]


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
    task = Posture(TARGET).scaled()
    point = Point("left_sole", friction=0.5)
    place, ceiling = Position("tool", target=np.zeros(3)), Ceiling("tool", 2.0)
    rows = [(place, "dim"), (ceiling, "dim"), (ceiling, "units")]
    for member, name in ((JointVelocityLimits(), "v_max"), (point, "friction"), (task, "is_scaled"), *rows):
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


def test_pairs_have_rows_from_where_an_assigned_rate_says() -> None:
    """A slower approach is stopped from further away: the rows are those of a constraint that is made so."""
    ball = Obstacle("ball", Sphere(0.05), SE3(np.eye(3), ARM.state().frame("tool").position + 0.1))
    made = [CollisionAvoidance([ball], self_collision=False, reach=0.05, rate=rate) for rate in (15.0, 2.0)]
    controllers = [wbc.Controller(ARM, wbc.Stack([], subject_to=[one]), level=wbc.AccelerationLevel()) for one in made]
    controllers[0].tick(0.0, ARM.q0, np.zeros(ARM.nv))
    made[0].rate = 2.0
    some = 0
    for seed in range(10):
        v = np.random.default_rng(seed).normal(size=ARM.nv)
        rows = []
        for controller in controllers:
            controller.tick(1e-3, ARM.q0, v)
            rows.append([row for row in controller.plan.qp.C.round(9).tolist() if any(row[: ARM.nv])])
        assert sorted(row[: ARM.nv] for row in rows[0]) == sorted(row[: ARM.nv] for row in rows[1])
        some += len(rows[0])
    assert some


def test_a_margin_decides_which_pairs_are_looked_at_and_cannot_be_assigned() -> None:
    constraint = CollisionAvoidance(margin=0.02, reach=0.1)
    with pytest.raises(InvalidInput, match=r"margin is read once and cannot be assigned"):
        constraint.margin = 0.05
    assert constraint.margin == 0.02


@pytest.mark.parametrize("made", ["exactly", "within", "with_reaction"])
@pytest.mark.parametrize(("what", "value"), [("kp", 9.0), ("kd", 2.0), ("target", [-0.5])])
def test_an_override_reaches_the_task_of_a_constraint(made: str, what: str, value: Any) -> None:
    """By its name, which a constraint on some joints and a reaction have, too."""
    joint, state = ARM.joint_names[1], (ARM.q0 + 0.1, np.full(ARM.nv, 0.2))
    rows = []
    for overridden in (True, False):
        task = Posture([0.4], joints=[joint], name="lock")
        said = {"lock": {what: value}} if overridden else {}
        if not overridden:
            setattr(task, what, value)
        one = task.within(0.5) if made == "within" else getattr(task, made)()
        place = {"contacts" if made == "with_reaction" else "subject_to": [one]}
        stack = wbc.Stack([Damping()], components=[Saying(wbc.Overrides(tasks=said))], **place)
        controller = wbc.Controller(ARM, stack, level=wbc.AccelerationLevel())
        assert controller.tick(0.0, *state).status.ok, controller.why
        rows.append(controller.qp)
    for name in ("A", "b", "C", "cl", "cu"):
        np.testing.assert_array_equal(*(getattr(one, name) for one in rows))


def test_an_override_reaches_the_task_and_not_a_constraint_on_one_called_the_same() -> None:
    saying = Saying(wbc.Overrides(tasks={"Posture": {"weight": 7.0}}))
    stack = wbc.Stack([Posture(ARM.q0)], subject_to=[Posture(ARM.q0).within(2.0)], components=[saying])
    controller = wbc.Controller(ARM, stack, level=wbc.AccelerationLevel())
    assert controller.tick(0.0, ARM.q0, np.zeros(ARM.nv)).status.ok
    (task,), (limit,) = controller.plan.stack.tasks, controller.plan.stack.subject_to
    assert (task.weight, limit.task.weight) == (7.0, 1.0)


@pytest.mark.parametrize("made", ["exactly", "within", "with_reaction"])
def test_the_task_of_a_constraint_is_the_one_that_it_was_made_of(made: str) -> None:
    task = Posture([0.4], joints=[ARM.joint_names[1]])
    one = task.within(0.5) if made == "within" else getattr(task, made)()
    assert one.task is task
    with pytest.raises(InvalidInput, match="task is read once and cannot be assigned"):
        one.task = Posture(TARGET)


def test_the_constraint_of_a_soft_one_cannot_be_assigned() -> None:
    with pytest.raises(InvalidInput, match="constraint is read once and cannot be assigned"):
        JointVelocityLimits().softly().constraint = JointVelocityLimits()


def test_gains_that_follow_from_something_else_cannot_be_assigned() -> None:
    guided = JointAdmittance(ARM.q0, inertia=0.5, damping=4.0, stiffness=1.0)
    geared = Posture([0.4], joints=[ARM.joint_names[1]]).with_reaction(name="gear")
    for member in (guided, geared):
        saying = Saying(wbc.Overrides(tasks={member.name: {"kp": 3.0}}))
        place = {"contacts" if member is geared else "tasks": [member]}
        stack = wbc.Stack(place.pop("tasks", [Damping()]), components=[saying], **place)
        controller = wbc.Controller(ARM, stack, level=wbc.AccelerationLevel())
        assert not controller.tick(0.0, ARM.q0, np.zeros(ARM.nv)).status.ok
        assert "there is no setting 'kp'" in controller.why
        for gain in ("kp", "kd"):
            with pytest.raises(InvalidInput, match="is read once and cannot be assigned"):
                setattr(member, gain, 3.0)


class Slow(JointInterval):
    """A limit of a user's own."""

    quantity = "velocity"

    def __init__(self, most: float) -> None:
        super().__init__()
        self.most = most

    def bounds(self, model: RobotModel) -> Any:
        return np.full(model.nj, -self.most), np.full(model.nj, self.most)


@pytest.mark.parametrize("soft", [True, False])
def test_a_setting_of_a_limit_on_joints_may_be_assigned_until_its_bounds_are_read(soft: bool) -> None:
    slow, far = Slow(1.0), Posture(ARM.q0 + 2.0)
    slow.most = 0.5
    stack = wbc.Stack([far, slow.softly(weight=1e6)]) if soft else wbc.Stack([far], subject_to=[slow])
    controller = wbc.Controller(ARM, stack, level=wbc.VelocityLevel())
    with pytest.raises(InvalidInput, match=r"Slow\.most: a controller has read the bounds"):
        slow.most = 0.1
    assert controller.tick(0.0, ARM.q0, np.zeros(ARM.nv)).v == pytest.approx(np.full(ARM.nv, slow.most), abs=1e-4)


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
    control = wbc.Controller(ARM, wbc.Stack([Posture(ARM.q0)], subject_to=[limit]), level=FORGETFUL)
    with pytest.raises(InvalidInput, match=r"\.z_max is no height"):
        limit.z_max = "high"
    before = problem(control, 0.0).cl.copy()
    limit.z_max, limit.colour = 3.0, "blue"
    assert limit.z_max == 4.0 and not np.allclose(problem(control, control.dt).cl, before)
    for name in ("axis", "frame", "subject", "slack"):
        with pytest.raises(InvalidInput, match=rf"\.{name} is read once"):
            setattr(limit, name, "elsewhere")
