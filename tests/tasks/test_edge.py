"""An edge in contact: its cone is what forces at its two ends can be, and it turns about itself freely."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pinocchio
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

import wbc
from tasks import CenterOfMass, Edge, Orientation, Posture, TorqueLimits, feet
from wbc.errors import InvalidInput
from wbc.stack.contact import Anchor
from wbc.testing.strategies import states
from wbc.types import Mat

HUMANOID = wbc.load("humanoid")
LENGTHS, FRICTIONS = st.floats(0.01, 1.0), st.floats(0.05, 2.0)
MODELS, SIDES = st.sampled_from(["outer", "inner"]), st.sampled_from([4, 8])


def toe(**more: Any) -> Edge:
    return Edge("left_sole", **{"half_length": 0.05, "origin": (0.11, 0.0, 0.0), "friction": 0.5} | more)


def end_wrenches(L: float, friction: float, model: str, sides: int) -> Mat:
    """Edges of the friction pyramids at both ends, as (fx, fy, fz, my, mz) about the middle (5, 2 sides): forces on the
    circular cone, or where the sides of an outer pyramid, which touch it, meet."""
    reach = friction if model == "inner" else friction * np.hypot(1.0, np.tan(np.pi / sides))
    found = []
    for end, k in product((-1, 1), range(sides)):
        angle = 2.0 * np.pi * (k + 0.5) / sides
        force = np.array([reach * np.cos(angle), reach * np.sin(angle), 1.0])
        found.append(np.concatenate([force, np.cross([end * L, 0.0, 0.0], force)[1:]]))
    return np.array(found).T


@given(LENGTHS, FRICTIONS, MODELS, SIDES)
def test_what_forces_at_the_ends_add_up_to_is_in_the_cone(L: float, friction: float, model: str, sides: int) -> None:
    edge = toe(half_length=L, friction=friction, friction_model=model, sides=sides)
    assert (edge.cone() @ end_wrenches(L, friction, model, sides)).max() <= 1e-12 * np.abs(edge.cone()).max()


@given(LENGTHS, FRICTIONS, MODELS, SIDES, st.integers(0, 2**32 - 1))
def test_rays_leave_the_cone_where_forces_at_the_ends_can_no_longer_follow(
    L: float, mu: float, model: str, sides: int, seed: int
) -> None:
    K = toe(half_length=L, friction=mu, friction_model=model, sides=sides).cone()
    V = end_wrenches(L, mu, model, sides)
    inside = V.mean(axis=1)
    ray = np.random.default_rng(seed).normal(size=5) * [mu, mu, 1.0, L, mu * L]
    slope = K @ ray
    exits = min((-(K @ inside) / slope)[slope > 1e-12], default=np.inf)
    followed = linprog(
        np.r_[-1.0, np.zeros(2 * sides)],
        A_eq=np.column_stack([-ray, V]),
        b_eq=inside,
        bounds=[(0, 1e3)] + [(0, None)] * (2 * sides),
    )
    np.testing.assert_allclose(followed.x[0], min(exits, 1e3), rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("sides", [4, 8])
def test_every_row_of_the_cone_is_needed(sides: int) -> None:
    K = toe(sides=sides).cone()
    for row in range(len(K)):
        rest = np.delete(K, row, axis=0)
        beyond = linprog(
            -K[row], A_ub=rest, b_ub=np.zeros(len(rest)), A_eq=np.eye(5)[2][None], b_eq=[1.0], bounds=(-9, 9)
        )
        assert -beyond.fun > 1e-9, toe(sides=sides).cone_labels()[row]


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


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: toe(half_length=0.0), "half_length is 0"),
        (lambda: toe(direction=(0, 0, 0)), "direction is .*points nowhere"),
        (lambda: toe(normal=[np.nan, 0, 1]), r"normal\[0\] is nan"),
    ],
)
def test_an_edge_that_makes_no_sense_is_refused(make: Any, said: str) -> None:
    with pytest.raises(InvalidInput, match=said):
        make()
