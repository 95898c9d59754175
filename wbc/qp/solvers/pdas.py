"""Primal-dual active set: the working-set loop of :mod:`wbc.qp.rows.core`, for a QP with a dense H.

From one problem to the next of a sequence the active set rarely changes, so the last one is nearly always right and a
solve is one step (:mod:`wbc.qp.rows.dense`). The certificate decides whether another one is needed.

Bergounioux, Ito, Kunisch: Primal-dual strategy for constrained optimal control problems, SIAM J. Control and
Optimization 37(4), 1999.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np

from wbc.qp.answer import Answer
from wbc.qp.certificate import Certificate
from wbc.qp.problem import QP
from wbc.qp.solver import Session, Solver


@final
class PdasSession(Session):
    """The working set between solves, and what came of the guesses in ``counts``."""

    def reset(self) -> None:
        self._steps.core.reset()

    def _solve(self, qp: QP) -> Answer:
        self._steps.read(qp)
        answer = self._steps.step(qp, np.zeros(qp.n))
        self.counts.add(*self._steps.core.work)
        return answer

    def _improved(self, qp: QP, answer: Answer, proof: Certificate) -> tuple[Answer, Certificate]:
        return self._onwards(qp, answer, proof)


@final
@dataclass(frozen=True)
class Pdas(Solver):
    """The default solver. It has no settings, asks no other one, and solves a tick of a controller from its rows.

    Example:
        >>> from wbc.qp import QP
        >>> qp = QP([[1.0]], [-3.0], ub=[2.0])
        >>> session = Pdas().open(qp.shape)
        >>> session.solve(qp).x, session.solve(qp).x, session.counts
        (array([2.]), array([2.]), Counts(first=1, repaired=1, fallback=0))
    """

    name = "pdas"
    takes_rows = True
    session = PdasSession
