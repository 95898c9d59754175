"""A solver in a process of its own answers as it does here, and can be ended."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from typing import ClassVar, final

import numpy as np
import pytest

from wbc.errors import InvalidInput
from wbc.qp import QP, solve
from wbc.qp.problem import Shape
from wbc.qp.solver import Answer, Session, Solver
from wbc.qp.solvers import Guarded, by_name
from wbc.types import Status

GOOD = QP(
    np.eye(3), [-1.0, -2.0, -3.0], A=[[1.0, 1.0, 1.0]], b=[1.0], C=[[1.0, 0.0, 0.0]], cl=[0.2], ub=[9.0, 9.0, 0.5]
)  # fmt: skip


@final
@dataclass(frozen=True)
class Stuck(Solver):
    """Never answers where the cost says 7, and dies where it says 8."""

    name: ClassVar[str] = "stuck"

    def open(self, shape: Shape) -> Session:
        return _StuckSession(self, shape)


class _StuckSession(Session):
    def _solve(self, qp: QP) -> Answer:
        if qp.g[0] == 7.0:
            time.sleep(1000.0)
        if qp.g[0] == 8.0:
            os._exit(1)
        return by_name("daqp").open(qp.shape)._solve(qp)


def moved(first: float) -> QP:
    qp = GOOD.copy()
    qp.g[0] = first
    return qp


def answered_again(session: Session) -> bool:
    """Whether it answers once another process stands ready, which nobody waits for in a solve."""
    for _ in range(600):
        start = time.monotonic()
        status = session.solve(GOOD).status
        assert time.monotonic() - start < 20.0
        if status.ok:
            return True
        time.sleep(0.05)
    return False


def test_answers_are_those_of_the_solver_and_its_faults_end():
    session = Guarded(Stuck(), seconds=3.0).open(GOOD.shape)
    try:
        found, here = session.solve(GOOD), solve(GOOD, "daqp")
        assert found.status is Status.SOLVED
        for part in ("x", "y", "z", "z_box"):
            np.testing.assert_array_equal(getattr(found, part), getattr(here, part))
        for fault, ended in ((7.0, 1), (8.0, 2)):
            start = time.monotonic()
            assert session.solve(moved(fault)).status is Status.FAILED
            assert time.monotonic() - start < 20.0
            assert session.ended == ended
            assert answered_again(session)
    finally:
        session.close()


def test_a_time_that_makes_no_sense_is_refused():
    with pytest.raises(InvalidInput, match="seconds"):
        Guarded(by_name("daqp"), seconds=0.0)
