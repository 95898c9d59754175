"""A stack and its controller are written to a file and read back, as another process would; there is no YAML."""

import pickle
from pathlib import Path

import numpy as np

import wbc
from wbc.tasks import JointLimits, Position, Posture

robot = wbc.load("arm")
stack = wbc.Stack(
    [[Position("tool", target=[0.4, 0.2, 0.5], kp=50.0)], [Posture(robot.q0, weight={"wrist_.*": 0.1})]],
    subject_to=[JointLimits(v_max=1.0)],
)
controller = wbc.Controller(robot, stack, level=wbc.AccelerationLevel(), hierarchy=wbc.Strict())
command = controller.tick(0.0, robot.q0, np.zeros(robot.nv))
Path("kept.pickle").write_bytes(pickle.dumps({"stack": stack, "controller": controller, "command": command}))

kept = pickle.loads(Path("kept.pickle").read_bytes())  # only from a place that you trust
print(kept["stack"])
again = kept["controller"].tick(0.0, robot.q0, np.zeros(robot.nv))
assert np.array_equal(kept["command"].a, command.a) and np.allclose(again.a, command.a)
