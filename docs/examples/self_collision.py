"""Two hands are both sent to the point between them: they stop a margin apart and come to rest."""

import numpy as np

import wbc
from wbc.tasks import CollisionAvoidance, JointLimits, Position, Posture

robot, dt = wbc.load("humanoid", base="fixed"), 2e-3
state, start, v = robot.state(), robot.q0, np.zeros(robot.nv)
middle = 0.5 * (state.frame("left_hand").position + state.frame("right_hand").position)

apart = CollisionAvoidance(margin=0.03)
stack = wbc.Stack(
    [Position("left_hand", target=middle), Position("right_hand", target=middle), Posture(start, weight=1e-3)],
    subject_to=[JointLimits(), apart],
)
controller = wbc.Controller(robot, stack, level=wbc.VelocityLevel(), dt=dt)
q, nearest = start, np.inf
for tick in range(1000):
    command = controller.tick(dt * tick, q, v)
    assert command.status.ok
    q, v = command.q, command.v
    nearest = min(nearest, controller.plan.margins()["CollisionAvoidance"][1].min() + 0.03)
print(f"nearest {1e3 * nearest:.1f} mm; fastest joint at the end {np.abs(v).max():.3f} rad/s")
assert nearest > 0.029 and np.abs(v).max() < 0.3
