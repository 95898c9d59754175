"""Every member of the library keeps the contract of its kind, on three robots. A new member is found here by itself."""

from __future__ import annotations

import inspect
import pkgutil
from importlib import import_module
from inspect import Parameter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tasks
import wbc
from tests.tasks.rows_of import linear_rows, rows
from wbc.arguments import UnknownArgument, WrongArguments
from wbc.errors import InvalidInput
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

HUMANOID = robots()[2]
KINDS = {Objective: check_task, Constraint: check_constraint, Contact: check_contact}
LIBRARY = Path(tasks.__file__).parent
#: Folders of the package that hold programs, not members.
PROGRAMS = {"scenarios", "workloads"}


def is_member(value: Any, kinds: tuple[type, ...] = tuple(KINDS)) -> bool:
    """A class of one of the kinds that can be instantiated."""
    return isinstance(value, type) and issubclass(value, kinds) and not inspect.isabstract(value)


MEMBERS = [value for name, value in sorted(vars(tasks).items()) if is_member(value)]
#: Everything else that users make by name.
OTHERS = [value for name, value in sorted(vars(tasks).items()) if is_member(value, (Component,))] + [
    wbc.Stack, wbc.Controller, wbc.Weighted, wbc.Strict, wbc.Scaled, wbc.VelocityLevel, wbc.AccelerationLevel,
    wbc.InverseDynamics, tasks.Sinusoid, tasks.MinimumJerk, tasks.PoseInterpolation, tasks.Piecewise, Push,
    IntegratorPlant, wbc.Overrides,
]  # fmt: skip


@pytest.mark.parametrize("robot", robots(), ids=lambda robot: robot.name)
@pytest.mark.parametrize("member", MEMBERS, ids=lambda member: member.__name__)
def test_a_member_keeps_the_contract(member: Any, robot: RobotModel):
    check = next(check for kind, check in KINDS.items() if issubclass(member, kind))
    for sample in member.samples(robot):
        check(sample, robot)


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


@pytest.mark.parametrize("member", MEMBERS, ids=lambda member: member.__name__)
def test_a_member_has_samples(member: Any):
    assert any(member.samples(robot) for robot in robots())


@pytest.mark.parametrize("member", [kind for kind in MEMBERS if issubclass(kind, Task)], ids=lambda m: m.__name__)
def test_samples_ask_for_motions_of_a_robots_size_and_speed(member: Any):
    """Random stacks are made of them: what asks for kilometres, or settles within hours, tests nothing there."""
    for robot in robots():
        state, when = robot.state(), moments(robot)
        for sample in (bound(sample, robot) for sample in member.samples(robot)):
            filled = []
            for moment in when:
                state.update(*moment)
                filled.append(rows(sample, state))
            size, slope, rate, change = (
                max(np.abs(getattr(one, what)).max() for one in filled) for what in ("e", "J", "rate_ref", "acc_ref")
            )
            assert size < 10.0 and slope < 100.0 and rate < 100.0 and change < 2e3, sample
            moves = np.abs([one.rate_ref for one in filled]).max(axis=0)
            assert (moves[moves > 1e-9] > 5e-3).all(), f"{sample} has a target that moves and hardly does"
            for kp, kd in zip(*sample.gains()[:2], strict=True):
                settles = -np.roots([1.0, kd, kp] if kp else [1.0, kd]).real
                assert kd == 0.0 or (settles.min() >= 0.1 and settles.max() <= 100.0), sample


@pytest.mark.parametrize("member", [kind for kind in MEMBERS if issubclass(kind, LinearTask)], ids=lambda m: m.__name__)
def test_samples_ask_for_torques_of_a_robots_size(member: Any):
    for robot in robots():
        state = robot.state()
        for sample in (bound(sample, robot) for sample in member.samples(robot) if sample.on == "torque"):
            for moment in moments(robot):
                state.update(*moment)
                out = linear_rows(sample, state, robot.nj)
                assert np.abs(out.A).max() < 1e3 and np.abs(out.b).max() < 1e3, sample


@pytest.mark.parametrize("member", [kind for kind in MEMBERS if issubclass(kind, Tracking)], ids=lambda m: m.__name__)
def test_targets_of_samples_that_move_do_so_in_seconds(member: Any):
    for sample in (bound(sample, robot) for robot in robots() for sample in member.samples(robot)):
        rates = np.abs([sample.reference(t).rate for t in np.arange(0.1, 2.0, 0.3)]).max(axis=0)
        assert ((rates == 0.0) | (rates > 5e-3)).all() and rates.max() < 100.0, sample


@pytest.mark.parametrize("member", [kind for kind in MEMBERS if issubclass(kind, Contact)], ids=lambda m: m.__name__)
def test_a_contact_gives_forces_in_newtons_and_moments_in_newton_metres(member: Any):
    for sample in (sample for robot in robots() for sample in member.samples(robot)):
        for label, unit in sample.force_labels():
            assert unit == {"f": "N", "m": "N m"}[label[0]]


@pytest.mark.parametrize("member", [kind for kind in MEMBERS if issubclass(kind, Contact)], ids=lambda m: m.__name__)
def test_rows_of_a_cone_of_four_sides_are_called_by_what_they_bound(member: Any):
    for sample in (sample for robot in robots() for sample in member.samples(robot) if sample.sides == 4):
        forces = [name for name, _ in sample.force_labels()]
        for row, (label, _) in zip(sample.cone(), sample.cone_labels(), strict=True):
            bounded = label.split()[0]
            assert row[forces.index(bounded.removeprefix("-"))] * (-1.0 if bounded.startswith("-") else 1.0) > 0.0


@pytest.mark.parametrize("member", MEMBERS, ids=lambda member: member.__name__)
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


class MyDamping(tasks.Damping):
    """A class of the library with one more attribute."""

    def __init__(self, extra: float) -> None:
        super().__init__(kd=2.0)
        self.extra = extra


class MyPlane(tasks.HalfSpaceLimit):
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


@pytest.mark.parametrize("member", MEMBERS, ids=lambda member: member.__name__)
def test_a_member_says_what_it_is_and_shows_how(member: Any):
    assert "Example:" in (inspect.getdoc(member) or ""), "its docstring has no example"
    arguments = inspect.signature(member).parameters.values()
    own = list(inspect.signature(member.__init__).parameters.values())[1:]
    assert list(arguments) == own, "help() does not show its arguments"


def test_a_member_may_be_used_by_its_name_alone():
    kinds = (*KINDS, Component)
    exported = {value for value in vars(tasks).values() if is_member(value, kinds)}
    for module in pkgutil.walk_packages([str(LIBRARY)], "wbc.tasks."):
        if module.name.split(".")[2] in PROGRAMS:
            continue
        for value in vars(import_module(module.name)).values():
            if is_member(value, kinds) and value.__module__ == module.name and not value.__name__.startswith("_"):
                assert value in exported, f"{module.name}.{value.__name__} is not in tasks/__init__.py"


def test_the_library_has_what_it_promises():
    promised = (
        "Frame Position Orientation CenterOfMass Posture JointVelocity Damping Torque ContactForce Point Sole "
        "JointPositionLimits JointVelocityLimits JointAccelerationLimits TorqueLimits"
    )
    assert set(promised.split()) <= {member.__name__ for member in MEMBERS}


def test_a_task_is_one_short_file():
    assert len((LIBRARY / "damping.py").read_text(encoding="utf-8").splitlines()) <= 40
