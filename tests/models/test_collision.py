"""Distances between shapes: what is near is found, whatever was measured before, and its derivatives are right."""

from __future__ import annotations

from functools import cache
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.models.builders import at, joint, link, origin, saved, shape
from wbc.errors import InvalidInput
from wbc.models import load
from wbc.models.collision import Distances, Obstacle
from wbc.models.geometry import Box, Cylinder, Mesh, Sphere
from wbc.testing import moments, robots
from wbc.testing.differences import along
from wbc.types import Mat, Vec

ARM, QUADRUPED, HUMANOID = robots()
SEEDS = st.integers(0, 2**32 - 1)


def placed(x: float, y: float, z: float) -> Any:
    return pin.SE3(np.eye(3), np.array([x, y, z]))


def ball(pose: Any, radius: float = 0.05, name: str = "ball") -> Obstacle:
    return Obstacle(name, Sphere(radius), pose)


BALL = ball(placed(0.4, 0.1, 0.4), 0.1)


def beside(*things: Obstacle, count: int = 1, reach: float = 2.0) -> Distances:
    """Of the arm from these things, and not from itself."""
    return Distances(ARM, obstacles=list(things), self_collision=False, count=count, reach=reach)


def read(distances: Distances, t: float = 0.0) -> Distances:
    """Read where the arm is in its reference, at rest."""
    distances.read(at(ARM, t=t))
    return distances


def reading(distances: Distances, state: Any) -> dict[int, float]:
    distances.read(state)
    return {int(pair): float(d) for pair, d in zip(distances.which, distances.distance, strict=True) if pair >= 0}


@cache
def measuring(robot: Any) -> tuple[Distances, Any]:
    """Distances that remember what examples before have read, and memory to measure everything anew."""
    distances = Distances(robot, obstacles=[BALL], count=10_000, reach=0.15)
    return distances, distances._geometry.createData()


@given(SEEDS, st.sampled_from([ARM, QUADRUPED]))
def test_all_that_is_within_reach_is_found_wherever_the_robot_was_before(seed: int, robot: Any):
    rng = np.random.default_rng(seed)
    distances, brute = measuring(robot)
    state = robot.state(drifts=False)
    q = robot.random_configuration(rng)
    for _ in range(6):
        # Small steps and jumps: shapes come a long way or none since they were measured last.
        step = rng.normal(size=robot.nv) * rng.choice([1e-3, 0.02, 1.0])
        q = robot.integrate(q, step)
        state.update(0.0, q, state.v)
        found = reading(distances, state)
        pin.computeDistances(robot.pinocchio, robot.pinocchio.createData(), distances._geometry, brute, q)
        expected = {k: result.min_distance for k, result in enumerate(brute.distanceResults)}
        nearest: dict[tuple[str, str], float] = {}
        for k, d in expected.items():
            nearest[distances.pairs[k]] = min(d, nearest.get(distances.pairs[k], np.inf))
        near = {k for k, d in expected.items() if d < min(0.15, nearest[distances.pairs[k]] + 0.075) - 2e-5}
        assert all(d < min(0.15, nearest[distances.pairs[k]] + 0.075) + 1e-3 for k, d in found.items())
        assert near <= set(found)
        for k, d in found.items():
            # The oracle has its own tolerance; depths inside one another are to no more than a millimetre.
            assert d == pytest.approx(expected[k], abs=2e-5 if d > 0 else 1e-3)


def test_what_was_read_before_changes_no_bit_of_any_pair():
    states = [ARM.state() for _ in range(4)]
    for state, moment in zip(states, moments(ARM, count=4, seed=3), strict=True):
        state.update(*moment)

    def bits(distances: Distances, state: Any) -> dict[int, tuple[bytes, ...]]:
        distances.read(state)
        arrays = distances.distance, distances.jacobian, distances.drift, distances.rate
        rows = enumerate(distances.which.tolist())
        return {pair: tuple(array[row].tobytes() for array in arrays) for row, pair in rows if pair >= 0}

    fresh = [bits(Distances(ARM, obstacles=[BALL], count=1000, reach=0.3), state) for state in states]
    again = Distances(ARM, obstacles=[BALL], count=1000, reach=0.3)
    for i in (0, 3, 1, 2, 2, 0, 3):
        assert fresh[i] == bits(again, states[i])
    again.reset()
    assert (again._near.measured == -np.inf).all()
    assert fresh[1] == bits(again, states[1])


