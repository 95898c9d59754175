"""Collision avoidance in a controller: distance is kept at every level, found again, and there is always an answer."""

from __future__ import annotations

import re
import warnings
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wbc
from tasks import CollisionAvoidance, JointLimits, Obstacle, Position, Posture
from wbc import AccelerationLevel, Controller, InverseDynamics, Stack, VelocityLevel
from wbc.models.collision import Distances
from wbc.models.geometry import Sphere
from wbc.sim.plant import IntegratorPlant
from wbc.sim.simulate import simulate
from wbc.testing import robots
from wbc.types import Status, Vec

ARM = robots()[0]
START = ARM.state().frame("tool").position.copy()
LEVELS = [VelocityLevel(), AccelerationLevel(), InverseDynamics()]
DT, MARGIN = 1e-3, 0.02


def at(point: Vec) -> Any:
    return pin.SE3(np.eye(3), np.asarray(point, dtype=np.float64))


def towards(goal: Vec, constraints: list[Any], level: Any, **settings: Any) -> Controller:
    reach = Position("tool", target=goal, kp=100.0, rate=5.0)
    stack = Stack([reach, Posture(ARM.q0, kp=10.0, weight=1e-2)], subject_to=[JointLimits(), *constraints])
    return Controller(ARM, stack, level=level, dt=DT, **settings)


def smallest(
    controller: Controller, constraint: CollisionAvoidance, seconds: float, q: Vec | None = None
) -> list[float]:
    """The smallest distance of each tick; the robot does what is decided."""
    q, v = np.array(ARM.q0) if q is None else q, np.zeros(ARM.nv)
    state, seen = ARM.state(drifts=False), []
    for k in range(round(seconds / DT)):
        command = controller.tick(k * DT, q, v)
        assert command.status is Status.SOLVED, controller.why
        q, v = command.q, command.v
        state.update((k + 1) * DT, q, v)
        seen.append(constraint.closest(state)[0][2] if constraint.closest(state) else np.inf)
    return seen


def ball_in_the_way(radius: float = 0.06) -> tuple[Vec, Obstacle]:
    goal = START + np.array([-0.1, 0.35, 0.0])
    return goal, Obstacle("ball", Sphere(radius), at(0.5 * (START + goal) + np.array([0.0, 0.0, 0.03])))


@pytest.mark.parametrize("level", LEVELS, ids=lambda level: level.name)
def test_the_tool_goes_round_what_it_would_go_through(level: Any):
    goal, ball = ball_in_the_way()
    constraint = CollisionAvoidance([ball], self_collision=False, margin=MARGIN)
    constraint.prepare(ARM)
    # A velocity is kept for a whole tick, in which the distance may fall by its curvature.
    assert min(smallest(towards(goal, [constraint], level), constraint, 1.5)) > MARGIN - 2e-4
    assert min(smallest(towards(goal, [], level), constraint, 1.5)) < 0.0


def test_obstacles_of_its_samples_leave_every_robot_room_where_it_starts():
    for robot in robots():
        for sample in CollisionAvoidance.samples(robot):
            nearest = sample.closest(robot.state())
            assert nearest and nearest[0][2] > sample.margin


@pytest.mark.parametrize("level", LEVELS, ids=lambda level: level.name)
def test_from_inside_one_another_shapes_come_apart_again(level: Any):
    constraint = CollisionAvoidance([Obstacle("ball", Sphere(0.1), at(START))], self_collision=False, margin=MARGIN)
    constraint.prepare(ARM)
    seen = smallest(towards(START, [constraint], level), constraint, 1.0)
    assert seen[0] < -0.05
    assert (np.diff(seen) > -1e-6).all()
    assert seen[-1] > MARGIN - 5e-4


