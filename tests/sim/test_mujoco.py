"""What physics must do whatever the engine: keep momentum, carry weight, slide, fall; and tell the truth about it."""

from __future__ import annotations

import warnings
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wbc
from tasks import Point, Sinusoid, Sole
from tasks.scenarios.humanoid_stand import STANCES
from tasks.scenarios.quadruped_stand import STANCES as QUADRUPED_STANCES
from tasks.scenarios.standing import standing_stack
from tests.models.builders import at
from tests.sim.builders import command, stander, standing
from wbc.errors import NotSupported, SimulationError
from wbc.models import load
from wbc.models.catalogue import OWN_ROBOTS
from wbc.sim.engine import PhysicsSettings
from wbc.sim.mujoco_ import MujocoPlant
from wbc.sim.plant import Delivered, ForwardDynamicsPlant
from wbc.sim.simulate import MissingContact, simulate

mujoco = pytest.importorskip("mujoco", reason="the extra `sim`")
pytestmark = pytest.mark.physics

QUADRUPED, HUMANOID, ARM = load("quadruped"), load("humanoid"), load("arm")


def momentum(model, q, v):
    """Linear momentum [N s]."""
    state = at(model, q, v)
    return model.mass * state.com_jacobian @ v


def stand(plant, controller, seconds):
    """Let a robot stand; the plant's truth at the end."""
    for _ in range(round(seconds / plant.dt)):
        plant.step(controller.tick(plant.t, plant.q, plant.v))
    return plant.truth()


def told(truth, what):
    """What the plant says of each foot."""
    return [value for name, value in truth.items() if name.startswith(f"plant.{what}.")]


def test_both_rigid_body_plants_move_an_arm_the_same_way():
    plants = [
        ForwardDynamicsPlant(ARM, dt=1e-3, substeps=10),
        MujocoPlant(ARM, dt=1e-3, substeps=10, settings=PhysicsSettings(integrator="euler", joint_stops=False)),
    ]
    for plant in plants:
        plant.reset(ARM.q0, 0.1 * np.ones(ARM.nv))
        for k in range(100):
            plant.step(command(ARM, tau=3.0 * np.sin(0.05 * k + np.arange(ARM.nj))))
    moved = np.abs(plants[0].q - ARM.q0).max()
    assert moved > 0.1
    np.testing.assert_allclose(plants[1].q, plants[0].q, atol=1e-3 * moved)
    assert plants[1].t == plants[0].t


def test_a_push_in_free_flight_changes_the_momentum_by_its_impulse():
    plant = MujocoPlant(QUADRUPED, floor=-100.0)
    force = np.array([5.0, -20.0, 30.0])
    for _ in range(100):
        plant.push("trunk", force)
        np.testing.assert_array_equal(plant.pushed, force)
        plant.step(command(QUADRUPED))
    expected = 0.1 * (force + QUADRUPED.mass * QUADRUPED.gravity)
    np.testing.assert_allclose(momentum(QUADRUPED, plant.q, plant.v), expected, rtol=1e-3, atol=1e-3)
    np.testing.assert_array_equal(plant.pushed, 0.0)


@pytest.mark.parametrize("model", [QUADRUPED, HUMANOID], ids=lambda model: model.name)
@pytest.mark.parametrize(
    ("sole_geometry", "dt", "substeps"), [("box", 1e-3, 1), ("spheres", 1e-3, 1), ("box", 2e-3, 4)]
)
def test_the_feet_carry_the_weight(model, sole_geometry, dt, substeps):
    """Wrenches are means over the substeps."""
    plant = MujocoPlant(model, contacts=standing(model), sole_geometry=sole_geometry, dt=dt, substeps=substeps)
    plant.reset(plant.on_floor(model.q0))
    truth, weight = stand(plant, stander(model, dt=dt), 0.4), model.mass * 9.81
    forces = sum(told(truth, "f"))
    assert abs(forces[2] - weight) < 0.02 * weight
    assert np.abs(forces[:2]).max() < 0.02 * weight
    assert all(0.0 < depth < 1e-3 for depth in told(truth, "penetration"))
    assert np.linalg.norm(told(truth, "slip"), axis=1).max() < 1e-3


