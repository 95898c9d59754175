"""Solver: frozen settings. Session: workspace and warm start; what it answers is certified here, whoever solves."""

from __future__ import annotations

from abc import ABC, abstractmethod
from copy import copy
from dataclasses import replace
from importlib.util import find_spec
from inspect import get_annotations
from time import perf_counter
from typing import Self, final

import numpy as np

from wbc import checks
from wbc.arguments import TellsArguments
from wbc.errors import InvalidProblem, SolverMissing
from wbc.qp.answer import Answer, Counts, Solution
from wbc.qp.certificate import FINE, TOLERANCE, Certificate
from wbc.qp.problem import QP, Shape, moderate
from wbc.qp.proof import contradiction, descent
from wbc.types import Frozen, Status

__all__ = ["Answer", "Counts", "Session", "Solution", "Solver"]

#: Steps of the core that are taken at most from an answer.
_STEPS = 10
#: An answer this near to an optimum, beside its size, is refined to it.
_NEAR = 1e-2


class Session(ABC):
    """Memory of one solver for QPs of one shape: workspace, warm start, and ``counts`` of guesses, where it guesses.

    ``own`` is the certificate of the back end's own answer to the last problem, before its refinement; ``fault`` says
    what is wrong with what the back end returned, or nothing.
    """

    def __init__(self, solver: Solver, shape: Shape) -> None:
        self.solver = solver
        self.shape = shape
        self.counts, self.fault = Counts(), ""
        from wbc.qp.rows.dense import DenseSteps  # compiled code: loaded where a problem is to be solved

        self._steps = DenseSteps(shape)

    @abstractmethod
    def _solve(self, qp: QP) -> Answer:
        """Hand the problem to the back end. The problem has been checked; the answer will be."""

    @final
    def _answered(self, qp: QP) -> Answer:
        """The back end's answer, none where what it returned is none."""
        answer, what = Answer.checked(self._solve(qp), self.shape)
        self.fault = f"solver {self.solver.name!r} returned {what}" if what else ""
        return answer

    def _improved(self, qp: QP, answer: Answer, proof: Certificate) -> tuple[Answer, Certificate]:
        """A better answer with its certificate, where there is one: here what the core makes of the active rows.

        It does not speak for a back end that is far off: that one has failed.
        """
        if not moderate(np.concatenate([answer.x, answer.y, answer.z, answer.z_box])):
            return answer, proof
        self._steps.read(qp)
        self._steps.name(qp, answer)
        better, found = self._onwards(qp, answer, proof)
        if not (np.abs(better.x - answer.x) <= _NEAR * (1.0 + np.abs(answer.x))).all():
            return answer, proof
        better.status, better.iterations, better.build_time = answer.status, answer.iterations, answer.build_time
        return better, found

    @final
    def _onwards(self, qp: QP, answer: Answer, proof: Certificate) -> tuple[Answer, Certificate]:
        """Steps of the core from ``answer`` until one is as fine as it need be, or they add nothing; the best."""
        at, tolerance = answer, self.solver.tolerance
        for k in range(_STEPS):
            if at.status is Status.INFEASIBLE or not moderate(at.x):
                break
            # Far away rounding hides the slope, so nobody goes there where it is proven not to end.
            if k == 1 and self._steps.has_flat and descent(qp, tolerance) is not None:
                break
            at = self._steps.step(qp, at.x)
            at.iterations += answer.iterations
            found, before = at.certificate(qp, tolerance), proof.level
            if found.level < before:
                answer, proof = at, found
            if proof.within(FINE * tolerance) or not (found.level < 0.5 * before or self._steps.has_flat):
                break
        return answer, proof

    def reset(self) -> None:
        """Forget the warm start."""

    def unguarded(self, qp: QP) -> Answer:
        """The back end's own answer to an unchecked problem; it may hang or crash. For reports alone."""
        return self._solve(qp)

    @final
    @np.errstate(all="ignore")  # numbers that overflow have a status; where warnings are errors, nobody sees one
    def solve(self, qp: QP) -> Solution:
        """Check the problem, solve it, check the answer; the same for every back end.

        What the back end returned may be anything: where it is no answer of this shape, ``reason`` says so by the
        solver's name. The certificate decides, not the back end's status. A solution that is not a hundred times finer
        than the tolerance is refined once with the active rows that its multipliers name (:mod:`wbc.qp.rows.dense`),
        and the better of the two is kept. If it still fails, a proof is looked for that there is no solution
        (:mod:`wbc.qp.proof`). Without one the status says how the back end ended, never INFEASIBLE or UNBOUNDED.

        Raises:
            InvalidProblem: what :meth:`QP.check` refuses, or another shape than the session's.
        """
        if not isinstance(qp, QP):
            raise InvalidProblem(f"a session solves a QP, not {qp!r}")
        if qp.shape != self.shape:
            raise InvalidProblem(f"this session was opened for {self.shape}, not {qp.shape}")
        self.fault = ""
        qp.check()
        tolerance = self.solver.tolerance
        start = perf_counter()
        answer = self._answered(qp)
        proof = self.own = answer.certificate(qp, tolerance)
        if not proof.within(FINE * tolerance):
            answer, proof = self._improved(qp, answer, proof)
        elapsed = perf_counter() - start
        status, reason = Status.SOLVED, ""
        if not proof.within(tolerance):
            status, reason = _verdict(qp, answer.status, proof, tolerance)
            reason = self.fault if self.fault and status is Status.FAILED else reason
            if status in (Status.INFEASIBLE, Status.UNBOUNDED):
                answer, proof = Answer.none(qp.shape, status, answer.iterations), Certificate.none()
        return Solution(
            status, answer.x, answer.y, answer.z, answer.z_box, proof, answer.iterations,
            answer.build_time, elapsed - answer.build_time, self.solver.name, reason,
        )  # fmt: skip


