"""Every other solver, through the qpsolvers package: rebuilt at each call, for comparison and offline work.

Caron et al.: qpsolvers: quadratic programming solvers in Python with a unified API.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from time import perf_counter
from typing import Any, NamedTuple, final

import numpy as np

from wbc.errors import UnknownSolver
from wbc.qp.certificate import Certificate
from wbc.qp.problem import QP, Shape
from wbc.qp.solver import Answer, Session, Solver
from wbc.qp.solvers.kept import explained
from wbc.types import Status, Vec


class Backend(NamedTuple):
    """Module that must be there, package that brings it, and settings that ask for about 1e-9."""

    module: str
    package: str
    settings: dict[str, Any]


BACKENDS = {
    "copt": Backend("coptpy", "coptpy", {"FeasTol": 1e-9, "DualTol": 1e-9}),
    "cvxopt": Backend("cvxopt", "cvxopt", {"abstol": 1e-9, "reltol": 1e-9, "feastol": 1e-9}),
    "ecos": Backend("ecos", "ecos", {"abstol": 1e-9, "reltol": 1e-9, "feastol": 1e-9}),
    "gurobi": Backend("gurobipy", "gurobipy", {"FeasibilityTol": 1e-9, "OptimalityTol": 1e-9}),
    "highs": Backend(
        "highspy",
        "highspy",
        # Its own regularisation, 1e-7, shows in the multipliers.
        {
            "primal_feasibility_tolerance": 1e-9,
            "dual_feasibility_tolerance": 1e-9,
            "qp_regularization_value": 1e-10,
            "qp_iteration_limit": 10_000,  # without one it cycles for ever on some problems
        },
    ),
    "hpipm": Backend("hpipm_python", "hpipm_python", {}),
    "jaxopt_osqp": Backend("jaxopt", "jaxopt", {"tol": 1e-9}),
    "kvxopt": Backend("kvxopt", "kvxopt", {"abstol": 1e-9, "reltol": 1e-9, "feastol": 1e-9}),
    "mosek": Backend("mosek", "mosek cvxopt", {}),
    "nppro": Backend("nppro", "nppro", {}),
    "pdhcg": Backend("pdhcg", "pdhcg", {"OptimalityTol": 1e-9, "FeasibilityTol": 1e-9}),
    "pyqpmad": Backend("pyqpmad", "pyqpmad", {}),
    "qpalm": Backend("qpalm", "qpalm", {"eps_abs": 1e-9, "eps_rel": 0.0}),
    "qpax": Backend("qpax", "qpax", {}),
    "qpoases": Backend("qpoases", "qpoases", {}),
    "qpswift": Backend("qpSWIFT", "qpSWIFT", {}),
    "qtqp": Backend("qtqp", "qtqp", {"atol": 1e-9, "rtol": 0.0}),
    "scs": Backend("scs", "scs", {"eps_abs": 1e-9, "eps_rel": 0.0, "max_iters": 20_000}),
    "sip": Backend("sip_qp_python", "sip-qp-python", {}),
}


@final
@dataclass(frozen=True)
class QpSolvers(Solver):
    """A back end of the qpsolvers package, by its name there.

    Offline: the problem is built anew at each call, and tolerances are the back end's own matter.

    Raises:
        UnknownSolver: no such back end.

    Example:
        >>> QpSolvers("highs").offline
        True
    """

    offline = True

    name: str

    def __post_init__(self) -> None:
        if self.name not in BACKENDS:
            raise UnknownSolver(self.name, BACKENDS)
        backend = BACKENDS[self.name]
        object.__setattr__(self, "requires", ("qpsolvers", backend.module))
        object.__setattr__(self, "package", f"qpsolvers {backend.package}")

    @property
    def settings(self) -> dict[str, Any]:
        """What the back end is told."""
        return dict(BACKENDS[self.name].settings)

    def open(self, shape: Shape) -> QpSolversSession:
        self.require()
        return QpSolversSession(self, shape)


@final
class QpSolversSession(Session):
    """Nothing is kept."""

    def __init__(self, solver: QpSolvers, shape: Shape) -> None:
        super().__init__(solver, shape)
        self._settings = solver.settings

    def _solve(self, qp: QP) -> Answer:
        import qpsolvers

        start = perf_counter()
        problem = qp.to_qpsolvers()
        build_time = perf_counter() - start
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the status says it
            try:
                found = qpsolvers.solve_problem(problem, self.solver.name, None, False, **self._settings)
            except (qpsolvers.QPError, ValueError):
                return Answer.none(qp.shape, Status.FAILED)
        if found.x is None:
            return Answer.none(qp.shape, Status.FAILED)
        up, low = np.isfinite(qp.cu), np.isfinite(qp.cl)
        pushed = _vector(found.z, int(up.sum() + low.sum()))
        z = np.zeros(len(qp.cu))
        z[up] += pushed[: up.sum()]
        z[low] -= pushed[up.sum() :]
        y, z_box = _vector(found.y, qp.n_eq), _vector(found.z_box, qp.n)
        status = Status.SOLVED if found.found else Status.FAILED  # the best it has may still pass the certificate
        return Answer(status, np.array(found.x), y, z, z_box, 0, build_time + (found.build_time or 0.0))

    def _improve(self, qp: QP, answer: Answer, proof: Certificate) -> Answer | None:
        return explained(qp, answer, proof)


def _vector(values: Any, size: int) -> Vec:
    """Multipliers as an array; zeros where the back end gives none."""
    return np.zeros(size) if values is None or len(values) == 0 else np.array(values, dtype=np.float64)
