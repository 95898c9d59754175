"""Slips in the fault fraction, and the test that each must fail."""

FRACTION = "wbc/methods/fault_fraction.py"
TESTS = "tests/methods/test_fault_fraction.py"
AGREE = f"{TESTS}::test_closed_form_and_qp_agree_on_every_solver"
COUPLED = f"{TESTS}::test_a_coupled_weight_lets_joints_explain_each_other"

#: (file, old text, new text, test that must fail)
MUTATIONS = [
    # a sign
    (FRACTION, "self.residual[known] + np.linalg.solve(", "self.residual[known] - np.linalg.solve(", COUPLED),
    (FRACTION, "-tau * (self.weight[known] @ self.residual)", "tau * (self.weight[known] @ self.residual)",
     f"{TESTS}::test_the_qp_as_it_is_written_has_the_closed_form_as_its_optimum"),
    # a term
    (FRACTION, "inverse_root(self.weight[np.ix_(known, known)]) / tau[:, None]",
     "inverse_root(self.weight[np.ix_(known, known)])",
     f"{TESTS}::test_the_fractions_are_those_of_bounded_least_squares"),
    (FRACTION, "known = self.identifiable\n        ratio", "known = self.tau < np.inf\n        ratio",
     f"{TESTS}::test_a_joint_that_is_asked_for_nothing_is_not_known"),
    # a bound
    (FRACTION, "ub=np.ones(len(tau)),", "ub=2.0 * np.ones(len(tau)),",
     f"{TESTS}::test_the_fractions_are_those_of_bounded_least_squares"),
    (FRACTION, "np.clip(ratio, 0.0, 1.0)", "np.clip(ratio, -1.0, 1.0)", AGREE),
]  # fmt: skip
