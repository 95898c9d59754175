"""What ``check_method`` promises: wrong methods are caught, and the sentence says which solver and which quantity."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from wbc.errors import NoClosedForm, SolverFailed, UnknownSolver
from wbc.methods import Method
from wbc.qp import QP, Solver, solve
from wbc.qp.solvers import by_name, usable
from wbc.testing import CheckFailed, check_method
from wbc.testing.methods import LINEAR, TOLERANCES, tolerance


@dataclass(frozen=True)
class Nearest(Method):
    """The number in [0, 1] that is nearest to ``wanted``; ``slip`` is what its formula is wrong by."""

    wanted: float
    slip: float = 0.0
    quantity: str = "number"
    formula: bool = True
    drift: tuple[tuple[str, float], ...] = ()

    def closed_form(self) -> float:
        if not self.formula:
            raise NoClosedForm("switched off")
        return float(np.clip(self.wanted, 0.0, 1.0)) + self.slip

    def qp(self) -> QP:
        return QP([[1.0]], [-self.wanted], lb=[0.0], ub=[1.0])

    def solve(self, solver: str | Solver = "pdas") -> float:
        name = by_name(solver).name
        return float(solve(self.qp(), solver).x[0]) + dict(self.drift).get(name, 0.0)

    def difference(self, result: float, reference: float) -> Mapping[str, float]:
        return {"something else": 0.0, self.quantity: abs(result - reference)}


def test_a_method_whose_two_ways_agree_passes_on_every_solver():
    check_method(Nearest(3.0))
    check_method(Nearest(0.25))


def test_a_slip_in_the_closed_form_is_found_and_named():
    with pytest.raises(CheckFailed, match=r"Nearest on 'daqp': number differs from the closed form by 0\.001 .*1e-09"):
        check_method(Nearest(3.0, slip=1e-3), solvers=["daqp"])


def test_a_slip_below_what_the_solver_reaches_is_not_held_against_it():
    check_method(Nearest(3.0, slip=1e-8), solvers=["proxqp"])
    with pytest.raises(CheckFailed):
        check_method(Nearest(3.0, slip=1e-8), solvers=["daqp"])


def test_what_a_linear_program_determines_is_held_to_more():
    with pytest.raises(CheckFailed, match="scale"):
        check_method(Nearest(3.0, slip=1e-7, quantity="scale"), solvers=["proxqp"])


def test_without_a_closed_form_solvers_are_compared_among_themselves():
    check_method(Nearest(3.0, formula=False, slip=1.0))
    with pytest.raises(CheckFailed, match=r"'daqp': number differs from 'pdas' by 0\.5"):
        check_method(Nearest(3.0, formula=False, drift=(("daqp", 0.5),)), solvers=["pdas", "daqp"])


def test_nan_is_the_largest_difference():
    with pytest.raises(CheckFailed, match="number differs"):
        check_method(Nearest(3.0, slip=np.nan), solvers=["pdas"])


@pytest.mark.parametrize("slip", [-1e-3, 1e-3])
def test_a_difference_with_a_sign_hides_no_slip(slip: float):
    class Signed(Nearest):
        def difference(self, result: float, reference: float) -> Mapping[str, float]:
            return {"number": result - reference}

    check_method(Signed(3.0))
    with pytest.raises(CheckFailed, match="number differs"):
        check_method(Signed(3.0, slip=slip))


def test_a_check_that_compares_nothing_fails():
    with pytest.raises(CheckFailed, match="no solver"):
        check_method(Nearest(3.0), solvers=[])
    with pytest.raises(CheckFailed, match=r"Silent\.difference named no quantity"):
        check_method(type("Silent", (Nearest,), {"difference": lambda *_: {}})(3.0), solvers=["pdas"])


@pytest.mark.parametrize("tired", ["daqp", "proxqp"])
def test_a_solver_that_gives_up_is_named(tired: str):
    class GivingUp(Nearest):
        def solve(self, solver: Any = "pdas") -> float:
            if by_name(solver).name == tired:
                raise SolverFailed(tired, "tired")
            return super().solve(solver)

    with pytest.raises(CheckFailed, match=rf"GivingUp on '{tired}': .*tired"):
        check_method(GivingUp(3.0))
    check_method(GivingUp(3.0), solvers=[name for name in usable() if name != tired])


def test_solvers_are_names_or_solvers_with_settings():
    check_method(Nearest(3.0), solvers=[by_name("daqp"), "pdas"])
    with pytest.raises(UnknownSolver, match="daqp"):
        check_method(Nearest(3.0), solvers=["dapq"])


def test_every_installed_solver_is_asked():
    asked: list[str] = []

    class Listening(Nearest):
        def solve(self, solver: Any = "pdas") -> float:
            asked.append(by_name(solver).name)
            return super().solve(solver)

    check_method(Listening(3.0))
    assert asked == usable()


def test_exact_solvers_are_held_to_nine_digits():
    assert {tolerance(name, "x") for name in ("pdas", "daqp", "quadprog")} == {1e-9}
    assert max(TOLERANCES.values()) < tolerance("scs", "x") <= 1e-6
    assert all(tolerance("scs", quantity) <= 1e-8 for quantity in LINEAR)