def test_the_moment_of_a_sole_says_where_the_robot_stands():
    """CoP = (−m_y, m_x) / f_z of each sole, and together below the centre of mass of a robot at rest."""
    contacts = standing(HUMANOID)
    plant = MujocoPlant(HUMANOID, contacts=contacts)
    truth = stand(plant, stander(HUMANOID), 0.6)
    state = at(HUMANOID, plant.q, plant.v)
    centres, loads = [], []
    for contact in contacts:
        f = truth[f"plant.f.{contact.name}"]
        cop = np.array([-f[4], f[3]]) / f[2]
        assert (np.abs(cop) <= np.array(contact.half_size) + 1e-4).all()
        anchor = contact.anchor(state)
        centres.append((anchor.position + anchor.rotation @ [*cop, 0.0])[:2])
        loads.append(f[2])
    np.testing.assert_allclose(np.average(centres, axis=0, weights=loads), state.com[:2], atol=5e-3)


@settings(max_examples=5, deadline=None)
@given(st.floats(-3.0, 3.0), st.floats(0.02, 3.0))
def test_a_slope_is_refused_and_a_turned_level_surface_is_not(yaw, lean):
    level, slope = (pinocchio.utils.rpyToMatrix(0.0, pitch, yaw) for pitch in (0.0, lean))
    foot = next(iter(QUADRUPED.feet))
    MujocoPlant(QUADRUPED, contacts=[Point(foot, friction=0.5, radius=0.02, axes=level)])
    for leaning in (
        Point(foot, friction=0.5, radius=0.02, axes=slope),
        Sole(foot, friction=0.5, half_size=(0.1, 0.05), target=pinocchio.SE3(slope, np.zeros(3))),
    ):
        with pytest.raises(NotSupported, match=rf"{foot}.* leans by {np.degrees(lean):.3g}°; here the floor is level"):
            MujocoPlant(QUADRUPED, contacts=[leaning])


def moved_feet(model, q):
    """How far the origins of the feet are from where they are in the reference, one row each."""
    states = at(model, q), at(model)
    return np.array([np.subtract(*(state.frame(name).position for state in states)) for name in model.feet])


def test_soles_that_slide_over_ice_slip_as_far_as_they_move():
    plant, v = MujocoPlant(HUMANOID, contacts=standing(HUMANOID), friction=1e-4), np.zeros(HUMANOID.nv)
    v[:2] = 0.3, -0.4
    plant.reset(HUMANOID.q0, v)
    held = stander(HUMANOID).tick(0.0, HUMANOID.q0, 0.0 * v)
    for _ in range(200):
        plant.step(held)
    moved = moved_feet(HUMANOID, plant.q)
    assert np.linalg.norm(moved, axis=1).min() > 0.09
    np.testing.assert_allclose(told(plant.truth(), "slip"), moved[:, :2], atol=1e-3)


def test_a_ball_that_rolls_does_not_slip():
    """The trunk sways over ball feet: their centres move along the floor, the material that touches it does not."""
    plant, controller = MujocoPlant(QUADRUPED, contacts=standing(QUADRUPED)), stander(QUADRUPED)
    sway = Sinusoid(controller.stack.tasks[0].target, amplitude=[0.04, 0.0, 0.0], frequency=1.0)
    controller.stack.tasks[0].target = sway
    way = 0.0
    for _ in range(750):
        plant.step(controller.tick(plant.t, plant.q, plant.v))
        way = max(way, np.linalg.norm(moved_feet(QUADRUPED, plant.q)[:, :2], axis=1).max())
    assert way > 1.5e-3
    assert np.linalg.norm(told(plant.truth(), "slip"), axis=1).max() < 0.2 * way


def test_torques_beyond_the_limit_act_as_the_limit():
    ends = []
    for factor in (1.0, 50.0):
        plant = MujocoPlant(ARM)
        for _ in range(20):
            plant.step(SimpleNamespace(tau=factor * ARM.limits.tau_max))
        ends.append(plant.q)
    np.testing.assert_array_equal(ends[0], ends[1])


def test_lying_is_fallen_and_turning_is_not():
    plant = MujocoPlant(QUADRUPED)
    upright, low = (np.r_[height * QUADRUPED.q0[:3], QUADRUPED.q0[3:]] for height in (1.0, 0.5))
    poses = [(upright, False), (low, True)]
    for angle, axis, fallen in ((2.0, 2, False), (0.6, 0, False), (0.9, 0, True), (-0.9, 1, True), (3.0, 1, True)):
        turn = *(np.sin(angle / 2) * np.eye(3)[axis]), np.cos(angle / 2)
        poses.append((np.r_[upright[:3], turn, upright[7:]], fallen))
    plant.reset(upright)  # what leans, leans against the start
    for plant._q, fallen in poses:
        assert plant.fallen is fallen