NO_POSES = [
    (np.eye(3), [0.4, np.nan, 0.4], "has the number nan; each must be finite"),
    (np.eye(3), [np.inf, 0.1, 0.4], "has the number inf; each must be finite"),
    (np.eye(3), [-1e200, 0.1, 0.4], r"has the number -1e\+200; each must be finite and below 1e\+08"),
    (np.full((3, 3), np.nan), [0.4, 0.1, 0.4], "has the number nan"),
    (np.diag([1.0, 1.0, np.nan]), [0.4, 0.1, 0.4], "has the number nan"),
    (5.0 * np.eye(3), [0.4, 0.1, 0.4], "is not a rotation: R Rᵀ differs from the identity by 24"),
    (np.zeros((3, 3)), [0.4, 0.1, 0.4], "is not a rotation: R Rᵀ differs from the identity by 1;"),
    (np.diag([1.0, 1.0, -1.0]), [0.4, 0.1, 0.4], "is not a rotation: its determinant is -1"),
]


@pytest.mark.parametrize(("rotation", "place", "said"), [*NO_POSES, (None, None, "is None; a pose is a pinocchio.SE3")])
def test_what_is_no_pose_is_refused_by_name_and_forgotten(rotation: Any, place: Any, said: str):
    good = placed(0.4, 0.1, 0.4)
    now, bad = [good], None if rotation is None else pin.SE3(rotation, np.array(place))
    few, everything = (
        Distances(ARM, obstacles=[Obstacle("ball", Sphere(0.1), lambda _: now[0])], count=1000) for _ in range(2)
    )
    state = ARM.state()
    for now[0] in (good, bad, good, placed(0.5, 0.1, 0.4), bad, placed(0.5, 0.2, 0.4)):
        if now[0] is bad:
            with pytest.raises(InvalidInput, match=f"the pose of obstacle 'ball' at 0 s {said}"):
                few.read(state)
            continue
        everything.reset()
        assert reading(few, state) == reading(everything, state)
    with pytest.raises(InvalidInput, match=said):
        Obstacle("ball", Sphere(0.1), bad)


@pytest.mark.parametrize("far", [1e5, 1e6, 9e7])
@pytest.mark.parametrize("shape", [Sphere(0.05), Box((0.1, 0.2, 0.3)), Cylinder(0.05, 0.3)], ids=repr)
def test_what_is_very_far_is_not_near_and_is_found_when_it_is_back(shape: Any, far: float):
    places = placed(0.4, 0.1, 0.4), placed(0.6, far, -0.7 * far)
    now = [places[0]]
    distances = Distances(ARM, obstacles=[Obstacle("it", shape, lambda _: now[0])], self_collision=False)
    state = ARM.state()
    here = reading(distances, state)
    for now[0] in 3 * [places[1], places[0]]:
        assert reading(distances, state) == (here if now[0] is places[0] else {})


def test_a_pair_keeps_its_row_while_others_come_and_go():
    rng = np.random.default_rng(0)
    distances, state = Distances(ARM, obstacles=[BALL], reach=0.3, count=1000), ARM.state(drifts=False)
    row_of: dict[int, int] = {}
    q = np.array(ARM.q0)
    for _ in range(200):
        q = ARM.integrate(q, 0.05 * rng.normal(size=ARM.nv))
        state.update(0.0, q, state.v)
        distances.read(state)
        for row, pair in enumerate(distances.which.tolist()):
            assert pair < 0 or row_of.setdefault(pair, row) == row
    assert len(row_of) > 5


