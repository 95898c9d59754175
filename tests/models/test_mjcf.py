"""A robot from MJCF is the robot that MuJoCo makes of the same file: inertia, bias, frames, limits, base."""

from __future__ import annotations

import warnings
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wbc
from tasks import mimic_joints
from tests.models.builders import at, quietly
from tests.models.mjcf_oracle import compare, corners
from wbc.errors import ModelError, PathRefused
from wbc.models.feet import Guessed
from wbc.models.geometry import Cylinder, Mesh, Sphere
from wbc.sim.mujoco_ import MujocoPlant

mujoco = pytest.importorskip("mujoco", reason="the extra `sim`")
pytestmark = pytest.mark.physics

#: Defaults, degrees, Euler angles, anchors, two joints on a body, masses from shapes, rotors, a slide, sites, a table.
BODY = """
<mujoco model="crawler">
  <compiler angle="degree" autolimits="true"/>
  <default>
    <joint armature="0.02" damping="0.3"/>
    <default class="strong"><motor ctrlrange="-10 10" gear="3"/></default>
  </default>
  <option gravity="0 0 -9.81" timestep="0.002"/>
  <worldbody>
    <light pos="0 0 3"/>
    <geom name="ground" type="plane" size="1 1 1"/>
    <body name="table" pos="1 1 0"><geom type="box" size=".1 .1 .1"/></body>
    <body name="trunk" pos="0.1 0.2 0.5" euler="10 20 30">
      {base}
      <geom type="box" size="0.2 0.1 0.05" mass="4" euler="0 30 10"/>
      <body name="thigh" pos="0.2 0 -0.1" euler="0 90 0">
        <joint name="hip_yaw" axis="0 0 1" range="-40 60"/>
        <joint name="hip_pitch" axis="0 1 0.2" pos="0.01 0.02 0.03" range="-90 90" frictionloss="0.4"/>
        <geom type="capsule" fromto="0 0 0 0 0.1 -0.3" size="0.03" density="800"/>
        <body name="shank" pos="0 0.1 -0.3" quat="0.9 0.1 0.2 0.3">
          <joint name="knee" axis="1 0 0" ref="25"/>
          <inertial pos="0.01 0 -0.1" mass="0.7" fullinertia="0.01 0.012 0.008 0.001 0.002 -0.001"/>
          <geom type="cylinder" size="0.02 0.1" contype="0" conaffinity="0"/>
          <site name="toe" pos="0 0.02 -0.25" euler="5 0 90"/>
        </body>
      </body>
      <body name="rail" pos="-0.2 0 0">
        <joint name="slider" type="slide" axis="1 1 0" pos="0.05 0 0" range="-0.2 0.3" ref="0.12"/>
        <geom type="sphere" size="0.05" pos="0 0 0.1"/>
        <body name="tool" pos="0 0 0.2"><geom size=".02"/></body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="a" joint="hip_yaw" class="strong"/>
    <motor name="b" joint="hip_pitch" class="strong" forcerange="-7 7"/>
    <position name="c" joint="slider" kp="50"/>
  </actuator>
  <equality><joint joint1="knee" joint2="hip_pitch" polycoef="0.1 -2 0 0 0"/></equality>
  <keyframe><key name="home"/></keyframe>
</mujoco>
"""

FREE, FIXED = BODY.format(base="<freejoint/>"), BODY.format(base="")


def written(folder: Path, files: str | dict[str, str]) -> Path:
    """The first of some files, or robot.xml with a text."""
    files = {"robot.xml": files} if isinstance(files, str) else files
    for name, text in files.items():
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(text)
    return folder / next(iter(files))


def simple(*, body: str = "", joint: str = 'type="hinge"', more: str = "", beside: str = "") -> str:
    """A link on a hinge, with something in it, beside it in the world, and beside the world."""
    link = f'<body name="link"><joint name="hinge" {joint}/><geom size=".1"/>{body}</body>'
    return f"<mujoco><worldbody>{beside}{link}</worldbody>{more}</mujoco>"


@pytest.fixture(scope="module", params=[FREE, FIXED], ids=["free", "fixed"])
def both(request, tmp_path_factory):
    """The robot, and MuJoCo's own reading of the same file."""
    physics = mujoco.MjModel.from_xml_string(request.param)
    return quietly(written(tmp_path_factory.mktemp("mjcf"), request.param)), physics


