"""Two hands want what only one of them can have: weights share the error, levels give the main hand all it asks for."""

import numpy as np

import wbc
from wbc.tasks import JointLimits, Position, Posture

robot, dt = wbc.load("humanoid", base="fixed"), 2e-3  # the pelvis is held, the trunk leans and turns
state = robot.state()
left, right = (state.frame(hand).position for hand in ("left_hand", "right_hand"))
main = Position("left_hand", target=left + [0.15, 0.3, 0.1])
other = Position("right_hand", target=right + [0.1, -0.7, 0.2])
missed = {}
for hierarchy in (wbc.Weighted(), wbc.Strict()):
    stack = wbc.Stack([[main], [other], [Posture(robot.q0, weight=1e-4)]], subject_to=[JointLimits()])
    controller = wbc.Controller(robot, stack, level=wbc.VelocityLevel(), hierarchy=hierarchy, dt=dt)
    q, v = robot.q0, np.zeros(robot.nv)
    for tick in range(2000):
        command = controller.tick(dt * tick, q, v)
        assert command.status.ok
        q, v = command.q, command.v
    errors = controller.plan.errors()
    missed[type(hierarchy).__name__] = np.linalg.norm(errors[main.name])
    print(f"{hierarchy}: main hand {1e3 * np.linalg.norm(errors[main.name]):.3f} mm off,", end=" ")
    print(f"other hand {1e3 * np.linalg.norm(errors[other.name]):.1f} mm")
assert missed["Strict"] < 1e-4 < 10 * missed["Weighted"]
