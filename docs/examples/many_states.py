"""One controller decides for a thousand states at once, on several processes: for sampling, learning and checks."""

import numpy as np

import wbc
from wbc.tasks import JointLimits, Position, Posture

robot, rng = wbc.load("arm"), np.random.default_rng(1)
stack = wbc.Stack(
    [Position("tool", target=[0.4, 0.2, 0.5]), Posture(robot.q0, weight=1e-3)],
    subject_to=[JointLimits()],
)
controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics())
low, high = 0.8 * robot.limits.q_min, 0.8 * robot.limits.q_max
states = [(0.0, rng.uniform(low, high), 0.1 * rng.normal(size=robot.nv)) for _ in range(1000)]
batch = wbc.run_many(controller, states, workers=2)
print(f"{batch.certified.sum()} of {len(states)} solved; {batch.ticks_per_second:.0f} ticks a second")
print(f"largest torque {np.abs(batch.tau).max():.1f} N m, shapes {batch.tau.shape}, {batch.a.shape}")
assert batch.certified.all() and (np.abs(batch.tau) <= robot.limits.tau_max + 1e-6).all()