@pytest.mark.parametrize("level", LEVELS, ids=lambda level: level.name)
def test_what_comes_flying_is_dodged(level: Any):
    def thrown(t: float) -> Any:
        return at(START + np.array([0.6 - 0.6 * t, 0.05, 0.02]))

    constraint = CollisionAvoidance([Obstacle("ball", Sphere(0.06), thrown)], self_collision=False, margin=MARGIN)
    constraint.prepare(ARM)
    assert min(smallest(towards(START, [constraint], level), constraint, 1.5)) > MARGIN - 2e-3
    assert min(smallest(towards(START, [], level), constraint, 1.5)) < 0.0


@settings(max_examples=12)
@given(st.integers(0, 10_000), st.sampled_from(LEVELS))
def test_every_tick_has_an_answer_however_the_obstacles_stand(seed: int, level: Any):
    """Balls all over the arm, from the first tick on."""
    rng = np.random.default_rng(seed)
    around = [Obstacle(f"ball {i}", Sphere(0.1), at(START + 0.3 * rng.normal(size=3))) for i in range(4)]
    constraints = [CollisionAvoidance(around, margin=MARGIN)]
    controller = towards(START + 0.2 * rng.normal(size=3), constraints, level)
    q, v = ARM.random_configuration(rng), 0.3 * rng.normal(size=ARM.nv)
    for k in range(5):
        command = controller.tick(k * DT, q, v)
        assert command.status is Status.SOLVED, controller.why
        q, v = command.q, command.v


def test_without_slack_it_is_a_constraint_that_may_contradict_itself():
    sides = 0.11 * np.vstack([np.eye(3), -np.eye(3)])
    balls = [Obstacle(f"ball {i}", Sphere(0.12), at(START + side)) for i, side in enumerate(sides)]
    for slack, status in ((None, Status.INFEASIBLE), (1e6, Status.SOLVED)):
        constraint = CollisionAvoidance(balls, self_collision=False, slack=slack, count=20)
        command = towards(START, [constraint], AccelerationLevel()).tick(0.0, ARM.q0, np.zeros(ARM.nv))
        assert command.status is status


def baxter() -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of fingers that mimic each other
        return wbc.load("baxter")


def hands_meet(robot: Any, hands: tuple[str, str], q: Vec, level: Any, seconds: float, **settings: Any) -> Any:
    """Both hands are sent to the point between them; the smallest distance of all, and the fastest joint in the end."""
    state, dt, margin = robot.state(), 2e-3, 0.03
    state.update(0.0, q, np.zeros(robot.nv))
    middle = 0.5 * sum(state.frame(hand).position for hand in hands)
    constraint = CollisionAvoidance(margin=margin, **settings)
    tasks = [*(Position(hand, target=middle) for hand in hands), Posture(q, weight=1e-3)]
    controller = Controller(robot, Stack(tasks, subject_to=[JointLimits(), constraint]), level=level, dt=dt)
    everything = Distances(robot, margin=margin, reach=0.2, count=10_000)
    v, seen, said = np.zeros(robot.nv), [], 0
    for k in range(round(seconds / dt)):
        command = controller.tick(k * dt, q, v)
        assert command.status is Status.SOLVED, controller.why
        q, v = command.q, command.v
        said += "have no row" in controller.why
        if k % 10 == 0:
            state.update(k * dt, q, v)
            everything.read(state)
            seen.append(everything.distance.min() if (everything.which >= 0).any() else 0.2)
    return np.array(seen), float(np.abs(v).max()), said


def test_two_arms_driven_into_each_other_keep_the_margin_and_come_to_rest():
    robot = baxter()
    bent = {f"{side}_{j}": x for side in ("left", "right") for j, x in (("s1", -0.5), ("e1", 1.2), ("w1", 0.8))}
    hands = "left_gripper_base_link", "right_gripper_base_link"
    seen, speed, _ = hands_meet(robot, hands, robot.configuration(bent), VelocityLevel(), 3.0)
    assert seen[40:].min() > 0.03 - 1e-3  # the start itself is within the margin
    assert speed < 0.15


