"""Every member of the library keeps the contract of its kind, on three robots. A new member is found here by itself."""

from __future__ import annotations

import inspect
import pkgutil
from collections.abc import Callable
from importlib import import_module
from inspect import Parameter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tasks as T
import wbc
from tests.tasks.rows_of import linear_rows, rows
from tests.test_features import contacts_of
from wbc.arguments import UnknownArgument, WrongArguments
from wbc.errors import InvalidInput, NotSupported
from wbc.models import Planar4P
from wbc.models.model import RobotModel
from wbc.sim.disturbance import Push
from wbc.sim.plant import IntegratorPlant
from wbc.stack.component import Component
from wbc.stack.constraint import Constraint
from wbc.stack.contact import Contact
from wbc.stack.kernel_rows import CENTRE, MOMENTUM, kernel_rows_of
from wbc.stack.member import UnknownSetting, bound
from wbc.stack.task import LinearTask, Objective, Task
from wbc.stack.tracking import Tracking
from wbc.testing import check_constraint, check_contact, check_task, moments, robots
from wbc.testing.levels import LEVELS, stack_with

HUMANOID = robots()[2]
KINDS = {Objective: check_task, Constraint: check_constraint, Contact: check_contact}
LIBRARY = Path(T.__file__).parent
#: Folders of the package that hold programs, not members.
PROGRAMS = {"scenarios", "workloads"}


def is_member(value: Any, kinds: tuple[type, ...] = tuple(KINDS)) -> bool:
    """A class of one of the kinds that can be instantiated."""
    return isinstance(value, type) and issubclass(value, kinds) and not inspect.isabstract(value)


MEMBERS = [value for name, value in sorted(vars(T).items()) if is_member(value)]
#: Everything else that users make by name.
OTHERS = [value for name, value in sorted(vars(T).items()) if is_member(value, (Component,))] + [
    wbc.Stack, wbc.Controller, wbc.Weighted, wbc.Strict, wbc.Scaled, wbc.VelocityLevel, wbc.AccelerationLevel,
    wbc.InverseDynamics, T.Sinusoid, T.MinimumJerk, T.PoseInterpolation, T.Piecewise, Push,
    IntegratorPlant, wbc.Overrides,
]  # fmt: skip


each_member = pytest.mark.parametrize("member", MEMBERS, ids=lambda member: member.__name__)
each_robot = pytest.mark.parametrize("robot", robots(), ids=lambda robot: robot.name)


@each_robot
@each_member
def test_a_member_keeps_the_contract(member: Any, robot: RobotModel):
    check = next(check for kind, check in KINDS.items() if issubclass(member, kind))
    for sample in member.samples(robot):
        check(sample, robot)


@each_robot
@each_member
def test_a_member_does_its_work_in_a_stack_at_every_level_that_carries_it(member: Any, robot: RobotModel):
    rng = np.random.default_rng(3)
    q = robot.integrate(robot.q0, 0.05 * rng.normal(size=robot.nv))
    v = 0.1 * rng.normal(size=robot.nv)
    for sample in member.samples(robot):
        for level in LEVELS:
            if robot.nb and level.dynamics:
                continue  # nothing holds a robot that floats; those that stand are tested elsewhere
            try:
                controller = wbc.Controller(robot, stack_with(sample, contacts_of(sample, robot)), level=level)
            except NotSupported:
                assert not isinstance(sample, Task)  # a kinematic task serves every level
                continue
            command = controller.tick(0.1, q, v)
            assert command.status.ok, (level.name, command.status)
            assert np.isfinite(command.v).all()


@pytest.mark.parametrize("base", ["fixed", "floating"])
def test_a_robot_without_mass_has_no_centre_of_mass(tmp_path: Path, base: Any):
    hinge = '<parent link="a"/><child link="b"/><limit lower="-1" upper="1" velocity="1" effort="1"/>'
    links = '<link name="a"/><link name="b"/>'
    path = tmp_path / "light.urdf"
    path.write_text(f'<robot name="light">{links}<joint name="hinge" type="revolute">{hinge}</joint></robot>')
    with pytest.warns(UserWarning, match="no inertia moves with"):
        light = wbc.load(path, base=base)
    refused = set()
    for sample in (sample for member in MEMBERS for sample in member.samples(HUMANOID)):
        said = kernel_rows_of(bound(sample, HUMANOID))
        if said is not None and {CENTRE, MOMENTUM} & set(said.of):
            stack = wbc.Stack([sample]) if isinstance(sample, Objective) else wbc.Stack([], subject_to=[sample])
            with pytest.raises(
                InvalidInput, match=f"^light has no mass, so {sample.name} has no centre of mass to speak of$"
            ):
                wbc.Controller(light, stack, level=wbc.AccelerationLevel())
            refused.add(type(sample).__name__)
    assert len(refused) == 7


