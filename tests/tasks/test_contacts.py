"""Cones are exactly what surfaces can give, and contact rows hold the surface, not the frame."""

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
from tasks import CenterOfMass, Edge, Orientation, Point, Posture, Sole, TorqueLimits, feet
from wbc.models.model import RobotState
from wbc.sim.simulate import simulate
from wbc.stack.contact import Anchor
from wbc.testing import robots
from wbc.testing.strategies import states
from wbc.types import Mat

ARM, QUADRUPED, HUMANOID = robots()
SIZES = st.floats(0.01, 1.0)
MODELS, SIDES = st.sampled_from(["outer", "inner"]), st.sampled_from([4, 8])
MOVED = np.array([0.1, 0.2, 0.3])


def sole(half_size: Any = (0.10, 0.065), friction: float = 0.3, **more: Any) -> Sole:
    return Sole("left_sole", half_size=half_size, friction=friction, **more)


def every_kind(**more: Any) -> list[Any]:
    edge = Edge("left_sole", half_length=0.05, friction=0.5, **more)
    return [Point("foot", friction=0.5, **more), sole(friction=0.5, **more), edge]


CONES = {f"{type(contact).__name__} of {n} sides": contact for n in (4, 8) for contact in every_kind(sides=n)}
each_cone = pytest.mark.parametrize("contact", CONES.values(), ids=CONES)


def pyramid_edges(friction: float, model: str = "inner", sides: int = 4) -> Mat:
    """Forces (sides, 3) along the edges: on the circular cone, or an outer pyramid's, whose sides touch it."""
    angles = 2.0 * np.pi * (np.arange(sides) + 0.5) / sides
    reach = friction if model == "inner" else friction * np.hypot(1.0, np.tan(np.pi / sides))
    return np.column_stack([reach * np.cos(angles), reach * np.sin(angles), np.ones(sides)])


def surfaces(X: float, Y: float, **more: Any) -> list[tuple[Any, Any]]:
    """A sole, an edge and a point, each with the points (x, y) at which forces can be."""
    corners, edge = list(product((-X, X), (-Y, Y))), Edge("left_sole", half_length=X, **more)
    return [(sole((X, Y), **more), corners), (edge, [(-X, 0.0), (X, 0.0)]), (Point("foot", **more), [(0.0, 0.0)])]


def wrenches(contact: Any, points: Any, friction: float, model: str, sides: int) -> Mat:
    """The edges of the friction pyramids at the points, as wrenches about the centre (dim, points times sides)."""
    edges = [
        np.concatenate([force, np.cross([x, y, 0.0], force)])
        for x, y in points for force in pyramid_edges(friction, model, sides)
    ]  # fmt: skip
    return np.array(edges).T[list(contact.wrench_axes)]


@given(SIZES, SIZES, st.floats(0.05, 2.0), MODELS, SIDES)
def test_what_forces_at_the_corners_add_up_to_is_in_the_cone(X: float, Y: float, mu: float, model: str, sides: int):
    for contact, points in surfaces(X, Y, friction=mu, friction_model=model, sides=sides):
        K = contact.cone()
        assert (K @ wrenches(contact, points, mu, model, sides)).max() <= 1e-12 * max(1.0, np.abs(K).max())


@given(SIZES, SIZES, st.floats(0.05, 2.0), MODELS, SIDES, st.integers(0, 2**32 - 1))
def test_rays_leave_the_cone_where_forces_at_the_corners_can_no_longer_follow(
    X: float, Y: float, mu: float, model: str, sides: int, seed: int
):
    away = np.random.default_rng(seed).normal(size=6) * [mu, mu, 1.0, Y, X, mu * (X + Y)]
    for contact, points in surfaces(X, Y, friction=mu, friction_model=model, sides=sides):
        K, V, ray = contact.cone(), wrenches(contact, points, mu, model, sides), away[list(contact.wrench_axes)]
        inside, slope = V.mean(axis=1), K @ ray
        exits = min((-(K @ inside) / slope)[slope > 1e-12], default=np.inf)
        count = V.shape[1]
        followed = linprog(
            np.r_[-1.0, np.zeros(count)], A_eq=np.column_stack([-ray, V]), b_eq=inside,
            bounds=[(0, 1e3)] + [(0, None)] * count,
        )  # fmt: skip
        np.testing.assert_allclose(followed.x[0], min(exits, 1e3), rtol=1e-6, atol=1e-6)


