"""The force at a point that explains a residual: least squares, and within a friction cone."""

from __future__ import annotations

import numpy as np
from hypothesis import example, given, settings
from hypothesis import strategies as st

from wbc.methods import ContactEstimate
from wbc.methods.contact_estimate import UNFELT
from wbc.testing import check_method


@given(st.integers(0, 9999), st.integers(3, 9))
@example(seed=217, joints=3)  # a direction that the joints hardly feel
def test_a_force_that_was_there_is_found(seed: int, joints: int) -> None:
    """But for the share δ / (λ + δ) of what lies along a direction of curvature λ, where δ is what unfelt ones get."""
    rng = np.random.default_rng(seed)
    J, force, weight = rng.standard_normal((3, joints)), 20.0 * rng.standard_normal(3), rng.uniform(0.1, 10.0, joints)
    found = ContactEstimate(J, -J.T @ force, weight=weight).closed_form()
    curvature = np.linalg.eigvalsh((J * weight) @ J.T)
    share, rounding = UNFELT * curvature.sum() / curvature[0], 1e-14 * curvature[-1] / curvature[0]
    assert np.linalg.norm(found.force - force) <= (share + rounding) * np.linalg.norm(force)
    assert found.unexplained < 1e-4


@settings(max_examples=20)
@given(st.integers(0, 9999), st.booleans())
def test_every_solver_gives_the_same(seed: int, surface: bool) -> None:
    rng = np.random.default_rng(seed)
    where = {"normal": rng.standard_normal(3), "friction": 0.5} if surface else {}
    check_method(ContactEstimate(rng.standard_normal((3, 7)), rng.standard_normal(7), **where))


@given(st.integers(0, 9999), st.floats(0.1, 1.0))
def test_the_force_pushes_and_does_not_slip(seed: int, friction: float) -> None:
    rng = np.random.default_rng(seed)
    normal = rng.standard_normal(3)
    normal /= np.linalg.norm(normal)
    J, r = rng.standard_normal((3, 7)), rng.standard_normal(7)
    cone = ContactEstimate(J, r, normal=normal, friction=friction)
    force = cone.solve().force
    inward = -float(force @ normal)
    assert inward >= -1e-7
    assert np.linalg.norm(force + inward * normal) <= 2.0**0.5 * friction * inward + 1e-7
    assert cone.solve().unexplained >= ContactEstimate(J, r).closed_form().unexplained - 1e-7


def test_what_no_joint_feels_is_no_force() -> None:
    J = np.vstack([np.eye(2), np.zeros((1, 2))])
    assert ContactEstimate(J, [1.0, 2.0]).closed_form().force[2] == 0.0
