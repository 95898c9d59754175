"""A robot from a model in memory is that robot: the same joints in the same order, dynamics, frames and shapes."""

from __future__ import annotations

import gc
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import wbc
from tasks import Posture, feet
from tests.models.builders import at, link, quietly, shape
from tests.models.mjcf_oracle import compare, corners
from tests.robots.examples import needs_examples
from wbc.errors import InvalidInput, ModelError, PathRefused
from wbc.models import load
from wbc.models.catalogue import example_robots
from wbc.models.geometry import Box, Cylinder, Mesh, Sphere
from wbc.models.pinocchio_ import PinocchioModel

OWN = Path(wbc.__file__).parent / "models" / "robots"
FILES = [
    "anymal_c_simple_description/urdf/anymal", "baxter_description/urdf/baxter", "g1_description/urdf/g1_29dof_rev_1_0",
    "go2_description/urdf/go2", "talos_data/robots/talos_reduced", "tiago_description/robots/tiago_no_hand",
    "ur_description/urdf/ur5_robot",
]  # fmt: skip


def assert_same(robot: PinocchioModel, model: Any, seed: int) -> None:
    """M, h and every frame at a random state that is the same for both."""
    rng = np.random.default_rng(seed)
    q, v = robot.random_configuration(rng), rng.standard_normal(robot.nv)
    theirs, data, state = robot.to_pinocchio(q), model.createData(), at(robot, q, v)
    assert theirs.shape == (model.nq,)
    np.testing.assert_allclose(robot.difference(q, robot.from_pinocchio(theirs)), 0.0, atol=1e-12)
    M = np.triu(pin.crba(model, data, theirs))
    M = M + np.triu(M, 1).T
    np.testing.assert_allclose(state.M, M, atol=1e-10 * np.abs(M).max())
    h = pin.nonLinearEffects(model, data, theirs, v)
    np.testing.assert_allclose(state.h, h, atol=1e-9 * (1 + np.abs(h).max()))
    pin.framesForwardKinematics(model, data, theirs)
    for i, frame in enumerate(model.frames):
        if frame.type in (pin.FrameType.BODY, pin.FrameType.OP_FRAME) and frame.parentJoint >= (1 if robot.nb else 0):
            np.testing.assert_allclose(state.frame(frame.name).position, data.oMf[i].translation, atol=1e-10)
            np.testing.assert_allclose(state.frame(frame.name).rotation, data.oMf[i].rotation, atol=1e-10)


@needs_examples
@pytest.mark.parametrize("base", ["fixed", "floating"])
@pytest.mark.parametrize("file", FILES)
def test_pinocchios_model_of_a_file_is_the_robot(file: str, base: str):
    path = example_robots() / "robots" / f"{file}.urdf"
    root = (pin.JointModelFreeFlyer(),) if base == "floating" else ()
    model = pin.buildModelFromUrdf(str(path), *root)
    robot, from_file = quietly(model, feet=[]), quietly(path, base=base, feet=[])
    assert robot.base == base and robot.joint_names == tuple(model.names)[-robot.nj :] == from_file.joint_names
    assert robot.joint_units == from_file.joint_units
    assert set(from_file.frame_names) <= set(robot.frame_names)
    for ours, theirs in zip(vars(robot.limits).values(), vars(from_file.limits).values(), strict=True):
        np.testing.assert_allclose(ours, theirs)
    for seed in range(3):
        assert_same(robot, model, seed)
        assert_same(from_file, model, seed)


def grown(seed: int, base: Any) -> Any:
    """A tree of up to ten joints of every kind in random order, with and without frames of its own."""
    rng = np.random.default_rng(seed)
    pin.seed(seed)
    model = pin.Model()
    first = 0
    if base is not None:
        first = model.addJoint(0, base, pin.SE3.Identity(), "root_joint")
        model.appendBodyToJoint(first, pin.Inertia.Random(), pin.SE3.Identity())
    axis = rng.standard_normal(3)
    axis /= np.linalg.norm(axis)
    kinds = [
        pin.JointModelRX(), pin.JointModelPY(), pin.JointModelRUBZ(), pin.JointModelRevoluteUnaligned(axis),
        pin.JointModelPrismaticUnaligned(axis), pin.JointModelRUBX(),
    ]  # fmt: skip
    for i, name in enumerate(rng.permutation([f"joint_{c}" for c in "abcdefghij"])):
        parent = rng.choice([j for j in model.supports[model.njoints - 1] if j >= first])  # depth first, as they must
        kind = kinds[rng.integers(len(kinds))]
        joint = model.addJoint(int(parent), kind, pin.SE3.Random(), str(name))
        model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
        if i % 2:
            model.addJointFrame(joint)
            model.addBodyFrame(f"link_{i}", joint, pin.SE3.Identity(), -1)
        if i % 3 == 0:
            model.addFrame(pin.Frame(f"tool_{i}", joint, 0, pin.SE3.Random(), pin.FrameType.OP_FRAME))
    model.armature = rng.uniform(0, 0.1, model.nv) * (np.arange(model.nv) >= (6 if base is not None else 0))
    return model


