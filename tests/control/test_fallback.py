"""The last torques that are left, contacts' default damping, and sensors that give no number: signs and sizes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import wbc
from tasks import ContactForce, MomentumObserver, Posture, TorqueLimits, feet
from wbc.control.fallback import BRAKE_TIME, torque
from wbc.errors import NotSupported
from wbc.testing.strategies import states

ARM, QUADRUPED = wbc.load("arm"), wbc.load("quadruped")
PLAN = wbc.Controller(ARM, wbc.Stack([Posture(ARM.q0)], subject_to=[TorqueLimits(1e6)]), level=wbc.InverseDynamics())


@given(state=states(ARM), carrying=st.one_of(st.none(), st.lists(st.floats(-50.0, 50.0), min_size=7, max_size=7)))
def test_where_nothing_else_is_a_number_the_last_torques_take_energy_out_of_every_joint(state, carrying):
    PLAN.tick(0.0, state.q, 0.0 * state.v)
    before = None if carrying is None else np.asarray(carrying)
    tau = torque(PLAN.plan, state, np.full(7, np.nan), None, before)
    damping = tau - (0.0 if before is None else before)
    np.testing.assert_allclose(damping, -np.diag(state.M) * state.v / BRAKE_TIME, rtol=1e-9, atol=1e-9)


def test_on_legs_what_brakes_the_robot_does_not_depend_on_what_its_tasks_want():
    torques, moving = [], np.linspace(-0.2, 0.2, QUADRUPED.nv)
    for wanted in ([], [ContactForce(feet(QUADRUPED)[0].frame, target=[5.0, 0.0, 90.0])]):
        stack = wbc.Stack([Posture(QUADRUPED.q0), *wanted], contacts=feet(QUADRUPED), subject_to=[TorqueLimits()])
        controller = wbc.Controller(QUADRUPED, stack, level=wbc.InverseDynamics())
        controller.tick(0.0, QUADRUPED.q0, moving)
        torques.append(torque(controller.plan, controller.state, -moving, None, None))
    np.testing.assert_allclose(torques[0], torques[1], rtol=0, atol=1e-6 * np.abs(torques[0]).max())


def test_a_foot_whose_sensor_gives_no_number_is_left_out_of_the_residual():
    contacts = feet(QUADRUPED)
    wrenches = {contact.frame: np.zeros(6) for contact in contacts}
    observer = MomentumObserver(gain=50.0, wrenches=lambda: wrenches)
    stack = wbc.Stack([Posture(QUADRUPED.q0)], contacts=contacts, components=[observer])
    controller = wbc.Controller(QUADRUPED, stack, level=wbc.InverseDynamics())
    for tick in range(6):
        if tick == 3:
            wrenches[contacts[0].frame] = np.array([np.nan, 0.0, 30.0, 0.0, 0.0, np.inf])
        controller.tick(1e-3 * tick, QUADRUPED.q0, np.zeros(QUADRUPED.nv))
        assert np.isfinite(observer.residual).all(), tick


@pytest.mark.parametrize("base", ["fixed", "floating"])
def test_a_robot_that_moves_no_mass_has_kinematics_alone(tmp_path, base):
    hinge = '<parent link="a"/><child link="b"/><limit lower="-1" upper="1" velocity="1" effort="1"/>'
    links = '<link name="a"/><link name="b"/>'
    path = tmp_path / "light.urdf"
    path.write_text(f'<robot name="light">{links}<joint name="hinge" type="revolute">{hinge}</joint></robot>')
    with pytest.warns(UserWarning, match="no inertia moves with"):
        robot = wbc.load(path, base=base)
    stack = wbc.Stack([Posture(robot.q0)])
    with pytest.raises(NotSupported, match=r"light: no inertia moves with .*'hinge', so there are no torques to find"):
        wbc.Controller(robot, stack, level=wbc.InverseDynamics())
    for level in (wbc.VelocityLevel(), wbc.AccelerationLevel()):
        assert wbc.Controller(robot, stack, level=level).tick(0.0, robot.q0, np.zeros(robot.nv)).status.ok
