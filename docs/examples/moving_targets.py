"""Targets jump at random every 20 ms: speed, acceleration and jerk of every joint stay within their limits."""

import numpy as np

import wbc
from wbc.tasks import JointLimits, Position, Posture

robot, dt, rng = wbc.load("arm"), 1e-3, np.random.default_rng(1)
A_MAX, J_MAX = 20.0, 2000.0  # rad/s², rad/s³
tool = Position("tool", target=robot.state().frame("tool").position, kp=400.0)
stack = wbc.Stack([tool, Posture(robot.q0, weight=1e-3)], subject_to=[JointLimits(a_max=A_MAX, j_max=J_MAX)])
controller = wbc.Controller(robot, stack, level=wbc.AccelerationLevel(), dt=dt)
center, limits = tool.target, robot.limits
q, v, a = robot.q0, np.zeros(robot.nv), np.zeros(robot.nv)
excess = -np.inf
for tick in range(5000):
    if tick % 20 == 0:
        tool.target = center + rng.uniform(-0.3, 0.3, size=3)
    command = controller.tick(dt * tick, q, v)
    assert command.status.ok
    jerk, (q, v, a) = (command.a - a) / dt, (command.q, command.v, command.a)
    beyond = (
        q - limits.q_max,
        limits.q_min - q,
        np.abs(v) - limits.v_max,
        np.abs(a) - A_MAX,
        (np.abs(jerk) - J_MAX) * dt,
    )
    excess = max(excess, *(x.max() for x in beyond))
print(f"5000 ticks solved; a limit exceeded by at most {max(excess, 0.0):.1e}")
assert excess < 1e-6
