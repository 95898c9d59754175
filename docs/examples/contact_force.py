"""A humanoid presses against a wall with 30 N, puts 400 N on one foot, and at most 250 N on the other."""

import numpy as np

import wbc
from wbc.tasks import CenterOfMass, ContactForce, JointLimits, Point, Posture, feet

robot = wbc.load("humanoid")
left, right = feet(robot)
right.f_max = 250.0  # N, a bound
wall = Point("left_hand", friction=0.5, axes=[[0, 0, -1], [0, 1, 0], [1, 0, 0]], name="wall")  # its normal: -x
only_normal = {"fz": 1.0, "f[xy]": 0.0}
stack = wbc.Stack(
    [
        CenterOfMass(target=robot.state().com),
        Posture(robot.q0, weight=1e-3),
        ContactForce("wall", target=[0.0, 0.0, 30.0], weight=only_normal),  # N, wanted
        ContactForce("left_sole", target=[0.0, 0.0, 400.0], weight=only_normal),
    ],
    contacts=[left, right, wall],
    subject_to=[JointLimits()],
)
controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics())
command = controller.tick(0.0, robot.q0, np.zeros(robot.nv))
force = {name: command.f[name] for name in ("wall", "left_sole", "right_sole")}
for name, wrench in force.items():
    print(f"{name}: {wrench[2]:.2f} N along its normal, {np.hypot(*wrench[:2]):.2f} N of friction")
assert command.status.ok
assert abs(force["wall"][2] - 30.0) < 0.1 and abs(force["left_sole"][2] - 400.0) < 1.0
assert force["right_sole"][2] <= 250.0 + 1e-6
