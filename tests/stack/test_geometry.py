"""Products and rotations for kernels are NumPy's and Pinocchio's, in plain Python and where it can be called compiled.

What is written into its callers has no machine code of its own.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.plain import plain
from wbc.stack.compiled import geometry
from wbc.types import Vec

FORMS: dict[str, Any] = {"compiled": geometry, "plain": plain(geometry)}
PLAIN = FORMS["plain"]
vectors = st.tuples(*[st.floats(-1.0, 1.0)] * 3)


def unit(axis: Any) -> Vec:
    """The axis as a vector of length 1; x where it has hardly a direction."""
    direction = np.array(axis) if np.linalg.norm(axis) > 1e-3 else np.array([1.0, 0.0, 0.0])
    return direction / np.linalg.norm(direction)


@given(a=vectors, b=vectors, s=st.floats(-3.0, 3.0), rows=st.tuples(vectors, vectors, vectors))
def test_products_are_numpys(a: Any, b: Any, s: float, rows: Any) -> None:
    R, x, y = np.array(rows), np.array(a), np.array(b)
    for name, given_, known in (
        ("three", (np.array([7.0, *a, 7.0]), 1), x), ("cross", (a, b), np.cross(x, y)), ("dot", (a, b), x @ y),
        ("plus", (a, s, b), x + s * y), ("times", (R.ravel(), a), R @ x), ("back", (R.ravel(), a), R.T @ x),
    ):  # fmt: skip
        found = getattr(PLAIN, name)(*given_)
        np.testing.assert_allclose(found, known, rtol=0, atol=1e-12, err_msg=name)


@given(w=vectors, r=st.floats(-3.0, 3.0) | st.sampled_from([0.0, 1e-9]), at=vectors)
def test_turning_is_the_exponential_map(w: Any, r: float, at: Any) -> None:
    R, out = pinocchio.exp3(np.array(at)), np.zeros(9)
    for form in FORMS.values():
        form.turn_by(r, np.array(w), R.ravel(), out)
        np.testing.assert_allclose(out.reshape(3, 3), pinocchio.exp3(r * np.array(w)) @ R, rtol=0, atol=1e-12)


@given(angle=st.floats(0.0, np.pi - 1e-6), axis=vectors, near=st.booleans())
def test_rotation_errors_of_any_angle_are_pinocchios(angle: float, axis: Any, near: bool) -> None:
    R = pinocchio.exp3((np.pi - 1e-3 * angle if near else angle) * unit(axis))
    w, e, p = np.zeros(3), np.zeros(6), np.array([0.3, -0.2, 0.1])
    for form in FORMS.values():
        assert form.log3(R, w) == pytest.approx(np.linalg.norm(w), abs=1e-12)
        form.log6(R, p, np.zeros(3), e)
        assert np.linalg.norm(w) <= np.pi + 1e-12
        np.testing.assert_allclose(pinocchio.exp3(w), R, rtol=0, atol=1e-12)
        np.testing.assert_allclose(pinocchio.exp6(e).homogeneous, pinocchio.SE3(R, p).homogeneous, rtol=0, atol=1e-12)
        if not near:  # at π either way round is right
            np.testing.assert_allclose(w, pinocchio.log3(R), rtol=0, atol=1e-9)
            np.testing.assert_allclose(e, pinocchio.log6(pinocchio.SE3(R, p)).vector, rtol=0, atol=1e-9)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-5, 1e-4, 2e-3, 0.029, 0.031, 0.3])
@pytest.mark.parametrize("form", FORMS)
def test_twists_of_small_angles_lose_no_digits(form: str, angle: float) -> None:
    pose, e = pinocchio.SE3(pinocchio.exp3(angle * np.array([0.6, 0.0, 0.8])), np.array([0.3, -0.2, 0.1])), np.zeros(6)
    FORMS[form].log6(pose.rotation, pose.translation, np.zeros(3), e)
    np.testing.assert_allclose(pinocchio.exp6(e).homogeneous, pose.homogeneous, rtol=0, atol=2e-13)


@pytest.mark.parametrize("axis", [(4.0, 2.0, 3.0), (-1.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, -1.0, 1e-9)])
@pytest.mark.parametrize("short_of_pi", [0.0, 1e-16, 1e-12, 1e-9, 1e-3])
@pytest.mark.parametrize("form", FORMS)
def test_half_a_turn_about_any_axis_is_read_from_its_rotation(form: str, axis: Any, short_of_pi: float) -> None:
    R, w = pinocchio.exp3((np.pi - short_of_pi) * unit(axis)), np.zeros(3)
    FORMS[form].log3(R, w)
    np.testing.assert_allclose(pinocchio.exp3(w), R, rtol=0, atol=1e-12)
