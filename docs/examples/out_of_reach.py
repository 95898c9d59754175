"""A humanoid reaches for a target a metre too far, in physics: its balance is in a higher level, and it stands."""

import numpy as np

import wbc
from wbc.sim.mujoco_ import MujocoPlant
from wbc.sim.simulate import simulate
from wbc.tasks import CenterOfMass, JointLimits, Orientation, Position, Posture, feet

robot = wbc.load("humanoid")
state = robot.state()
hand = state.frame("left_hand").position.copy()
stack = wbc.Stack(
    [
        [CenterOfMass(target=state.com), Orientation("torso", target=np.eye(3), weight=0.1)],
        [Position("left_hand", target=hand + [1.0, 0.0, 0.0], kp=20.0)],
        [Posture(robot.q0, weight=1e-2)],
    ],
    contacts=feet(robot),
    subject_to=[JointLimits()],
)
controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), hierarchy=wbc.Strict())
plant = MujocoPlant(robot, contacts=stack.contacts)
plant.reset(plant.settled(robot.q0))
run = simulate(controller, plant, duration=2.0)

balance = np.linalg.norm(run["error.CenterOfMass"], axis=1)
left = np.linalg.norm(run["error.Position[left_hand]"], axis=1)[-1]
print(f"{run.meta['ended']}; centre of mass at most {1e3 * balance.max():.1f} mm off, the hand {left:.2f} m short")
assert run.meta["ended"] == "complete" and balance.max() < 5e-3 and 0.2 < left < 1.0
