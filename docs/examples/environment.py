"""An environment as Gymnasium has them, in physics: an action moves the target of a tool, the controller the robot."""

import numpy as np

import wbc
from wbc.sim.mujoco_ import MujocoPlant
from wbc.tasks import JointLimits, Position, Posture


class Reach:
    def __init__(self):
        self.robot = wbc.load("arm")
        self.home = self.robot.state().frame("tool").position.copy()
        self.tool = Position("tool", target=self.home, kp=200.0)
        stack = wbc.Stack([self.tool, Posture(self.robot.q0, weight=1e-4)], subject_to=[JointLimits()])
        self.controller = wbc.Controller(self.robot, stack, level=wbc.InverseDynamics(), dt=2e-3)
        self.plant = MujocoPlant(self.robot, dt=2e-3)

    def reset(self, seed):
        rng = np.random.default_rng(seed)
        self.tool.target, self.goal = self.home, self.home + rng.uniform(-0.15, 0.15, size=3)
        self.plant.reset(self.robot.q0)
        self.controller.reset()
        return self.step(np.zeros(3))[0]

    def step(self, action):  # (3,): how the target moves in 20 ms [m]
        self.tool.target = self.tool.target + np.clip(action, -0.01, 0.01)
        for _ in range(10):
            self.plant.step(self.controller.tick(self.plant.t, self.plant.q, self.plant.v))
        place = self.tool.target - self.controller.plan.errors()["Position[tool]"]
        return np.concatenate([self.plant.q, self.plant.v, self.goal - place]), -np.linalg.norm(self.goal - place)


env, ends = Reach(), []
for observed in (env.reset(seed) for seed in (1, 1)):
    for _ in range(100):
        observed, reward = env.step(0.2 * observed[-3:])
    ends.append(observed)
print(f"after two seconds the tool is {-1e3 * reward:.2f} mm from its goal")
assert reward > -2e-3 and np.array_equal(*ends)  # an episode repeats to the bit
