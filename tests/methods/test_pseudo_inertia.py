"""The nearest body: by eigenvalues and by a QP of four rows, on every solver."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from wbc.methods import PseudoInertia
from wbc.testing import check_method
from wbc.types import Vec

SIZES = np.array([2.0, 0.2, 0.2, 0.2, 0.05, 0.02, 0.05, 0.02, 0.02, 0.05])


def drawn(seed: int) -> Vec:
    return SIZES * np.random.default_rng(seed).standard_normal(10)


@settings(max_examples=max(20, settings.default.max_examples // 2))
@given(st.integers(0, 9999))
def test_both_ways_agree_on_every_solver(seed: int) -> None:
    check_method(PseudoInertia(drawn(seed), length=0.2))


@given(st.integers(0, 9999), st.sampled_from([0.05, 0.1, 0.5]))
def test_the_answer_is_a_body_and_bodies_stay_as_they_are(seed: int, length: float) -> None:
    found = PseudoInertia(drawn(seed), length=length, floor=1e-4).closed_form()
    assert found.smallest >= 1e-4 * (1 - 1e-9)
    again = PseudoInertia(found.parameters, length=length, floor=1e-4)
    assert again.smallest == pytest.approx(found.smallest, abs=1e-9)
    np.testing.assert_allclose(again.closed_form().parameters, found.parameters, atol=1e-9)


@given(st.integers(0, 9999))
def test_no_point_mass_is_nearer(seed: int) -> None:
    """The optimality condition on the cone: against every point mass, which span it."""
    off, rng = drawn(seed), np.random.default_rng(seed)
    x, Q = PseudoInertia(off, floor=1e-9).closed_form().parameters, PseudoInertia.metric()
    for _ in range(20):
        m, c = rng.exponential(2.0), 0.2 * rng.standard_normal(3)
        about = m * (c @ c * np.eye(3) - np.outer(c, c))
        other = np.array([m, *m * c, *about[np.triu_indices(3)][[0, 1, 3, 2, 4, 5]]])
        assert (off - x) @ Q @ (other - x) <= 1e-6 * (1 + np.abs(off).max()) ** 2 * (1 + m)


def test_a_mass_that_is_not_negative_is_not_enough() -> None:
    """Ixx > Iyy + Izz: no distribution of mass is like that."""
    assert PseudoInertia([1.0, 0, 0, 0, 0.1, 0, 0.01, 0, 0, 0.01]).smallest < 0.0