@pytest.mark.parametrize("seed", range(12))
def test_a_model_built_by_hand_is_the_robot_in_its_own_order(seed: int):
    model = grown(seed, pin.JointModelFreeFlyer() if seed % 2 else None)
    robot = quietly(model, feet=[])
    assert robot.joint_names == tuple(model.names)[-robot.nj :]
    assert_same(robot, model, seed)
    before = robot.state().M.copy()
    model.inertias[model.njoints - 1] = pin.Inertia.Random()
    np.testing.assert_array_equal(robot.state().M, before, "what is changed later changes no robot")


@pytest.mark.physics
@pytest.mark.parametrize("name", ["arm", "quadruped"])
def test_it_is_simulated_and_controlled_as_any_other(name: str):
    pytest.importorskip("mujoco", reason="the extra `sim`")
    from wbc.sim.mujoco_ import MujocoPlant

    known = load(name)
    model = pin.buildModelFromUrdf(str(OWN / f"{name}.urdf"), *((pin.JointModelFreeFlyer(),) if known.nb else ()))
    collisions = pin.buildGeomFromUrdf(model, str(OWN / f"{name}.urdf"), pin.GeometryType.COLLISION)
    robot = quietly(SimpleNamespace(model=model, collision_model=collisions, visual_model=None))
    assert {foot: f.kind for foot, f in robot.feet.items()} == {foot: f.kind for foot, f in known.feet.items()}
    plant = MujocoPlant(robot, dt=2e-3)
    assert max(plant.agreement.values()) < 1e-9
    stack = wbc.Stack([Posture(robot.q0)], contacts=feet(robot) if robot.feet else [])
    controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), dt=2e-3)
    assert controller.tick(0.0, robot.q0, np.zeros(robot.nv)).status.ok


def test_shapes_come_along():
    path = str(OWN / "humanoid.urdf")
    model = pin.buildModelFromUrdf(path, pin.JointModelFreeFlyer())
    solid, seen = (
        pin.buildGeomFromUrdf(model, path, kind) for kind in (pin.GeometryType.COLLISION, pin.GeometryType.VISUAL)
    )
    wrapper = SimpleNamespace(model=model, collision_model=solid, visual_model=seen)
    robot, known = quietly(wrapper), load("humanoid")
    for ours, theirs in ((robot.collisions, known.collisions), (robot.visuals, known.visuals)):
        assert sorted(type(g.shape).__name__ for g in ours) == sorted(type(g.shape).__name__ for g in theirs)
    assert robot.feet["left_sole"].half_size == pytest.approx((0.11, 0.05))
    capsule = pin.GeometryModel()
    item = pin.GeometryObject("c", 2, model.getFrameId("torso"), pin.SE3.Identity(), pin.coal.Capsule(0.1, 0.4))
    capsule.addGeometryObject(item)
    wrapper.collision_model = capsule
    assert [type(g.shape) for g in quietly(wrapper, feet=[]).collisions] == [Cylinder, Sphere, Sphere]


def test_reference_configurations_are_named_ones():
    model = pin.buildModelFromUrdf(str(OWN / "arm.urdf"))
    model.referenceConfigurations["bent"] = 0.1 * np.arange(7.0)
    assert quietly(model).configurations["bent"].tolist() == (0.1 * np.arange(7.0)).tolist()
    assert quietly(model, q0="bent").q0[3] == pytest.approx(0.3)


