"""Slips in the solver of problems with bounds alone."""

from __future__ import annotations

BOX, TESTS = "wbc/qp/rows/box.py", "tests/qp/rows/test_row_solvers.py"

MUTATIONS = [
    (BOX, "pull[self._lb == self._ub] = 0.0", "pass",
     f"{TESTS}::test_unknowns_whose_bounds_are_one_may_be_pulled_either_way_and_are_guessed"),
    (BOX, "self._D_tied[items, items] = ", "_ = ",
     f"{TESTS}::test_bounds_that_change_in_every_tick_are_not_guessed_until_they_stand_still"),
    (BOX, "self._changes < RESTLESS and ", "",
     f"{TESTS}::test_bounds_that_change_in_every_tick_are_not_guessed_until_they_stand_still"),
    (BOX, "self._weight / _KAPPA", "1.0 / _KAPPA", f"{TESTS}::test_bounds_alone_are_answered_by_the_box_solver"),
    (BOX, "gradient *= self._metric", "pass", f"{TESTS}::test_bounds_alone_are_answered_by_the_box_solver"),
    (BOX, "daxpy(self._centre, gradient, len(gradient), -1.0)", "pass",
     f"{TESTS}::test_bounds_alone_are_answered_by_the_box_solver"),
    (BOX, "daxpy(self._x, self._under, n, -1.0)", "pass",
     f"{TESTS}::test_bounds_that_come_and_go_are_found_and_forgotten"),
    (BOX, "np.copyto(self._held, self._lb, where=self._at_lower)", "pass",
     f"{TESTS}::test_bounds_that_change_in_every_tick_are_not_guessed_until_they_stand_still"),
    (BOX, "return primal <= tolerance and", "return",
     f"{TESTS}::test_bounds_that_come_and_go_are_found_and_forgotten"),
]  # fmt: skip
