"""Slips in what joints, frames and distances may do, and the test that each must fail."""

CONTRACT = "tests/tasks/test_contract.py::test_a_member_keeps_the_contract"
JERK, JERK_TESTS = "wbc/stack/jerk.py", "tests/stack/test_jerk.py"
FROM_REST = f"{JERK_TESTS}::test_from_rest_whatever_is_chosen_keeps_jerk_and_all_other_limits"
NEARER = (
    "tests/stack/test_interval.py"
    "::test_velocities_within_positions_and_velocities_alone_are_bounded_by_the_nearer_limit"
)
LIMITS = "tests/control/test_joint_limits.py"
COLLISION, DISTANCES = "wbc/models/collision.py", "tests/models/test_collision.py"
FOUND = f"{DISTANCES}::test_all_that_is_within_reach_is_found_wherever_the_robot_was_before"
MOVES = f"{DISTANCES}::test_an_obstacle_that_moves_changes_distances_by_itself"
SELF = f"{DISTANCES}::test_derivatives_of_self_distances_are_those_of_differences"
AVOIDANCE = "tests/control/test_collision_avoidance.py"
FRAMES = "tests/control/test_frame_limits.py"
SPEED, SPEED_TESTS = "tasks/limits/torque_speed.py", "tests/tasks/test_torque_speed.py"
APART = f"{DISTANCES}::test_pairs_left_out_as_always_apart_never_come_near"

#: (file, old text, new text, test that must fail)
MUTATIONS = [
    # jerk: room for braking to set in, half of it for the approach, the window about the last acceleration
    (JERK, "(dt + braking / least)", "dt", FROM_REST),
    (JERK, "_SHARE = 0.5", "_SHARE = 1.5", FROM_REST),
    (JERK, "soft -= slope", "soft += slope", FROM_REST),
    (JERK, "np.add(self.last, self._window_up, most)", "np.add(self.last, 2.0 * self._window_up, most)", FROM_REST),
    (JERK, "np.minimum(side, upper, out=side)", "pass",
     f"{JERK_TESTS}::test_bounds_are_never_wider_than_without_jerk_limits"),
    (JERK, "soft[self._free] = np.inf", "pass", f"{JERK_TESTS}::test_joints_without_a_jerk_limit_are_as_they_were"),
    ("wbc/stack/interval.py", "        self._jerk = None\n        self._derive()\n\n    @property",
     "        self._derive()\n\n    @property", f"{JERK_TESTS}::test_reset_forgets_the_last_acceleration"),
    ("wbc/control/controller.py", "intervals.remember(", "abs(",
     f"{LIMITS}::test_inside_stays_inside_whatever_is_wished"),
    ("wbc/control/ladder.py", "np.argsort(-np.abs(slack)", "np.argsort(np.abs(slack)",
     f"{LIMITS}::test_torque_limits_stand_above_the_interval_of_a_joint"),
    ("wbc/stack/interval.py", "daxpy(q, self._room_below)", "pass", NEARER),
    ("wbc/stack/interval.py", "self._clear = (q - v * dt)", "self._clear = q", NEARER),
    ("wbc/stack/interval.py", "self._flags[2] = -1", "self._flags[2] = 0", NEARER),
    # barriers
    ("wbc/stack/writers.py", "self._lower -= out.rate", "pass", f"{AVOIDANCE}::test_what_comes_flying_is_dodged"),
    ("wbc/stack/plan.py", "(*above, *stack.levels)", "(*stack.levels, *above)",
     f"{FRAMES}::test_a_law_that_may_give_way_stands_above_every_level_of_tasks"),
    ("tasks/limits/cone.py", "- cos * curvature", "+ cos * curvature", f"{CONTRACT}[ConeLimit-arm]"),
    ("tasks/limits/axis_cone.py", "+ omega.dot(", "- omega.dot(", f"{CONTRACT}[AxisConeLimit-arm]"),
    ("tasks/limits/box.py", "-high[self._high]", "high[self._high]",
     f"{FRAMES}::test_what_starts_inside_stays_inside_whatever_is_wished"),
    ("tasks/limits/support_polygon.py", "self._offsets += self.margin", "self._offsets -= self.margin",
     f"{FRAMES}::test_a_polygon_is_the_hull_of_its_points_less_the_margin"),
    (SPEED, "self._slope = np.array([-slope, slope])", "self._slope = np.array([slope, -slope])",
     f"{SPEED_TESTS}::test_full_up_to_the_corner_then_falling_to_nothing"),
    (SPEED, "np.maximum(left, 0.0, out=left)", "pass",
     f"{SPEED_TESTS}::test_zero_is_always_allowed_and_neither_side_jumps"),
    # distances
    (COLLISION, "moved[self._second] - moved[self._first]", "moved[self._second]", SELF),
    (COLLISION, "way += np.sqrt(np.einsum(\"ij,ij->i\", turned, turned)) * self._radii", "pass",
     f"{DISTANCES}::test_a_shape_that_only_turns_comes_nearer_too"),
    (COLLISION, "way += np.sqrt(np.einsum(\"ij,ij->i\", moved, moved))", "pass", FOUND),
    (COLLISION, "since[pair] + d - self.reach", "since[pair] + 3.0 * (d - self.reach)", FOUND),
    (COLLISION, "            if shape in self._moving", "            if shape < 0", MOVES),
    (COLLISION, "distances + self.ahead * (", "distances - self.ahead * (",
     f"{DISTANCES}::test_the_most_critical_of_many_are_those_that_will_be_nearest"),
    (COLLISION, "(2.0 / _STEP**2)", "(1.0 / _STEP**2)", SELF),
    ("wbc/models/separation.py", "half * self._levers(half)", "0.2 * half * self._levers(half)", APART),
    ("tasks/limits/collision.py", "distances.distance, self.margin", "distances.distance, 0.0",
     f"{AVOIDANCE}::test_the_tool_goes_round_what_it_would_go_through"),
]  # fmt: skip
