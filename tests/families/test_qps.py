"""Each week other problems of every family: no wrong verdict on any solver for control."""

from __future__ import annotations

import pytest

from tests.families import qps
from tests.seeds import SEED


@pytest.mark.parametrize("solver", ["pdas", "daqp", "proxqp", "osqp", "clarabel"])
def test_no_verdict_on_a_random_qp_is_wrong(solver: str):
    found = list(qps.cases(10 * len(qps.FAMILIES), SEED, [solver]))
    assert not [case for case in found if case.wrong]
    given_up = sum(case.status not in ("SOLVED", "INFEASIBLE", "UNBOUNDED", "THIN") for case in found)
    assert given_up <= (0.03 if solver in ("pdas", "daqp") else 0.06) * len(found)


def test_the_oracle_notices_a_wrong_verdict():
    """An answer that is moved, or a verdict that is exchanged, is called wrong."""
    from dataclasses import replace

    import wbc
    from wbc.qp import QP
    from wbc.types import Status

    noticed = 0
    for index in range(20):
        p = qps.problem(qps.convex, SEED, index)
        true, answer = qps.truth(p), wbc.solve(QP(**p))
        assert qps.judge(p, answer, true) == ""
        moved = replace(answer, x=answer.x + 1e-2 * (1.0 + abs(answer.x)))
        noticed += bool(qps.judge(p, moved, true))
        for status in (Status.INFEASIBLE, Status.UNBOUNDED):
            assert qps.judge(p, replace(answer, status=status), true)
    assert noticed >= 18