@each_member
def test_samples_ask_for_what_is_of_a_robots_size_and_speed(member: Any):
    """Random stacks are made of them: what asks for kilometres, or settles within hours, tests nothing there."""
    for sample, robot in ((bound(one, model), model) for model in robots() for one in member.samples(model)):
        state, filled = robot.state(), []
        for moment in moments(robot):
            state.update(*moment)
            if isinstance(sample, Task):
                filled.append(rows(sample, state))
            elif isinstance(sample, LinearTask) and sample.on == "torque":
                out = linear_rows(sample, state, robot.nj)
                assert np.abs(out.A).max() < 1e3 and np.abs(out.b).max() < 1e3, sample
        for what, most in {"e": 10.0, "J": 100.0, "rate_ref": 100.0, "acc_ref": 2e3}.items():
            assert all(np.abs(getattr(one, what)).max() < most for one in filled), (sample, what)
        moves = np.abs([one.rate_ref for one in filled]).max(axis=0, initial=0.0)
        assert (moves[moves > 1e-9] > 5e-3).all(), f"{sample} has a target that moves and hardly does"
        if isinstance(sample, Tracking):
            rates = np.abs([sample.reference(t).rate for t in np.arange(0.1, 2.0, 0.3)]).max(axis=0)
            assert ((rates == 0.0) | (rates > 5e-3)).all() and rates.max() < 100.0, sample
        for kp, kd in zip(*sample.gains()[:2], strict=True) if isinstance(sample, Task) else ():
            settles = -np.roots([1.0, kd, kp] if kp else [1.0, kd]).real
            assert kd == 0.0 or (settles.min() >= 0.1 and settles.max() <= 100.0), sample


@pytest.mark.parametrize("member", [kind for kind in MEMBERS if issubclass(kind, Contact)], ids=lambda m: m.__name__)
def test_forces_of_a_contact_have_units_and_rows_of_its_cone_the_names_of_what_they_bound(member: Any):
    for sample in (sample for robot in robots() for sample in member.samples(robot)):
        forces = [name for name, _ in sample.force_labels()]
        assert all(unit == {"f": "N", "m": "N m"}[label[0]] for label, unit in sample.force_labels())
        for row, (label, _) in zip(sample.cone(), sample.cone_labels(), strict=True) if sample.sides == 4 else ():
            bounded = label.split()[0]
            assert row[forces.index(bounded.removeprefix("-"))] * (-1.0 if bounded.startswith("-") else 1.0) > 0.0


@each_member
@given(data=st.data())
def test_a_slip_in_the_name_of_a_setting_is_told_and_changes_nothing(member: Any, data: st.DataObject):
    sample = data.draw(st.sampled_from([sample for robot in robots() for sample in member.samples(robot)]))
    names = {name for name in (*vars(sample), *dir(sample)) if not name.startswith("_")}
    kinds = {name: getattr(member, name, None) for name in names}
    settable = {name for name, kind in kinds.items() if isinstance(kind, property) and kind.fset is not None}
    settable |= names & set(vars(sample))
    name = data.draw(st.sampled_from(sorted(settable) or ["name"]))  # some members have no settings at all
    at = data.draw(st.integers(0, len(name) - 1))
    letter = data.draw(st.sampled_from(["", 2 * name[at], f"{name[at]}_", "x"]))
    slip = name[:at] + letter + name[at + 1 :]
    if not slip or slip.startswith("_") or slip in names:
        return
    before = dict(vars(sample))
    with pytest.raises(UnknownSetting) as refused:
        setattr(sample, slip, 3.0)
    assert vars(sample) == before and not hasattr(sample, slip)
    assert set(refused.value.available) >= settable
    if name in settable and letter == 2 * name[at]:
        assert name in refused.value.near


class Mine(wbc.Task):
    """What users write: attributes of their own, before and after the constructor of the library's class."""

    declared: float
    shared: list[int] = []  # noqa: RUF012  # as users write it

    def __init__(self, frame: str, **settings: Any) -> None:
        self.frame = self.subject = frame
        self.dim, self.units = 1, "m"
        super().__init__(**settings)
        self.gain = 3
        self.helper()

    def helper(self) -> None:
        self.height = 0.5

    def prepare(self, model: RobotModel) -> None:
        self.mass = model.mass

    def fill(self, state: Any, out: Any) -> None:
        self.calls = getattr(self, "calls", 0) + 1
        out.e[:] = self.height - state.frame(self.frame).position[2]
        out.J[:] = state.frame(self.frame).jacobian()[2]