@settings(max_examples=20)
@given(seed=st.integers(0, 2**31))
def test_inertia_bias_and_frames_are_those_of_mujoco(both, seed):
    robot, physics = both
    assert {"trunk", "thigh", "shank", "rail", "tool", "toe"} <= set(robot.frame_names)
    compare(robot, physics, seed)


@pytest.mark.parametrize(("name", "base"), [("arm", "fixed"), ("quadruped", "floating"), ("humanoid", "floating")])
def test_our_robots_written_as_mjcf_are_the_same_robots(tmp_path, name, base):
    robot = wbc.load(name)
    compiler = '<mujoco><compiler fusestatic="false" discardvisual="false"/></mujoco></robot>'
    spec = mujoco.MjSpec.from_string(robot.urdf.text(continuous="revolute").replace("</robot>", compiler))
    if base == "floating":
        spec.worldbody.first_body().add_freejoint()
    physics = spec.compile()
    path = written(tmp_path, spec.to_xml())
    again = wbc.load(path, feet=[])
    assert (again.base, set(again.joint_names)) == (base, set(robot.joint_names))
    order = [again.joint_names.index(joint) for joint in robot.joint_names]
    np.testing.assert_allclose(again.limits.q_min[order], robot.limits.q_min, rtol=1e-5)
    np.testing.assert_allclose(again.limits.tau_max[order], robot.limits.tau_max, rtol=1e-5)
    np.testing.assert_allclose(again.mass, robot.mass, rtol=1e-5)
    for seed in range(5):
        compare(again, mujoco.MjModel.from_xml_path(str(path)), seed)
    assert physics.nv == again.nv


def test_limits_come_from_joints_and_actuators(both):
    robot = both[0]
    joint = {name: i for i, name in enumerate(robot.joint_names)}
    limits = robot.limits
    assert robot.joint_units[joint["slider"]] == "m"
    np.testing.assert_allclose(np.degrees(limits.q_min[joint["hip_yaw"]]), -40.0)
    np.testing.assert_allclose(limits.q_max[joint["slider"]], 0.3)
    assert limits.q_max[joint["knee"]] == np.inf
    assert np.isinf(limits.v_max).all()
    torques = {name: limits.tau_max[i] for name, i in joint.items()}
    assert torques == {"hip_yaw": 30.0, "hip_pitch": 21.0, "slider": np.inf, "knee": 0.0}
    assert (robot.armature == 0.02).all()


def test_a_free_joint_is_a_floating_base_that_starts_where_the_file_says(both):
    robot, physics = both
    assert robot.base == ("floating" if physics.nq > physics.nv else "fixed")
    state = robot.state()
    np.testing.assert_allclose(state.frame("trunk").position, [0.1, 0.2, 0.5], atol=1e-15)


def test_equal_joints_are_gears(both):
    (gear,) = mimic_joints(both[0])
    assert (gear.joint, gear.ratios) == ("knee", {"hip_pitch": -2.0})
    assert gear.offset == pytest.approx(0.1 + np.radians(25.0)), "MuJoCo counts from where the file draws the joint"


def test_a_robot_starts_where_its_file_draws_it(both):
    robot, physics = both
    drawn = dict(zip(robot.joint_names, robot.q0[robot.nq - robot.nj :], strict=True))
    assert drawn == {name: physics.qpos0[physics.jnt(name).qposadr[0]] for name in robot.joint_names}
    assert drawn["knee"] == pytest.approx(np.radians(25.0)) and drawn["slider"] == 0.12


def test_a_capsule_is_a_cylinder_with_two_balls_and_what_does_not_collide_is_only_seen(both):
    shapes = [type(shape.shape) for shape in both[0].collisions if shape.link == "thigh"]
    assert sorted(shapes, key=str) == sorted([Cylinder, Sphere, Sphere], key=str)
    assert {shape.link for shape in both[0].visuals} - {shape.link for shape in both[0].collisions} == {"shank"}


def test_physics_is_built_from_it_with_its_rotors(tmp_path):
    arm = simple(joint='axis="0 1 0" pos="0 0 0.1" armature="0.5" actuatorfrcrange="-9 9"', body='<site name="s"/>')
    plant = MujocoPlant(wbc.load(written(tmp_path, arm)))
    assert max(plant.agreement.values()) < 1e-11
    assert plant.physics.dof_armature[0] == 0.5


