"""Least violation finds where rows contradict each other, and nothing where they do not."""

from __future__ import annotations

import numpy as np

from wbc.qp import QP
from wbc.qp.relax import least_violation


def test_rows_that_can_be_met_give_nothing():
    assert least_violation(QP(np.eye(2), [1.0, 1.0], C=[[1.0, 1.0]], cl=[0.0], cu=[1.0], lb=[0.0, 0.0])) == []


def test_a_bound_and_an_equality_share_what_is_missing():
    qp = QP(np.eye(1), [0.0], A=[[1.0]], b=[3.0], ub=[1.0], rows=[("aim", "x", "m"), ("wall", "x", "m")])
    found = {violation.row.owner: violation.amount for violation in least_violation(qp)}
    np.testing.assert_allclose([found["aim"], found["wall"]], [-1.0, 1.0], atol=1e-8)


def test_rows_that_are_kept_hold_exactly():
    qp = QP(np.eye(1), [0.0], A=[[1.0]], b=[3.0], ub=[1.0], rows=[("aim", "x", "m"), ("wall", "x", "m")])
    found = least_violation(qp, keep=lambda row: row.owner == "wall")
    assert [violation.row.owner for violation in found] == ["aim"]
    np.testing.assert_allclose(found[0].amount, -2.0, atol=1e-8)
