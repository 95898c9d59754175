"""Solver: frozen settings. Session: workspace and warm start. Solution: the answer and its certificate."""

from __future__ import annotations

from abc import ABC, abstractmethod
from copy import copy
from dataclasses import dataclass, replace
from importlib.util import find_spec
from time import perf_counter
from typing import Self, final

import numpy as np

from wbc import checks
from wbc.errors import InvalidProblem, SolverMissing
from wbc.qp.certificate import TOLERANCE, Certificate, certificate
from wbc.qp.problem import QP, Shape
from wbc.qp.proof import contradiction, descent
from wbc.qp.refine import Point, refined
from wbc.types import Status, Vec

#: The share of the tolerance at which an answer is as good as it need be.
_FINE = 1e-2


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

    def certificate(self, qp: QP, tolerance: float = TOLERANCE) -> Certificate:
        """The certificate of this answer, recomputed from the data of ``qp``."""
        return certificate(qp, self.x, self.y, self.z, self.z_box, tolerance=tolerance)


@final
@dataclass(frozen=True, slots=True)
class Solution:
    """The answer to a QP: status, x (n,), multipliers y (n_eq,), z (n_in,), z_box (n,).

    ``status`` is SOLVED exactly when our own certificate holds, INFEASIBLE and UNBOUNDED exactly when multipliers or
    a direction were found that prove it; ``reason`` says in a sentence why there is no certified answer, and is empty
    where there is one. Times are in seconds: ``build_time`` is spent on turning the QP into the back end's form,
    ``solve_time`` in the back end and in the refinement of its answer.
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
    reason: str = ""


@final
@dataclass(slots=True)
class Counts:
    """How often the first guess of the active set was right, had to be repaired, or led nowhere."""

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
        """Check the problem, solve it, check the answer; the same for every back end.

        The certificate decides, not the back end's word. An answer that is not a hundred times finer than asked is
        refined once with the active rows that its multipliers name (:mod:`wbc.qp.refine`), and the better of the two
        is kept. Where it still fails, a
        proof is looked for that there is no answer (:mod:`wbc.qp.proof`). Without one the status says how the back
        end ended, never INFEASIBLE or UNBOUNDED.

        Raises:
            InvalidProblem: what :meth:`QP.check` refuses, or another shape than the session's.
        """
        if not isinstance(qp, QP):
            raise InvalidProblem(f"a session solves a QP, not {qp!r}")
        if qp.shape != self.shape:
            raise InvalidProblem(f"this session was opened for {self.shape}, not {qp.shape}")
        qp.check()
        tolerance = self.solver.tolerance
        start = perf_counter()
        answer = self._solve(qp)
        proof = answer.certificate(qp, tolerance)
        second = self._improve(qp, answer, proof)
        if second is not None:
            answer, proof = second, second.certificate(qp, tolerance)
        if not proof.within(_FINE * tolerance):
            answer, proof = _refined(qp, answer, proof, tolerance)
        elapsed = perf_counter() - start
        status, reason = answer.status, ""
        if proof.within(tolerance):
            status = Status.SOLVED
        else:
            status, reason = _verdict(qp, answer.status, proof, tolerance)
            if status in (Status.INFEASIBLE, Status.UNBOUNDED):
                answer, proof = Answer.none(qp.shape, status, answer.iterations), Certificate.none()
        return Solution(
            status, answer.x, answer.y, answer.z, answer.z_box, proof, answer.iterations,
            answer.build_time, elapsed - answer.build_time, self.solver.name, reason,
        )  # fmt: skip


def _refined(qp: QP, answer: Answer, proof: Certificate, tolerance: float) -> tuple[Answer, Certificate]:
    """The answer, or the one of its active rows where that is certified better."""
    point = refined(qp, Point(answer.x, answer.y, answer.z, answer.z_box))
    if point is None:
        return answer, proof
    better = replace(answer, x=point.x, y=point.y, z=point.z, z_box=point.z_box)
    found = better.certificate(qp, tolerance)
    return (better, found) if found.level < proof.level else (answer, proof)


def _verdict(qp: QP, claimed: Status, proof: Certificate, tolerance: float) -> tuple[Status, str]:
    """What is true of a problem without a certified answer, and why."""
    if contradiction(qp, tolerance) is not None:
        return Status.INFEASIBLE, "multipliers of the rows and bounds prove that no point meets them all"
    if descent(qp, tolerance) is not None:
        return Status.UNBOUNDED, "the cost falls for ever along a direction that no row or bound ends"
    if claimed in (Status.INFEASIBLE, Status.UNBOUNDED):
        return Status.FAILED, f"the solver says {claimed}, and no proof of that was found"
    if not proof.level < np.inf:
        return (Status.INACCURATE if claimed.ok else claimed), "the solver gave no finite answer"
    return (Status.INACCURATE if claimed.ok else claimed), proof.fault(tolerance)


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
