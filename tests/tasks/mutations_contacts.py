"""Slips in contacts, schedules and trajectories, and the test that each must fail."""

SCHEDULE, PLANS, PLAN = "tasks/components/contact_schedule.py", "wbc/stack/plans.py", "wbc/stack/plan.py"
EDGE, INTERNAL, TRAJECTORIES = "tasks/edge.py", "tasks/internal_force.py", "tasks/trajectories.py"
SAYS, MODES = "tests/tasks/test_contact_schedule.py::test_", "tests/stack/test_plans.py::test_"
MOVES, PRESSES = "tests/tasks/test_trajectories.py::test_", "tests/tasks/test_internal_force.py::test_"
FOLLOWS = f"{SAYS}at_every_tick_the_set_is_that_of_the_timeline"
RAMPS = f"{SAYS}the_normal_force_of_a_contact_comes_and_goes_no_faster_than_the_ramp"
RATES = f"{SAYS}while_a_contact_goes_no_normal_force_moves_faster_than_the_force_rate"
STANDS = f"{SAYS}a_robot_that_stands_may_change_its_forces_as_fast_as_it_has_to"
FEELS = f"{SAYS}with_a_sensor_a_contact_is_made_when_it_touches_and_broken_when_the_timeline_says"
TOGETHER = f"{SAYS}feet_that_land_together_may_touch_one_after_the_other_without_surprise"
STARTS = f"{SAYS}a_run_that_starts_again_starts_on_its_feet"
MADE = f"{MODES}a_contact_that_stays_is_held_where_it_was_made_and_a_new_one_where_the_robot_is"
GUESS = f"{MODES}what_held_before_a_change_is_the_first_guess_after_it"
PLACES = f"{MODES}the_forces_of_all_contacts_keep_their_places"
WAITS = f"{MODES}a_set_nobody_announced_is_compiled_between_ticks_and_the_present_plan_holds_until_then"
CONTRACT = "tests/tasks/test_contract.py::test_a_member_keeps_the_contract"
CONE = "tests/tasks/test_edge.py::test_what_forces_at_the_ends_add_up_to_is_in_the_cone"
BAR = f"{PRESSES}a_bar_between_two_contacts_is_felt_as_what_it_presses_with"
ENDS = f"{MOVES}a_minimum_jerk_keeps_its_ends_and_goes_on_uniformly"
RESTS = f"{MOVES}a_pose_begins_and_ends_at_rest_and_a_lift_is_on_top_halfway"
TURNS = f"{MOVES}a_pose_interpolation_is_consistent"

#: (file, old text, new text, test that must fail)
MUTATIONS = [
    # which contacts hold, and how much they may carry
    (SCHEDULE, "for k in (-1, 0, 1)]", "for k in (0, 1)]", FOLLOWS),
    (SCHEDULE, "until - plan.dt - t)", "until - t)", RAMPS),
    (SCHEDULE, "make - self.early <= t + _SAME and self.touching(name)", "make - self.early <= t + _SAME", FEELS),
    (SCHEDULE, "self._held, self._next_change = frozenset(), -inf", "pass", STARTS),
    (SCHEDULE, "for k in range(len(new) + 1):", "for k in range(1):", TOGETHER),
    (SCHEDULE, "plan.normal_floors[place] = min(force - most, limit)", "pass", RATES),
    (SCHEDULE, "min(plan.normal_limits[place], force + most)", "plan.normal_limits[place]", RATES),
    (SCHEDULE, "self._limits.min() < self._weight", "True", STANDS),
    (PLAN, "if self._is_scheduled:", "if False:", RATES),
    # a plan for each set
    (PLANS, "mode.plan.take_over(self.present.plan, state)", "pass", MADE),
    (PLANS, "mode.solver.start_from(self.present.solver)", "pass", GUESS),
    (PLANS, "result[self._places] = forces", "result[: len(forces)] = forces", PLACES),
    (PLANS, "self._waiting.append(asked)", "self._compile(asked)", WAITS),
    (PLAN, "if not any(contact is held for held in former.layout.contacts):", "if True:", MADE),
    # contacts and what they press with
    (EDGE, "out.e[3:] = z, -y", "out.e[3:] = z, y", CONTRACT),
    (EDGE, "drift[:3] += np.cross(twist[3:], twist[:3])", "pass", CONTRACT),
    (EDGE, "-mu * L, -mu, -s]", "-mu * L, -mu, s]", CONE),
    (INTERNAL, "= -half @ R, half @ S", "= half @ R, -half @ S", BAR),
    (INTERNAL, "0.5 / max(", "1.0 / max(", BAR),
    # trajectories
    (TRAJECTORIES, "6 * d - 3 * u_T - 3 * w_T", "6 * d - 3 * u_T + 3 * w_T", ENDS),
    (TRAJECTORIES, "pinocchio.log3(rotation @ self._rotation.T)", "pinocchio.log3(self._rotation.T @ rotation)", RESTS),
    (TRAJECTORIES, "((rest - s) ** 2 - s * rest)", "((rest - s) ** 2 + s * rest)", TURNS),
]
