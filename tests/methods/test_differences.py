"""Differences of two results do not depend on units, and are no larger than what differs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from tests.methods.problems import scaled_tasks
from tests.methods.torque_problems import CALM, again, problems
from wbc.methods import NullSpaceSaturation, WeightedTorque
from wbc.methods.weighted_torque import Torque


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