def test_the_same_start_gives_the_same_motion_to_the_bit():
    plant = MujocoPlant(QUADRUPED, contacts=standing(QUADRUPED))
    ends = []
    for _ in range(2):
        plant.reset(QUADRUPED.q0)
        stand(plant, stander(QUADRUPED), 0.1)
        ends.append((plant.q, plant.v, *plant.truth().values()))
    for first, second in zip(*ends, strict=True):
        np.testing.assert_array_equal(first, second)


def test_a_payload_adds_the_inertia_of_a_point_mass_until_the_next_reset():
    plant, mass, J = MujocoPlant(ARM), 2.0, at(ARM).frame("tool").jacobian()[:3].copy()

    def inertia():
        mujoco.mj_forward(plant.physics, plant.data)
        M = np.zeros((ARM.nv, ARM.nv))
        mujoco.mj_fullM(plant.physics, plant.data, M)
        X = plant._bridge.velocity_map(plant.data)
        return X.T @ M @ X

    bare = inertia()
    plant.add_mass("tool", mass)
    np.testing.assert_allclose(inertia(), bare + mass * J.T @ J, atol=1e-9)
    plant.reset(ARM.q0)
    np.testing.assert_array_equal(inertia(), bare)


def test_a_state_that_runs_away_is_an_error_not_a_new_beginning():
    plant = MujocoPlant(ARM)
    plant.reset(ARM.q0, np.full(ARM.nv, 1e14))
    with pytest.raises(SimulationError, match="diverged at t = "):
        for _ in range(10):
            plant.step(command(ARM))


def test_every_setting_is_said():
    plant = MujocoPlant(QUADRUPED, contacts=standing(QUADRUPED), friction=0.4, settings=PhysicsSettings(impratio=20.0))
    said = plant.settings()
    assert said["impratio"] == 20.0 and said["cone"] == "elliptic" and said["engine"].startswith("MuJoCo ")
    assert set(said["friction"].values()) == {0.4}
    others = {"dt", "substeps", "integrator", "solref", "solimp", "joint_friction", "armature", "joint_stops"}
    assert others <= set(said)


def test_settings_reach_the_engine():
    given = PhysicsSettings(
        integrator="euler", impratio=20.0, armature=0.02, joint_friction=0.3, joint_damping=0.4, joint_stops=False
    )
    physics = MujocoPlant(ARM, dt=2e-3, substeps=4, settings=given).physics
    assert physics.opt.timestep == 5e-4 and physics.opt.impratio == 20.0
    assert physics.opt.integrator == mujoco.mjtIntegrator.mjINT_EULER
    assert physics.opt.cone == mujoco.mjtCone.mjCONE_ELLIPTIC
    assert (physics.dof_armature == 0.02).all() and (physics.dof_frictionloss == 0.3).all()
    assert (physics.dof_damping == 0.4).all()
    assert not physics.jnt_limited.any()


def test_friction_and_damping_are_the_files_only_when_asked():
    joints = {joint.name: joint for joint in ARM.urdf.joints}
    of_file = [(joints[name].friction, joints[name].damping) for name in ARM.joint_names]
    for settings_, wanted in (
        (PhysicsSettings(), [(0.0, 0.0)] * ARM.nj),
        (PhysicsSettings(joint_friction="urdf", joint_damping="urdf"), of_file),
    ):
        physics = MujocoPlant(ARM, settings=settings_).physics
        np.testing.assert_array_equal(np.column_stack([physics.dof_frictionloss, physics.dof_damping]), wanted)


@pytest.mark.parametrize("stops", [True, False])
def test_joints_stop_at_their_limits_where_there_are_stops(stops):
    plant = MujocoPlant(ARM, settings=PhysicsSettings(joint_stops=stops, joint_damping=5.0))
    for _ in range(3000):
        plant.step(command(ARM, tau=0.3 * ARM.limits.tau_max))
    beyond = (plant.q - ARM.limits.q_max).max()
    assert 0.0 < beyond < 0.1 if stops else beyond > 1.0