def test_where_rows_are_few_a_pair_is_replaced_by_one_that_is_nearer_by_a_tenth_of_the_reach():
    """Two balls on either side of the flange, which moves between them: one row, taken over once each way."""
    middle = ARM.state().frame("flange").position
    moves = [0.0]

    def on(side: float) -> Any:
        return lambda t: placed(middle[0], middle[1] + side * 0.25 + moves[0], middle[2])

    balls = [ball(on(side), name=name) for name, side in (("left", 1.0), ("right", -1.0))]
    distances = Distances(ARM, obstacles=balls, pairs=[("flange", "left"), ("flange", "right")], count=1, reach=0.5)
    seen = []
    for moves[0] in (0.0, 0.02, -0.02, 0.02, 0.06, 0.02, -0.02, -0.06):
        read(distances)
        assert distances.missing >= 1
        seen.append(distances.pairs[distances.which[0]][1])
    assert seen[0] == seen[1] == seen[2] == seen[3]
    assert seen[4:] == ["right", "right", "right", "left"]


def test_what_approaches_fast_is_felt_from_where_it_can_be_stopped():
    """A ball at u: with drifts a row from margin + 2 u ahead on, without them from the reach on."""
    start = ARM.state().frame("flange").position + np.array([0.9, 0.0, 0.0])

    def thrown(t: float) -> Any:
        return placed(*(start - np.array([3.0 * t, 0.0, 0.0])))

    for drifts, first in ((True, 0.03 + 2.0 * 3.0 / 15.0), (False, 0.12)):
        settings = {"pairs": [("flange", "ball")], "reach": 0.12, "margin": 0.03, "ahead": 1.0 / 15.0}
        distances, felt = Distances(ARM, obstacles=[ball(thrown)], **settings), []
        for t in np.linspace(0.0, 0.25, 251):
            distances.read(at(ARM, t=float(t), drifts=drifts))
            felt += distances.distance[distances.which >= 0].tolist()
        assert max(felt) == pytest.approx(first, abs=0.01)


@pytest.mark.parametrize("robot", [ARM, QUADRUPED, HUMANOID], ids=lambda robot: robot.name)
def test_by_default_there_is_a_row_for_each_pair_that_is_near_in_the_reference_and_room_for_more(robot: Any):
    distances = Distances(robot, reach=0.12, margin=0.02)
    distances.read(robot.state())
    near = int((distances.which >= 0).sum())
    assert distances.missing == 0
    assert distances.count == min(64 + 2 * near, 1024, len(distances.pairs))


@given(SEEDS)
def test_two_balls_are_as_far_apart_as_geometry_says(seed: int):
    """A foot, one ball, against a ball in the world: d = |p − c| − r − r'."""
    rng = np.random.default_rng(seed)
    state = QUADRUPED.state()
    state.update(*moments(QUADRUPED, count=1, seed=seed)[0])
    shape = next(g for g in QUADRUPED.collisions if g.link == "rear_left_foot")
    centre = state.frame(shape.link).placement.act(np.array(shape.origin.xyz))
    obstacle = Obstacle("other", Sphere(0.05), pin.SE3(np.eye(3), centre + 0.2 * rng.normal(size=3)))
    distances = Distances(QUADRUPED, obstacles=[obstacle], pairs=[(shape.link, "other")], count=10, reach=10.0)
    gap = np.linalg.norm(centre - obstacle.pose.translation) - 0.05 - shape.shape.radius
    assert reading(distances, state) == {0: pytest.approx(gap, abs=1e-12)}


@pytest.mark.parametrize("robot", [ARM, HUMANOID], ids=lambda robot: robot.name)
def test_derivatives_of_self_distances_are_those_of_differences(robot: Any):
    distances, state = Distances(robot, count=40, reach=0.3, margin=0.01), robot.state()

    def value(what: str, moment: Any) -> Vec:
        state.update(*moment)
        distances.read(state)
        return getattr(distances, what).copy()

    checked = 0
    for moment in moments(robot, count=6, seed=1):
        which = value("which", moment)
        J, drift, d = (value(what, moment) for what in ("jacobian", "drift", "distance"))
        apart = (which >= 0) & (d > 5e-3)  # inside one another depths have kinks
        found = np.column_stack(
            [along(lambda m: value("distance", m), robot, moment, axis) for axis in np.eye(robot.nv)]
        )
        speed = along(lambda m, v=moment[2]: value("jacobian", m) @ v, robot, moment, moment[2])
        smooth = apart & (np.abs(found - J).max(axis=1) < 1e-4)  # at a step of 1e-5, all but those beside a kink
        assert smooth.sum() >= 0.9 * apart.sum()
        # Curved shapes have their normals to about 1e-6: differences of them over 2e-5 s to 0.1.
        assert np.median(np.abs(speed - drift)[smooth]) <= 1e-2 * (1 + np.abs(drift).max())
        checked += int(smooth.sum())
    assert checked > 20


