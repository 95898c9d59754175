"""A robot from a file stands: its feet are found and measured, its base is above the ground, its pose has a name."""

from __future__ import annotations

import warnings
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tasks import CenterOfMass, Orientation, Position, Posture, TorqueLimits, feet
from tests.models.builders import at, inertial, joint, link, origin, quietly, saved, shape
from tests.robots.examples import needs_examples
from wbc.errors import InvalidInput, ModelError, NotSupported, UnknownConfiguration, UnknownFrame, UnknownJoint
from wbc.models import load
from wbc.models.catalogue import OWN_ROBOTS, example_robots
from wbc.models.feet import Foot, Guessed
from wbc.models.geometry import Box, Geometry, Mesh, Origin
from wbc.models.pinocchio_ import PinocchioModel
from wbc.models.soles import Measured, largest_rectangle

OWN = Path(wbc.__file__).parent / "models" / "robots"
#: Files of robots with legs, and how many of these.
TWO = [
    "alexander_description/urdf/alexander_v1.lowerBodyOnly.urdf", "bolt_description/robots/bolt.urdf",
    "g1_description/urdf/g1_29dof_rev_1_0.urdf", "icub_description/robots/icub_reduced.urdf",
    "romeo_description/urdf/romeo_small.urdf", "talos_data/robots/talos_full_v2.urdf",
    "talos_data/robots/talos_reduced.urdf",
]  # fmt: skip
FOUR = [
    "a1_description/urdf/a1.urdf", "anymal_b_simple_description/robots/anymal-kinova.urdf",
    "anymal_b_simple_description/robots/anymal.urdf", "anymal_c_simple_description/urdf/anymal.urdf",
    "b1_description/urdf/b1.urdf", "go1_description/urdf/go1.urdf", "go2_description/urdf/go2.urdf",
    "hyq_description/robots/hyq_no_sensors.urdf", "solo_description/robots/solo.urdf",
    "solo_description/robots/solo12.urdf",
]  # fmt: skip
LEGGED = dict.fromkeys(TWO, 2) | dict.fromkeys(FOUR, 4)


def example(file: str, **settings: Any) -> PinocchioModel:
    return quietly(example_robots() / "robots" / file, base="floating", **settings)


def corners(robot: PinocchioModel, q: np.ndarray) -> dict[str, np.ndarray]:
    """The lowest points of each foot in the world."""
    state = at(robot, q)
    return {
        name: np.array([state.frame(name).placement.act(np.array(p)) - [0, 0, below] for p, below in foot.lowest()])
        for name, foot in robot.feet.items()
    }


@needs_examples
@pytest.mark.parametrize("file", LEGGED)
def test_a_robot_with_legs_stands_on_the_ground_with_its_mass_above_its_feet(file: str):
    robot = example(file)
    assert len(robot.feet) == LEGGED[file] == len(feet(robot))
    points = corners(robot, robot.q0)
    lowest = np.array([foot[:, 2].min() for foot in points.values()])
    state = robot.state()
    assert lowest.min() == pytest.approx(0.0, abs=1e-9)
    assert lowest.max() < 0.03 * state.com[2]
    for name, foot in robot.feet.items():
        assert foot.kind == "point" or state.frame(name).rotation[2, 2] > np.cos(np.radians(2.0))
    on_ground = np.concatenate(list(points.values()))[:, :2]
    low, high = on_ground.min(axis=0) - 0.02, on_ground.max(axis=0) + 0.02
    assert ((low < state.com[:2]) & (state.com[:2] < high)).all()
    for q in robot.configurations.values():
        assert min(foot[:, 2].min() for foot in corners(robot, q).values()) == pytest.approx(0.0, abs=1e-9)


