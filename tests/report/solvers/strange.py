"""Solvers that nobody should trust: one never answers, one takes its process down, one calls everything solved, and one
is wrong by a little."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import dataclass
from typing import final

import numpy as np

from wbc.qp import QP, Session, Shape, Solver, solve
from wbc.qp.solver import Answer
from wbc.types import Status


class Strange(Solver):
    """Behaves on small problems, so that its process starts, and badly on others."""

    def open(self, shape: Shape) -> Session:
        return StrangeSession(self, shape)


@final
@dataclass(frozen=True)
class Hanging(Strange):
    """Never answers where there are more than three variables."""

    name = "hanging"


@final
@dataclass(frozen=True)
class Crashing(Strange):
    """Takes its process down where there are more than three variables."""

    name = "crashing"


@final
@dataclass(frozen=True)
class Lying(Strange):
    """Calls zero the solution of everything."""

    name = "lying"


@final
@dataclass(frozen=True)
class Careless(Strange):
    """Is off by a thousandth, with the right multipliers."""

    name = "careless"


class StrangeSession(Session):
    """All of them."""

    def _solve(self, qp: QP) -> Answer:
        n, n_eq, n_in = qp.shape
        if n > 3 and self.solver.name == "hanging":
            time.sleep(1000.0)
        if n > 3 and self.solver.name == "crashing":
            os.kill(os.getpid(), signal.SIGSEGV)
        if self.solver.name == "careless":
            right = solve(qp)
            return Answer(Status.SOLVED, 1e-3 + right.x, right.y, right.z, right.z_box)
        print("what a back end prints must not disturb anybody")
        return Answer(Status.SOLVED, np.zeros(n), np.zeros(n_eq), np.zeros(n_in), np.zeros(n))