def _verdict(qp: QP, claimed: Status, proof: Certificate, tolerance: float) -> tuple[Status, str]:
    """What is true of a problem without a certified answer, and why."""
    if contradiction(qp, tolerance) is not None:
        return Status.INFEASIBLE, "multipliers of the rows and bounds prove that no point meets them all"
    if descent(qp, tolerance) is not None:
        return Status.UNBOUNDED, "the cost falls for ever along a direction that no row or bound ends"
    if claimed in (Status.INFEASIBLE, Status.UNBOUNDED):
        return Status.FAILED, f"the solver says {claimed}, and no proof of that was found"
    why = proof.fault(tolerance) if proof.level < np.inf else "the solver gave no finite answer"
    return (Status.INACCURATE if claimed.ok else claimed), why


class Solver(Frozen, metaclass=TellsArguments):
    """Frozen settings of a QP solver; ``open(shape)`` gives a session with memory.

    ``name`` is what users type, ``requires`` the modules it needs (looked up, not imported).
    ``tolerance`` is the certificate without which no answer is SOLVED;
    ``semidefinite`` says whether H may be singular (a linear program, a task without posture),
    ``repeatable`` whether fresh sessions give the same bits, and ``offline`` is true for a solver that is
    not shown to keep limits to 1e-6 at 1 kHz and so is refused by a controller. ``takes_rows`` is true for the one that
    solves a tick from its rows (:mod:`wbc.qp.rows`); all others get products. ``session`` is what ``open`` makes, and
    ``accuracies`` names the settings, all positive, that say where the solver stops.
    """

    name: str
    requires: tuple[str, ...] = ()
    tolerance: float = TOLERANCE
    semidefinite: bool = True
    repeatable: bool = True
    offline: bool = False
    takes_rows: bool = False
    session: type[Session]
    accuracies: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Refuse settings out of their range: accuracies are positive, and counts at least one."""
        for name in self.accuracies:
            checks.number(name, getattr(self, name), low=0.0, strict=True)
        for name, kind in get_annotations(type(self)).items():
            if kind == "int":
                checks.number(name, getattr(self, name), low=1)

    @property
    def package(self) -> str:
        """What to install."""
        return " ".join(self.requires)

    def open(self, shape: Shape) -> Session:
        """A session for QPs of this shape.

        Raises:
            SolverMissing: the back end is not installed.
        """
        self.require()
        return self.session(self, shape)

    def available(self) -> bool:
        """True if the back end is installed; this imports nothing."""
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
        """The same solver with another accuracy: where it stops, and the certificate a solution needs to be SOLVED.

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
        asked._set(tolerance=tolerance)
        return asked

    def _stopping_at(self, tolerance: float) -> Self:
        """These settings with another accuracy; the same settings if the solver has no accuracy to set."""
        return replace(self, **dict.fromkeys(self.accuracies, tolerance)) if self.accuracies else self  # type: ignore[type-var]