@needs_examples
@pytest.mark.physics
@pytest.mark.parametrize("file", [file for file in LEGGED if "bolt" not in file])  # which nobody can hold on two points
def test_it_stands_in_physics_without_a_number_from_the_user(file: str):
    pytest.importorskip("mujoco", reason="the extra `sim`")
    from wbc.sim.mujoco_ import MujocoPlant
    from wbc.sim.simulate import simulate

    robot = example(file)
    state, base = robot.state(), robot.frame_names[0]
    com, upright = state.com.copy(), np.array(state.frame(base).rotation)
    goals = [CenterOfMass(target=com, kp=100), Orientation(base, target=upright, kp=100)]
    stack = wbc.Stack([*goals, Posture(robot.q0, weight=1e-3)], contacts=feet(robot), subject_to=[TorqueLimits()])
    plant = MujocoPlant(robot, contacts=feet(robot, friction_share=1.0), dt=2e-3)
    run = simulate(wbc.Controller(robot, stack, level=wbc.InverseDynamics(), dt=2e-3), plant, duration=1.0)
    assert run.meta["ended"] == "complete" and not plant.fallen
    assert np.linalg.norm(at(robot, plant.q).com - com) < 0.02


@pytest.mark.parametrize("name", ["quadruped", "humanoid"])
def test_what_is_found_is_what_the_catalogue_knows(name: str):
    known, found = load(name), quietly(OWN / f"{name}.urdf", base="floating")
    assert set(found.feet) == set(known.feet)
    for frame, foot in known.feet.items():
        assert found.feet[frame].kind == foot.kind and found.feet[frame].radius == pytest.approx(foot.radius, abs=1e-9)
        for mine, theirs in zip(found.feet[frame].lowest(), foot.lowest(), strict=True):
            np.testing.assert_allclose(mine[0], theirs[0], atol=1e-9)


