"""Two arms carry a box along a path: one hand leads it, the other keeps its place beside the first."""

import numpy as np

import wbc
from wbc.tasks import JointLimits, Position, Posture, RelativeFrame, Sinusoid

robot, dt = wbc.load("baxter"), 2e-3
ready = {f"{side}_{joint}": x for side in ("left", "right") for joint, x in (("s1", -0.5), ("e1", 1.2), ("w1", 0.8))}
q, v = robot.configuration(ready), np.zeros(robot.nv)
state = robot.state()
state.update(0.0, q, v)
left, right = state.frame("left_gripper"), state.frame("right_gripper")
grip = np.eye(4)  # the pose of the right hand in the left one, to be kept
grip[:3, :3] = left.rotation.T @ right.rotation
grip[:3, 3] = left.rotation.T @ (right.position - left.position)

path = Sinusoid(left.position, amplitude=[0.05, 0.05, 0.1], frequency=0.25)
stack = wbc.Stack(
    [
        [RelativeFrame("right_gripper", reference="left_gripper", target=grip, rate=20.0)],
        [Position("left_gripper", target=path, rate=10.0)],
        [Posture(q, weight=1e-3)],
    ],
    subject_to=[JointLimits()],
)
controller = wbc.Controller(robot, stack, level=wbc.VelocityLevel(), hierarchy=wbc.Strict(), dt=dt)
apart, off = 0.0, 0.0
for tick in range(2000):
    command = controller.tick(dt * tick, q, v)
    assert command.status.ok
    q, v = command.q, command.v
    errors = controller.plan.errors()
    apart = max(apart, np.linalg.norm(errors["RelativeFrame[right_gripper in left_gripper]"][:3]))
    off = max(off, np.linalg.norm(errors["Position[left_gripper]"]))
print(f"the hands move {1e6 * apart:.1f} µm against each other, the box is at most {1e3 * off:.2f} mm off its path")
assert apart < 1e-4 and off < 2e-3
