"""Every other solver, through the qpsolvers package: rebuilt at each call, for comparison and offline work.

Caron et al.: qpsolvers: quadratic programming solvers in Python with a unified API.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from time import perf_counter
from types import MappingProxyType
from typing import Any, NamedTuple, final

import numpy as np

from wbc.errors import UnknownSolver
from wbc.qp.problem import QP
from wbc.qp.solver import Answer, Session, Solver
from wbc.tolerances import ACCURACY
from wbc.types import Status, Vec


class Backend(NamedTuple):
    """Modules that must be there, by the names of their packages; which settings are tolerances, and the others."""

    modules: str
    tolerances: tuple[str, ...] = ()
    others: Mapping[str, Any] = MappingProxyType({})


BACKENDS = {
    "copt": Backend("coptpy", ("FeasTol", "DualTol")),
    "cvxopt": Backend("cvxopt", ("abstol", "reltol", "feastol")),
    "ecos": Backend("ecos", ("abstol", "reltol", "feastol")),
    "gurobi": Backend("gurobipy", ("FeasibilityTol", "OptimalityTol")),
    "highs": Backend(
        "highspy",
        ("primal_feasibility_tolerance", "dual_feasibility_tolerance"),
        # Its own regularisation, 1e-7, shows in the multipliers; without a limit it cycles for ever on some problems.
        {"qp_regularization_value": ACCURACY / 10, "qp_iteration_limit": 10_000},
    ),
    "hpipm": Backend("hpipm_python"),
    "jaxopt_osqp": Backend("jaxopt", ("tol",)),
    "kvxopt": Backend("kvxopt", ("abstol", "reltol", "feastol")),
    "mosek": Backend("mosek cvxopt"),
    "nppro": Backend("nppro"),
    "pdhcg": Backend("pdhcg", ("OptimalityTol", "FeasibilityTol")),
    "pyqpmad": Backend("pyqpmad"),
    "qpalm": Backend("qpalm", ("eps_abs",), {"eps_rel": 0.0}),
    "qpax": Backend("qpax"),
    "qpoases": Backend("qpoases"),
    "qpswift": Backend("qpSWIFT"),
    "qtqp": Backend("qtqp", ("atol",), {"rtol": 0.0}),
    "scs": Backend("scs", ("eps_abs",), {"eps_rel": 0.0, "max_iters": 20_000}),
    "sip": Backend("sip_qp_python"),
}


@final
class QpSolversSession(Session):
    """Nothing is kept."""

    solver: QpSolvers

    def _solve(self, qp: QP) -> Answer:
        import qpsolvers

        if self.solver.name == "highs":
            _greet_unseen()
        start = perf_counter()
        problem = qp.to_qpsolvers()
        build_time = perf_counter() - start
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the status says it
            try:
                found = qpsolvers.solve_problem(problem, self.solver.name, None, False, **self.solver.settings)
            except (qpsolvers.QPError, ValueError):
                return Answer.none(qp.shape, Status.FAILED)
        if found.x is None or found.x.shape != (qp.n,):  # HiGHS gives a point of no size where it gives up
            return Answer.none(qp.shape, Status.FAILED)
        up, low = np.isfinite(qp.cu), np.isfinite(qp.cl)
        pushed = _vector(found.z, int(up.sum() + low.sum()))
        z = np.zeros(len(qp.cu))
        z[up] += pushed[: up.sum()]
        z[low] -= pushed[up.sum() :]
        y, z_box = _vector(found.y, qp.n_eq), _vector(found.z_box, qp.n)
        status = Status.SOLVED if found.found else Status.FAILED  # the best it has may still pass the certificate
        return Answer(status, np.array(found.x), y, z, z_box, 0, build_time + (found.build_time or 0.0))


@final
@dataclass(frozen=True)
class QpSolvers(Solver):
    """A back end of the qpsolvers package, by its name there.

    Offline: the problem is built anew at each call, and each back end has its own meaning of ``accuracy``.

    Raises:
        UnknownSolver: no such back end.
        InvalidInput: an accuracy that is not positive.

    Example:
        >>> QpSolvers("highs").offline
        True
    """

    offline = True
    session = QpSolversSession
    accuracies = ("accuracy",)

    name: str
    accuracy: float = ACCURACY

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.name not in BACKENDS:
            raise UnknownSolver(self.name, BACKENDS)
        self._set(requires=("qpsolvers", *BACKENDS[self.name].modules.split()))

    @property
    def settings(self) -> dict[str, Any]:
        """The settings of the back end."""
        backend = BACKENDS[self.name]
        return dict.fromkeys(backend.tolerances, self.accuracy) | dict(backend.others)


@cache
def _greet_unseen() -> None:
    """Let the first object of HiGHS in this process, which prints a greeting, be one that may not print."""
    import highspy

    # Highs itself may greet before it can be told anything; the class that it extends does not.
    plain = next(kind for kind in reversed(highspy.Highs.__mro__) if hasattr(kind, "setOptionValue"))
    first = plain()
    first.setOptionValue("log_to_console", False)
    first.run()


def _vector(values: Any, size: int) -> Vec:
    """Multipliers as an array; zeros where the back end gives none."""
    return np.zeros(size) if np.shape(values) != (size,) else np.array(values, dtype=np.float64)
