"""Slips in the momentum residual, and the test that each must fail."""

RESIDUAL = "wbc/methods/momentum_residual.py"
TESTS = "tests/methods/test_momentum_residual.py"
EXERCISE = f"{TESTS}::test_a_total_fault_of_the_first_actuator_shows_as_in_the_exercise"
ZERO = f"{TESTS}::test_without_a_fault_the_residual_is_zero"

#: (file, old text, new text, test that must fail)
MUTATIONS = [
    # a sign
    (RESIDUAL, "missing = tau - beta - (p - before) / self.dt", "missing = tau + beta - (p - before) / self.dt", ZERO),
    (RESIDUAL, "missing = tau - beta - (p - before) / self.dt", "missing = tau - beta + (p - before) / self.dt", ZERO),
    # a term
    (RESIDUAL, "residual + self._share * (missing - residual)", "residual + self._share * missing", EXERCISE),
    (RESIDUAL, "missing = tau - beta - (p - before) / self.dt", "missing = tau - beta - p / self.dt", EXERCISE),
    (RESIDUAL, '"exact": -np.expm1(-product)', '"exact": product',
     f"{TESTS}::test_the_other_schemes_are_stable_and_monotone_always"),
    (RESIDUAL, "product / (1.0 + product)", "product / (2.0 + product)",
     f"{TESTS}::test_the_other_schemes_are_stable_and_monotone_always"),
    # the start
    (RESIDUAL, 'self._momentum = checks.array("p0", p0, (size,))',
     'self._momentum = 0.0 * checks.array("p0", p0, (size,))', EXERCISE),
    # a bound
    (RESIDUAL, "value * self.dt >= 2.0", "value * self.dt > 2.0", f"{TESTS}::test_bad_arguments_are_named"),
]  # fmt: skip
