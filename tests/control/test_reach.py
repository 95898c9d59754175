"""One-shot inverse kinematics: what can be reached is reached, within limits; what cannot is said, with the reason."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pinocchio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import tasks as T
import wbc
from wbc.errors import InvalidInput
from wbc.models.model import RobotModel
from wbc.stack.member import bound
from wbc.stack.task import Task
from wbc.types import Mat, Vec

ARM, BODY = wbc.load("arm"), wbc.load("humanoid", base="fixed")
TASKS = [kind for _, kind in sorted(vars(T).items()) if isinstance(kind, type) and issubclass(kind, Task)]


def pose(robot: RobotModel, frame: str, q: Vec) -> Mat:
    """Where Pinocchio puts a frame."""
    data = robot.pinocchio.createData()
    pinocchio.framesForwardKinematics(robot.pinocchio, data, q)
    return np.array(data.oMf[robot.frames[frame]].homogeneous)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 10**6), which=st.sampled_from([(ARM, "tool"), (BODY, "left_hand")]))
def test_a_pose_of_some_configuration_is_reached_within_the_limits(seed: int, which: tuple[RobotModel, str]) -> None:
    robot, frame = which
    wanted = pose(robot, frame, robot.random_configuration(np.random.default_rng(seed)))
    found = wbc.reach(robot, [T.Frame(frame, target=wanted)])
    assert found.ok and not found.reason
    assert np.abs(pose(robot, frame, found.q) - wanted).max() <= 2e-5
    assert (found.q >= robot.limits.q_min - 1e-6).all() and (found.q <= robot.limits.q_max + 1e-6).all()


@given(place=st.tuples(*[st.floats(-500.0, 500.0)] * 2), base=st.sampled_from(["planar", "rails"]))
def test_a_base_that_slides_goes_as_far_as_it_has_to(place: tuple[float, float], base: str) -> None:
    """Steps of half a metre are as many as metres; no answer is no reason, nor is it a target in millimetres."""
    robot = wbc.load("arm", base="planar")
    if base == "rails":
        ends = np.where(np.arange(robot.nj) < 2, 600.0, np.inf)
        limits = (np.maximum(robot.limits.q_min, -ends), np.minimum(robot.limits.q_max, ends))
        robot = robot.replace(limits=replace(robot.limits, q_min=limits[0], q_max=limits[1]))
    found = wbc.reach(robot, [T.Position("tool", target=[*place, 0.5])], attempts=1)
    assert found.ok and found.steps <= 20, found
    assert np.abs(pose(robot, "tool", found.q)[:2, 3] - place).max() <= 2e-5


def test_a_point_out_of_reach_is_told_by_task_axis_and_distance() -> None:
    found = wbc.reach(ARM, [T.Position("tool", target=[4.0, 0.0, 0.5])], attempts=2)
    assert not found.ok and found.attempts == 2
    off = float(np.abs(found.errors["Position[tool]"]).max())
    assert found.reason == f"Position[tool] stays {off:.3g} m off in x" and off > 2.0


@pytest.mark.parametrize("kind", TASKS, ids=lambda kind: kind.__name__)
def test_any_task_with_an_error_is_met_or_told_by_name(kind: Any) -> None:
    start = ARM.q0 + 0.1
    for task in kind.samples(ARM):
        if not bound(task, ARM).gains()[0].any():
            with pytest.raises(InvalidInput, match="has kp = 0, so it has no error that could be met"):
                wbc.reach(ARM, [task])
            continue
        found = wbc.reach(ARM, [task], start=start, attempts=1, steps=3)
        assert found.ok == (not found.reason) and found.reason.startswith("" if found.ok else f"{task.name} stays ")
        asked = bound(task, ARM).weights() > 0.0
        assert found.ok == bool(np.abs(found.errors[task.name][asked]).max(initial=0.0) <= 1e-5)


def test_the_limit_that_stands_in_the_way_is_named() -> None:
    narrow = replace(
        ARM.limits,
        q_min=np.maximum(ARM.limits.q_min, ARM.q0 - 0.1),
        q_max=np.minimum(ARM.limits.q_max, ARM.q0 + 0.1),
    )
    beyond = ARM.replace(limits=narrow)
    q = ARM.q0.copy()
    q[1] += 0.6
    found = wbc.reach(beyond, [T.Frame("tool", target=pose(ARM, "tool", q))], attempts=3)
    assert not found.ok and found.reason.endswith("; it can be met without position limits")
    wall = T.HalfSpaceLimit("tool", normal=[0.0, 0.0, -1.0], offset=-0.2)
    assert wbc.reach(ARM, [T.Position("tool", target=[0.4, 0.2, 0.5])], subject_to=[], attempts=2).ok
    blocked = wbc.reach(ARM, [T.Position("tool", target=[0.4, 0.2, 0.5])], subject_to=[wall], attempts=2)
    assert not blocked.ok and f"without {wall.name}" in blocked.reason


#: Constraints of a controller that are about motions, or come near their limits slowly: [0.4, 0.2, 0.5] meets them all.
CONSTRAINTS = {
    "slow": T.JointLimits(v_max=0.05, a_max=0.5, j_max=10.0),
    "careful": T.JointPositionLimits(braking=1e-3),
    "velocities": T.JointVelocityLimits(0.01),
    "accelerations": T.JointAccelerationLimits(1.0),
    "a frame's velocity": T.FrameVelocityLimits("tool", linear=0.01),
    "a wall at the point": T.HalfSpaceLimit("tool", normal=[0.0, 0.0, -1.0], offset=-0.5, rate=0.5),
    "a ball around it": T.Position("tool", target=[0.4, 0.2, 0.6], name="ball").within(0.1, rate=0.5),
    "exactly there": T.Position("tool", target=[0.4, 0.2, 0.5], rate=0.5, name="there").exactly(),
    "a joint exactly there": T.Posture([0.3], joints=[ARM.joint_names[-1]], rate=0.5).exactly(),
}


@pytest.mark.parametrize("which", CONSTRAINTS)
def test_how_fast_a_constraint_lets_a_robot_move_does_not_matter(which: str) -> None:
    task = T.Position("tool", target=[0.4, 0.2, 0.5])
    found = wbc.reach(ARM, [task], subject_to=[CONSTRAINTS[which]], attempts=1)
    assert found.ok and found.steps <= 5


def test_a_task_that_is_a_constraint_is_met_or_named() -> None:
    robot = wbc.load("humanoid")
    foot, hand = (pose(robot, frame, robot.q0)[:3, 3] for frame in ("left_sole", "left_hand"))
    ahead, up = np.array([0.05, 0.0, 0.0]), np.array([0.0, 0.0, 0.1])
    place = T.Position("left_hand", target=hand + ahead)
    step = T.Position("left_sole", target=foot + up, name="step").exactly()
    found = wbc.reach(robot, [place], subject_to=[step, T.JointPositionLimits()])
    assert found.ok and np.abs(pose(robot, "left_sole", found.q)[:3, 3] - foot - up).max() <= 1e-5
    short = wbc.reach(robot, [place], subject_to=[step, T.JointPositionLimits()], steps=1, attempts=1)
    assert not short.ok and "step" in short.reason and np.abs(short.errors[step.name]).max() > 1e-5


def test_rows_without_weight_ask_for_nothing() -> None:
    far = np.eye(4)
    far[:3, 3] = 0.4, 0.2, 4.0
    found = wbc.reach(ARM, [T.Frame("tool", target=far, weight=[1.0, 1.0, 0.0, 0.0, 0.0, 0.0])])
    assert found.ok and np.abs(pose(ARM, "tool", found.q)[:2, 3] - [0.4, 0.2]).max() <= 1e-5
    idle = T.Position("tool", target=[0.4, 0.2, 4.0])
    idle.active = False
    assert wbc.reach(ARM, [idle]).steps == 0


class Rooted(Task):
    """The root of what the first joint is short of 1 rad: beyond it there is none."""

    dim, units = 1, ("rad½",)

    def fill(self, state: Any, out: Any) -> None:
        with np.errstate(invalid="ignore"):
            out.e[0] = 0.5 + np.sqrt(1.0 - state.q[0])
        out.J[:] = 0.0
        out.J[0, 0] = 1.0


def test_a_task_that_has_no_error_at_all_somewhere_is_not_met_there() -> None:
    found = wbc.reach(ARM, [Rooted()], subject_to=[], attempts=2)
    assert not found.ok and found.q[0] <= 1.0


def test_tasks_of_lower_levels_choose_among_the_answers() -> None:
    reach = T.Position("tool", target=[0.4, 0.2, 0.5])
    alone, near = wbc.reach(ARM, [reach]), wbc.reach(ARM, [[reach], [T.Posture(ARM.q0)]])
    assert near.ok and np.abs(near.errors["Position[tool]"]).max() <= 1e-5
    assert np.linalg.norm(near.q - ARM.q0) <= np.linalg.norm(alone.q - ARM.q0) + 1e-9


def test_a_configuration_within_the_tolerance_is_an_answer_as_it_stands() -> None:
    """With levels below there is still something to choose: a step may then lead on."""
    target = pose(ARM, "tool", ARM.q0)
    target[:3, 3] += [3e-3, -3e-3, 3e-3]
    found = wbc.reach(ARM, [T.Frame("tool", target=target)], tolerance=1e-2)
    assert found.ok and (found.steps, found.attempts) == (0, 1)
    np.testing.assert_array_equal(found.q, ARM.q0)


@pytest.mark.parametrize("steps", [1, 3])
def test_every_attempt_takes_the_steps_that_it_may_where_it_has_not_arrived(steps: int) -> None:
    far = [[T.Position("tool", target=[4.0, 0.0, 0.5])], [T.Posture(ARM.q0)]]
    assert wbc.reach(ARM, far, attempts=2, steps=steps).steps == 2 * steps


def test_the_same_seed_gives_the_same_answer_and_the_tasks_stay_as_they_were() -> None:
    task = T.Frame("tool", target=pose(ARM, "tool", ARM.random_configuration(np.random.default_rng(4))), rate=3.0)
    start = ARM.limits.q_min
    first, again = (wbc.reach(ARM, [task], start=start, seed=7) for _ in range(2))
    assert (first.q == again.q).all() and first.steps == again.steps
    assert task.gains()[2].tolist() == [3.0] * 6
