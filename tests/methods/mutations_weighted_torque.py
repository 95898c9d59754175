"""Slips in the weighted torque and in least distances, and the test that each must fail."""

TORQUE, NEAREST = "wbc/methods/weighted_torque.py", "wbc/methods/least_distance.py"
TESTS = "tests/methods/test_weighted_torque.py"
EXACT = f"{TESTS}::test_the_torque_of_the_exercise_is_exact"
LIMITED = f"{TESTS}::test_within_limits_the_optimum_meets_the_conditions_of_optimality"
WRITTEN = f"{TESTS}::test_the_qp_as_it_is_written_has_the_closed_form_as_its_optimum"
PROGRAM = f"{TESTS}::test_the_scale_is_that_of_a_linear_program"
PROVEN = (
    "tests/methods/test_least_distance.py"
    "::test_limits_that_leave_no_point_are_infeasible_and_those_that_leave_one_are_not"
)
WORD = (
    "tests/methods/test_least_distance.py"
    "::test_a_solver_that_calls_everything_infeasible_has_failed_where_there_is_a_point"
)
DEAR = "tests/methods/test_least_distance.py::test_the_scale_is_the_largest_however_dear_its_last_part_is"

#: (file, old text, new text, test that must fail)
MUTATIONS = [
    # a sign
    (TORQUE, "self._inverse @ (tau + self.tau_external - self.n)", "self._inverse @ (tau - self.tau_external - self.n)",
     EXACT),
    (TORQUE, "multipliers = -found.y", "multipliers = found.y", EXACT),
    (TORQUE, "[self.task_acceleration - self.drift, self.e]", "[self.task_acceleration + self.drift, self.e]",
     f"{TESTS}::test_forward_dynamics_give_the_commanded_acceleration"),
    (TORQUE, "H, g = 0.5 * (H + H.T), -M @ (self.W @ (self.tau_0 + gap))",
     "H, g = 0.5 * (H + H.T), -M @ (self.W @ (self.tau_0 - gap))", WRITTEN),
    # a term
    (TORQUE, "return A, self._wanted + A @ (self.n - self.tau_external)", "return A, self._wanted + A @ self.n", EXACT),
    (TORQUE, "tau = self.tau_0 + away @ (Lambda @ missing)", "tau = away @ (Lambda @ missing)", EXACT),
    (TORQUE, " + (self.tau_0 - away @ (Lambda @ (A @ self.tau_0)))", " + self.tau_0", EXACT),
    (TORQUE, "* self.damping])", "* 0.0])",
     "tests/methods/test_weighted_torque_refusals.py::test_damping_leaves_an_error_of_its_square_and_ends_at_tau_0"),
    (TORQUE, "return inverse @ inverse, M", "return inverse @ inverse, inverse",
     f"{TESTS}::test_the_torque_beside_tau_0_lies_in_the_range_of_the_task"),
    # a bound
    (TORQUE, "C, cl, cu, lb, ub = M, lb + gap, ub + gap, -free, free",
     "C, cl, cu, lb, ub = M, ub + gap, lb + gap, -free, free",
     f"{TESTS}::test_all_sets_of_unknowns_have_the_same_optimum"),
    (TORQUE, "lb, ub = np.concatenate([-free, lb]), np.concatenate([free, ub])",
     "lb, ub = np.concatenate([lb, -free]), np.concatenate([ub, free])",
     f"{TESTS}::test_all_sets_of_unknowns_have_the_same_optimum"),
    # what is scaled
    (TORQUE, "direction[: len(self.J)] = self.task_acceleration", "direction[:qp.n_eq] = qp.b",
     f"{TESTS}::test_equalities_and_drift_are_never_scaled"),
    (NEAREST, "A=padded[:n_eq], b=qp.b - direction,", "A=padded[:n_eq], b=qp.b,", PROGRAM),
    (NEAREST, "steeper = nearest(scaled, np.append(centre, 1.0 + slope), wide, solver)", "break", DEAR),
    (NEAREST, "found.x + LONG * onwards", "found.x + onwards", DEAR),
    (NEAREST, "found = replace(steeper, x=exact.x) if exact.status.ok else steeper", "found = steeper", DEAR),
    # least distance
    (NEAREST, "if rest.violation > CONSISTENT * self.size:", "if False:", PROVEN),
    (NEAREST, "if rest.violation > CONSISTENT * self.size:", "if first.status is Status.INFEASIBLE:", WORD),
    (NEAREST, "force[kept] = answer.z / length", "force[kept] = answer.z * length",
     "tests/methods/test_least_distance.py::test_answer_and_multipliers_are_certified_in_the_units_of_the_problem"),
    (NEAREST, "x = centre + root @ answer.x", "x = centre + root.T @ answer.x", LIMITED),
    (NEAREST, "(lower - at)[kept] / length, (upper", "lower[kept] / length, (upper", LIMITED),
]  # fmt: skip