def test_a_mesh_lies_where_the_file_has_it_whatever_the_compiler_does_to_it(tmp_path):
    (tmp_path / "shapes").mkdir()
    points, faces = [(0, 0, 0), (1, 0, 0), (0, 2, 0), (0, 0, 3)], ["1 3 2", "1 2 4", "1 4 3", "2 3 4"]
    lines = ["v {} {} {}".format(*point) for point in points] + [f"f {face}" for face in faces]
    (tmp_path / "shapes" / "wedge.obj").write_text("\n".join(lines))
    text = simple(
        body='<geom type="mesh" mesh="wedge" pos="1 2 3" euler="10 20 30"/>',
        more='<compiler meshdir="shapes"/><asset><mesh file="wedge.obj" scale="0.1 0.1 0.1"/></asset>',
    )
    path = written(tmp_path, text)
    (mesh,) = [shape for shape in wbc.load(path).visuals if isinstance(shape.shape, Mesh)]
    ours = np.array(points) * mesh.shape.scale @ mesh.origin.rotation.T + mesh.origin.xyz
    np.testing.assert_allclose(sorted(ours.tolist()), corners(mujoco.MjModel.from_xml_path(str(path))), atol=1e-6)


#: A scene includes a robot, which includes what stands beside it; a mesh is looked for from the scene.
SCENE = {
    "scene.xml": '<mujoco model="scene"><include file="parts/robot.xml"/><worldbody><light/></worldbody></mujoco>',
    "parts/robot.xml": '<mujoco><include file="defaults.xml"/><worldbody><body name="link"><joint name="hinge"/>'
    '<geom size=".1"/><include file="parts/arm.xml"/></body></worldbody></mujoco>',
    "parts/defaults.xml": '<mujocoinclude><default><joint armature="0.3"/></default></mujocoinclude>',
    "parts/arm.xml": '<any><body name="arm" pos="1 0 0"><joint name="elbow" axis="0 1 0"/><geom size=".2"/></body>'
    "</any>",
}

REFUSED: dict[str, tuple[str | dict[str, str], str]] = {
    "a number that is none": (simple(joint='armature="nan"'), "armature of <joint> 'hinge' is 'nan'"),
    "an end without end": (simple(body='<body pos="0 -inf 0"/>'), "pos of <body> is '0 -inf 0'"),
    "a rotor of less than nothing": (simple(joint='armature="-1"'), "joint 'hinge' has an armature of -1"),
    "a mass of less than nothing": (
        simple(body='<body name="b"><inertial pos="0 0 0" mass="-1" diaginertia="1 1 1"/></body>'),
        "the mass of <inertial> is '-1'",
    ),
    "a ball joint": (simple(joint='type="ball"'), "joint 'hinge' is a ball"),
    "a rotor of a cord": (
        simple(more='<tendon><fixed armature="0.1"><joint joint="hinge" coef="1"/></fixed></tendon>'),
        "tendon '' has an armature",
    ),
    "a rotor of what flies": (
        '<mujoco><worldbody><body name="b"><joint type="free" armature="1"/><geom size="1"/><body><joint/>'
        '<geom size="1"/></body></body></worldbody></mujoco>',
        "the free joint of body 'b' has an armature",
    ),
    "gravity compensation": (simple(body='<body name="b" gravcomp="1"/>'), "body 'b' has gravcomp"),
    "an ellipsoid": (simple(body='<geom type="ellipsoid" size=".1 .2 .3"/>'), "type ellipsoid, which is not supported"),
    "a file that is not there": (simple(more='<include file="more.xml"/>'), "<include> 'more.xml' does not exist"),
    "a file without a name": (simple(more="<include/>"), "an <include> has a file and nothing inside"),
    "itself": (simple(more='<include file="robot.xml"/>'), "<include> 'robot.xml' is there twice"),
    "a plugin": (simple(more='<extension><plugin plugin="x"/></extension>'), "is not supported"),
    "a copy a million times": (simple(body='<replicate count="1000000"><site/></replicate>'), "<replicate> is not"),
    "a section nobody knows": (simple(more="<wings/>"), "<wings> is not supported"),
    "what MuJoCo refuses": (simple(body='<body pos="0 0"/>'), "pos"),
    "no masses": ("<mujoco><worldbody><body><joint/></body></worldbody></mujoco>", "mass"),
    "a mesh made of numbers": (simple(more='<asset><mesh name="m" vertex="0 0 0"/></asset>'), "<mesh> 'm' has no file"),
    "a lost mesh that weighs": (
        simple(body='<body name="b"><geom type="mesh" mesh="m"/></body>', more='<asset><mesh file="m.stl"/></asset>'),
        "<body> 'b' has no <inertial>, and its mesh 'm' does not exist",
    ),
    "two robots": (
        '<mujoco><worldbody><body name="a"><freejoint/><geom size="1"/></body>'
        '<body name="b"><freejoint/><geom size="1"/></body></worldbody></mujoco>',
        "bodies 'a', 'b' stand in the world side by side",
    ),
    "a part with nothing in it": (SCENE | {"parts/defaults.xml": "<x/>"}, "<include> 'defaults.xml' holds nothing"),
    "a part that is there already": (
        SCENE | {"parts/defaults.xml": '<x><include file="arm.xml"/></x>'}, "<include> 'parts/arm.xml' is there twice",
    ),
    "a part with a document type": (SCENE | {"parts/arm.xml": "<!DOCTYPE x><x/>"}, "document type"),
    "a part that is nested": (
        SCENE | {"parts/arm.xml": "<x>" + "<body>" * 48 + "</body>" * 48 + "</x>"}, "nested more than 50 deep",
    ),
}  # fmt: skip