def test_too_few_rows_are_said():
    robot = baxter()
    hands = "left_gripper_base_link", "right_gripper_base_link"
    *_, said = hands_meet(robot, hands, np.array(robot.q0), VelocityLevel(), 0.2, count=2)
    assert said > 50


def test_far_from_everything_it_changes_nothing():
    far = Obstacle("moon", Sphere(1.0), at(np.array([50.0, 0.0, 0.0])))
    constraint = CollisionAvoidance([far], self_collision=False)
    with_constraint, without = (
        towards(START + 0.1, constraints, InverseDynamics()) for constraints in ([constraint], [])
    )
    one, other = (controller.tick(0.0, ARM.q0, np.zeros(ARM.nv)) for controller in (with_constraint, without))
    np.testing.assert_allclose(one.tau, other.tau, atol=1e-7)


def test_the_closest_are_named_the_nearest_first():
    _, ball = ball_in_the_way()
    constraint = CollisionAvoidance([ball], margin=MARGIN, reach=0.5)
    constraint.prepare(ARM)
    found = constraint.closest(ARM.state())
    assert [d for *_, d in found] == sorted(d for *_, d in found)
    assert any("ball" in pair for *pair, _ in found)


def test_margins_are_recorded_pair_by_pair_and_explained_by_name():
    goal, ball = ball_in_the_way()
    constraint = CollisionAvoidance([ball], self_collision=False, margin=MARGIN, count=3)
    controller = towards(goal, [constraint], AccelerationLevel())
    run = simulate(controller, IntegratorPlant(ARM), duration=0.3)
    margins, pairs = run["margin.CollisionAvoidance"], run["about.CollisionAvoidance"]
    assert margins.shape == pairs.shape == (300, 3)
    nearest = constraint.closest(controller.state)[0]
    row = int(np.argmin(margins[-1]))
    assert margins[-1, row] == pytest.approx(nearest[2] - MARGIN, abs=1e-12)
    assert constraint.names[int(pairs[-1, row])] == nearest[:2]
    assert f"CollisionAvoidance: {nearest[0]} and ball" in controller.explain()


@pytest.mark.parametrize("level", LEVELS, ids=lambda level: level.name)
@pytest.mark.parametrize(
    ("lost", "said"),
    [(at(np.full(3, np.nan)), "has the number nan"), (at(np.full(3, 1e200)), "has the number 1e[+]200"),
     (pin.SE3(5.0 * np.eye(3), START), "is not a rotation"), (None, "is None; a pose is a pinocchio.SE3")],
    ids=["nan", "huge", "scaled", "none"],
)  # fmt: skip
def test_a_pose_that_is_none_fails_its_tick_and_no_other(level: Any, lost: Any, said: str):
    good = at(START + np.array([0.12, 0.0, 0.0]))
    now = [good]
    ball = Obstacle("ball", Sphere(0.05), lambda _: now[0])
    controllers = [towards(START + np.array([0.35, 0.0, 0.0]), [CollisionAvoidance([ball])], level) for _ in range(2)]
    for controller in controllers:
        controller.tick(0.0, ARM.q0, np.zeros(ARM.nv))
    now[0] = lost
    failed = controllers[0].tick(DT, ARM.q0, np.zeros(ARM.nv))
    assert failed.status is Status.FAILED
    assert re.match(
        f"CollisionAvoidance.fill raised InvalidInput: the pose of obstacle 'ball' at 0.001 s {said}",
        controllers[0].why,
    )
    now[0] = good
    for _ in range(2):
        for k in range(2, 5):
            commands = [controller.tick(k * DT, ARM.q0, np.zeros(ARM.nv)) for controller in controllers]
            assert commands[0].status is Status.SOLVED
            margins = [controller.plan.margins()["CollisionAvoidance"][1] for controller in controllers]
            assert margins[0].tobytes() == margins[1].tobytes()
        controllers[0].reset()
