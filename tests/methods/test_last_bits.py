"""What another processor rounds otherwise decides nothing, and differences of two results do not depend on units."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tests.methods.problems import integer_task, scaled_tasks
from tests.methods.torque_problems import CALM, again, problems
from tests.seeds import generator
from wbc.methods import NullSpaceSaturation, WeightedTorque
from wbc.methods.shared import factors
from wbc.methods.weighted_torque import Torque
from wbc.tolerances import SAME


def integer_torque(rng: np.random.Generator) -> WeightedTorque:
    """Integers: rows and columns that repeat, depend on each other or are zero, and rows that contradict each other."""
    task = integer_task(rng)
    J, n = task.J, task.J.shape[1]
    target, drift = task.target * 1.0, task.drift * rng.integers(0, 2)
    if rng.random() < 0.5:
        times = float(rng.integers(-1, 3))
        J = np.vstack([J, times * J[0]])
        target = np.append(target, rng.choice([times * target[0], 3.0, 1.0]))
        drift = np.append(drift, rng.choice([times * drift[0], 0.0, 1.0]))
    B = rng.integers(-1, 2, size=(n, n)).astype(float)
    return WeightedTorque(
        B @ B.T + np.eye(n), rng.integers(-2, 3, size=n), J, target, drift=drift, tau_0=rng.integers(-2, 3, size=n),
        weight=rng.choice(["inverse_inertia", "identity"]),
    )  # fmt: skip


def last_bits(task: WeightedTorque) -> tuple[float, float]:
    """What last bits of the data may make of the scale, and of the torque through it.

    A scale below one is a quotient: of what rows that depend on each other leave of the right side, which is known to
    last bits of its terms times the condition of the rows, and of what they leave of the target, however little.
    """
    inverse = np.linalg.inv(task.M)
    A, R = task.J @ inverse, np.linalg.cholesky(np.linalg.inv(task.W))
    rows = factors(A @ R, of_unit_length=True)
    terms = np.abs(task.task_acceleration) + np.abs(task.drift) + np.abs(A) @ (np.abs(task.n) + np.abs(task.tau_0))
    left = float(np.linalg.norm(rows.unreached(task.task_acceleration)))
    if left <= SAME * np.linalg.norm(terms / rows.length):  # rows leave nothing of it: one, or never
        return 0.0, 0.0
    scale = 16.0 * np.finfo(float).eps * rows.condition * float(np.linalg.norm(terms / rows.length)) / left
    return scale, scale * float(np.linalg.norm(R @ rows.inverse(task.task_acceleration)))


def test_last_bits_and_the_order_of_joints_and_rows_change_nothing_but_last_bits():
    """What another processor does: other last bits in every product, other places for ties to be found first."""
    rng, kinds = generator("order of rows"), Counter[str]()
    for _ in range(10 * settings().max_examples):
        task = integer_torque(rng)
        m, n = task.J.shape
        rows, joints = rng.permutation(m), rng.permutation(n)
        named = "inverse_inertia" if not np.array_equal(task.W, np.eye(n)) else "identity"
        turned = again(
            task, M=task.M[np.ix_(joints, joints)], n=task.n[joints], J=task.J[np.ix_(rows, joints)],
            task_acceleration=task.task_acceleration[rows], drift=task.drift[rows], tau_0=task.tau_0[joints],
            tau_external=task.tau_external[joints], weight=named, tau_min=None, tau_max=None, equalities=None,
        )  # fmt: skip
        bits = [1.0 + 4.0 * np.finfo(float).eps * rng.integers(-1, 2, size=size) for size in ((m, n), m, m, n)]
        near = again(
            task, J=task.J * bits[0], task_acceleration=task.task_acceleration * bits[1], drift=task.drift * bits[2],
            tau_0=task.tau_0 * bits[3], weight=named, tau_min=None, tau_max=None,
        )  # fmt: skip
        found = task.closed_form()
        kinds["never" if np.isnan(found.scale) else "whole" if found.feasible else "scaled"] += 1
        of_scale, of_torque = last_bits(task)
        for other, places in ((turned, joints), (near, np.arange(n))):
            answer = other.closed_form()
            assert answer.feasible == found.feasible, task
            assert answer.scale == pytest.approx(found.scale, abs=max(1e-12, of_scale), nan_ok=True), task
            room = 1e-9 * (1.0 + np.abs(np.nan_to_num(found.tau)).max()) + of_torque
            np.testing.assert_allclose(answer.tau, found.tau[places], rtol=0, atol=room)
    assert min(kinds[kind] for kind in ("never", "whole", "scaled")) >= settings().max_examples // 5, kinds


def test_a_row_that_nothing_moves_stops_the_task_though_rounding_takes_the_scale_below_zero():
    """0 q̈ = s t holds at s = 0 alone; rounding of the first and last row, which are one, makes it −1e-9."""
    M = [
        [7, -3, -3, 3, 1, -3, 0, 1], [-3, 8, 1, -1, 0, 1, 1, 1], [-3, 1, 7, -2, -3, 0, -2, 0],
        [3, -1, -2, 7, 4, 0, 0, 1], [1, 0, -3, 4, 7, 1, 2, 1], [-3, 1, 0, 0, 1, 6, 2, 0],
        [0, 1, -2, 0, 2, 2, 4, 1], [1, 1, 0, 1, 1, 0, 1, 5],
    ]  # fmt: skip
    unit = np.array([1e4, 1e3, 1.0, 1.0, 1e-4, 2e4])
    J = [
        [-1, -2, 2, 1, 0, 1, -1, 0], [-2, 1, 2, -1, 0, -2, 1, 1], [0] * 8, [-2, 1, 1, 2, 1, 1, 0, 2],
        [-2, -1, 1, 1, 2, 0, -2, -1], [-1, -2, 2, 1, 0, 1, -1, 0],
    ]  # fmt: skip
    task = WeightedTorque(
        np.array(M, dtype=float), [-1.0, 1.0, -2.0, 0.0, 1.0, 0.0, -1.0, 2.0], unit[:, None] * J,
        [-1e4, 1e3, -2e-3, 1.0, 1e-4, -2e4], tau_0=[0.0, -1.0, 2.0, -1.0, -1.0, 2.0, 2.0, 1.0], weight="identity",
    )  # fmt: skip
    assert task.closed_form().scale == pytest.approx(0.0, abs=1e-8)


@given(problems(**CALM, limited=True, damped=False), st.sampled_from([1e-3, 1e3]), st.integers(0, 2**32 - 1))
def test_differences_do_not_depend_on_the_unit_of_torque(task: WeightedTorque, unit: float, seed: int):
    found = task.solve()
    if np.isnan(found.scale):
        return
    rng = np.random.default_rng(seed)
    other = replace(found, tau=found.tau + 0.1 * np.abs(found.tau).max() * rng.normal(size=len(found.tau)))
    in_unit = again(
        task, M=unit * task.M, n=unit * task.n, tau_0=unit * task.tau_0, tau_external=unit * task.tau_external,
        tau_min=unit * task.tau_min, tau_max=unit * task.tau_max,
    )  # fmt: skip

    def scaled(torque: Torque) -> Torque:
        return replace(torque, tau=unit * torque.tau, cost=in_unit._cost(unit * torque.tau))

    expected = task.difference(replace(other, cost=task._cost(other.tau)), found)
    got = in_unit.difference(scaled(other), scaled(found))
    assert got == pytest.approx(expected, rel=1e-6, abs=1e-9)


@given(scaled_tasks(), st.floats(1e-6, 1.0))
def test_scales_that_differ_are_as_far_apart_as_they_are_at_most(task: NullSpaceSaturation, share: float):
    found = task.closed_form()
    assume(found.feasible)
    other = replace(found, scale=(1.0 - share) * found.scale)
    told = task.difference(other, found)["scale"]
    assert told <= abs(other.scale - found.scale)
