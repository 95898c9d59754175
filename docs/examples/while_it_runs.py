"""What may change between ticks: targets, gains, weights, which tasks count, limits of contacts, the stack itself."""

import numpy as np

import wbc
from wbc.tasks import CenterOfMass, Damping, JointLimits, Position, Posture, feet

robot, dt = wbc.load("humanoid"), 2e-3
state = robot.state()
balance, posture = CenterOfMass(target=state.com), Posture(robot.q0, weight=1e-2)
hand = Position("left_hand", target=state.frame("left_hand").position, kp=50.0)
left, right = feet(robot)
around = {"contacts": [left, right], "subject_to": [JointLimits()]}
stack = wbc.Stack([balance, hand, posture], **around)
controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), dt=dt)
changes = {
    100: lambda: setattr(hand, "target", hand.target + [0.1, 0.05, 0.1]),
    400: lambda: setattr(hand, "kp", 200.0),
    600: lambda: setattr(posture, "weight", 1e-3),
    800: lambda: setattr(hand, "active", False),
    1000: lambda: setattr(balance, "target", balance.target + [0.0, 0.03, 0.0]),
    1200: lambda: setattr(right, "f_max", 200.0),  # N
    1300: lambda: controller.replace(wbc.Stack([balance, hand, posture, Damping(weight=0.1)], **around)),
}
q, v = robot.q0, np.zeros(robot.nv)
for tick in range(1500):
    changes.get(tick, lambda: None)()
    command = controller.tick(dt * tick, q, v)
    assert command.status.ok, controller.why
    q, v = command.q, command.v
    if tick in (99, 799, 1199, 1499):
        off = [1e3 * np.linalg.norm(controller.plan.errors()[task.name]) for task in (balance, hand)]
        print(f"tick {tick}: balance {off[0]:.1f} mm, hand {off[1]:.1f} mm, foot {command.f['right_sole'][2]:.0f} N")
assert command.f["right_sole"][2] <= 200.0 + 1e-6 and off[0] < 5.0
try:
    hand.kpp = 3.0
except AttributeError as error:
    print(error)
