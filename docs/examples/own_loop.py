"""A loop of your own, with Pinocchio's forward dynamics as the robot, and a push on the tool."""

import numpy as np
import pinocchio

import wbc
from wbc.tasks import JointLimits, Position, Posture

robot, dt = wbc.load("ur5"), 1e-3
model = robot.pinocchio  # the robot that is controlled here, to be replaced by yours
data, tool = model.createData(), model.getFrameId("tool0")
q = robot.configuration({"shoulder_lift_joint": -1.2, "elbow_joint": 1.6, "wrist_1_joint": -2.0, "wrist_2_joint": -1.6})
v, state = np.zeros(robot.nv), robot.state()
state.update(0.0, q, v)
home = state.frame("tool0").position.copy()

stack = wbc.Stack([Position("tool0", target=home, kp=900.0), Posture(q, weight=1e-2)], subject_to=[JointLimits()])
controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), dt=dt)
off = []
for tick in range(2000):
    command = controller.tick(dt * tick, q, v)  # t [s], q, v as measured
    assert command.status.ok
    push = np.array([0.0, 20.0, 0.0]) if 500 <= tick < 1000 else np.zeros(3)  # N, world axes
    pinocchio.computeJointJacobians(model, data, q)
    jacobian = pinocchio.getFrameJacobian(model, data, tool, pinocchio.LOCAL_WORLD_ALIGNED)[:3]
    a = pinocchio.aba(model, data, q, v, command.tau + jacobian.T @ push)
    v = v + dt * a
    q = pinocchio.integrate(model, q, dt * v)
    off.append(np.linalg.norm(controller.plan.errors()["Position[tool0]"]))
print(f"pushed {1e3 * max(off):.1f} mm away; a second later {1e3 * off[-1]:.3f} mm")
assert 1e-3 < max(off) < 0.1 and off[-1] < 1e-3
