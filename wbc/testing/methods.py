"""check_method: the closed form of a method and its QP give one answer, on every solver."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from wbc import checks
from wbc.arguments import tells_arguments
from wbc.errors import NoClosedForm, SolverFailed
from wbc.methods.method import Method
from wbc.qp.solver import Solver
from wbc.qp.solvers import by_name, usable
from wbc.testing.failure import CheckFailed, require

#: What a solver reaches, relative to what is measured. Active-set methods end at rounding, with what the condition of
#: the problem makes of it; the others stop at the library's certificate.
TOLERANCES: Mapping[str, float] = {"pdas": 1e-9, "daqp": 1e-9, "quadprog": 1e-9}
OTHERS = 1e-6

#: Unknowns of a linear program. A method poses it so that every solver reaches these.
LINEAR: Mapping[str, float] = {"alpha": 1e-8, "scale": 1e-8}


def tolerance(solver: str, quantity: str) -> float:
    """The largest difference of this quantity, relative to what it measures, that this solver may show."""
    reached = TOLERANCES.get(solver, OTHERS)
    return min(reached, LINEAR[quantity]) if quantity in LINEAR else reached


@tells_arguments
def check_method(method: Method, solvers: Iterable[str | Solver] | None = None) -> None:
    """Closed form and QP of one method agree, and so do the solvers among themselves.

    On each solver, by default every installed one, ``method.difference(method.solve(solver), method.closed_form())``
    must stay below what that solver reaches (``TOLERANCES``), quantity by quantity. A method without a closed form for
    its options is compared between solvers only: each with the first, in both directions. A solver that gives up
    (:class:`SolverFailed`) fails the check too: formulate the problem so that it can solve it, or leave it out.

    Raises:
        CheckFailed: the solver, the worst quantity and its difference; or the solver that gave up.
        UnknownSolver, SolverMissing: as :func:`wbc.qp.solvers.by_name`.

    Example:
        >>> from wbc.methods import ProjectedGradientStep
        >>> from wbc.testing import check_method
        >>> check_method(ProjectedGradientStep([0.0, 0.5], [1.0, 1.0], v_min=[-1, -1], v_max=[1, 1]))
    """
    checks.instance("method", method, Method, "a wbc.methods.Method")
    named = usable() if solvers is None else checks.items("solvers", solvers, "solvers")
    chosen = [by_name(solver) for solver in named]
    require(chosen, "there is no solver to check the method on")
    answers = [(solver.name, _answer(method, solver)) for solver in chosen]
    try:
        reference = method.closed_form()
    except NoClosedForm:
        pass
    else:
        for name, answer in answers:
            _require(method, f"{name!r}", method.difference(answer, reference), "the closed form", name)
    for name, answer in answers[1:]:
        first, other = answers[0]
        judge = max(first, name, key=lambda solver: tolerance(solver, ""))
        _require(method, f"{name!r}", method.difference(answer, other), f"{first!r}", judge)
        _require(method, f"{first!r}", method.difference(other, answer), f"{name!r}", judge)


def _answer(method: Method, solver: Solver) -> Any:
    try:
        return method.solve(solver)
    except SolverFailed as cause:
        raise CheckFailed(f"{type(method).__name__} on {solver.name!r}: {cause}") from cause


def _require(method: Method, one: str, differences: Mapping[str, float], other: str, judge: str) -> None:
    """Raise for the quantity that is worst compared with what the solver ``judge`` may show; NaN is the worst."""
    excess = {
        name: np.nan_to_num(abs(value), nan=np.inf) / tolerance(judge, name) for name, value in differences.items()
    }
    require(excess, f"{type(method).__name__}.difference named no quantity to compare")
    worst = max(excess, key=excess.__getitem__)
    if excess[worst] > 1.0:
        raise CheckFailed(
            f"{type(method).__name__} on {one}: {worst} differs from {other} by {differences[worst]:.3g} (relative),"
            f" allowed is {tolerance(judge, worst):.3g}"
        )
