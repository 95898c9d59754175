"""Where links and arrows are."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wbc.models import load
from wbc.models.collision import Obstacle
from wbc.models.geometry import Box, Sphere
from wbc.report.motion import PUSH_LENGTH, WEIGHT_LENGTH, hull, motion, quaternions
from wbc.report.shapes import obstacle_parts

from .conftest import FRICTION, HALF_SIZE, standing_run


@given(st.integers(0, 1000))
def test_a_quaternion_turns_vectors_as_its_rotation_does(seed: int):
    rng = np.random.default_rng(seed)
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    rotation, x = q * np.sign(np.linalg.det(q)), rng.normal(size=3)
    w, *u = quaternions(rotation[None])[0]
    assert w >= 0
    assert np.allclose(x + 2 * np.cross(u, np.cross(u, x) + w * x), rotation @ x)


def test_force_arrows_end_at_the_soles_and_together_carry_the_weight():
    run, robot = standing_run(), load("humanoid")
    moving = motion(run, robot, np.array([0, 60]), ["torso"])
    tail, tip = moving.forces[:, :, 0], moving.forces[:, :, 1]
    assert np.allclose(tip[..., 2], 0.0, atol=1e-3)
    assert (tip - tail)[..., 2].sum(axis=1) == pytest.approx(1.01 * WEIGHT_LENGTH)


def test_the_push_arrow_points_where_the_push_goes_and_only_while_it_lasts():
    run, robot = standing_run(), load("humanoid")
    moving = motion(run, robot, np.array([0, 40]), ["torso"])
    assert np.allclose(moving.pushes[0, 0], moving.pushes[0, 1])
    assert np.allclose(moving.pushes[1, 1] - moving.pushes[1, 0], [0.0, PUSH_LENGTH, 0.0])
    assert np.allclose(moving.pushes[1, 1], moving.links["torso"][0][1])


def test_links_follow_the_recorded_configuration():
    run, robot = standing_run(), load("humanoid")
    moving = motion(run, robot, np.arange(0, 120, 10), robot.frame_names[:1])
    position, _ = moving.links[robot.frame_names[0]]
    assert np.ptp(position[:, 1]) == pytest.approx(np.ptp(run["q"][::10, 1]), abs=1e-9)


def test_obstacles_are_drawn_where_they_stand_and_as_they_move():
    def rising(t: float) -> Any:
        return pinocchio.SE3(np.eye(3), np.array([0.0, 0.0, t]))

    still = Obstacle("wall", Box((0.1, 0.2, 0.3)), pinocchio.SE3(np.eye(3), np.array([1.0, 0.0, 0.0])))
    obstacles = [still, Obstacle("ball", Sphere(0.1), rising)]
    parts = obstacle_parts(obstacles)
    assert [part.link for part in parts] == ["wall", "ball"]
    assert np.ptp(parts[0].vertices, axis=0) == pytest.approx([0.1, 0.2, 0.3])
    run, rows = standing_run(), np.array([0, 50])
    moving = motion(run, load("humanoid"), rows, ["torso", "wall", "ball"], obstacles)
    assert moving.links["wall"][0].tolist() == [[1.0, 0.0, 0.0]] * 2
    assert moving.links["ball"][0][:, 2] == pytest.approx(run["t"][rows])


def test_a_friction_cone_has_the_slope_of_the_friction_and_is_closed_while_the_contact_is_free():
    run, robot = standing_run(), load("humanoid")
    run.columns["plant.f.Sole[left_sole]"][60:] = 0.0
    moving = motion(run, robot, np.array([0, 80]), ["torso"])
    cone = moving.cones["Sole[left_sole]"]
    along = cone[0] - moving.forces[0, 0, 1]
    rim = along[np.linalg.norm(along, axis=1) > 0]
    assert np.hypot(rim[:, 0], rim[:, 1]) == pytest.approx(-FRICTION * rim[:, 2])
    assert np.ptp(cone[1], axis=0) == pytest.approx(0.0)


def test_the_support_is_the_hull_of_the_contacts_that_carry():
    run, robot = standing_run(), load("humanoid")
    run.columns["plant.f.Sole[left_sole]"][60:] = 0.0
    both, one = motion(run, robot, np.array([0, 80]), ["torso"]).support
    assert both is not None and one is not None
    assert np.ptp(one[:, 1]) == pytest.approx(2 * HALF_SIZE[1], abs=1e-3) and np.ptp(both[:, 1]) > 4 * HALF_SIZE[1]


def test_corners_on_a_line_have_no_hull():
    line = np.column_stack([np.arange(4.0), np.arange(4.0)])
    assert hull(line) is None and hull(line[:2]) is None