@each_cone
def test_every_row_of_a_cone_is_needed(contact: Any):
    K = contact.cone()
    for row in range(len(K)):
        rest = np.delete(K, row, axis=0)
        normal = np.eye(contact.dim)[2][None]
        beyond = linprog(-K[row], A_ub=rest, b_ub=np.zeros(len(rest)), A_eq=normal, b_eq=[1.0], bounds=(-1e3, 1e3))
        assert -beyond.fun > 1e-9, contact.cone_labels()[row]


@given(st.floats(0.05, 2.0), st.floats(0.0, 2 * np.pi), SIDES)
def test_the_inner_pyramid_is_inside_the_circular_cone_and_the_outer_one_around_it(mu: float, angle: float, sides: int):
    force = np.array([mu * np.cos(angle), mu * np.sin(angle), 1.0])
    inner, outer = (Point("foot", friction=mu, friction_model=model, sides=sides) for model in ("inner", "outer"))
    assert (outer.cone() @ force).max() <= 1e-12
    assert (inner.cone() @ (force * [1.0001, 1.0001, 1.0])).max() > 0.0
    # The inner one touches the cone in its edges, the outer one in the middle of its sides.
    np.testing.assert_allclose((inner.cone() @ pyramid_edges(mu, "inner", sides).T).max(axis=0), 0.0, atol=1e-12)
    middle = np.column_stack([mu * inner.pyramid.normals, np.ones(sides)])
    np.testing.assert_allclose((outer.cone() @ middle.T).max(axis=0), 0.0, atol=1e-12)


@pytest.mark.parametrize("sides", [4, 8])
def test_what_a_foot_may_do_by_default_never_slips(sides: int):
    for contact in every_kind(sides=sides):
        K = contact.cone()
        for angle in np.linspace(0.0, 2 * np.pi, 33):
            pull = np.zeros(contact.dim)
            pull[:2] = np.cos(angle), np.sin(angle)
            push = np.eye(contact.dim)[2]
            most = linprog(-pull, A_ub=K, b_ub=np.zeros(len(K)), A_eq=push[None], b_eq=[1.0], bounds=(-9, 9))
            assert 0.5 * np.cos(np.pi / sides) - 1e-9 <= -most.fun <= 0.5 + 1e-9


@given(states(QUADRUPED), st.floats(0.0, 0.1))
def test_a_ball_that_rolls_does_not_slip_and_is_held_at_its_height(state: RobotState, radius: float):
    foot = Point("front_left_foot", friction=0.5, radius=radius)
    frame = state.frame("front_left_foot")
    twist = frame.jacobian() @ state.v
    rolling = twist[:3] + np.cross(twist[3:], [0.0, 0.0, -radius])
    out = foot.rows(state, Anchor(np.eye(3), foot.anchor(state).position + MOVED))
    np.testing.assert_allclose(out.J @ state.v, rolling, atol=1e-12)
    np.testing.assert_allclose(out.e, MOVED if radius == 0.0 else [0.0, 0.0, 0.3], atol=1e-12)