@pytest.mark.parametrize("own", ["fixed", "floating", "planar"])
@pytest.mark.parametrize("base", [None, "fixed", "floating", "planar"])
def test_the_base_of_a_model_can_be_another(base: str | None, own: str):
    """It is the robot that its file gives on that base, whose base link has a mass too; by default its own."""
    path = str(OWN / "quadruped.urdf")
    root = {"fixed": (), "floating": (pin.JointModelFreeFlyer(),), "planar": (pin.JointModelPlanar(),)}[own]
    model = pin.buildModelFromUrdf(path, *root)
    model.gravity = pin.Motion(np.array([0.0, 0.0, -1.6, 0.0, 0.0, 0.0]))
    moon, robots = model.gravity.linear, [quietly(model, base=base), load(path, base=base or own, feet=[])]
    assert np.array_equal(robots[0].gravity, moon) and robots[0].joint_names == robots[1].joint_names
    assert robots[0].mass == pytest.approx(robots[1].mass)
    q, v = robots[1].random_configuration(np.random.default_rng(0)), np.arange(robots[1].nv) + 1.0
    states = [at(robot, q, v) for robot in robots]
    lift = (np.array([0.0, 0.0, -9.81]) - moon) @ states[1].centroidal_map[:3]
    np.testing.assert_allclose(states[0].M, states[1].M, atol=1e-12)
    np.testing.assert_allclose(states[0].h, states[1].h + lift, atol=1e-10)
    for frame in robots[1].frame_names:
        np.testing.assert_allclose(states[0].frame(frame).placement, states[1].frame(frame).placement, atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_the_order_of_joints_stays_on_another_base(seed: int):
    robot = quietly(model := grown(seed, None), base="floating")
    assert robot.joint_names == tuple(model.names)[1:]
    np.testing.assert_allclose(robot.state().M[6:, 6:], quietly(model).state().M, atol=1e-12)


@pytest.mark.parametrize(
    ("joint", "sentence"),
    [
        (pin.JointModelSpherical(), "joint 'odd' is JointModelSpherical"),
        (pin.JointModelPlanar(), "joint 'odd' is JointModelPlanar"),
        (pin.JointModelHX(0.1), "joint 'odd' is a screw"),
    ],
)
def test_joints_that_a_robot_cannot_have_are_named(joint: Any, sentence: str):
    model = pin.Model()
    hinge = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "hinge")
    model.addJoint(hinge, joint, pin.SE3.Identity(), "odd")
    with pytest.raises(ModelError, match=sentence):
        load(model)


def test_a_model_on_a_planar_joint_stands_where_pinocchio_has_it():
    """Its configurations by name too, and q as ``to_pinocchio`` and ``from_pinocchio`` convert it."""
    model = pin.buildModelFromUrdf(str(OWN / "arm.urdf"), pin.JointModelPlanar())
    theirs = np.array([0.4, -0.3, np.cos(2.0), np.sin(2.0), *0.1 * np.arange(7.0)])
    model.referenceConfigurations["parked"] = theirs
    robot, data = quietly(model, q0="parked"), model.createData()
    assert (robot.base, robot.joint_names[:3]) == ("planar", ("base_x", "base_y", "base_yaw"))
    np.testing.assert_allclose(robot.from_pinocchio(theirs), robot.q0, atol=1e-12)
    np.testing.assert_allclose(robot.to_pinocchio(robot.q0), theirs, atol=1e-12)
    pin.framesForwardKinematics(model, data, theirs)
    tool = data.oMf[model.getFrameId("tool")]
    np.testing.assert_allclose(robot.state().frame("tool").placement, tool, atol=1e-12)
    model.jointPlacements[1] = pin.SE3.Random()
    with pytest.raises(ModelError, match="the planar joint 'root_joint' is not at the world's origin"):
        load(model)


def test_a_free_joint_is_at_the_origin_and_called_as_no_other():
    model = pin.Model()
    base = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Random(), "free")
    model.appendBodyToJoint(base, pin.Inertia.Random(), pin.SE3.Identity())
    hinge = model.addJoint(base, pin.JointModelRZ(), pin.SE3.Random(), "root_joint")
    model.appendBodyToJoint(hinge, pin.Inertia.Random(), pin.SE3.Identity())
    with pytest.raises(ModelError, match="the free joint 'free' is not at the world's origin"):
        load(model)
    model.jointPlacements[1] = pin.SE3.Identity()
    robot = quietly(model)
    assert robot.joint_names == ("root_joint",) and len(set(robot.pinocchio.names)) == robot.pinocchio.njoints
    assert_same(robot, model, 0)


def test_an_order_that_pinocchio_cannot_compute_with_is_refused():
    model = pin.Model()
    for parent, name in ((0, "a"), (0, "b"), (1, "c")):
        model.addJoint(parent, pin.JointModelRX(), pin.SE3.Identity(), name)
    with pytest.raises(ModelError, match="joint 'c' is added after other limbs than its own"):
        load(model)


