"""A target out of reach leads to rest at the nearest point, and back when it comes back; what can be met is met."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import least_squares, linprog

import tasks as T
import wbc
from tests.stack.conftest import feet
from wbc import AccelerationLevel, Controller, InverseDynamics, Stack, VelocityLevel
from wbc.errors import ModelError
from wbc.types import Status, Vec

try:
    ARM, UR5 = wbc.load("arm"), wbc.load("ur5")
except ModelError as missing:
    pytest.skip(str(missing), allow_module_level=True)
LEVELS = [VelocityLevel, AccelerationLevel, InverseDynamics]
DT = 2e-3
each_level = pytest.mark.parametrize("level", LEVELS, ids=lambda level: level.name)


def far_away(seed: int) -> Any:
    """A pose at two to three metres: neither arm is longer than 1.2 m."""
    rng = np.random.default_rng(seed)
    direction, axis = rng.normal(size=(2, 3))
    place = direction / np.linalg.norm(direction) * (2.0 + rng.random())
    return pin.SE3(pin.exp3(axis / np.linalg.norm(axis)), place)


def hand_of(robot: Any) -> str:
    return "tool" if robot is ARM else "tool0"


def moved(
    controller: Controller, q: Vec, v: Vec, seconds: float, start: float = 0.0, *, certified: bool = True
) -> tuple[Vec, Vec, list[Vec]]:
    """The state in the end, and all velocities on the way; every tick is answered as asked, by the first solver."""
    seen = []
    for k in range(round(seconds / DT)):
        command = controller.tick(start + k * DT, q, v)
        assert not certified or (command.status.ok and command.fallback_level == "solved"), command
        q, v = command.q, command.v
        seen.append(v)
    return q, v, seen


def best(robot: Any, frame: str, target: Vec, q: Vec) -> float:
    """How near the frame can come from here, by an optimiser that shares nothing with the controller."""
    state = robot.state(drifts=False)

    def error(q: Vec) -> Vec:
        state.update(0.0, q, np.zeros(robot.nv))
        return np.asarray(target - state.frame(frame).position, dtype=np.float64)

    low, high = robot.limits.q_min, robot.limits.q_max
    found = least_squares(error, np.clip(q, low + 1e-9, high - 1e-9), bounds=(low, high), xtol=1e-12, ftol=1e-12)
    return float(np.linalg.norm(found.fun))


@each_level
@pytest.mark.parametrize("robot", [ARM, UR5], ids=lambda robot: robot.name)
@pytest.mark.parametrize("seed", [0, 1])
def test_out_of_reach_is_rest_at_the_nearest_point_and_back_in_reach_is_the_target(level: Any, robot: Any, seed: int):
    frame, target = hand_of(robot), far_away(seed).translation
    reach = T.Position(frame, target=target)
    controller = Controller(robot, Stack([reach], subject_to=[T.JointLimits()]), level=level(), dt=DT)
    q, v, seen = moved(controller, np.array(robot.q0), np.zeros(robot.nv), 4.0)
    last = np.array(seen[-250:])
    assert np.abs(last).max() < 1e-2
    flips = (last[1:] * last[:-1] < 0.0) & (np.abs(last[1:]) > 1e-3)
    assert flips.mean() < 0.01
    state = robot.state(drifts=False)
    state.update(0.0, q, v)
    distance = float(np.linalg.norm(target - state.frame(frame).position))
    assert distance == pytest.approx(best(robot, frame, target, q), abs=1e-4)

    state.update(0.0, np.array(robot.q0), v)
    reach.target = home = state.frame(frame).position.copy()
    q, v, _ = moved(controller, q, v, 2.5, start=4.0)
    state.update(0.0, q, v)
    assert np.linalg.norm(home - state.frame(frame).position) < 5e-3


@each_level
def test_without_damping_the_joints_chatter_at_their_limits(level: Any):
    """What the damping is there for: else the tests above could not fail."""
    stack = Stack([T.Position("tool", target=far_away(0).translation)], subject_to=[T.JointLimits()])
    controller = Controller(ARM, stack, level=level(lm_damping=0.0), dt=DT)
    # Where the arm is stretched out nothing but a regularisation of 1e-8 says what six joints at full speed do.
    _, _, seen = moved(controller, np.array(ARM.q0), np.zeros(ARM.nv), 3.0, certified=False)
    assert np.abs(seen[-50:]).max() > 1.0


@each_level
@pytest.mark.parametrize("hierarchy", [wbc.Weighted(), wbc.Strict(), wbc.Scaled()], ids=lambda h: type(h).__name__)
def test_what_can_be_met_gets_the_same_command_with_and_without(level: Any, hierarchy: Any):
    start = ARM.state().frame("tool").placement
    near = T.Frame("tool", target=start * pin.SE3(pin.exp3(np.array([0.1, 0.0, 0.2])), np.array([0.05, -0.05, 0.02])))
    commands = []
    for factor in (0.0, 0.05):
        stack = Stack([[near], [T.Damping(weight=1e-6)]], subject_to=[T.JointLimits()])
        controller = Controller(ARM, stack, level=level(lm_damping=factor), hierarchy=hierarchy, dt=DT)
        q, v, seen = moved(controller, np.array(ARM.q0), np.zeros(ARM.nv), 0.5)
        commands.append(np.concatenate([q, v, *seen]))
    np.testing.assert_allclose(commands[0], commands[1], atol=1e-4)


@each_level
@pytest.mark.parametrize("hierarchy, below", [
    (wbc.Strict(), "rate"), (wbc.Scaled(), "rate"), (wbc.Strict(), "posture"), (wbc.Scaled(), "posture"),
    (wbc.Strict(), "orientation and posture"), (wbc.Scaled(), "orientation and posture"),
], ids=lambda value: value if isinstance(value, str) else type(value).__name__)  # fmt: skip
def test_a_level_that_cannot_be_met_comes_to_rest_whatever_ranks_below_it(level: Any, hierarchy: Any, below: str):
    target, posture = far_away(1), [T.Posture(ARM.q0, kp=50)]
    ranked = {
        "rate": [[T.Damping(weight=1.0)]],
        "posture": [posture],
        "orientation and posture": [[T.Orientation("tool", target=target.rotation)], posture],
    }
    stack = Stack([[T.Position("tool", target=target.translation)], *ranked[below]], subject_to=[T.JointLimits()])
    controller = Controller(ARM, stack, level=level(), hierarchy=hierarchy, dt=DT)
    _, _, seen = moved(controller, np.array(ARM.q0), np.zeros(ARM.nv), 3.0)
    assert np.abs(seen[-50:]).max() < 1e-2


@pytest.mark.parametrize("hierarchy", [wbc.Strict(), wbc.Scaled()], ids=lambda h: type(h).__name__)
@pytest.mark.parametrize("frame, away", [
    ("right_shoulder_roll", (0.1, 0.1, 0.1)), ("right_hand", (0.4, 0.0, 0.6)), ("neck_yaw", (0.5, -1.0, 1.5)),
])  # fmt: skip
def test_a_robot_on_legs_comes_to_rest_with_a_frame_out_of_reach(hierarchy: Any, frame: str, away: Any):
    """All joints that keep the balance meanwhile, too: the other arm has no lever on the frame."""
    robot = wbc.load("humanoid")
    state = robot.state()
    target = state.frame(frame).position + np.array(away)
    pelvis = robot.frame_names[0]
    stack = Stack(
        [
            [T.CenterOfMass(target=state.com), T.Orientation(pelvis, target=np.eye(3))],
            [T.Position(frame, target=target)],
            [T.Posture(robot.q0, kp=50)],
        ],
        contacts=feet(robot), subject_to=[T.TorqueLimits(), T.JointPositionLimits(), T.JointVelocityLimits()],
    )  # fmt: skip
    controller = Controller(robot, stack, level=InverseDynamics(), hierarchy=hierarchy, dt=DT)
    _, _, seen = moved(controller, np.array(robot.q0), np.zeros(robot.nv), 3.0, certified=False)
    last = np.array(seen[-100:])
    assert np.abs(last).max() < 0.3
    assert np.abs(np.diff(last, 2, axis=0)).max() < 10.0 * DT  # accelerations do not jump either


def test_a_reset_forgets_the_damping_and_explain_says_it():
    stack = Stack([T.Position("tool", target=[2.0, 0.5, 0.5])], subject_to=[T.JointLimits()])
    controller = Controller(ARM, stack, level=VelocityLevel(), dt=DT)
    first = [v.tobytes() for v in moved(controller, np.array(ARM.q0), np.zeros(ARM.nv), 0.2)[2]]
    assert "damping of the joints" in controller.explain()
    assert controller.solution().certificate.ok
    controller.reset()
    assert first == [v.tobytes() for v in moved(controller, np.array(ARM.q0), np.zeros(ARM.nv), 0.2)[2]]


@each_level
def test_an_exact_task_out_of_reach_comes_to_rest_there_too(level: Any) -> None:
    """The task is relaxed in every tick, and what is left of it damps the joints."""
    target = np.array([0.4, 0.2, 4.0])
    stack = Stack(
        [T.Posture(ARM.q0, weight=1e-3)], subject_to=[T.Position("tool", target=target).exactly(), T.JointLimits()]
    )
    controller = Controller(ARM, stack, level=level(), dt=DT)
    q, v, seen = moved(controller, np.array(ARM.q0), np.zeros(ARM.nv), 4.0, certified=False)
    levels = {event.fallback_level for event in controller.fallbacks.log}
    assert levels == {"relaxed"}
    turned = [np.any(one * other < -1e-6) for one, other in pairwise(seen)]
    assert sum(turned) < 25 and not any(turned[-250:])
    assert np.abs(v).max() < 1e-3
    state = ARM.state(drifts=False)
    state.update(0.0, q, v)
    assert np.linalg.norm(target - state.frame("tool").position) < best(ARM, "tool", target, q) + 1e-3


def test_what_a_nearly_stretched_arm_cannot_do_is_proven_infeasible() -> None:
    """Its rows nearly depend on each other. That no point meets them is what linear programming says, too."""
    target, limits = np.array([2.0, 0.5, 0.5]), ARM.limits.v_max
    stack = Stack([T.Position("tool", target=target)], subject_to=[T.JointVelocityLimits()])
    q, _, _ = moved(Controller(ARM, stack, level=VelocityLevel(), dt=DT), ARM.q0, np.zeros(ARM.nv), 6.0)
    state, rng = ARM.state(drifts=False), np.random.default_rng(0)
    for _ in range(500):
        state.update(0.0, q + 10 ** rng.uniform(-4, -1) * rng.normal(size=ARM.nj), np.zeros(ARM.nv))
        tool = state.frame("tool")
        J, wanted = tool.jacobian()[:3], 5.0 * (target - tool.position)
        off = np.ones((3, 1))
        least = linprog(
            np.eye(8)[7], np.block([[J, -off], [-J, -off]]), np.concatenate([wanted, -wanted]),
            bounds=[*zip(-limits, limits, strict=True), (0.0, None)],
        )  # fmt: skip
        assert least.status == 0 and least.fun > 0.1, "the speed that is missing"
        qp = wbc.QP(np.eye(7), np.zeros(7), A=J, b=wanted, lb=-limits, ub=limits)
        assert wbc.solve(qp).status is Status.INFEASIBLE