@pytest.mark.parametrize("text", REFUSED, ids=str)
def test_what_is_not_supported_is_refused_by_name(tmp_path, text):
    content, message = REFUSED[text]
    path = written(tmp_path, content)
    with pytest.raises(ModelError, match=rf"{path.name}: ") as refusal:
        wbc.load(path)
    assert message in str(refusal.value)


ELSEWHERE = [
    f'<asset><mesh name="m" file="{file}"/></asset>' for file in ("../a.stl", "/etc/passwd", "http://host/a.stl")
]
ELSEWHERE += [f'<include file="{file}"/>' for file in ("../a.xml", "/etc/passwd", "a/../../a.xml", "http://host/a.xml")]


@pytest.mark.parametrize("file", ELSEWHERE)
def test_a_mesh_or_a_part_that_is_elsewhere_is_refused(tmp_path, file):
    (tmp_path / "a.xml").write_text("<x><option/></x>")
    with pytest.raises(PathRefused):
        wbc.load(written(tmp_path, {"home/robot.xml": simple(more=file)}))


CUBE = '<body name="cube" pos="1 0 1"><freejoint/><geom size=".1"/></body>'
ARMS = "".join(
    f'<body name="{side}" pos="0 {y} 0"><joint name="{side}_hinge"/><geom size="1" pos="3 0 0"/></body>'
    for side, y in (("left", 0.5), ("right", -0.5))
)


@pytest.mark.parametrize(
    ("files", "joints", "said"),
    [
        (SCENE, {"hinge", "elbow"}, None),
        (simple(beside=CUBE), {"hinge"}, "body 'cube', which is free and has no joints, is left out"),
        (f"<mujoco><worldbody>{ARMS}</worldbody></mujoco>", {"left_hinge", "right_hinge"}, None),
    ],
    ids=["in several files", "beside a thing that lies about", "of two arms bolted to one world"],
)
def test_a_robot_is_what_mujoco_makes_of_its_files(tmp_path, files, joints, said):
    path = written(tmp_path, files)
    with nullcontext() if said is None else pytest.warns(UserWarning, match=said):
        robot = wbc.load(path)
    assert (robot.base, set(robot.joint_names)) == ("fixed", joints)
    assert robot.armature.tolist() == ([0.3, 0.3] if files is SCENE else [0.0] * len(joints))
    compare(robot, mujoco.MjModel.from_xml_path(str(path)), seed=0)


def test_a_site_named_as_its_body_is_another_frame(tmp_path):
    robot = wbc.load(written(tmp_path, simple(body='<site name="link" pos="0 0 1"/>')))
    assert {"link", "link_site"} <= set(robot.frame_names)