class MyDamping(T.Damping):
    """A class of the library with one more attribute."""

    def __init__(self, extra: float) -> None:
        super().__init__(kd=2.0)
        self.extra = extra


class MyPlane(T.HalfSpaceLimit):
    """Without a constructor of its own."""

    colour = "red"


def test_a_class_of_ones_own_may_have_attributes_of_its_own():
    mine, damping = Mine("tool", kp=3.0), MyDamping(4.0)
    plane = MyPlane("tool", normal=[0, 0, 1], offset=0.0)
    for member, settings in (
        (mine, {"gain": 4, "height": 0.6, "declared": 1.0, "shared": [1], "_secret": 1, "kp": 2.0}),
        (damping, {"extra": 5.0, "kd": 3.0}),
        (plane, {"colour": "blue"}),
    ):
        for name, value in settings.items():
            setattr(member, name, value)
            assert getattr(member, name) is value or getattr(member, name) == value
    for member, slip, near in ((mine, "gian", "gain"), (damping, "extar", "extra"), (plane, "color", "colour")):
        with pytest.raises(UnknownSetting, match=f"no setting '{slip}'; did you mean '{near}'"):
            setattr(member, slip, 1)
    robot = wbc.load("arm")
    controller = wbc.Controller(robot, wbc.Stack([mine, damping], subject_to=[plane]), level=wbc.VelocityLevel())
    for k in range(3):  # what it notes while it works is its own affair
        assert controller.tick(1e-3 * k, robot.q0, 0.0 * robot.q0).status.ok, controller.why


@pytest.mark.parametrize("member", [*MEMBERS, *OTHERS], ids=lambda member: member.__name__)
def test_a_constructor_says_which_arguments_it_has(member: Any):
    kinds = {name: known.kind for name, known in inspect.signature(member).parameters.items()}
    if Parameter.VAR_KEYWORD not in kinds.values():
        with pytest.raises(UnknownArgument, match=rf"{member.__name__}: there is no argument 'cost'") as refused:
            member(cost=1.0)
        assert refused.value.available == sorted(kinds) and isinstance(refused.value, TypeError)
    if Parameter.VAR_POSITIONAL not in kinds.values():
        with pytest.raises(WrongArguments, match=r"by position and .* by name, not 20 arguments") as many:
            member(*range(20))
        sentence = str(many.value)
        assert all(f"{name}=" in sentence for name, kind in kinds.items() if kind is Parameter.KEYWORD_ONLY)
        assert isinstance(many.value, TypeError)


def test_a_type_error_inside_a_constructor_is_passed_on():
    class Broken(wbc.Task):
        def __init__(self) -> None:
            super().__init__()
            len(3)  # type: ignore[arg-type]

        def fill(self, state: wbc.RobotState, out: Any) -> None: ...

    with pytest.raises(TypeError, match=r"object of type 'int' has no len\(\)"):
        Broken()


@each_member
def test_a_member_says_what_it_is_and_shows_how(member: Any):
    assert "Example:" in (inspect.getdoc(member) or ""), "its docstring has no example"
    arguments = inspect.signature(member).parameters.values()
    own = list(inspect.signature(member.__init__).parameters.values())[1:]
    assert list(arguments) == own, "help() does not show its arguments"


def test_a_member_may_be_used_by_its_name_alone():
    kinds = (*KINDS, Component)
    exported = {value for value in vars(T).values() if is_member(value, kinds)}
    for module in pkgutil.walk_packages([str(LIBRARY)], "wbc.tasks."):
        if module.name.split(".")[2] in PROGRAMS:
            continue
        for value in vars(import_module(module.name)).values():
            if is_member(value, kinds) and value.__module__ == module.name and not value.__name__.startswith("_"):
                assert value in exported, f"{module.name}.{value.__name__} is not in tasks/__init__.py"


def test_a_task_is_one_short_file():
    assert len((LIBRARY / "damping.py").read_text(encoding="utf-8").splitlines()) <= 40