def test_a_settled_robot_is_carried_from_the_first_step():
    robot = wbc.load("humanoid")
    contacts = standing_stack(robot, STANCES["humanoid"]).contacts
    plant = MujocoPlant(robot, contacts=contacts)
    plant.reset(plant.settled(robot.q0))
    controller = wbc.Controller(robot, standing_stack(robot, STANCES["humanoid"]), level=wbc.InverseDynamics())
    weight = 9.81 * robot.mass
    for k in range(20):
        plant.step(controller.tick(k * 1e-3, plant.q, plant.v))
        carried = sum(told(plant.truth(), "f"))[2]
        assert 0.9 * weight < carried < 1.1 * weight


def test_force_sensors_in_the_feet_account_for_all_momentum_that_gravity_does_not_give():
    """In world axes about a fixed point: d(momentum)/dt = weight + Σ (f, origin × f + m)."""
    plant = MujocoPlant(QUADRUPED, contacts=stander(QUADRUPED).stack.contacts)
    plant.reset(plant.settled(QUADRUPED.q0))
    assert all(not wrench.any() for wrench in plant.wrenches().values())
    controller, weight = stander(QUADRUPED), QUADRUPED.mass * QUADRUPED.gravity
    for _ in range(20):
        state, total = at(QUADRUPED, plant.q, plant.v), np.zeros(6)
        before = momentum(QUADRUPED, plant.q, plant.v)
        plant.step(controller.tick(plant.t, plant.q, plant.v))
        for link, wrench in plant.wrenches().items():
            total += np.r_[wrench[:3], np.cross(state.frame(link).position, wrench[:3]) + wrench[3:]]
        change = (momentum(QUADRUPED, plant.q, plant.v) - before) / plant.dt
        np.testing.assert_allclose(total[:3] + weight, change, atol=1e-3 * np.linalg.norm(weight))
        np.testing.assert_allclose(total[3:] + np.cross(state.com, weight), 0.0, atol=0.5)


def test_a_brake_holds_its_joint_against_gravity_until_the_next_reset():
    plant, moved = MujocoPlant(ARM), []
    plant.brake(ARM.joint_names[1])
    for _ in range(2):
        for _ in range(200):
            plant.step(command(ARM))
        moved.append(np.abs(plant.q - ARM.q0))
        plant.reset(ARM.q0)
    assert moved[0][1] < 1e-3 < moved[0][3] and moved[1][1] > 0.05


def test_a_plant_that_lacks_contacts_of_the_stack_is_warned_about():
    stack = standing_stack(QUADRUPED, QUADRUPED_STANCES["quadruped"])
    controller = wbc.Controller(QUADRUPED, stack, level=wbc.InverseDynamics())
    front, rear = stack.contacts[:2], stack.contacts[2:]
    for there, missing in (((), stack.contacts), (front, rear), (stack.contacts, ())):
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            simulate(controller, MujocoPlant(QUADRUPED, contacts=there), duration=2e-3)
        told = [str(one.message) for one in said if one.category is MissingContact]
        assert len(told) == bool(missing)
        for contact in stack.contacts:
            assert (contact.name in "".join(told)) == (contact in missing)
        assert all(one.filename == __file__ for one in said)


@pytest.mark.parametrize("base", ["fixed", "floating", "planar"])
@pytest.mark.parametrize("link", ["trunk", "front_left_thigh"])
def test_a_link_may_be_called_world(tmp_path: Path, base: Any, link: str):
    """MuJoCo takes a link of that name for its own world, and a base of that name would not move."""
    path = tmp_path / "robot.urdf"
    text = (OWN_ROBOTS / "quadruped.urdf").read_text()
    assert f'"{link}"' in text
    moved = []
    for name in (link, "world"):
        path.write_text(text.replace(f'"{link}"', f'"{name}"'))
        robot = load(path, base=base, feet=[])
        plant = MujocoPlant(robot)
        plant.reset(robot.q0, 0.1 * np.ones(robot.nv))
        still = np.zeros(robot.nv)
        for _ in range(5):
            plant.step(Delivered(np.zeros(robot.nj), still, still, plant.q))
        moved.append(plant.q)
    np.testing.assert_allclose(*moved, atol=1e-12)
