"""A task of your own: the mean height of two hands, checked by finite differences, beside a limit and other tasks."""

import numpy as np

import wbc
from wbc.tasks import JointLimits, Posture
from wbc.testing import check_task


class MeanHeight(wbc.Task):
    """e = target - (z_left + z_right) / 2 [m]: one row."""

    def __init__(self, left, right, *, target, **settings):
        self.hands, self.subject = (left, right), f"{left}, {right}"
        self.dim, self.units = 1, "m"
        super().__init__(**settings)  # kp, kd, rate, weight, name
        self.target = target

    def fill(self, state, out):
        hands = [state.frame(hand) for hand in self.hands]
        out.e[:] = self.target - np.mean([hand.position[2] for hand in hands])
        out.J[:] = np.mean([hand.jacobian()[2] for hand in hands], axis=0)
        out.drift[:] = np.mean([hand.drift()[2] for hand in hands])


robot, dt = wbc.load("humanoid", base="fixed"), 5e-3
high = MeanHeight("left_hand", "right_hand", target=1.1, rate=5.0)
check_task(high)  # the Jacobian and the drift, on every robot with these frames
stack = wbc.Stack([high, Posture(robot.q0, weight=1e-5)], subject_to=[JointLimits()])
controller = wbc.Controller(robot, stack, level=wbc.VelocityLevel(), dt=dt)
q, v, state = robot.q0, np.zeros(robot.nv), robot.state()
for tick in range(600):
    command = controller.tick(dt * tick, q, v)
    assert command.status.ok
    q, v = command.q, command.v
state.update(3.0, q, v)
left, right = (state.frame(hand).position[2] for hand in high.hands)
print(f"the hands are {left:.3f} m and {right:.3f} m high")
assert abs((left + right) / 2 - 1.1) < 2e-3