# ---- arguments by default: nothing that was not asked for, unit directions, and sizes and times of a robot's scale
#: Names of arguments that are one where nothing is said, that bound nothing, and that are directions.
ONE = {"weight", "persistence", "release", "gain", "damping"}
BOUNDS_NOTHING = {
    "lower": -np.inf, "upper": np.inf, "linear": np.inf, "angular": np.inf, "threshold": np.inf,
    "standing_rate": np.inf,
}  # fmt: skip
DIRECTIONS = {"direction", "normal", "axle", "axis"}
#: Ranges of those that are chosen, in SI units: what is farther off is of another scale than robots are.
CHOSEN = {
    "rate": (1.0, 100.0), "filter": (1.0, 100.0),  # of decay [1/s]
    "slack": (1e4, 1e12), "force_weight": (0.0, 1e-4),  # far above every weight, and far below
    "reach": (0.05, 0.5), "margin": (0.0, 0.05), "nearest": (1e-3, 0.1), "length": (0.1, 1.0),  # [m]
    "ramp": (0.02, 2.0), "early": (0.01, 0.2), "start": (0.1, 2.0), "lockout": (0.1, 2.0), "settle": (0.005, 0.1),
    "recheck": (0.05, 0.5), "lag": (0.01, 0.5),  # [s]
    "force_rate": (0.01, 0.2), "friction_share": (0.5, 1.0), "dominance": (2.0, 20.0), "sides": (4, 4),
    "smoothing": (1e-4, 1e-2), "floor": (1e-8, 1e-4),
}  # fmt: skip
MADE = {name: made for name, made in sorted(vars(T).items()) if callable(made) and not name.startswith("_")}


def defaults(made: Any) -> dict[str, np.ndarray]:
    """What is made of numbers by default, by argument."""
    found = {}
    for argument, known in inspect.signature(made).parameters.items():
        value = np.asarray(known.default, dtype=object)
        if value.size and all(isinstance(entry, int | float) and not isinstance(entry, bool) for entry in value.flat):
            found[argument] = value.astype(float)
    return found


#: What has no samples, with no more arguments than it must have.
BARE: dict[str, Callable[[], Any]] = {
    "Clearance": lambda: T.Clearance("tool", point=[0.0, 0.0, 0.0]),
    "Comply": T.Comply,
    "ContactSchedule": lambda: T.ContactSchedule([(0.0, ["foot"])]),
    "FaultReaction": lambda: T.FaultReaction(T.MomentumObserver(gain=1.0)),
    "Follow": lambda: T.Follow([0.0], velocity=1.0, acceleration=1.0, jerk=1.0),
    "MeasuredWrench": lambda: T.MeasuredWrench("tool"),
    "MinimumJerk": lambda: T.MinimumJerk([0.0], [1.0], duration=1.0),
    "MomentumObserver": lambda: T.MomentumObserver(gain=1.0),
    "PoseInterpolation": lambda: T.PoseInterpolation(np.eye(4), np.eye(4), duration=1.0),
    "Sinusoid": lambda: T.Sinusoid([0.0], amplitude=1.0, frequency=1.0),
    "SlotineLi": lambda: T.SlotineLi([0.0], kp=1.0, kd=1.0, gain=1.0),
    "feet": lambda: T.feet(wbc.load("humanoid")),
}


def samples(name: str) -> list[Any]:
    """Some of a class, or what a function makes, with few arguments."""
    if is_member(MADE[name]):
        return [sample for robot in robots() for sample in MADE[name].samples(robot)]
    return [BARE[name]()] if name in BARE else []


@pytest.mark.parametrize("name", MADE)
def test_a_default_is_nothing_or_of_a_robots_scale(name: str):
    assert samples(name) or not defaults(MADE[name]), "it cannot be made without them"
    for argument, value in defaults(MADE[name]).items():
        if argument in ("kp", "kd"):
            continue  # see below
        if (name, argument) == ("SlotineLi", "weight"):  # the law is the command
            assert 1e4 < value < 1e8
        elif argument in ONE:
            assert value == 1.0, argument
        elif argument in BOUNDS_NOTHING:
            assert value == BOUNDS_NOTHING[argument], argument
        elif argument in DIRECTIONS:
            assert np.linalg.norm(value) == 1.0, argument
        elif argument in CHOSEN:
            low, high = CHOSEN[argument]
            assert low <= value <= high, argument
        else:
            assert not value.any() or np.array_equal(value, np.eye(3)), argument


