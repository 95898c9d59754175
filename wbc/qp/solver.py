"""Solver: frozen settings. Session: workspace and warm start. Solution: the answer and its certificate."""

from __future__ import annotations

from abc import ABC, abstractmethod
from copy import copy
from dataclasses import dataclass
from importlib.util import find_spec
from time import perf_counter
from typing import Self, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidProblem, SolverMissing
from wbc.qp.certificate import TOLERANCE, Certificate, certificate
from wbc.qp.problem import QP, Shape
from wbc.types import Status, Vec


@final
@dataclass(slots=True)
class Answer:
    """What a back end returns: its own word, before anything is checked."""

    status: Status
    x: Vec
    y: Vec
    z: Vec
    z_box: Vec
    iterations: int = 0
    build_time: float = 0.0

    @classmethod
    def none(cls, shape: Shape, status: Status, iterations: int = 0) -> Answer:
        """No answer: NaN everywhere."""
        x, y, z, z_box = (np.full(size, np.nan) for size in (shape.n, shape.n_eq, shape.n_in, shape.n))
        return cls(status, x, y, z, z_box, iterations)


@final
@dataclass(frozen=True, slots=True)
class Solution:
    """The answer to a QP: status, x (n,), multipliers y (n_eq,), z (n_in,), z_box (n,).

    ``status`` is SOLVED exactly when our own certificate holds. Times are in seconds: ``build_time``
    is spent on turning the QP into the back end's form, ``solve_time`` in the back end.
    Arrays are NaN where there is no answer, and the best the back end has where it gave up.

    Example:
        >>> import wbc
        >>> answer = wbc.solve(wbc.QP([[1.0]], [-1.0]))
        >>> answer.status.name, answer.certificate.ok
        ('SOLVED', True)
    """

    status: Status
    x: Vec
    y: Vec
    z: Vec
    z_box: Vec
    certificate: Certificate
    iterations: int = 0
    build_time: float = 0.0
    solve_time: float = 0.0
    solver: str = ""


@final
@dataclass(slots=True)
class Counts:
    """How often the first guess of the active set was right, had to be repaired, or was given up for DAQP."""

    first: int = 0
    repaired: int = 0
    fallback: int = 0

    @property
    def total(self) -> int:
        """All solves."""
        return self.first + self.repaired + self.fallback


class Session(ABC):
    """Memory of one solver for QPs of one shape: workspace and warm start. ``counts`` is kept by those that guess."""

    def __init__(self, solver: Solver, shape: Shape) -> None:
        self.solver = solver
        self.shape = shape
        self.counts = Counts()

    @abstractmethod
    def _solve(self, qp: QP) -> Answer:
        """Hand the problem to the back end. The problem has been checked; the answer will be."""

    def _improve(self, qp: QP, answer: Answer, proof: Certificate) -> Answer | None:
        """A second answer for a session that can do better than the first; ``None`` keeps that."""
        return None

    def reset(self) -> None:
        """Forget the warm start."""

    def unguarded(self, qp: QP) -> Answer:
        """The back end's own word on a problem that nobody looked at; it may hang or crash. For reports alone."""
        return self._solve(qp)

    @final
    def solve(self, qp: QP) -> Solution:
        """Check the problem, solve it, check the answer.

        The certificate decides, not the back end's word: SOLVED means that it holds, an answer that was called
        solved and fails it is INACCURATE, and one that came with a warning and passes is SOLVED.

        Raises:
            InvalidProblem: what :meth:`QP.check` refuses, or another shape than the session's.
        """
        if qp.shape != self.shape:
            raise InvalidProblem(f"this session was opened for {self.shape}, not {qp.shape}")
        qp.check()
        start = perf_counter()
        answer = self._solve(qp)
        elapsed = perf_counter() - start
        proof = certificate(qp, answer.x, answer.y, answer.z, answer.z_box)
        start = perf_counter()
        second = self._improve(qp, answer, proof)
        if second is not None:
            elapsed += perf_counter() - start
            answer = second
            proof = certificate(qp, answer.x, answer.y, answer.z, answer.z_box)
        status = answer.status
        if proof.within(self.solver.tolerance):
            status = Status.SOLVED
        elif status.ok:
            status = Status.INACCURATE
        return Solution(
            status, answer.x, answer.y, answer.z, answer.z_box, proof, answer.iterations,
            answer.build_time, elapsed - answer.build_time, self.solver.name,
        )  # fmt: skip


class Solver(ABC):
    """Frozen settings of a QP solver; ``open(shape)`` gives a session with memory.

    ``name`` is what users type, ``requires`` the modules it needs (looked up, not imported),
    ``package`` what to install. ``tolerance`` is the certificate without which no answer is SOLVED;
    ``semidefinite`` says whether H may be singular (a linear program, a task without posture),
    ``repeatable`` whether fresh sessions give the same bits, and ``offline`` is true for a solver that is
    not shown to keep limits to 1e-6 at 1 kHz and so is refused by a controller.
    """

    name: str
    requires: tuple[str, ...] = ()
    package: str = ""
    tolerance: float = TOLERANCE
    semidefinite: bool = True
    repeatable: bool = True
    offline: bool = False

    @abstractmethod
    def open(self, shape: Shape) -> Session:
        """A session for QPs of this shape.

        Raises:
            SolverMissing: the back end is not installed.
        """

    def available(self) -> bool:
        """Whether the back end is installed; nothing is imported to find out."""
        return all(find_spec(module) is not None for module in self.requires)

    def require(self) -> None:
        """Raise :class:`SolverMissing` unless the back end is installed."""
        if not self.available():
            raise SolverMissing(self.name, self.package)

    def solve(self, qp: QP) -> Solution:
        """Solve one QP in a fresh session."""
        return self.open(qp.shape).solve(qp)

    @final
    def at(self, tolerance: float) -> Self:
        """The same solver asked for another accuracy: where it stops, and the certificate an answer needs to be SOLVED.

        Raises:
            InvalidInput: a tolerance that is not positive.

        Example:
            >>> from wbc.qp.solvers import by_name
            >>> coarse = by_name("osqp").at(1e-3)
            >>> coarse.eps_abs, coarse.tolerance
            (0.001, 0.001)
        """
        tolerance = checks.number("tolerance", tolerance, low=0.0, strict=True)
        asked = copy(self._stopping_at(tolerance))
        object.__setattr__(asked, "tolerance", tolerance)  # settings are frozen for everybody else
        return asked

    def _stopping_at(self, tolerance: float) -> Self:
        """These settings with another accuracy; themselves where a solver can be asked for none."""
        del tolerance
        return self
