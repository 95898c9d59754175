"""A limit of your own on the forces of a contact: at most a part of the friction that is available."""

import numpy as np

import wbc
from wbc.tasks import CenterOfMass, JointLimits, Posture, feet


class LessFriction(wbc.LinearConstraint):
    """|fx| and |fy| of a contact are at most ``share`` of friction times fz: A f <= 0 for its wrench f (6,)."""

    on, dim, units = "force", 4, "N"  # "velocity", "acceleration" and "torque" are the others

    def __init__(self, sole, *, share, name=None):
        self.contact = self.subject = sole.frame
        super().__init__(name=name)
        self.slope = share * sole.friction

    def fill(self, state, out):
        for row, (axis, sign) in enumerate([(0, 1.0), (0, -1.0), (1, 1.0), (1, -1.0)]):
            out.A[row] = 0.0
            out.A[row, [axis, 2]] = sign, -self.slope
        out.lo[:], out.hi[:] = -np.inf, 0.0


robot = wbc.load("humanoid")
soles = feet(robot)
stack = wbc.Stack(
    [CenterOfMass(target=robot.state().com + [0, 0.1, 0]), Posture(robot.q0, weight=1e-3)],  # a step aside
    contacts=soles,
    subject_to=[JointLimits(), *(LessFriction(sole, share=0.2) for sole in soles)],
)
controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics())
command = controller.tick(0.0, robot.q0, np.zeros(robot.nv))
for sole in soles:
    fx, fy, fz = command.f[sole.frame][:3]
    print(f"{sole.frame}: {max(abs(fx), abs(fy)) / (sole.friction * fz):.3f} of its friction in use")
    assert max(abs(fx), abs(fy)) <= 0.2 * sole.friction * fz + 1e-6
assert command.status.ok and "LessFriction" in controller.explain()
