"""A mobile manipulator drives its base so that its hand gets where the arm alone cannot."""

import numpy as np

import wbc
from wbc.tasks import AxisAlignment, JointLimits, Position, Posture, Rolling

robot, dt = wbc.load("tiago", base="floating"), 5e-3
state = robot.state()
goal = state.frame("hand_palm_link").position + [1.0, 0.3, -0.1]  # a metre away
base, wheel = state.frame("base_footprint"), state.frame("wheel_left_link")
ground, radius = base.position[2], wheel.position[2] - base.position[2]

stack = wbc.Stack(
    [
        Position("hand_palm_link", target=goal, rate=2.0),
        Posture(robot.q0, weight={".*": 1e-3, "wheel_.*": 0.0}),  # wheels turn as they like
    ],
    subject_to=[
        JointLimits(v_max={"wheel_.*": 15.0}),
        Rolling("wheel_left_link", radius=radius, axle=[0.0, 0.0, 1.0]).exactly(),
        Rolling("wheel_right_link", radius=radius, axle=[0.0, 0.0, 1.0]).exactly(),
        Position("base_footprint", target=[ground], axes="z").exactly(),
        AxisAlignment("base_footprint", axis=[0, 0, 1], target=[0, 0, 1]).exactly(),  # it may turn about z
    ],
)
controller = wbc.Controller(robot, stack, level=wbc.VelocityLevel(), dt=dt)
q, v = robot.q0, np.zeros(robot.nv)
for tick in range(1000):
    command = controller.tick(dt * tick, q, v)
    assert command.status.ok, controller.explain()
    q, v = command.q, command.v
state.update(5.0, q, v)
error = np.linalg.norm(state.frame("hand_palm_link").position - goal)
print(f"the base went {np.linalg.norm(q[:2] - robot.q0[:2]):.2f} m, the hand is {1e3 * error:.2f} mm off")
assert error < 1e-3 and abs(state.frame("base_footprint").position[2] - ground) < 1e-4
