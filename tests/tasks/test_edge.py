"""An edge in contact turns about itself freely. Its cone: tests/tasks/test_contacts.py."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tasks import CenterOfMass, Edge, Orientation, Posture, TorqueLimits, feet
from wbc.stack.contact import Anchor
from wbc.testing.strategies import states

HUMANOID = wbc.load("humanoid")


def toe(**more: Any) -> Edge:
    return Edge("left_sole", **{"half_length": 0.05, "origin": (0.11, 0.0, 0.0), "friction": 0.5} | more)


@given(states(HUMANOID), st.floats(-0.5, 0.5))
def test_turning_about_the_edge_is_no_motion_of_the_contact(state: Any, speed: float) -> None:
    edge = toe()
    anchor = edge.anchor(state)
    frame = state.frame("left_sole")
    # Any velocity of the robot that turns the sole about the edge and nothing else.
    about = speed * anchor.rotation[:, 0]
    twist = np.concatenate([np.cross(about, frame.position - anchor.position), about])
    v = np.linalg.pinv(frame.jacobian()) @ twist
    np.testing.assert_allclose(edge.rows(state, anchor).J @ v, 0.0, atol=1e-9)
    turned = Anchor(pinocchio.exp3(0.3 * anchor.rotation[:, 0]) @ anchor.rotation, anchor.position)
    np.testing.assert_allclose(edge.rows(state, turned).e, 0.0, atol=1e-9)


@pytest.mark.physics
def test_a_humanoid_stands_with_one_foot_on_an_edge() -> None:
    from wbc.sim.mujoco_ import MujocoPlant
    from wbc.sim.simulate import simulate

    state = HUMANOID.state()
    left = next(contact for contact in feet(HUMANOID, kp=0.0, kd=20.0) if contact.frame == "left_sole")
    right = Edge("right_sole", half_length=0.05, friction=0.48, kp=0.0, kd=20.0)
    stack = wbc.Stack(
        [
            CenterOfMass(target=state.com),
            Orientation("torso", target=np.array(state.frame("torso").rotation)),
            Orientation("right_sole", target=np.array(state.frame("right_sole").rotation)),
            Posture(HUMANOID.q0, weight=1e-4),
        ],
        contacts=[left, right],
        subject_to=[TorqueLimits()],
    )
    plant = MujocoPlant(HUMANOID, contacts=stack.contacts)
    plant.reset(plant.settled(HUMANOID.q0))
    run = simulate(wbc.Controller(HUMANOID, stack, level=wbc.InverseDynamics()), plant, duration=0.5)
    weight = 9.81 * HUMANOID.mass
    assert run.meta["ended"] == "complete" and run.meta["contacts"][right.name]["kind"] == "edge"
    assert np.linalg.norm(run["error.CenterOfMass"], axis=1).max() < 5e-3
    true, wanted = run[f"plant.f.{right.name}"][-1], run[f"f.{right.name}"][-1]
    assert true[2] > 0.2 * weight and abs(true[3]) < 1e-3 * weight
    np.testing.assert_allclose(true[list(right.wrench_axes)], wanted, atol=0.02 * weight)
