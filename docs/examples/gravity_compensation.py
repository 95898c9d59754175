"""An arm is led by hand while it carries its own weight, then holds its place as springs and dampers do."""

import numpy as np

import wbc
from wbc.sim.disturbance import Push
from wbc.sim.mujoco_ import MujocoPlant
from wbc.sim.simulate import simulate
from wbc.tasks import Damping, GravityCompensation, JointImpedance, TorqueLimits

robot = wbc.load("arm")
push = Push("tool", force=(0.0, 15.0, 0.0), start=0.5, duration=1.0)
floats = [GravityCompensation(), Damping(kd=2.0, weight=1e-3)]
springs = [JointImpedance(robot.q0, stiffness={".*": 200.0, "wrist_.*": 40.0}, damping={".*": 8.0, "wrist_.*": 0.3})]
moved = {}
for name, tasks in (("gravity compensation", floats), ("joint impedance", springs)):
    controller = wbc.Controller(robot, wbc.Stack(tasks, subject_to=[TorqueLimits()]), level=wbc.InverseDynamics())
    plant = MujocoPlant(robot)
    plant.reset(robot.q0)
    run = simulate(controller, plant, duration=3.0, disturbances=[push])
    off = np.abs(run["plant.q"] - robot.q0).max(axis=1)
    moved[name] = off[-1]
    print(f"{name}: pushed {off.max():.3f} rad away, at the end {off[-1]:.4f} rad")
assert moved["gravity compensation"] > 0.1 and moved["joint impedance"] < 0.01