def passing(t: float) -> Any:
    return placed(0.6 - 0.5 * t, 0.1 * t, 0.42)


def thrown_from_rest(t: float) -> Any:
    return placed(0.8 - 2.5 * min(t, 0.2) ** 2, 0.0, 0.42)


@pytest.mark.parametrize(
    ("way", "when", "least"),
    [(passing, 0.4, 0.0), (thrown_from_rest, 0.0, 4.0), (thrown_from_rest, 0.1, 4.0), (thrown_from_rest, 0.5, 0.0)],
)
def test_an_obstacle_that_moves_changes_distances_as_their_differences_say(way: Any, when: float, least: float):
    """Its acceleration too, from rest on: d̈ has at least this size."""
    distances, h = beside(ball(way)), 1e-3
    before, after, now = (float(read(distances, when + s).distance[0]) for s in (-h, h, 0.0))
    assert distances.rate[0] == pytest.approx((after - before) / (2.0 * h), abs=1e-5)
    assert distances.drift[0] == pytest.approx((before - 2.0 * now + after) / h**2, abs=1e-2)
    assert abs(distances.drift[0]) >= least


@pytest.mark.parametrize("t", [0.3, 0.3 - 5e-5, 0.3 + 5e-5])
def test_an_obstacle_that_jumps_moves_as_before_or_after(t: float):
    distances = read(beside(ball(lambda t: placed(0.9 if t < 0.3 else 0.6 + 0.1 * t, 0.0, 0.42))), t)
    assert abs(distances.rate[0]) <= 0.1
    assert abs(distances.drift[0]) < 1.0


@pytest.mark.parametrize("link", ["forearm", "flange"])
def test_through_contact_the_normal_does_not_turn(link: str):
    """A wall pushed into a link: from outside to inside the distance falls evenly, along one normal."""
    middle = ARM.state().frame(link).position

    def against(wall_at: float) -> tuple[float, Vec]:
        wall = Obstacle("wall", Box((0.2, 2.0, 2.0)), placed(wall_at + 0.1, middle[1], middle[2]))
        distances = read(Distances(ARM, obstacles=[wall], pairs=[(link, "wall")], count=1, reach=2.0))
        return float(distances.distance[0]), distances.jacobian[0].copy()

    start, normal = against(middle[0] + 0.5)
    for into in np.linspace(-0.02, 0.01, 13):
        d, J = against(middle[0] + 0.5 - start - into)
        assert d == pytest.approx(-into, abs=1e-5)
        np.testing.assert_allclose(J, normal, atol=1e-2)  # inside, normals are to 0.02 rad


def test_the_most_critical_of_many_are_those_that_will_be_nearest():
    balls = [ball(placed(0.7 + 0.05 * i, 0.0, 0.42), name=f"ball {i}") for i in range(4)]
    soon = Distances(ARM, obstacles=balls, self_collision=False, count=3, reach=0.6, ahead=0.1)
    assert reading(beside(*balls, count=3, reach=0.6), at(ARM)) == reading(soon, at(ARM))
    for seed in range(5):
        state = at(ARM, v=np.random.default_rng(seed).normal(size=ARM.nv))
        everything = beside(*balls, count=1000, reach=0.6)
        everything.read(state)
        known = everything.which >= 0
        later = (everything.distance + 0.1 * (everything.jacobian @ state.v))[known]
        expected = set(everything.which[known][np.argsort(later)[:3]].tolist())
        soon.reset()
        assert set(reading(soon, state)) == expected


