"""Slips in the parameter update, and the test that each must fail."""

UPDATE = "wbc/methods/parameter_update.py"
TESTS = "tests/methods/test_parameter_update.py"
AGREE = f"{TESTS}::test_closed_form_and_qp_agree_on_every_solver"
BOX = f"{TESTS}::test_in_a_box_the_rate_is_that_of_bounded_least_squares"
STEPS = f"{TESTS}::test_steps_never_leave_the_set"

#: (file, old text, new text, test that must fail)
MUTATIONS = [
    # a sign
    (UPDATE, "((low <= rounding) & (rate < 0.0))", "((low <= rounding) & (rate > 0.0))", AGREE),
    (UPDATE, "return np.eye(size, k=1) - np.eye(size)", "return np.eye(size) - np.eye(size, k=1)", TESTS),
    # a factor
    (UPDATE, "self.gain @ (self.Y.T @ self.s)", "self.Y.T @ self.s", BOX),
    (UPDATE, "0.5 * (inverse + inverse.T), -self.Y.T @ self.s,", "self.gain, -self.Y.T @ self.s,",
     f"{TESTS}::test_the_qp_as_it_is_written_has_the_closed_form_as_its_optimum"),
    # the metric
    (UPDATE, "found = answered(nearest(self.qp(), self._free_rate, root(self.gain), solver), solver)",
     "found = answered(nearest(self.qp(), self._free_rate, np.eye(len(self.a_hat)), solver), solver)", BOX),
    # a bound
    (UPDATE, "lb=np.where(low <= rounding, 0.0, -np.inf), ub=np.where(high <= rounding, 0.0, np.inf),",
     "lb=np.where(high <= rounding, 0.0, -np.inf), ub=np.where(low <= rounding, 0.0, np.inf),", BOX),
    (UPDATE, "cu=np.where(rows <= rounding, 0.0, np.inf)", "cu=np.where(rows <= rounding, np.inf, 0.0)",
     f"{TESTS}::test_in_a_polyhedron_what_is_taken_from_the_rate_is_a_push_of_its_rows"),
    (UPDATE, "cu=np.maximum(self.d - self.C @ self.a_hat, 0.0)", "cu=np.full(len(self.d), np.inf)", STEPS),
]  # fmt: skip
