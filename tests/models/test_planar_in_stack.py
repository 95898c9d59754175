"""The planar robots in a stack and a plant, like any other robot."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import tasks
import wbc
from tests.models.planar_oracle import FOUR, robots, some_parameters
from wbc.models import Limits, PlanarPR
from wbc.models.lagrange import derive
from wbc.sim.plant import ForwardDynamicsPlant, IntegratorPlant
from wbc.testing import check_constraint, check_contact, check_task


def members(names: tuple[str, ...], model: Any) -> list[Any]:
    """Samples of members of the library, by class name."""
    return [sample for name in names for sample in getattr(tasks, name).samples(model)]


@robots
def test_every_task_of_the_library_works(robot: Any):
    names = (
        "AxisAlignment", "Damping", "Distance", "Frame", "FrozenJoints", "Gaze", "JointCoupling", "JointVelocity",
        "KineticEnergy", "LowAcceleration", "Orientation", "Position", "Posture", "RelativeFrame", "Rolling", "Torque",
    )  # fmt: skip
    heavy = ("AngularMomentum", "CenterOfMass", "CentroidalMomentum", "LinearMomentum")
    for task in members(names if robot.mass == 0 else names + heavy, robot):
        check_task(task, robot)


@robots
def test_every_limit_and_contact_of_the_library_works(robot: Any):
    bounded = robot.replace(limits=Limits(*(np.full(robot.nj, x) for x in (-2.0, 2.0, 1.0, 30.0))))
    for limit in members(
        ("JointAccelerationLimits", "JointPositionLimits", "JointVelocityLimits", "TorqueLimits"), bounded
    ):
        check_constraint(limit, bounded)
    for contact in members(("Point", "Sole"), bounded):
        check_contact(contact, bounded)


def closed_loop(controller: wbc.Controller, plant: Any, duration: float) -> list[wbc.Command]:
    """Tick and step; every command, each of which must be solved."""
    commands = []
    for _ in range(round(duration / plant.dt)):
        command = controller.tick(plant.t, plant.q, plant.v)
        assert command.status.ok, controller.explain()
        plant.step(command)
        commands.append(command)
    return commands


def reach(robot: Any, axes: str = "xyz") -> tuple[tasks.Position, np.ndarray]:
    """A position task for the end effector, and the place (3,) it goes to."""
    goal = robot.state()
    goal.update(0.0, robot.q0 + 0.15, np.zeros(robot.nv))
    place = goal.frame("end_effector").position.copy()
    return tasks.Position("end_effector", target=place["xyz".index(axes[0]) :][: len(axes)], axes=axes), place


LEVELS = {
    "velocity": (wbc.VelocityLevel(), lambda robot: IntegratorPlant(robot, dt=1e-3, level="velocity")),
    "acceleration": (wbc.AccelerationLevel(), lambda robot: IntegratorPlant(robot, dt=1e-3)),
    "torque": (wbc.InverseDynamics(), lambda robot: ForwardDynamicsPlant(robot, dt=1e-3)),
}


@robots
@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("axes", ["xyz", "xy"])
def test_the_end_effector_goes_where_it_is_told_at_every_level(robot: Any, level: str, axes: str):
    """With the row for z, which is zero, and without it."""
    bent = robot.replace(q0=np.full(robot.nq, 0.6))
    task, place = reach(bent, axes)
    formulation, plant_of = LEVELS[level]
    limits = [tasks.JointPositionLimits(lower=-3.0, upper=3.0), tasks.JointVelocityLimits(2.0)]
    if level == "torque":
        limits.append(tasks.TorqueLimits(80.0))
    stack = wbc.Stack([task, tasks.Posture(bent.q0, kp=10.0, weight=1e-5)], subject_to=limits)
    plant = plant_of(bent)
    closed_loop(wbc.Controller(bent, stack, level=formulation, dt=1e-3), plant, 1.2)
    state = bent.state()
    state.update(plant.t, plant.q, plant.v)
    assert np.allclose(state.frame("end_effector").position, place, atol=2e-3)


def test_an_exact_pose_in_the_plane_is_met_by_three_revolute_joints():
    robot = derive("RRR").robot(some_parameters(derive("RRR").chain)).replace(q0=[0.3, 0.8, 0.5])
    state = robot.state()
    state.update(0.0, robot.q0 + np.array([0.1, -0.2, 0.15]), np.zeros(3))
    pose = state.frame("end_effector").placement.copy()
    stack = wbc.Stack([tasks.Frame("end_effector", target=pose, kp=200.0)])
    plant = ForwardDynamicsPlant(robot, dt=1e-3)
    closed_loop(wbc.Controller(robot, stack, level=wbc.InverseDynamics(), dt=1e-3), plant, 1.0)
    state.update(plant.t, plant.q, plant.v)
    assert np.allclose(state.frame("end_effector").placement.homogeneous, pose.homogeneous, atol=2e-3)


def test_torque_limits_hold_in_newtons_and_newton_metres():
    robot = PlanarPR(m1=1.0, m2=1.0, l2=0.5, d2=0.25, I2=0.1, tau_max=(3.0, 2.6))
    target = tasks.Posture([1.0, 0.5], kp=200.0)
    controller = wbc.Controller(
        robot, wbc.Stack([target], subject_to=[tasks.TorqueLimits()]), level=wbc.InverseDynamics(), dt=1e-3
    )
    torques = np.array([c.tau for c in closed_loop(controller, ForwardDynamicsPlant(robot, dt=1e-3), 0.5)])
    assert np.allclose(np.abs(torques).max(axis=0), [3.0, 2.6], atol=1e-7)
    units = {row.label: row.unit for row in controller.plan.qp.rows if row.owner.startswith("TorqueLimits")}
    assert units == {"q1": "N", "q2": "N m"}


def test_the_torque_task_by_inverse_inertia_gives_the_exercise():
    """τ(0) = (104/11, −71/22) as a stack: the task exactly, the torque near τ0 in the norm of M⁻¹, the force known."""
    robot = PlanarPR(m1=1.0, m2=1.0, l2=0.5, d2=0.25, I2=0.1, gravity=0.0).replace(q0=[0.0, np.pi / 2])
    x = tasks.Position("end_effector", axes="x", target=lambda t: ([1.0 - np.cos(3 * t)], [3.0 * np.sin(3 * t)], [9.0]))
    tau_0, F = np.array([-1.0, 2.0]), np.array([-1.0, 1.0])
    # The wrench shifts what the motors have to do by JᵀF: the preferred torque is of motors and wrench together.
    wrench = robot.J(robot.q0).T @ F
    stack = wbc.Stack([tasks.Torque(tau_0 + wrench, weight="inverse_inertia")], subject_to=[x.exactly()])
    command = wbc.Controller(robot, stack, level=wbc.InverseDynamics()).tick(0.0, robot.q0, np.zeros(2))
    assert np.allclose(command.tau - wrench, [104 / 11, -71 / 22], atol=1e-6)


# ---- in a plant
@robots
def test_free_motion_keeps_the_energy(robot: Any):
    plant = ForwardDynamicsPlant(robot, dt=1e-3, substeps=20)
    plant.reset(np.full(robot.nq, 0.3), np.full(robot.nv, 0.5))
    before = robot.energy(plant.q, plant.v)
    rest = SimpleNamespace(tau=np.zeros(robot.nv))
    for _ in range(200):
        plant.step(rest)
    assert robot.energy(plant.q, plant.v) == pytest.approx(before, abs=2e-3 * (1 + abs(before)))


def test_plants_without_a_robot_library_follow_newton():
    """Four sliding joints under constant forces: q̈ = M⁻¹ (τ − g), exactly."""
    plant, tau = ForwardDynamicsPlant(FOUR, dt=1e-3), np.array([1.0, 40.0, -2.0, 3.0])
    for _ in range(500):
        plant.step(SimpleNamespace(tau=tau))
    a = np.linalg.solve(FOUR.M(FOUR.q0), tau - FOUR.g(FOUR.q0))
    assert np.allclose(plant.q, 0.125 * a, atol=1e-10) and np.allclose(plant.v, 0.5 * a, atol=1e-10)
