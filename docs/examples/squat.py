"""A humanoid squats in physics: its centre of mass goes down and up between feet that stay where they are."""

import numpy as np

import wbc
from wbc.sim.mujoco_ import MujocoPlant
from wbc.sim.simulate import simulate
from wbc.tasks import CenterOfMass, JointLimits, Orientation, Posture, Sinusoid, feet

robot = wbc.load("humanoid")
com = robot.state().com.copy()
depth = 0.08  # m
squat = Sinusoid(com - [0.0, 0.0, depth], amplitude=[0.0, 0.0, depth], frequency=0.5, phase=np.pi / 2, ramp=0.0)
stack = wbc.Stack(
    [
        CenterOfMass(target=squat, kp=100.0),
        Orientation("torso", target=np.eye(3), weight=0.1),
        Posture(robot.q0, weight=1e-5),
    ],
    contacts=feet(robot),
    subject_to=[JointLimits()],
)
controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics())
plant = MujocoPlant(robot, contacts=stack.contacts)
plant.reset(plant.settled(robot.q0))
run = simulate(controller, plant, duration=4.0)

error = np.linalg.norm(run["error.CenterOfMass"], axis=1)
knee = run["plant.q"][:, 7 + robot.joint_names.index("left_knee")]
print(f"{run.meta['ended']}; the knee bends from {knee.min():.2f} to {knee.max():.2f} rad")
print(f"centre of mass: rms {1e3 * np.sqrt(np.mean(error**2)):.2f} mm, largest {1e3 * error.max():.2f} mm")
assert run.meta["ended"] == "complete" and error.max() < 5e-3 and np.ptp(knee) > 0.3
