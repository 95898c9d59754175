"""The planar robots: numbers that agree with the derivation, and robots like any other in a stack and a plant."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

import tasks
import wbc
from tests.models.builders import at
from tests.models.planar_oracle import FOUR, PR, check_against_derivation, in_pinocchio, robots
from wbc.errors import InvalidInput, UnknownFrame, UnknownJoint
from wbc.models import Limits, Planar4P, PlanarPR
from wbc.models.lagrange import derive
from wbc.sim.plant import ForwardDynamicsPlant, IntegratorPlant
from wbc.testing import check_constraint, check_contact, check_task

seeds = st.integers(0, 2**32 - 1)


def drawn(kind: str, seed: int) -> Any:
    """A robot of one of the two kinds with random parameters, some masses zero."""
    rng = np.random.default_rng(seed)
    gravity = float(rng.choice([0.0, 9.81, 1.6]))
    if kind == "4p":
        m = rng.uniform(0.05, 5.0, 4)
        m[rng.integers(3)] *= rng.integers(2)
        return Planar4P(m=m, gravity=gravity)
    m1, m2, l2, d2, I2 = rng.uniform(0.05, 5.0, 5)
    return PlanarPR(m1=m1 * rng.integers(2), m2=m2, l2=l2, d2=d2 - 1.0, I2=I2, gravity=gravity)


def vectors(robot: Any, seed: int, count: int) -> np.ndarray:
    """Random rows (count, n)."""
    return np.random.default_rng(seed).normal(size=(count, robot.nv))


# ---- formulas
@given(kind=st.sampled_from(["pr", "4p"]), seed=seeds)
def test_the_numbers_are_those_of_the_derivation(kind: str, seed: int):
    robot = drawn(kind, seed)
    check_against_derivation(robot, *vectors(robot, seed, 4), rtol=1e-12, atol=1e-12)
    assert robot.symbolic() is derive(str(robot.chain))


@given(seed=seeds)
def test_the_four_masses_and_the_four_coefficients_give_the_same_forces(seed: int):
    """Property 31. Y a = Y_m m = M q̈ + g, Y_m = Y T with a = T m, and Y is linear in (q̈, g0)."""
    robot = drawn("4p", seed)
    (a, b), m = vectors(robot, seed, 2), np.array(list(robot.parameters.values()))
    T = np.triu(np.ones((4, 4)))
    forces = robot.M(np.zeros(4)) @ a + robot.g(np.zeros(4))
    assert np.allclose(robot.Y(a) @ robot.coefficients, forces, rtol=1e-12, atol=1e-11)
    assert np.allclose(robot.Y_masses(a) @ m, forces, rtol=1e-12, atol=1e-11)
    assert np.allclose(robot.coefficients, T @ m, rtol=1e-14)
    assert np.allclose(robot.Y(a) @ T, robot.Y_masses(a), atol=1e-12)
    twice = Planar4P(m=m, gravity=2.0 * robot.g0)
    assert np.allclose(robot.Y(a) + robot.Y(b), twice.Y(a + b), atol=1e-12)


# ---- arguments


def test_links_without_mass_are_allowed_while_all_joints_feel_inertia():
    """M is positive definite if and only if m1 + m2, m2 + m3, m3 + m4 and m4 are positive."""
    for m in ((1, 0, 1, 1), (0, 1, 0, 1)):
        assert np.linalg.eigvalsh(Planar4P(m=m).M(np.zeros(4)))[0] > 0


def test_a_parameter_too_many_or_too_few_is_named():
    with pytest.raises(InvalidInput, match="parameter 'I1' of chain R is missing"):
        derive("R").robot({"m1": 1.0, "l1": 1.0, "d1": 0.5})
    with pytest.raises(InvalidInput, match="chain Px has no parameter 'l1'; it has m1"):
        derive("P").robot({"m1": 1.0, "l1": 1.0})


@robots
def test_wrong_shapes_are_refused_by_name(robot: Any):
    good, bad = np.zeros(robot.nv), np.zeros(robot.nv + 1)
    for call in (robot.M, robot.g, robot.J, robot.cartesian_inertia):
        with pytest.raises(InvalidInput, match="q must have shape"):
            call(bad)
    for call in (robot.c, robot.S, robot.Jdot_v, robot.momentum, robot.beta, robot.energy):
        with pytest.raises(InvalidInput, match="v must have shape"):
            call(good, bad)
    with pytest.raises(InvalidInput, match="v_reference must have shape"):
        robot.regressor(good, good, bad, good)
    for words in ("here", ["1"] * robot.nv, [None] * robot.nv):
        with pytest.raises(InvalidInput, match="q must be an array of numbers"):
            robot.M(words)
    with pytest.raises(InvalidInput, match=r"a\[0\] is nan"):
        robot.regressor(good, good, good, np.full(robot.nv, np.nan))


# ---- a robot like any other
@robots
@given(seed=seeds)
def test_frames_and_masses_are_where_the_chain_puts_them(robot: Any, seed: int):
    """How they move, and the rest of a state, is that of any robot: tests/models/test_states.py."""
    q, v = vectors(robot, seed, 2)
    model, state = in_pinocchio(robot.chain, robot.parameters, robot.g0), at(robot, q, v, 0.5)
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    for name in robot.frame_names[1:]:
        expected = data.oMf[model.getFrameId(name)].homogeneous
        assert np.allclose(state.frame(name).placement.homogeneous, expected, atol=1e-12)
    assert np.allclose(state.com, pin.centerOfMass(model, data, q), atol=1e-12)
    assert np.allclose(state.centroidal_map, pin.ccrba(model, data, q, v), atol=1e-12)
    assert not state.frame("base").jacobian().any()


@robots
def test_names_sizes_and_units(robot: Any):
    n = len(robot.chain)
    assert robot.nq == robot.nv == robot.nj == n and robot.nb == 0
    assert robot.joint_names == tuple(f"q{i}" for i in range(1, n + 1)) and robot.joint("q2") == 1
    assert robot.frame_names[0] == "base" and robot.frame_names[-1] == "end_effector"
    assert robot.mass == pytest.approx(sum(v for k, v in robot.parameters.items() if k[0] == "m"))
    assert robot.joint_units == tuple("rad" if kind == "R" else "m" for kind in robot.chain.joints)
    assert np.array_equal(robot.gravity, [0.0, -9.81, 0.0])
    with pytest.raises(UnknownJoint, match="no joint 'q9'"):
        robot.joint("q9")
    with pytest.raises(UnknownFrame, match="did you mean 'end_effector'"):
        robot.state().frame("endeffector")


def test_without_limits_there_are_none_and_limits_are_given_by_keyword():
    assert np.array_equal(PR.limits.q_max, [np.inf] * 2) and np.array_equal(PR.limits.tau_max, [np.inf] * 2)
    bounded = Planar4P(q_min=-1.0, q_max=(1.0, 2.0, 3.0, 4.0), v_max=0.5, tau_max=20.0)
    assert np.array_equal(bounded.limits.q_max, [1, 2, 3, 4]) and np.array_equal(bounded.limits.v_max, [0.5] * 4)
    other = bounded.replace(limits=Limits(*([x] * 4 for x in (-2.0, 2.0, 3.0, 4.0))))
    assert np.array_equal(other.limits.tau_max, [4.0] * 4) and np.array_equal(bounded.limits.tau_max, [20.0] * 4)


@given(seed=seeds)
def test_random_configurations_keep_the_limits(seed: int):
    rng = np.random.default_rng(seed)
    bounded = PlanarPR(m1=1, m2=1, l2=1, d2=1, I2=1, q_min=(5.0, -np.inf), q_max=(np.inf, -4.0))
    q = bounded.random_configuration(rng)
    assert 5.0 <= q[0] <= 7.0 and -4.0 - 2 * np.pi - 1e-9 <= q[1] <= -4.0
    assert (np.abs(PR.random_configuration(rng)) <= [1.0, np.pi]).all()


# ---- in a stack and a plant, like any other robot
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
    limits = tuple(f"Joint{what}Limits" for what in ("Acceleration", "Position", "Velocity"))
    for limit in members((*limits, "TorqueLimits"), bounded):
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
    place = at(robot, robot.q0 + 0.15).frame("end_effector").position.copy()
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
    assert np.allclose(at(bent, plant.q).frame("end_effector").position, place, atol=2e-3)


def test_torque_limits_hold_in_newtons_and_newton_metres():
    robot = PlanarPR(m1=1.0, m2=1.0, l2=0.5, d2=0.25, I2=0.1, tau_max=(3.0, 2.6))
    stack = wbc.Stack([tasks.Posture([1.0, 0.5], kp=200.0)], subject_to=[tasks.TorqueLimits()])
    controller = wbc.Controller(robot, stack, level=wbc.InverseDynamics(), dt=1e-3)
    torques = np.array([c.tau for c in closed_loop(controller, ForwardDynamicsPlant(robot, dt=1e-3), 0.5)])
    assert np.allclose(np.abs(torques).max(axis=0), [3.0, 2.6], atol=1e-7)
    units = {row.label: row.unit for row in controller.plan.qp.rows if row.owner.startswith("TorqueLimits")}
    assert units == {"q1": "N", "q2": "N m"}


# ---- in a plant
def test_plants_without_a_robot_library_follow_newton():
    """Four sliding joints under constant forces: q̈ = M⁻¹ (τ − g), exactly."""
    plant, tau = ForwardDynamicsPlant(FOUR, dt=1e-3), np.array([1.0, 40.0, -2.0, 3.0])
    for _ in range(500):
        plant.step(SimpleNamespace(tau=tau))
    a = np.linalg.solve(FOUR.M(FOUR.q0), tau - FOUR.g(FOUR.q0))
    assert np.allclose(plant.q, 0.125 * a, atol=1e-10) and np.allclose(plant.v, 0.5 * a, atol=1e-10)
