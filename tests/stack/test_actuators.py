"""Motors that are known to deliver otherwise are sent the command that gives the torque decided."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tasks as T
import wbc
from tests.stack.conftest import Saying, feet
from wbc.errors import InvalidInput
from wbc.stack.overrides import Actuators

numbers = st.floats(-50.0, 50.0)


@given(st.floats(0.05, 1.0), numbers, numbers)
def test_the_command_gives_the_torque(share: float, offset: float, tau: float) -> None:
    motors = Actuators(np.array([1.0, share, 1.0]), np.array([0.0, offset, 0.0]))
    wanted = np.array([1.0, tau, -2.0])
    sent = motors.command(wanted)
    np.testing.assert_allclose(share * sent[1] - offset, tau, atol=1e-9)
    np.testing.assert_allclose(motors.torque(sent), wanted, atol=1e-9)
    assert sent[[0, 2]].tolist() == [1.0, -2.0]


def test_a_dead_motor_is_sent_nothing_and_gives_nothing() -> None:
    motors = Actuators(np.array([0.0, 1.0]), np.zeros(2))
    assert motors.command(np.array([7.0, 7.0])).tolist() == [0.0, 7.0]
    assert motors.torque(np.array([7.0, 7.0])).tolist() == [0.0, 7.0]


class HalfStrength(wbc.Component):
    """Says in each tick that joint 1 delivers half of what it is sent."""

    def before(self, state: Any, last: Any, plan: Any) -> wbc.Overrides:
        return wbc.Overrides(motors={1: wbc.Motor(share=0.5)})


def test_a_controller_sends_what_gives_the_torque_it_decided() -> None:
    arm = wbc.load("arm")

    def tau(*components: wbc.Component) -> Any:
        stack = wbc.Stack([T.Posture(arm.q0)], subject_to=[T.TorqueLimits()], components=components)
        return wbc.Controller(arm, stack, level=wbc.InverseDynamics()).tick(0.0, arm.q0, 0 * arm.q0).tau

    sound, known = tau(), tau(HalfStrength())
    assert abs(sound[1]) > 1.0
    np.testing.assert_allclose(known, sound * np.array([1, 2, *[1] * (arm.nj - 2)]))


@pytest.mark.parametrize("motor", [None, "ab", (), (0.5,), (0.5, 0.0, 0.0), np.array([0.5, 0.0]), {0.5: 0.0}])
def test_what_is_neither_a_motor_nor_a_share_is_refused_by_joint(motor: Any) -> None:
    arm = wbc.load("arm")
    applied = wbc.InverseDynamics().compile(arm, wbc.Stack([T.Posture(arm.q0)]), dt=1e-3).applied
    with pytest.raises(InvalidInput, match=r"mine\.motors\[1\]\.share"):
        applied.apply([("mine", wbc.Overrides(motors={1: motor}))])
    assert (applied.actuators.share == 1.0).all()
    share: Any = 0.5
    for half in (share, (share, 0.0), wbc.Motor(share)):
        applied.apply([("mine", wbc.Overrides(motors={1: half}))])
        assert applied.actuators.share.tolist() == [1.0, 0.5, *[1.0] * (arm.nj - 2)]


def test_a_command_stays_within_the_torque_limits_whatever_is_known_of_its_motor() -> None:
    """Torques are bounded by what commands within the limits give, so that no command is divided beyond them."""
    arm = wbc.load("arm")

    class Known(wbc.Component):
        def before(self, state: Any, last: Any, plan: Any) -> wbc.Overrides:
            return wbc.Overrides(motors={1: wbc.Motor(share=0.1, offset=0.5), 3: wbc.Motor(offset=-2.0)})

    stack = wbc.Stack([T.Posture(arm.q0 + 2.0, kp=1e4)], subject_to=[T.TorqueLimits()], components=[Known()])
    command = wbc.Controller(arm, stack, level=wbc.InverseDynamics()).tick(0.0, arm.q0, 0 * arm.q0)
    assert command.status.ok
    assert (np.abs(command.tau) <= arm.limits.tau_max + 1e-6).all()
    assert np.abs(command.tau[1]) > 0.999 * arm.limits.tau_max[1]


ARM = wbc.load("arm")
FREE = T.TorqueSpeedLimits(ARM.limits.v_max)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_a_command_stays_within_what_its_motor_has_at_its_speed(seed: int) -> None:
    """What is known to be lost on the way to the joint does not make the motor stronger."""
    rng = np.random.default_rng(seed)
    v, share, offset = rng.uniform(-0.9, 0.9, ARM.nv) * ARM.limits.v_max, rng.uniform(0.1, 1.0, 7), rng.normal(size=7)
    knows = Saying(wbc.Overrides(motors={i: wbc.Motor(share[i], 0.1 * offset[i]) for i in range(ARM.nj)}))
    stack = wbc.Stack([T.Posture(ARM.q0 + np.sign(v), kp=1e4)], subject_to=[FREE], components=[knows])
    command = wbc.Controller(ARM, stack, level=wbc.InverseDynamics()).tick(0.0, ARM.q0, v)
    assert command.status.ok
    left = np.clip(1.0 - np.array([v, -v]) / ARM.limits.v_max, 0.0, 1.0) * ARM.limits.tau_max
    for torque in (command.tau, Actuators(share, 0.1 * offset).torque(command.tau)):
        assert (torque <= left[0] + 1e-6).all() and (-torque <= left[1] + 1e-6).all()
    assert np.abs(np.array([command.tau, -command.tau]) - left).min() <= 1e-6, "one of them is used up"


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_joint_whose_torque_limits_are_lifted_is_held_at_any_speed(side: float) -> None:
    """As by a brake, which has no torque-speed curve."""
    held = np.where(np.arange(ARM.nj) == 1, 0.0, np.inf)
    braked = wbc.Overrides(lifted={"torque": [1]}, motors={1: wbc.Motor(0.0)}, acceleration=(-held, held))
    q, v = ARM.q0.copy(), np.zeros(ARM.nv)
    q[1], v[1] = -1.5 * side, 0.9 * side * ARM.limits.v_max[1]  # upwards, so fast that a motor could not carry it
    stack = wbc.Stack([T.Posture(q, kp=10.0)], subject_to=[FREE, T.JointVelocityLimits()], components=[Saying(braked)])
    control = wbc.Controller(ARM, stack, level=wbc.InverseDynamics())
    command = control.tick(0.0, q, v)
    assert command.status.ok, control.explain()
    assert command.tau[1] == 0.0 and np.abs(command.a).max() <= 1e-4, "no other joint has to carry it"


def test_a_motor_that_leaves_no_torque_is_refused_by_the_component_that_speaks_of_it() -> None:
    weak, sound = Saying(name="weak"), Saying(wbc.Overrides(motors={1: wbc.Motor()}), name="sound")
    stack = wbc.Stack([T.Posture(ARM.q0)], subject_to=[T.TorqueLimits()], components=[weak, sound])
    control = wbc.Controller(ARM, stack, level=wbc.InverseDynamics())
    weak.now = wbc.Overrides(motors={0: wbc.Motor(offset=1e6)})
    assert not control.tick(0.0, ARM.q0, 0 * ARM.q0).status.ok
    assert control.why.startswith("weak.motors: joint 'shoulder_yaw' is left no torque")


# ---- bounds on normal forces of contacts, and forces that are wanted of them
ROBOTS = {name: wbc.load(name) for name in ("humanoid", "quadruped")}
HUMANOID = ROBOTS["humanoid"]
HIERARCHIES = {"weighted": wbc.Weighted(), "strict": wbc.Strict(), "scaled": wbc.Scaled()}


def standing(name: str, *more: Any, hierarchy: str = "weighted", **parts: Any) -> tuple[wbc.Controller, list[Any]]:
    """A robot on its feet; tasks ``more`` stand below its balance."""
    robot = ROBOTS[name]
    contacts = feet(robot)
    balance = [T.CenterOfMass(target=robot.state().com), T.Orientation(robot.frame_names[0], target=np.eye(3))]
    levels = [balance, *([more] if more else []), [T.Posture(robot.q0, weight=1e-3)]]
    stack = wbc.Stack(levels, contacts=contacts, **parts)
    return wbc.Controller(robot, stack, level=wbc.InverseDynamics(), hierarchy=HIERARCHIES[hierarchy]), contacts


def normals(controller: wbc.Controller, contacts: list[Any]) -> np.ndarray:
    """The normal forces of a tick at rest, which has an answer."""
    robot = controller.model
    command = controller.tick(0.0, robot.q0, np.zeros(robot.nv))
    assert command.status.ok, controller.why
    return np.array([command.f[contact.name][2] for contact in contacts])


@pytest.mark.parametrize("hierarchy", HIERARCHIES)
@pytest.mark.parametrize("robot", ROBOTS)
def test_a_normal_force_stays_within_its_bounds_and_the_others_carry_the_rest(robot: str, hierarchy: str):
    controller, contacts = standing(robot, hierarchy=hierarchy)
    free = normals(controller, contacts)
    contacts[0].f_max = 0.9 * free[0]
    less = normals(controller, contacts)
    assert less[0] <= 0.9 * free[0] + 1e-5 and less.sum() == pytest.approx(free.sum(), rel=0.02)
    contacts[0].f_max, contacts[0].f_min = None, 1.1 * free[0]
    more = normals(controller, contacts)
    assert more[0] >= 1.1 * free[0] - 1e-5 and more.sum() == pytest.approx(free.sum(), rel=0.02)
    contacts[0].f_min = None
    np.testing.assert_allclose(normals(controller, contacts), free, atol=1e-3 * free.max())


def test_bounds_given_with_a_contact_are_those_assigned_to_it():
    assigned, contacts = standing("quadruped")
    for contact in contacts:
        contact.f_min, contact.f_max = 10.0, 45.0
    robot = ROBOTS["quadruped"]
    balance = [T.CenterOfMass(target=robot.state().com), T.Orientation(robot.frame_names[0], target=np.eye(3))]
    given = [
        T.Point(f.frame, radius=f.radius, friction=f.friction, f_min=10.0, f_max=45.0) for f in robot.feet.values()
    ]
    stack = wbc.Stack([balance, [T.Posture(robot.q0, weight=1e-3)]], contacts=given)
    found = normals(wbc.Controller(robot, stack, level=wbc.InverseDynamics()), given)
    np.testing.assert_allclose(found, normals(assigned, contacts), atol=1e-6)


def test_what_a_component_allows_goes_before_the_least_force():
    lifting = Saying()
    controller, contacts = standing("quadruped", components=[lifting])
    contacts[1].f_min = 30.0
    assert normals(controller, contacts)[1] >= 30.0 - 1e-5
    lifting.now = wbc.Overrides(normal_limits={contacts[1].name: 5.0})
    assert normals(controller, contacts)[1] <= 5.0 + 1e-5
    lifting.now = None
    assert normals(controller, contacts)[1] >= 30.0 - 1e-5


@pytest.mark.parametrize("what", ["normal_limits", "normal_floors"])
def test_bounds_on_the_force_of_a_contact_that_the_stack_does_not_have_are_named(what: str):
    lifting = Saying()
    controller, contacts = standing("quadruped", components=[lifting])
    normals(controller, contacts)
    lifting.now = wbc.Overrides(**{what: {"rear_left_fot": 5.0}})
    command = controller.tick(0.001, controller.model.q0, np.zeros(controller.model.nv))
    assert not command.status.ok and np.isfinite(command.tau).all()
    assert f"{what} speaks of a contact" in controller.why and "'rear_left_fot'" in controller.why
    assert "did you mean 'rear_left_foot'" in controller.why


@pytest.mark.parametrize("hierarchy", HIERARCHIES)
def test_a_wanted_normal_force_leaves_the_rest_of_the_wrench_free(hierarchy: str):
    free = normals(*standing("humanoid"))
    target = [1e3, 1e3, 1.2 * free[0]]  # the first two are not wanted
    wanted = T.ContactForce(HUMANOID.feet["left_sole"].frame, target=target, weight={"fz": 1e-1, "f[xy]": 0.0})
    controller, contacts = standing("humanoid", wanted, hierarchy=hierarchy)
    found = normals(controller, contacts)
    left = [contact.frame for contact in contacts].index(HUMANOID.feet["left_sole"].frame)
    assert found[left] == pytest.approx(target[2], rel=1e-2)


def test_bounds_count_where_forces_are_decided():
    robot = ROBOTS["quadruped"]
    contacts = [T.Point(f, friction=0.5, f_min=1.0, f_max=2.0) for f in robot.feet]
    stack = wbc.Stack([T.Posture(robot.q0)], contacts=contacts)
    command = wbc.Controller(robot, stack, level=wbc.VelocityLevel()).tick(0.0, robot.q0, np.zeros(robot.nv))
    assert command.status.ok
