"""Numbers that look like another unit are warned about, and used as they are."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import tasks as T
import wbc
from wbc.models.plausible import ImplausibleUnit, NothingHoldsTheBase, Sinks
from wbc.sim.mujoco_ import MujocoPlant
from wbc.sim.simulate import simulate

ARM, BODY = wbc.load("arm"), wbc.load("humanoid")
LEVEL = wbc.VelocityLevel()


def test_degrees_milliseconds_and_millimetres_are_doubted():
    for task, settings, said in (
        (T.Posture(np.full(7, 45.0)), {}, r"Posture.target has 45 rad for joint .*degrees"),
        (T.Position("tool", target=[400.0, 200.0, 500.0]), {}, r"Position\[tool\].target is .*millimetres"),
        (T.Posture(ARM.q0, rate=1.0), {"dt": 1.0}, r"dt is 1 s: .*milliseconds"),
    ):
        with pytest.warns(ImplausibleUnit, match=said):
            control = wbc.Controller(
                ARM, wbc.Stack([task], subject_to=[T.JointVelocityLimits()]), level=LEVEL, **settings
            )
        assert control.tick(0.0, ARM.q0, np.zeros(7)).status.ok


@pytest.mark.parametrize(
    ("made", "said"),
    [
        (lambda: T.Sole("foot", half_size=(100, 50), friction=0.5), r"Sole\[foot\].half_size is \[100.  50.\] m"),
        (lambda: T.Edge("foot", half_length=60.0, friction=0.5), r"Edge\[foot\].half_length is 60.0 m"),
        (lambda: T.Point("foot", friction=0.5, radius=20.0), r"Point\[foot\].radius is 20.0 m"),
        (lambda: T.Rolling("wheel", radius=50.0), r"Rolling\[wheel\].radius is 50.0 m"),
    ],
)
def test_sizes_of_contacts_in_millimetres_are_doubted(made: Any, said: str):
    with pytest.warns(ImplausibleUnit, match=said):
        made()


def test_a_first_state_in_degrees_is_doubted_once():
    control = wbc.Controller(ARM, wbc.Stack([T.Posture(ARM.q0)], subject_to=[T.JointVelocityLimits()]), level=LEVEL)
    with pytest.warns(ImplausibleUnit, match="q has 30 rad"):
        control.tick(0.0, np.full(7, 30.0), np.zeros(7))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        control.tick(1e-3, np.full(7, 30.0), np.zeros(7))


@pytest.mark.parametrize("far", [400.0, -90.0])
def test_reference_configurations_in_degrees_are_doubted(far: float):
    joints = dict.fromkeys(ARM.joint_names, 0.0) | {ARM.joint_names[2]: far}
    said = f"has {far:g} rad for joint {ARM.joint_names[2]!r}, .*: are these degrees"
    for q0 in (joints, list(joints.values()), np.array(list(joints.values()))):
        with pytest.warns(ImplausibleUnit, match=f"^q0 {said}") as found:
            robot = wbc.load("arm", q0=q0)
        assert len(found) == 1
        assert robot.q0[2] == far
    with pytest.warns(ImplausibleUnit, match=f"^joints {said}"):
        assert ARM.configuration(joints)[2] == far
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert wbc.load("arm", q0={ARM.joint_names[2]: 2.0}).q0[2] == ARM.configuration({ARM.joint_names[2]: 2.0})[2]


@pytest.mark.parametrize("scalar", [1.0, -1.0])
def test_a_quaternion_with_its_scalar_first_is_doubted_once(scalar: float):
    humanoid = wbc.load("humanoid")
    control = wbc.Controller(humanoid, wbc.Stack([T.Posture(humanoid.q0)]), level=LEVEL)
    first = np.concatenate([humanoid.q0[:3], [scalar, 0.0, 0.0, 0.0], humanoid.q0[7:]])
    said = "for the base, which is upside down: quaternions are x, y, z, w here"
    with pytest.warns(ImplausibleUnit, match=f"^q has .* {said}"):
        control.tick(0.0, first, np.zeros(humanoid.nv))
    with pytest.warns(ImplausibleUnit, match=f"^q0 has .* {said}"):
        wbc.load("humanoid", q0=first)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert control.tick(1e-3, first, np.zeros(humanoid.nv)).status.ok
        for turned in ([0.0, 0.0, 0.0, scalar], [scalar * 0.6, 0.8, 0.0, 0.0]):
            control.reset()
            control.tick(0.0, np.concatenate([first[:3], turned, first[7:]]), np.zeros(humanoid.nv))
        control.reset()
        assert control.tick(0.0, first, np.zeros(humanoid.nv)).status.ok  # a warning that is an error is none in a tick


def test_what_is_far_but_possible_is_not_doubted():
    humanoid = wbc.load("humanoid")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for robot, task in (
            (ARM, T.Posture(np.full(7, 6.0))), (ARM, T.Position("tool", target=[2.0, 0.0, 0.0])),
            (humanoid, T.Position(humanoid.frame_names[-1], target=[500.0, 0.0, 0.0])),
        ):  # fmt: skip
            wbc.Controller(robot, wbc.Stack([task]), level=LEVEL, dt=0.05).tick(0.0, robot.q0, np.zeros(robot.nv))


@pytest.mark.parametrize(("most", "doubted"), [(2e-5, True), (1e-3, False)])
def test_torques_limited_to_what_counts_as_met_are_doubted(most: float, *, doubted: bool):
    stack = wbc.Stack([T.Posture(ARM.q0)], subject_to=[T.TorqueLimits(np.full(7, most))])
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        wbc.Controller(ARM, stack, level=wbc.InverseDynamics())
    found = [str(one.message) for one in said if issubclass(one.category, ImplausibleUnit)]
    assert bool(found) == doubted
    assert all("a limit counts as met within 1e-06 N m: is this another unit?" in sentence for sentence in found)


def falls(robot: wbc.RobotModel, level: wbc.Formulation = wbc.InverseDynamics(), **members: Any) -> bool:  # noqa: B008
    """Whether a controller that is made says that nothing holds the base."""
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        wbc.Controller(robot, wbc.Stack([T.Posture(robot.q0)], **members), level=level)
    found = [str(one.message) for one in said if one.category is NothingHoldsTheBase]
    assert len(found) <= 1
    assert all(f"{robot.name} has a floating base and the stack has no contacts" in sentence for sentence in found)
    return bool(found)


@pytest.mark.parametrize("name", ["humanoid", "quadruped"])
def test_a_floating_base_that_nothing_holds_is_doubted(name: str, monkeypatch: pytest.MonkeyPatch):
    robot = wbc.load(name)
    assert falls(robot) and falls(robot, subject_to=[T.TorqueLimits(), T.JointVelocityLimits()])
    for k in range(1, len(T.feet(robot)) + 1):
        assert not falls(robot, contacts=T.feet(robot)[:k])
    first, second, *_ = robot.joint_names
    assert not falls(robot, contacts=[T.JointCoupling(first, to={second: 1.0}).with_reaction()])
    assert not falls(robot, components=[T.MeasuredWrench(T.feet(robot)[0].frame)]), "a component may know of forces"
    assert not falls(robot, LEVEL) and not falls(robot, wbc.AccelerationLevel())
    assert not falls(wbc.load(name, base="fixed")) and not falls(ARM)
    monkeypatch.setattr(robot, "gravity", np.zeros(3))
    assert not falls(robot)


def fall() -> None:
    robot = wbc.load("quadruped")
    control = wbc.Controller(
        robot, wbc.Stack([T.Posture(robot.q0)], contacts=T.feet(robot)), level=wbc.InverseDynamics()
    )
    simulate(control, MujocoPlant(robot), duration=1e-3)


def misspell() -> None:
    class Mistaken(wbc.Component):
        def befor(self, state: Any, last: Any, plan: Any) -> None:
            """No hook is called so."""


@pytest.mark.parametrize(
    "act",
    [
        lambda: T.Posture(np.full(7, 45.0)).prepare(ARM),
        lambda: wbc.Controller(ARM, wbc.Stack([T.Posture(ARM.q0, rate=1.0)]), level=LEVEL, dt=1.0),
        lambda: wbc.Controller(ARM, wbc.Stack([T.Posture(np.full(7, 45.0))]), level=LEVEL),
        lambda: wbc.Controller(BODY, wbc.Stack([T.Posture(BODY.q0)]), level=wbc.InverseDynamics()),
        fall,
        misspell,
    ],
)
def test_warnings_stand_at_the_line_of_the_user(act: Callable[[], Any]):
    with pytest.warns(UserWarning) as said:
        act()
    assert {one.filename for one in said} == {__file__}


@pytest.mark.parametrize("mass", [100.0, 2000.0])
def test_a_robot_that_sinks_on_what_its_forces_cost_is_warned_about(mass: float) -> None:
    """By g m² force_weight / n, on n contacts, against a task of weight 1; with the weight that is said it stands."""
    model = wbc.load("quadruped").pinocchio.copy()
    share = mass / sum(one.mass for one in model.inertias)
    for one in model.inertias:
        one.mass, one.inertia = share * one.mass, share * one.inertia
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        robot = wbc.load(model, base="floating", feet=list(wbc.load("quadruped").feet))
    assert robot.mass == pytest.approx(mass)

    def sinks(**weight: float) -> tuple[float, list[str]]:
        com = T.CenterOfMass(target=robot.state().com)
        stack = wbc.Stack([com, T.Orientation("trunk", target=np.eye(3))], contacts=T.feet(robot, **weight))
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics())
        command = controller.tick(0.0, robot.q0, np.zeros(robot.nv))
        lifted = sum(force[2] for force in command.f.values())
        return 9.81 - lifted / mass, [str(one.message) for one in said if one.category is Sinks]

    (falls, said), (stands, _) = sinks(), sinks(force_weight=1e-14)
    share = 1e-6 * mass**2 / 4
    assert falls - stands == pytest.approx(9.81 * share / (1.0 + share), rel=0.1)
    assert bool(said) == (share > 0.05)
    if said:
        (weight,) = re.findall(r"force_weight=(\S+)$", said[0])
        falls, said = sinks(force_weight=float(weight))
        assert falls - stands < 0.02 * 9.81 and not said
    robot.pinocchio.gravity.linear = np.zeros(3)
    robot.gravity = np.zeros(3)
    assert not sinks()[1]