@pytest.mark.parametrize(("robot", "margin"), [(ARM, 0.02), (ARM, 0.1), (QUADRUPED, 0.02), (QUADRUPED, 0.2)], ids=str)
def test_pairs_left_out_as_always_apart_never_come_near(robot: Any, margin: float):
    links = list(combinations(dict.fromkeys(shape.link for shape in robot.collisions), 2))
    everything = Distances(robot, pairs=links, margin=10.0)  # nothing is always further apart than that
    kept = set(_shape_pairs(Distances(robot, pairs=links, margin=margin)))
    far = [k for k, names in enumerate(_shape_pairs(everything)) if names not in kept]
    assert far
    rng, geometry = np.random.default_rng(0), everything._geometry
    data, kinematics = geometry.createData(), robot.pinocchio.createData()
    for _ in range(200):
        pin.updateGeometryPlacements(robot.pinocchio, kinematics, geometry, data, robot.random_configuration(rng))
        for k in far:
            pin.computeDistance(geometry, data, k)
            assert data.distanceResults[k].min_distance > margin


def _shape_pairs(distances: Distances) -> list[tuple[str, str]]:
    shapes = distances._geometry.geometryObjects
    return [(shapes[p.first].name, shapes[p.second].name) for p in distances._geometry.collisionPairs]


@pytest.mark.parametrize("kind", ["prismatic", "revolute"])
def test_a_joint_without_limits_reaches_everything_on_its_way(tmp_path: Path, kind: str):
    limit = '<limit lower="-inf" upper="inf" effort="1" velocity="1"/>'
    cart = link("cart", shape('<sphere radius="0.1"/>', origin("0 0.5 0")))
    path = saved(tmp_path, link("rail"), cart, joint("x", "rail", "cart", kind, limit, axis="0 0 1"))
    with pytest.warns(UserWarning, match="no inertia moves"):
        robot = load(path)
    posts = [ball(placed(0.0, 0.5, z), name=f"post {z}") for z in (1.0, 3.0, 50.0)]
    circle = [ball(placed(0.5 * np.sin(a), 0.5 * np.cos(a), 0.0), name=f"angle {a}") for a in (1.0, 3.0)]
    distances = Distances(robot, obstacles=posts + circle)
    on_its_way = posts if kind == "prismatic" else circle
    assert {owner for _, owner in distances.pairs} >= {one.name for one in on_its_way}


def test_a_ball_close_to_a_link_has_that_links_name():
    placement = ARM.state().frame("flange").placement
    near = Obstacle("cup", Cylinder(0.03, 0.1), pin.SE3(np.eye(3), placement.act(np.array([0.0, 0.0, 0.2]))))
    distances = read(beside(near, reach=0.3))
    assert distances.pairs[distances.which[0]] == ("flange", "cup")


def test_links_that_are_neighbours_or_overlap_in_the_reference_are_left_out_and_the_base_is_one():
    assert ("wrist_link", "flange") in Distances(ARM, margin=0.1).excluded
    assert Distances(ARM, pairs=[("base", "forearm")], margin=0.1).excluded == ()
    pairs = set(Distances(ARM, margin=0.0).pairs)
    assert ("base", "upper_arm") in pairs
    assert not {("base", "shoulder"), ("shoulder", "upper_arm"), ("hand_hub", "flange")} & pairs


def as_stl(points: Mat, path: Path) -> Mesh:
    """A mesh file of all triangles of some points."""
    corners = "".join(
        f"facet normal 0 0 1\nouter loop\n{lines}\nendloop\nendfacet\n"
        for three in combinations(points, 3)
        for lines in ["\n".join("vertex {:f} {:f} {:f}".format(*point) for point in three)]
    )
    path.write_text(f"solid s\n{corners}endsolid s\n")
    return Mesh(path)


def test_a_mesh_stands_for_its_convex_hull(tmp_path: Path):
    corners = 0.1 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (0, 2)], dtype=np.float64)
    mesh = Obstacle("mesh", as_stl(corners, tmp_path / "box.stl"), placed(0.55, 0.0, 0.6))
    box = Obstacle("box", Box((0.2, 0.2, 0.2)), placed(0.55, 0.0, 0.7))
    found = [sorted(reading(beside(one, count=50, reach=1.0), ARM.state()).values()) for one in (mesh, box)]
    np.testing.assert_allclose(found[0], found[1], atol=1e-7)


def test_a_mesh_without_volume_is_refused_by_its_name(tmp_path: Path):
    flat = as_stl(np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]), tmp_path / "flat.stl")
    with pytest.raises(InvalidInput, match=r"flat.stl has no convex hull"):
        Distances(ARM, obstacles=[Obstacle("thing", flat, placed(0.5, 0, 0))])
