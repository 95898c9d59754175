"""TargetEnv: Gymnasium's own checker passes it, actions are targets, and a seed with its actions is an episode."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wbc
import wbc.robots
from wbc.errors import InvalidInput, NotSupported
from wbc.sim.plant import IntegratorPlant
from wbc.tasks import CenterOfMass, JointVelocityLimits, Position, Posture, feet

gymnasium = pytest.importorskip("gymnasium", reason='needs the extra "gym"')
from gymnasium.utils.env_checker import check_env  # noqa: E402

from wbc.robots import TargetEnv  # noqa: E402

LOW, HIGH = np.array([0.3, -0.3, 0.3]), np.array([0.5, 0.3, 0.7])


def distance(env: TargetEnv) -> float:
    return -float(np.linalg.norm(env.controller.plan.errors()["Position[tool]"]))


def reaching(**other: Any) -> TargetEnv:
    robot = wbc.load("arm")
    tool = Position("tool", target=[0.4, 0.0, 0.5], rate=5.0)
    stack = wbc.Stack([tool, Posture(robot.q0, weight=1e-5)], subject_to=[JointVelocityLimits()])
    controller = wbc.Controller(robot, stack, level=wbc.VelocityLevel(), dt=2e-3)
    plant = IntegratorPlant(robot, level="velocity", dt=2e-3)
    given = {"plant": plant, "targets": [(tool, LOW, HIGH)], "reward": distance, "duration": 0.4} | other
    return TargetEnv(controller, given.pop("plant"), given.pop("targets"), **given)


def standing() -> TargetEnv:
    from wbc.sim.mujoco_ import MujocoPlant

    robot = wbc.load("quadruped")
    com = robot.state().com.copy()
    task = CenterOfMass(target=com)
    stack = wbc.Stack([task, Posture(robot.q0, weight=1e-2)], contacts=feet(robot))
    controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), dt=2e-3)
    plant = MujocoPlant(robot, dt=2e-3, contacts=stack.contacts)
    return TargetEnv(
        controller, plant, [(task, com - 0.02, com + 0.02)], reward=lambda env: float(env.plant.q[2]), noise=0.02
    )


@pytest.mark.parametrize("make", [reaching, pytest.param(standing, marks=pytest.mark.physics)])
def test_the_checker_of_gymnasium_finds_nothing(make: Any):
    env = make()
    check_env(env, skip_render_check=True)  # nothing is drawn
    env.close()


@settings(max_examples=5, deadline=None)
@given(seed=st.integers(0, 2**31 - 1))
def test_a_seed_and_its_actions_are_an_episode(seed: int):
    actions = np.random.default_rng(seed).uniform(-1.0, 1.0, (10, 3)).astype(np.float32)
    episodes = []
    for env in (reaching(), reaching()):
        rows = [env.reset(seed=seed)[0]]
        rows += [env.step(action)[0] for action in actions]
        rows += [env.reset(seed=seed)[0]]  # nothing is left of the episode before
        rows += [env.step(action)[0] for action in actions]
        episodes.append(np.array(rows))
    np.testing.assert_array_equal(*episodes)
    np.testing.assert_array_equal(episodes[0][:11], episodes[0][11:])


def test_the_tool_goes_where_the_action_says_and_no_further_than_the_bounds():
    env = reaching(duration=100.0)
    env.reset(seed=3)
    goal = np.array([0.35, 0.25, 0.6])
    for _ in range(100):
        share = (2.0 * (goal - LOW) / (HIGH - LOW) - 1.0).astype(np.float32)
        _, reward, terminated, truncated, info = env.step(share)
    assert reward > -1e-3 and not terminated and not truncated and info == {"unsolved": 0}
    state = env.plant.model.state()
    state.update(0.0, env.plant.q, env.plant.v)
    np.testing.assert_allclose(state.frame("tool").position, goal, atol=1e-3)
    env.step(np.full(3, 9.0, dtype=np.float32))
    np.testing.assert_allclose(env.targets[0].target, HIGH, rtol=1e-6)


def test_an_episode_is_truncated_after_its_duration():
    env = reaching(duration=0.1, ticks=10)
    env.reset(seed=0)
    ends = [env.step(env.action_space.sample())[3] for _ in range(5)]
    assert ends == [False] * 4 + [True]


@pytest.mark.physics
def test_a_robot_that_falls_terminates_the_episode():
    env = standing()
    env.reset(seed=0)
    env.plant.reset(np.concatenate([[0.0, 0.0, 0.3], [1.0, 0.0, 0.0, 0.0], env.plant.model.q0[7:]]))  # on its back
    ends = [env.step(np.zeros(3, dtype=np.float32))[2] for _ in range(10)]
    assert ends[-1]


def test_many_environments_are_stepped_by_the_vector_class():
    many = gymnasium.vector.SyncVectorEnv([reaching] * 3)
    observed, _ = many.reset(seed=5)
    alone = [reaching().reset(seed=5 + k)[0] for k in range(3)]
    np.testing.assert_array_equal(observed, np.array(alone))
    observed, reward, *_ = many.step(many.action_space.sample())
    assert observed.shape == (3, 14) and reward.shape == (3,)
    many.close()


def test_an_action_that_is_no_number_is_refused():
    env = reaching()
    env.reset(seed=0)
    with pytest.raises(InvalidInput, match="action"):
        env.step(np.array([np.nan, 0.0, 0.0], dtype=np.float32))


def test_without_gymnasium_the_extra_is_named(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    monkeypatch.delitem(sys.modules, "wbc.robots.gym")
    with pytest.raises(NotSupported, match=r"TargetEnv needs gymnasium; .*pip install '\.\[gym\]'"):
        _ = wbc.robots.TargetEnv
