"""Slips in single tasks, and the test that each must fail."""

CONTRACT = "tests/tasks/test_contract.py::test_a_member_keeps_the_contract"
DIRECTIONS, JOINTS = "tests/tasks/test_directions.py", "tests/tasks/test_joint_tasks.py"
BALANCE, COMPLIANCE = "tests/tasks/test_balance.py", "tests/tasks/test_compliance.py"
SEEN, WHEELS = "tasks/directions.py", "tasks/wheels.py"
BEHIND = f"{DIRECTIONS}::test_straight_behind_is_a_hundredth_beside_it"
TURNS = f"{DIRECTIONS}::test_turning_by_the_yaw_error_reaches_the_heading"
NEAR = f"{DIRECTIONS}::test_distances_down_to_none_push_apart"
GEAR = f"{JOINTS}::test_geared_joints_do_what_the_robot_without_them_would"
LOOP = "tests/tasks/test_loop_closure.py::test_a_schedule_that_lets_feet_go_keeps_loops_closed"

#: (file, old text, new text, test that must fail)
MUTATIONS = [
    ("tasks/relative.py", "- np.dot(spin, d))", "+ np.dot(spin, d))", f"{CONTRACT}[RelativePosition-humanoid]"),
    ("tasks/relative.py", "change[3:] -= ", "change[3:] += ", f"{CONTRACT}[RelativeOrientation-humanoid]"),
    (SEEN, "direction.rate + seen)", "2.0 * seen)", f"{CONTRACT}[Gaze-humanoid]"),
    (SEEN, "f1 = (c * f - 1.0)", "f1 = (c * f + 1.0)", f"{CONTRACT}[AxisAlignment-arm]"),
    (SEEN, "if c < -_COS_BEHIND", "if c < -2.0", BEHIND),
    ("tasks/yaw.py", "- 2.0 * yaw_rate", "- yaw_rate", f"{CONTRACT}[Yaw-arm]"),
    ("tasks/yaw.py", "+ np.pi) % (2.0 * np.pi) - np.pi", ")", TURNS),
    ("tasks/distance.py", "max(r, _NEAREST)", "r", NEAR),
    ("tasks/kinetic_energy.py", "(C + C.T)", "(C - C.T)", f"{CONTRACT}[KineticEnergy-arm]"),
    (
        "tasks/manipulability.py",
        "a_second = cross(spin_rate, a) + ",
        "a_second = ",
        f"{CONTRACT}[ManipulabilityTask-arm]",
    ),
    (WHEELS, " - self.radius * np.dot(spin, m_rate)", "", f"{CONTRACT}[Rolling-arm]"),
    (WHEELS, "drift[:2] += ", "drift[:2] -= ", f"{CONTRACT}[OmniWheel-arm]"),
    ("tasks/joint_coupling.py", "= -ratio", "= ratio", GEAR),
    ("tasks/zero_moment_point.py", "state.com_drift - model.gravity", "state.com_drift", BALANCE),
    ("tasks/center_of_pressure.py", "= -y, 1.0", "= y, 1.0", BALANCE),
    ("tasks/capture_point.py", " - velocity) - ", ") - ", BALANCE),
    ("tasks/admittance.py", "moved = self._compliance", "moved = -self._compliance", COMPLIANCE),
    ("tasks/joint_admittance.py", "self._mobility * torque", "torque", COMPLIANCE),
    ("tasks/impedance.py", "np.dot(J, reached)", "force", COMPLIANCE),
    ("wbc/stack/plans.py", " | self._always", "", LOOP),
]