@pytest.mark.parametrize("name", [name for name, made in MADE.items() if is_member(made)])
def test_gains_by_default_settle_in_seconds(name: str):
    """ë + kd ė + kp e = 0, or ė + kd e = 0 of a task on rates; no gain stated is critical damping."""
    assert samples(name)
    default = defaults(MADE[name])
    kp, kd = default.get("kp"), default.get("kd")
    if kp is None and kd is None:
        return
    rates = -np.roots([1.0, 2.0 * np.sqrt(kp) if kd is None else kd, kp] if kp else [1.0, kd]).real
    assert 1.0 <= min(rates) and max(rates) <= 100.0


def test_the_names_above_are_those_of_arguments():
    arguments = {argument for made in MADE.values() for argument in defaults(made)}
    assert {*ONE, *BOUNDS_NOTHING, *DIRECTIONS, *CHOSEN} <= arguments


# ---- components bear ticks without a state: they fail in none, and learn nothing from them
ARM, QUADRUPED = wbc.load("arm"), wbc.load("quadruped")


def arm_observer() -> T.MomentumObserver:
    """Of the arm."""
    return T.MomentumObserver(gain=100.0, threshold=1.0, persistence=2)


def adaptive(robot: RobotModel, **settings: Any) -> T.SlotineLi:
    """Follows a wave."""
    return T.SlotineLi(T.Sinusoid(robot.q0, amplitude=0.1, frequency=0.5), kp=50.0, kd=20.0, gain=2.0, **settings)


def component_samples() -> dict[str, tuple[RobotModel, list[Component]]]:
    """A robot and the components of a stack for it, new ones."""
    watches = arm_observer()
    names = [foot.name for foot in T.feet(QUADRUPED)]
    planar = Planar4P()
    return {
        "ContactSchedule": (QUADRUPED, [T.ContactSchedule([(0.0, names), (0.01, names[:3])])]),
        "FaultReaction": (ARM, [watches, T.FaultReaction(watches, start=0.0)]),
        "MeasuredWrench": (ARM, [T.MeasuredWrench("tool", wrench=[0.0, 0.0, -5.0])]),
        "MomentumObserver": (ARM, [arm_observer()]),
        "SlotineLi": (ARM, [adaptive(ARM, composite=0.1, window=0.5, estimate_floor=1e-3)]),
        "SlotineLi of a planar robot": (planar, [adaptive(planar)]),
    }


def component_controller(name: str) -> tuple[wbc.Controller, list[Component]]:
    """With a stack for those components."""
    robot, components = component_samples()[name]
    asked = [component.torque for component in components if isinstance(component, T.SlotineLi)]
    stack = wbc.Stack(
        [T.Posture(robot.q0), *asked], components=components, contacts=T.feet(robot) if robot is QUADRUPED else [],
        subject_to=[T.TorqueLimits()] if robot.nj > 4 else [],
    )  # fmt: skip
    return wbc.Controller(robot, stack, level=wbc.InverseDynamics()), components


def signals(components: list[Component]) -> list[Any]:
    """All that they say, copied."""
    return [{name: np.array(value) for name, value in one.signals().items()} for one in components]


def test_all_components_of_the_library_are_tried() -> None:
    kinds = {name for name, kind in vars(T).items() if isinstance(kind, type) and issubclass(kind, Component)}
    assert kinds == {name.split()[0] for name in component_samples()}


@pytest.mark.parametrize("name", component_samples())
def test_a_first_tick_without_a_state_is_nobodys_fault_and_is_recorded_like_others(name: str) -> None:
    control, _ = component_controller(name)
    robot, recorder = control.model, wbc.Recorder(10)
    recorder.tick(control, 0.0, np.full(robot.nq, np.nan), np.zeros(robot.nv))
    assert control.why == "q[0] is nan"
    for k in range(1, 4):
        command = recorder.tick(control, k * control.dt, robot.q0, np.zeros(robot.nv))
        assert command.status.ok, control.explain()
    assert recorder.run().rows == 4


@pytest.mark.parametrize("name", component_samples())
def test_nothing_is_learnt_from_ticks_without_a_state(name: str) -> None:
    control, components = component_controller(name)
    robot = control.model
    q = robot.integrate(robot.q0, np.append(np.zeros(robot.nb), np.full(robot.nj, 0.1)))
    for k in range(5):
        control.tick(k * control.dt, q, np.zeros(robot.nv))
    before = signals(components)
    for k in range(5, 30):
        control.tick(k * control.dt, np.full(robot.nq, np.nan), np.zeros(robot.nv))
    for known, now in zip(before, signals(components), strict=True):
        for signal, value in known.items():
            np.testing.assert_array_equal(now[signal], value, err_msg=signal)
