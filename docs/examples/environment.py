"""An environment of Gymnasium, in physics: an action is the target of a tool, the controller moves the robot."""

import numpy as np

import wbc
from wbc.robots import TargetEnv
from wbc.sim.engine import PhysicsSettings
from wbc.sim.mujoco_ import MujocoPlant
from wbc.tasks import JointLimits, Position, Posture

GOAL = np.array([0.45, 0.15, 0.45])


def place(env):
    state = env.plant.model.state()
    state.update(env.plant.t, env.plant.q, env.plant.v)
    return state.frame("tool").position.copy()


def make():
    robot = wbc.load("arm")
    tool = Position("tool", target=GOAL, kp=200.0)
    stack = wbc.Stack([tool, Posture(robot.q0, weight=1e-4)], subject_to=[JointLimits()])
    controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), dt=2e-3)
    plant = MujocoPlant(robot, dt=2e-3, settings=PhysicsSettings(armature=0.01))
    return TargetEnv(
        controller, plant, [(tool, GOAL - 0.3, GOAL + 0.3)],
        reward=lambda env: -np.linalg.norm(GOAL - place(env)), observe=place, ticks=10, duration=2.0,
    )  # fmt: skip


env, ends = make(), []
for _ in range(2):
    observed, _ = env.reset(seed=1)
    for _ in range(100):
        target = observed[-3:] + np.clip(GOAL - observed[-3:], -0.05, 0.05)
        observed, reward, terminated, truncated, info = env.step((target - GOAL) / 0.3)
    ends.append(observed)
print(f"after two seconds the tool is {-1e3 * reward:.2f} mm from its goal")
assert reward > -5e-3 and np.array_equal(*ends)  # an episode repeats to the bit