def test_what_was_guessed_is_said_once_and_what_was_given_is_not():
    path = OWN / "quadruped.urdf"
    with pytest.warns(Guessed, match=r"foot 'front_left_foot', .*: a ball of 20 mm, friction 0\.5 \(") as said:
        load(path, base="floating")
    assert len(said) == 1 and said[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        load(path, base="floating", q0={}, feet=[Foot("front_left_foot", "point", 0.6, radius=0.02)])
        assert not load(path, base="floating", feet=[]).feet
        load(path)
        load("quadruped")


def test_feet_are_given_by_frame_or_whole():
    path = OWN / "humanoid.urdf"
    whole = Foot("left_sole", "sole", 0.7, half_size=(0.1, 0.04))
    robot = quietly(path, base="floating", feet=[whole, "right_sole"])
    assert robot.feet["left_sole"] == whole
    assert robot.feet["right_sole"].half_size == pytest.approx((0.11, 0.05))
    measured = quietly(path, base="floating", feet=[Foot("left_sole", "sole", 0.7)]).feet["left_sole"]
    assert measured.friction == 0.7 and measured.half_size == pytest.approx((0.11, 0.05))
    with pytest.raises(UnknownFrame, match="'left_soul'; did you mean 'left_sole'"):
        load(path, base="floating", feet=["left_soul"])
    for wrong, sentence in (
        ("left_sole", "it must be a frame or a Foot, in a list"),
        ([3], r"feet\[0\] is 3; it must be a frame or a Foot"),
    ):
        with pytest.raises(InvalidInput, match=sentence):
            load(path, feet=wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize(("frame", "leans"), [("left_sole", False), ("left_thigh", False), ("sideways", True)])
def test_a_sole_whose_frame_does_not_look_up_is_said(tmp_path: Path, frame: str, leans: bool):
    path = tmp_path / "humanoid.urdf"
    more = link("sideways") + joint("turned", "left_sole", "sideways", "fixed", origin(rpy="0 1.57 0"))
    path.write_text((OWN_ROBOTS / "humanoid.urdf").read_text().replace("</robot>", f"{more}</robot>"))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        load(path, base="floating", feet=[Foot(frame, "sole", 0.6, half_size=(0.1, 0.05))])
    assert any(f"z axis of its frame {frame!r}, which leans by 90°" in str(one.message) for one in told) == leans


@pytest.mark.parametrize("seed", range(4))
def test_the_order_of_links_in_a_file_says_nothing(tmp_path: Path, seed: int):
    """The feet are turned against the base, so that their soles get frames of their own, along the base."""
    turned = pin.rpy.rpyToMatrix(np.array([0.3, 0.2, 0.5]))
    place = origin(turned.T @ [0.03, 0.0, -0.05], pin.rpy.matrixToRpy(turned.T))
    sole = shape('<box size="0.2 0.1 0.02"/>', place)
    links, joints = [link("base", inertial())], []
    for side, y in (("left", 0.1), ("right", -0.1)):
        leg, foot, imu = f"{side}_leg", f"{side}_foot", f"{side}_foot_imu"
        links += [link(leg, inertial()), link(foot, inertial(), sole), link(imu)]
        joints += [
            joint(f"{side}_imu", foot, imu, "fixed"),
            joint(f"{side}_hip", "base", leg, inside=origin(f"0 {y} 0")),
            joint(f"{side}_ankle", leg, foot, inside=origin("0 0 -0.5", "0.3 0.2 0.5")),
        ]
    np.random.default_rng(seed).shuffle(links)
    with pytest.warns(Guessed):
        robot = load(saved(tmp_path, *links, *joints), base="floating")
    assert set(robot.feet) == {"left_foot_foot", "right_foot_foot"}
    for frame, foot in robot.feet.items():
        assert foot.half_size == pytest.approx((0.1, 0.05))
        np.testing.assert_allclose(robot.state().frame(frame).rotation, np.eye(3), atol=1e-9)


@pytest.mark.parametrize(("carrier", "count"), [("gripper_base", 0), ("palm", 0), ("ankle", 6), ("spur", 6)])
def test_fingers_of_any_name_on_a_hand_are_no_feet(carrier: str, count: int, tmp_path: Path):
    """Two limbs that hang down and part into three: of hands whatever they are called, and of legs with toes."""

    def ball(name: str, radius: float) -> str:
        return link(name, inertial(), shape(f'<sphere radius="{radius}"/>'))

    def hangs(name: str, parent: str, place: str, radius: float) -> str:
        return ball(name, radius) + joint(f"to_{name}", parent, name, inside=origin(place))

    parts = [ball("trunk", 0.1)]
    for side, y in (("left", 0.3), ("right", -0.3)):
        upper, end = f"{side}_upper", f"{side}_{carrier}"
        parts += [hangs(upper, "trunk", f"0 {y} 0", 0.03), hangs(end, upper, "0 0 -0.5", 0.03)]
        parts += [hangs(f"{side}_index_{k}", end, f"{0.05 * k} 0 -0.1", 0.02) for k in range(3)]
    assert len(quietly(saved(tmp_path, *parts), base="floating").feet) == count


def test_an_arm_that_floats_has_no_feet():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert not load(OWN / "arm.urdf", base="floating").feet
        with pytest.raises(NotSupported, match=r"arm has no feet: list its contacts, or .*feet=\[...\]\) names them$"):
            feet(load(OWN / "arm.urdf", base="floating"))
        with pytest.raises(NotSupported, match=r"quadruped has no feet: .* base='floating' has feet$"):
            feet(load(OWN / "quadruped.urdf"))


SRDF = (
    '<robot name="arm"><group_state name="home" group="all"><joint name="elbow" value="1.2"/>'
    '<joint name="of_another_robot" value="9"/></group_state>'
    '<group_state name="up" group="all"><joint name="elbow" value="0.3"/></group_state></robot>'
)


def test_named_configurations_come_from_the_srdf_beside_the_file(tmp_path: Path):
    for folder in ("urdf", "srdf"):
        (tmp_path / folder).mkdir()
    path = tmp_path / "urdf" / "arm_left.urdf"
    path.write_text((OWN / "arm.urdf").read_text())
    (tmp_path / "srdf" / "arm.srdf").write_text(SRDF)
    (tmp_path / "srdf" / "arm_right.srdf").write_text("<robot/>")
    robot = load(path)
    elbow = robot.joint("elbow")
    assert {name: q[elbow] for name, q in robot.configurations.items()} == {"home": 1.2, "up": 0.3}
    assert robot.q0[elbow] == robot.configuration({})[elbow], "what is fixed to the ground stands anyway"
    assert load(path, q0="up").q0[elbow] == 0.3
    with pytest.raises(UnknownConfiguration, match="no configuration 'upp'; did you mean 'up'"):
        load(path, q0="upp")
    (tmp_path / "srdf" / "arm.srdf").write_text("not even XML")
    assert load(path).configurations == {}
    with pytest.raises(ModelError, match=r"arm\.srdf': not well-formed XML"):
        load(path, srdf=tmp_path / "srdf" / "arm.srdf")
    (tmp_path / "srdf" / "arm.srdf").write_text(SRDF.replace("1.2", "nan"))
    with pytest.raises(ModelError, match=r"arm\.srdf': 'nan' is not a finite number"):
        load(path, srdf=str(tmp_path / "srdf" / "arm.srdf"))
    assert load(path).configurations == {}


def test_configurations_and_the_reference_may_be_given():
    path = OWN / "arm.urdf"
    robot = load(path, srdf={"bent": {"elbow": 1.0}}, q0="bent")
    elbow = robot.joint("elbow")
    assert robot.q0[elbow] == 1.0 == robot.configurations["bent"][elbow]
    assert load(path, q0={"elbow": 0.7}).q0[elbow] == 0.7
    assert load("arm", q0=robot.q0).q0.tolist() == robot.q0.tolist()
    whole = np.r_[0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 1.0, np.zeros(12)]
    assert load("quadruped", q0=whole).q0.tolist() == whole.tolist(), "all of it, the height of the base too"
    with pytest.raises(UnknownJoint, match="'elbo'; did you mean 'elbow'"):
        load(path, q0={"elbo": 0.7})
    with pytest.raises(InvalidInput, match=r"q0 must have shape \(7,\)"):
        load(path, q0=np.zeros(3))
    for wrong in (3, {"bent": 3}):
        with pytest.raises(InvalidInput, match=r"srdf is .*; it must be a path"):
            load(path, srdf=wrong)  # type: ignore[arg-type]
    with pytest.raises(UnknownJoint, match="'elbo'; did you mean 'elbow'"):
        load(path, srdf={"bent": {"elbo": 0.7}})


@needs_examples
def test_a_stance_outside_the_limits_is_not_taken():
    robot = example("simple_humanoid_description/urdf/simple_humanoid.urdf")
    q = robot.q0[-robot.nj :]
    assert "half_sitting" in robot.configurations
    assert ((robot.limits.q_min <= q) & (q <= robot.limits.q_max)).all()


@pytest.mark.parametrize("round_ends", [True, False])
def test_wheels_are_no_feet_though_shanks_that_turn_without_end_are(tmp_path: Path, round_ends: bool):
    wheel = shape('<cylinder radius="0.1" length="0.04"/>', origin(rpy="1.5707963 0 0"))
    shank = shape('<box size="0.02 0.02 0.2"/>', origin("0 0 -0.1"))
    parts = [link("body", inertial())]
    for x, y in product((-0.3, 0.3), (-0.2, 0.2)):
        end = f"end_{x}_{y}"
        parts.append(link(end, inertial(), wheel if round_ends else shank))
        parts.append(joint(f"turn_{x}_{y}", "body", end, "continuous", origin(f"{x} {y} 0")))
    assert len(quietly(saved(tmp_path, *parts), base="floating").feet) == (0 if round_ends else 4)


# ---- what a foot is
points = st.lists(st.tuples(*[st.floats(-0.2, 0.2)] * 2), min_size=3, max_size=30).map(np.array)


@given(points)
def test_the_rectangle_lies_in_the_hull(cloud: np.ndarray):
    from scipy.spatial import ConvexHull, QhullError

    (x, y), (dx, dy) = largest_rectangle(cloud)
    assert dx >= 0.0 and dy >= 0.0
    try:
        hull = ConvexHull(cloud).equations
    except QhullError:
        return
    ends = np.array([[x + i * dx, y + j * dy] for i in (-1, 1) for j in (-1, 1)])
    assert (hull[:, :2] @ ends.T + hull[:, 2:]).max() < 3e-9, "points are rounded to nanometres"


@pytest.mark.parametrize("seed", range(20))
def test_a_box_is_measured_as_it_is_wherever_the_robot_stands(seed: int):
    rng = np.random.default_rng(seed)
    arm = load("arm")
    size, at = rng.uniform(0.05, 0.3, 3), rng.uniform(-0.2, 0.2, 3)
    shape = Geometry("base", Box(tuple(size)), Origin(tuple(at)))
    robot = PinocchioModel(replace(arm.urdf, collisions=(shape,)), base="floating")
    q = robot.q0.copy()
    yaw = rng.uniform(-3, 3)
    q[:7] = [*rng.uniform(-2, 2, 3), 0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2)]
    measured = Measured(robot, q)
    measured.add("base")
    (foot,) = measured.feet
    assert foot.half_size == pytest.approx(size[:2] / 2)
    assert foot.origin == pytest.approx((at[0], at[1], at[2] - size[2] / 2))


def ball_file(path: Path, radius: float, level: int) -> Path:
    """A ball as triangles: rings of 24 points."""
    turn, tilt = np.linspace(0, 2 * np.pi, 24, endpoint=False), np.linspace(-np.pi / 2, np.pi / 2, level)
    points = [radius * np.array([np.cos(b) * np.cos(a), np.cos(b) * np.sin(a), np.sin(b)]) for b in tilt for a in turn]
    faces = [(24 * i + j, 24 * i + (j + 1) % 24, 24 * (i + 1) + j) for i in range(level - 1) for j in range(24)]
    lines = ["v {} {} {}".format(*point) for point in points] + [
        "f {} {} {}".format(*np.add(face, 1)) for face in faces
    ]
    path.write_text("\n".join(lines))
    return path


@pytest.mark.parametrize("radius", [0.015, 0.03, 0.06])
def test_a_ball_made_of_triangles_is_a_ball(tmp_path: Path, radius: float):
    urdf = load("arm").urdf
    mesh = Geometry("base", Mesh(ball_file(tmp_path / "ball.obj", radius, 41)), Origin((0.1, 0.0, -0.2)))
    robot = PinocchioModel(replace(urdf, collisions=(mesh,)), base="floating")
    measured = Measured(robot, robot.q0)
    measured.add("base")
    (foot,), (mount,) = measured.feet, measured.added
    assert foot.kind == "point" and foot.radius == pytest.approx(radius, abs=1e-4) and foot.frame == "base_foot"
    assert mount.origin.xyz == pytest.approx((0.1, 0.0, -0.2), abs=1e-4)


# ---- a base that drives
def test_a_planar_base_is_three_joints_that_drive():
    robot = load("arm", base="planar")
    assert robot.joint_names[:3] == ("base_x", "base_y", "base_yaw") and (robot.nb, robot.nq) == (0, 10)
    assert robot.joint_units[:3] == ("m", "m", "rad") and np.isinf(robot.limits.v_max[:3]).all()
    assert repr(robot).startswith("arm (10 joints, planar base")
    x, y, z = load("arm").state().frame("tool").position
    turned = at(robot, np.r_[1.0, 2.0, np.pi / 2, robot.q0[3:]])
    np.testing.assert_allclose(turned.frame("tool").position, [1.0 - y, 2.0 + x, z], atol=1e-12)


@pytest.mark.physics
def test_a_planar_base_carries_its_arm_where_that_does_not_reach():
    pytest.importorskip("mujoco", reason="the extra `sim`")
    from wbc.sim.mujoco_ import MujocoPlant
    from wbc.sim.simulate import simulate

    robot = load("arm", base="planar")
    target = robot.state().frame("tool").position + np.array([0.8, -0.5, 0.0])
    stack = wbc.Stack(
        [Position("tool", target=target, kp=25), Posture(robot.q0, weight=1e-4)], subject_to=[TorqueLimits()]
    )
    plant = MujocoPlant(robot, dt=2e-3)
    run = simulate(wbc.Controller(robot, stack, level=wbc.InverseDynamics(), dt=2e-3), plant, duration=4.0)
    assert run.meta["ended"] == "complete" and max(plant.agreement.values()) < 1e-9
    np.testing.assert_allclose(at(robot, plant.q).frame("tool").position, target, atol=5e-3)
    assert np.hypot(*plant.q[:2]) > 0.5
