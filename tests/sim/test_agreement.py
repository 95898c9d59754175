"""Physics and model are the same robot, or there is no plant."""

from __future__ import annotations

import copy
from dataclasses import replace

import numpy as np
import pytest

from tasks import Point
from tests.sim.builders import standing
from wbc.errors import InvalidInput, ModelError, SimulationError, UnknownFrame
from wbc.models import load
from wbc.models.catalogue import example_robots
from wbc.sim.engine import PhysicsSettings
from wbc.sim.mujoco_ import MujocoPlant

mujoco = pytest.importorskip("mujoco", reason="the extra `sim`")
pytestmark = pytest.mark.physics


OWN = PhysicsSettings(armature=0.1, joint_damping=1.0, joint_friction=0.5)


@pytest.mark.parametrize(
    ("name", "base", "settings"),
    [("arm", "fixed", None), ("quadruped", "floating", None), ("humanoid", "floating", None), ("arm", "floating", None),
     ("arm", "fixed", OWN)],
)  # fmt: skip
def test_our_robots_are_the_same_in_physics_whatever_settings_the_plant_has(name, base, settings):
    plant = MujocoPlant(load(name, base=base), settings=settings or PhysicsSettings())
    assert set(plant.agreement) == {"total mass", "M", "h", "a"}
    assert max(plant.agreement.values()) < 1e-11


@pytest.mark.slow
@pytest.mark.parametrize("name", ["talos", "g1", "go2", "panda"])
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_example_robots_are_the_same_in_physics(name):
    try:
        model = load(name)
    except ModelError as missing:
        pytest.skip(str(missing))
    assert max(MujocoPlant(model).agreement.values()) < 1e-11


def heavier(by):
    return lambda inertial: replace(inertial, mass=inertial.mass + by)


def rounder(inertial):
    return replace(inertial, inertia=tuple(1.0001 * x for x in inertial.inertia))


@pytest.mark.parametrize(
    ("name", "link", "change", "sentence"),
    [
        ("quadruped", "trunk", heavier(-1e-3), r"quadruped are not the same robot: total mass by 6\.\de-05, M by"),
        ("arm", "forearm", rounder, "not the same robot: M by"),
        ("arm", "forearm", lambda inertial: None, r"MuJoCo cannot build arm: .*mass"),
    ],
    ids=["a lost gram", "an inertia that is off by a ten-thousandth", "no mass"],
)
def test_a_link_that_is_changed_behind_the_model_is_found(name, link, change, sentence):
    other = copy.copy(load(name))
    links = [replace(one, inertial=change(one.inertial)) if one.name == link else one for one in other.urdf.links]
    other.urdf = replace(other.urdf, links=tuple(links))
    with pytest.raises(SimulationError, match=sentence):
        MujocoPlant(other)


def test_a_description_of_another_robot_is_refused():
    other = copy.copy(load("arm"))
    other.urdf = load("quadruped").urdf
    with pytest.raises(SimulationError, match="MuJoCo has no joint 'shoulder_yaw', which arm has"):
        MujocoPlant(other)


def test_a_joint_without_torque_is_passive():
    arm = load("arm")
    tau_max = arm.limits.tau_max.copy()
    tau_max[1] = 0.0
    plant = MujocoPlant(arm.replace(limits=replace(arm.limits, tau_max=tau_max)))
    assert max(plant.agreement.values()) < 1e-11
    plant._bridge.write_torques(plant.data, np.full(arm.nj, 1.0))
    mujoco.mj_forward(plant.physics, plant.data)
    np.testing.assert_array_equal(plant.data.qfrc_actuator != 0, tau_max > 0)


@pytest.mark.parametrize("name", ["arm", "quadruped"])
@pytest.mark.parametrize("moments", [(0.0, 0.0, 0.0), (1e-3, 1e-3, 5e-3)], ids=["none", "a disc too flat"])
def test_inertias_that_the_engine_refuses_move_as_the_model_says(name, moments, tmp_path):
    xx, yy, zz = moments
    model = load(name)
    old = model.urdf.links[-1]
    centre = old.inertial or model.urdf.links[1].inertial
    odd = replace(centre, mass=0.1, inertia=(xx, 0.0, 0.0, yy, 0.0, zz))
    path = tmp_path / "odd.urdf"
    path.write_text(replace(model.urdf, links=(*model.urdf.links[:-1], replace(old, inertial=odd))).text())
    plant = MujocoPlant(load(path, base=model.base))
    assert max(plant.agreement.values()) < 1e-9


@pytest.mark.deep
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_nine_in_ten_of_the_example_robots_have_a_plant():
    """Those that have none: no joint that moves, links that move and weigh nothing, or a mesh outside the folders."""
    try:
        folder = example_robots()
    except ModelError as missing:
        pytest.skip(str(missing))
    files = sorted((folder / "robots").rglob("*.urdf"))
    without = {}
    for file in files:
        try:
            MujocoPlant(load(file, packages=[folder]))
        except (ModelError, SimulationError) as reason:
            without[file.name] = str(reason)
    print(*(f"{name}: {reason}" for name, reason in without.items()), sep="\n")
    assert len(without) <= 0.1 * len(files), without
    reasons = ("no joint moves", "mass and inertia of moving bodies", "outside the folders")
    assert all(any(known in reason for known in reasons) for reason in without.values()), without


def test_arguments_are_checked_by_name():
    with pytest.raises(InvalidInput, match=r"needs one that wbc\.load made from a URDF"):
        MujocoPlant(object())
    with pytest.raises(InvalidInput, match="sole_geometry is 'disc'"):
        MujocoPlant(load("arm"), sole_geometry="disc")
    with pytest.raises(InvalidInput, match="integrator is 'rk4'"):
        PhysicsSettings(integrator="rk4")
    with pytest.raises(InvalidInput, match="friction is -1"):
        MujocoPlant(load("quadruped"), contacts=standing(load("quadruped")), friction=-1.0)
    with pytest.raises(UnknownFrame, match=r"no frame 'front_left_knee'.*a contact must be on a link"):
        MujocoPlant(load("quadruped"), contacts=[Point("front_left_knee", friction=0.8)])
