"""An arm draws a circle with its tool, at a quarter of the joint speeds that its description allows."""

import numpy as np

import wbc
from wbc.tasks import JointLimits, Orientation, Position, Posture, Sinusoid

robot, dt = wbc.load("ur5"), 2e-3
ready = robot.configuration(
    {"shoulder_lift_joint": -1.2, "elbow_joint": 1.6, "wrist_1_joint": -2.0, "wrist_2_joint": -1.57}
)
state = robot.state()
state.update(0.0, ready, np.zeros(robot.nv))
tool = state.frame("tool0")
center, rotation = tool.position.copy(), tool.rotation.copy()
circle = Sinusoid(center, amplitude=[0.0, 0.1, 0.1], frequency=0.4, phase=[0.0, np.pi / 2, 0.0])

stack = wbc.Stack(
    [Position("tool0", target=circle, rate=10.0), Orientation("tool0", target=rotation), Posture(ready, weight=1e-4)],
    subject_to=[JointLimits(v_max=0.25 * robot.limits.v_max)],
)
controller = wbc.Controller(robot, stack, level=wbc.VelocityLevel(), dt=dt)
q, v, errors, used = ready, np.zeros(robot.nv), [], 0.0
for tick in range(3000):
    command = controller.tick(dt * tick, q, v)
    assert command.status.ok
    q, v = command.q, command.v
    errors.append(np.linalg.norm(controller.plan.errors()["Position[tool0]"]))
    used = max(used, (np.abs(v) / robot.limits.v_max).max())
print(f"median error {1e3 * np.median(errors):.3f} mm; at most {100 * used:.0f} % of the joint speeds in use")
assert max(errors[1000:]) < 1e-4 and used <= 0.25 + 1e-9
