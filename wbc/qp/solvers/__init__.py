"""The solvers, by name. A new one is a file beside this and a line in ``SOLVERS``.

Example:
    >>> from wbc.qp.solvers import by_name
    >>> by_name("proxqp")
    ProxQp(eps_abs=1e-09, max_iter=100, max_iter_in=50)
"""

from __future__ import annotations

from collections.abc import Mapping

from wbc.errors import UnknownSolver
from wbc.qp.solver import Solver
from wbc.qp.solvers.clarabel_ import Clarabel as Clarabel
from wbc.qp.solvers.daqp_ import Daqp as Daqp
from wbc.qp.solvers.guarded import Guarded as Guarded
from wbc.qp.solvers.osqp_ import Osqp as Osqp
from wbc.qp.solvers.pdas import Pdas as Pdas
from wbc.qp.solvers.piqp_ import Piqp as Piqp
from wbc.qp.solvers.proxqp_ import ProxQp as ProxQp
from wbc.qp.solvers.qpsolvers_ import BACKENDS
from wbc.qp.solvers.qpsolvers_ import QpSolvers as QpSolvers
from wbc.qp.solvers.quadprog_ import Quadprog as Quadprog

#: Every known solver with the settings that a name stands for.
SOLVERS: tuple[Solver, ...] = (
    Pdas(),
    Daqp(),
    ProxQp(),
    Piqp(),
    Osqp(),
    Clarabel(),
    Quadprog(),
    *(QpSolvers(name) for name in BACKENDS),
)
#: What the extras of this package bring.
EXTRAS: Mapping[str, tuple[str, ...]] = {"solvers": ("highs", "piqp", "scs"), "gpl": ("quadprog",)}


def names() -> list[str]:
    """All names, installed or not; the default solver first."""
    return [solver.name for solver in SOLVERS]


def usable() -> list[str]:
    """The names whose packages are installed. Nothing is imported to find out."""
    return [solver.name for solver in SOLVERS if solver.available()]


def by_name(name_or_solver: str | Solver) -> Solver:
    """The solver of this name with its default settings; a :class:`Solver` is returned as it is.

    Raises:
        UnknownSolver: there is no such name.
        SolverMissing: its package is not installed.
    """
    found = name_or_solver if isinstance(name_or_solver, Solver) else None
    for solver in SOLVERS:
        if isinstance(name_or_solver, str) and solver.name == name_or_solver:
            found = solver
    if found is None:
        raise UnknownSolver(name_or_solver, names(), _told())
    found.require()
    return found


def _told() -> str:
    """Which solvers are installed, and what installs the others."""
    others, told = [name for name in names() if name not in usable()], [f"installed: {', '.join(usable())}"]
    for extra, brought in EXTRAS.items():
        if some := [name for name in brought if name in others]:
            told.append(f"from a clone of wbc: pip install '.[{extra}]' for {', '.join(some)}")
    if own := [name for name in others if not any(name in brought for brought in EXTRAS.values())]:
        told.append(f"packages of their own for {', '.join(own)}")
    return "; ".join(told)