@given(states(QUADRUPED), st.floats(-1.0, 1.0))
def test_a_point_on_a_slope_is_the_point_in_turned_axes(state: RobotState, angle: float):
    axes = pinocchio.exp3(np.array([0.0, angle, 0.0]))
    level, slope = (Point("front_left_foot", friction=0.5, axes=axes_) for axes_ in (None, axes))
    anchor = Anchor(axes, level.anchor(state).position + MOVED)
    first, second = level.rows(state, anchor), slope.rows(state, anchor)
    for array in ("J", "drift", "e"):
        np.testing.assert_allclose(getattr(second, array), axes.T @ getattr(first, array), atol=1e-12)


@given(states(HUMANOID))
def test_a_sole_moved_in_its_frame_is_held_at_its_own_centre(state: RobotState):
    origin = np.array([0.02, -0.01, -0.03])
    plain, moved = sole(), sole(origin=origin)
    np.testing.assert_allclose(moved.anchor(state).position, state.frame("left_sole").placement.act(origin), atol=1e-12)
    there = pinocchio.SE3(state.frame("left_sole").placement) * pinocchio.exp6(np.array([0.01, 0.02, 0.0, 0.1, 0, 0]))
    centre = there * pinocchio.SE3(np.eye(3), origin)
    errors = (
        plain.rows(state, Anchor(there.rotation, there.translation)).e,
        moved.rows(state, Anchor(centre.rotation, centre.translation)).e,
    )
    shift = pinocchio.SE3(np.eye(3), origin)
    np.testing.assert_allclose(errors[1], shift.actionInverse @ errors[0], atol=1e-9)


def test_an_anchor_keeps_its_own_memory():
    rotation, position = np.eye(3), np.zeros(3)
    anchor = Anchor(rotation, position)
    position[0] = rotation[0, 0] = 5.0
    assert not anchor.position.any() and anchor.rotation[0, 0] == 1.0


@pytest.mark.parametrize("kp", [1.0, 100.0, 400.0])
def test_by_default_a_foot_comes_back_as_fast_as_it_can_without_passing_its_place(kp: float):
    """ë + kd ė + kp e = 0 is critically damped: s² + kd s + kp has one double root."""
    for contact in every_kind(kp=kp):
        roots = np.roots([1.0, contact.kd, contact.kp])
        np.testing.assert_allclose(roots, -np.sqrt(kp), rtol=1e-6)
    assert sole(kp=kp, kd=3.0).kd == 3.0


@given(states(HUMANOID), st.floats(-0.5, 0.5))
def test_turning_about_the_edge_is_no_motion_of_the_contact(state: RobotState, speed: float) -> None:
    edge = Edge("left_sole", half_length=0.05, origin=(0.11, 0.0, 0.0), friction=0.5)
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

    state = HUMANOID.state()
    left = next(contact for contact in feet(HUMANOID, kp=0.0, kd=20.0) if contact.frame == "left_sole")
    right = Edge("right_sole", half_length=0.05, friction=0.48, kp=0.0, kd=20.0)
    upright = [Orientation(name, target=np.array(state.frame(name).rotation)) for name in ("torso", "right_sole")]
    tasks = [CenterOfMass(target=state.com), *upright, Posture(HUMANOID.q0, weight=1e-4)]
    stack = wbc.Stack(tasks, contacts=[left, right], subject_to=[TorqueLimits()])
    plant = MujocoPlant(HUMANOID, contacts=stack.contacts)
    plant.reset(plant.settled(HUMANOID.q0))
    run = simulate(wbc.Controller(HUMANOID, stack, level=wbc.InverseDynamics()), plant, duration=0.5)
    weight = 9.81 * HUMANOID.mass
    assert run.meta["ended"] == "complete" and run.meta["contacts"][right.name]["kind"] == "edge"
    assert np.linalg.norm(run["error.CenterOfMass"], axis=1).max() < 5e-3
    true, wanted = run[f"plant.f.{right.name}"][-1], run[f"f.{right.name}"][-1]
    assert true[2] > 0.2 * weight and abs(true[3]) < 1e-3 * weight
    np.testing.assert_allclose(true[list(right.wrench_axes)], wanted, atol=0.02 * weight)