#: Names that this library gives to links and joints of the robot below, and some of its own.
OURS = ("a", "b", "j", "k", "b_mount", "b_mount_", "c_mount", "b_site", "b_site_site", "s_site", "b/j", "b/k", "c_site")
OURS += ("loop_1", "tie_1", "tie_1_mount", "world_mount", "world_site", "joint_1", "joint_2", "body_3")


@given(
    joints=st.lists(st.sampled_from(OURS), min_size=2, max_size=2, unique=True), child=st.sampled_from(["", *OURS[2:]]),
    sites=st.lists(st.sampled_from(OURS), min_size=2, max_size=2, unique=True),
    free=st.sampled_from(["", "<freejoint/>"]), base=st.sampled_from(["fixed", "floating"]),
)  # fmt: skip
@settings(deadline=None)
def test_names_of_a_file_are_kept_whatever_we_call_the_parts_that_we_add(joints, child, sites, free, base):
    """Of joints, of bodies and of sites, but of those that are called as a body: all are where MuJoCo has them."""
    text = f"""<mujoco><worldbody><body name="a" pos="0 .2 0">{free}<geom size=".1"/><body name="b" pos="0 0 1">
      <joint name="{joints[0]}" axis="0 1 0"/><joint name="{joints[1]}" pos="0 0 .1"/><geom size=".1" pos="0 0 .2"/>
      <site name="{sites[0]}" pos="0 .4 .3"/><site name="{sites[1]}" pos=".7 0 .3"/>
      <body pos="0 0 .5"{child and f' name="{child}"'}><joint axis="0 1 0"/><geom size=".05"/></body></body></body>
      </worldbody><equality><connect name="tie" body1="a" body2="b" anchor="0 0 .4"/></equality></mujoco>"""
    physics = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(physics)
    mujoco.mj_forward(physics, data)
    robot = wbc.load(physics, base=base if free else "fixed")
    assert robot.joint_names[:2] == tuple(joints) and robot.nj == 3
    state = robot.state()
    bodies = {"a", "b", child} - {""}
    for name in bodies:
        np.testing.assert_allclose(state.frame(name).position, data.body(name).xpos, atol=1e-9)
    for name in {*sites} - bodies:
        np.testing.assert_allclose(state.frame(name).position, data.site(name).xpos, atol=1e-9)


@pytest.mark.parametrize("in_memory", [False, True])
def test_what_is_left_out_is_said(tmp_path, in_memory):
    more = (
        '<tendon><fixed name="cord"><joint joint="hinge" coef="1"/></fixed></tendon>'
        '<actuator><motor name="winch" tendon="cord"/></actuator>'
    )
    path = written(tmp_path, simple(joint='stiffness="0 3" damping="1 2"', more=more))
    with pytest.warns(UserWarning) as said:
        wbc.load(mujoco.MjModel.from_xml_path(str(path)) if in_memory else path)
    text = str(said[0].message)
    assert "the spring (stiffness) of joint 'hinge' is left out" in text
    assert "the damping of joint 'hinge' beyond its linear part is left out" in text
    assert "tendon 'cord' is left out" in text
    assert "actuator 'winch' is left out: it moves no joint" in text


@pytest.mark.parametrize(
    ("words", "color"),
    [("", (0.5, 0.5, 0.5, 1)), ('rgba="0 1 0 1"', (0, 1, 0, 1)), ('material="red"', (1, 0, 0, 1)),
     ('material="red" rgba="0 1 0 1"', (0, 1, 0, 1))],
)  # fmt: skip
def test_a_colour_of_a_shape_is_before_that_of_its_material(tmp_path, words, color):
    path = written(
        tmp_path,
        '<mujoco><asset><material name="red" rgba="1 0 0 1"/></asset><worldbody><body name="a"><joint/>'
        f'<geom size=".1" {words}/></body></worldbody></mujoco>',
    )
    (shape,) = wbc.load(path).visuals
    assert shape.color == color