# ---- folders and packages
def test_a_folder_is_the_robot_in_it(tmp_path: Path):
    (tmp_path / "urdf").mkdir()
    path = tmp_path / "urdf" / "arm.urdf"
    path.write_text((OWN / "arm.urdf").read_text())
    assert load(tmp_path).joint_names == load("arm").joint_names
    path.rename(tmp_path / "urdf" / "arm.xml")
    with pytest.raises(ModelError, match="this is not a file"):
        load(tmp_path)
    path.write_text((tmp_path / "urdf" / "arm.xml").read_text())
    (tmp_path / "other.urdf").write_text(path.read_text())
    with pytest.raises(ModelError, match=r"there are 2 robot files in this folder; .*: other\.urdf, urdf/arm\.urdf"):
        load(tmp_path)


def test_a_module_of_robot_descriptions_is_its_file(tmp_path: Path):
    for folder in ("arm/urdf", "arm/meshes", "other"):
        (tmp_path / folder).mkdir(parents=True)
    module: Any = ModuleType("arm_description")
    module.URDF_PATH = str(tmp_path / "arm/urdf/arm.urdf")
    (tmp_path / "arm/meshes/part.stl").write_text("solid part")

    def write(mesh: str) -> None:
        seen = link("base", shape(f'<mesh filename="package://arm/{mesh}"/>', kind="visual"))
        text = (OWN / "arm.urdf").read_text().replace('<link name="base">', seen.removesuffix("</link>"))
        Path(module.URDF_PATH).write_text(text)

    write("meshes/part.stl")
    with pytest.warns(UserWarning, match="there is no mesh 'package://arm/meshes/part.stl'"):
        load(module)
    module.PACKAGE_PATH, module.REPOSITORY_PATH = str(tmp_path / "arm"), str(tmp_path)
    assert any(isinstance(g.shape, Mesh) for g in load(module).visuals)
    write("../../../meshes/part.stl")
    with pytest.raises(PathRefused):
        load(module)


# ---- MuJoCo
WEDGE = "0 0 0  0.1 0 0  0 0.2 0  0 0 0.3"
SCENE = f"""
<mujoco model="two">
  <asset><mesh name="wedge" vertex="{WEDGE}"/></asset>
  <worldbody>
    <body name="link" pos="0 0 1"><joint name="hinge" axis="0 1 0" range="-90 90" armature="0.1"/>
      <geom type="mesh" mesh="wedge" pos="1 2 3" euler="10 20 30"/>
      <body name="arm" pos="0.3 0 0"><joint name="slide" type="slide" axis="1 0 0"/><geom type="box" size=".1 .2 .3"/>
        <site name="tip" pos="0 0 .3"/></body></body>
  </worldbody>
  <actuator><motor joint="hinge" ctrlrange="-5 5"/></actuator>
</mujoco>
"""


@pytest.mark.physics
@pytest.mark.parametrize("kind", ["model", "spec"])
def test_mujocos_model_in_memory_is_the_robot(kind: str):
    mujoco = pytest.importorskip("mujoco", reason="the extra `sim`")
    spec = mujoco.MjSpec.from_string(SCENE)
    physics = mujoco.MjModel.from_xml_string(SCENE)
    with pytest.raises(InvalidInput, match="not by MjData"):
        load(mujoco.MjData(physics))
    robot = quietly(spec if kind == "spec" else physics)
    assert (robot.name, robot.joint_names) == ("two", ("hinge", "slide")) and "tip" in robot.frame_names
    assert robot.limits.tau_max.tolist() == [5.0, 0.0] and robot.armature.tolist() == [0.1, 0.0]
    for seed in range(3):
        compare(robot, physics, seed)
    (mesh,) = (g for g in robot.visuals if isinstance(g.shape, Mesh))
    (box,) = (g for g in robot.collisions if isinstance(g.shape, Box))
    assert box.shape.size == pytest.approx((0.2, 0.4, 0.6))
    lines = [line.split() for line in mesh.shape.path.read_text().splitlines()]
    ours = np.array([line[1:] for line in lines if line[0] == "v"], dtype=float) @ mesh.origin.rotation.T
    np.testing.assert_allclose(sorted((ours + mesh.origin.xyz).tolist()), corners(physics), atol=1e-6)
    folder = mesh.shape.path.parent
    del robot, mesh, box
    gc.collect()
    assert not folder.exists(), "files of meshes live as long as the robot"


@pytest.mark.physics
def test_a_spec_that_does_not_compile_is_refused():
    mujoco = pytest.importorskip("mujoco", reason="the extra `sim`")
    spec = mujoco.MjSpec()
    spec.worldbody.add_body(name="b").add_joint(name="j")
    with pytest.raises(ModelError, match="mass and inertia"):
        load(spec)