@pytest.mark.parametrize("base", ["fixed", "planar", "floating"])
def test_a_free_robot_on_another_base_is_where_it_is_drawn(tmp_path, base):
    turn = "" if base == "planar" else 'quat="1 2 3 4"'
    path = written(
        tmp_path,
        f'<mujoco><worldbody><body name="trunk" pos="0 0 0.4" {turn}><freejoint/><geom size=".1"/><body name="arm" pos='
        '".1 .2 .3"><joint name="hinge" axis="1 0 0"/><geom size=".1" pos="0 0 1"/></body></body></worldbody></mujoco>',
    )
    robot = wbc.load(path, base=base, feet=[])
    drawn = mujoco.MjData(model := mujoco.MjModel.from_xml_path(str(path)))
    mujoco.mj_forward(model, drawn)
    state = robot.state()
    for body in ("trunk", "arm"):
        np.testing.assert_allclose(state.frame(body).position, drawn.body(body).xpos, atol=1e-12)
        np.testing.assert_allclose(state.frame(body).rotation.ravel(), drawn.body(body).xmat, atol=1e-12)
    plant = MujocoPlant(robot)
    assert max(plant.agreement.values()) < 1e-9
    np.testing.assert_allclose(plant.data.body("arm").xpos, drawn.body("arm").xpos, atol=1e-12)


@pytest.mark.parametrize("in_memory", [False, True])
@pytest.mark.parametrize(
    ("option", "said"),
    [
        ('<option gravity="0 -9.81 0" timestep="0.01"/>', "gravity (0.0, -9.81, 0.0) m/s² is left out"),
        ('<option><flag gravity="disable" contact="disable"/></option>', "gravity (0.0, 0.0, 0.0) m/s² is left out"),
        ('<option gravity="0 0 -9.80665"/>', ""),
        ("", ""),
    ],
)
def test_another_gravity_is_left_out_and_said(tmp_path, option, said, in_memory):
    path = written(tmp_path, simple(more=option))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        robot = wbc.load(mujoco.MjModel.from_xml_path(str(path)) if in_memory else path)
    assert robot.gravity.tolist() == [0.0, 0.0, -9.81]
    sentences = " ".join(str(one.message) for one in told)
    assert said in sentences and ("gravity" in sentences) == bool(said)


#: Two legs of a box each under a trunk, drawn stretched; a keyframe bends them.
LEGS = """
<mujoco model="walker"><compiler angle="radian"/>
  <worldbody><body name="trunk" pos="0 0 1" quat="0.7071067811865476 0 0 0.7071067811865476"><freejoint/>
    <geom type="box" size=".1 .2 .1"/>{left}{right}</body></worldbody>
  <keyframe><key time="3"/><key name="low" qpos="3 4 0.9 1 0 0 0 0.5 -1 0.5 0.5 -1 0.5"/></keyframe>
</mujoco>
"""
LEG = """
  <body name="{0}_thigh" pos="0 {1} -.1"><joint name="{0}_hip" axis="0 1 0" range="-2 2"/>
    <geom type="box" size=".02 .02 .2" pos="0 0 -.2"/>
    <body name="{0}_shank" pos="0 0 -.4"><joint name="{0}_knee" axis="0 1 0" range="-2 2"/>
      <geom type="box" size=".02 .02 .2" pos="0 0 -.2"/>
      <body name="{0}_foot" pos="0 0 -.4"><joint name="{0}_ankle" axis="0 1 0" range="-2 2"/>
        <geom type="box" size=".1 .04 .01" pos=".03 0 -.05"/></body></body></body>
"""


def test_keyframes_are_named_configurations_and_the_feet_are_found(tmp_path):
    path = written(tmp_path, LEGS.format(left=LEG.format("left", 0.1), right=LEG.format("right", -0.1)))
    with pytest.warns(Guessed, match=r"foot 'left_foot', 'right_foot': a sole of 20\.0 x 8\.0 cm"):
        robot = wbc.load(path)
    assert robot.q0[:7] == pytest.approx([0, 0, 0.96, 0, 0, 0.5**0.5, 0.5**0.5]), "drawn at 1 m, its soles at 4 cm"
    low = robot.configurations["low"]
    assert low[:2].tolist() == [3.0, 4.0] and low[3:7].tolist() == [0, 0, 0, 1]
    assert dict(zip(robot.joint_names, low[7:], strict=True)) == {
        f"{side}_{joint}": x for side in ("left", "right") for joint, x in (("hip", 0.5), ("knee", -1), ("ankle", 0.5))
    }
    assert at(robot, low).frame("right_foot").position[2] == pytest.approx(0.06)
    assert wbc.load(path, q0="low", feet=[]).q0[2] == pytest.approx(0.9), "without feet, where the keyframe has it"
