"""Which matrices are taken as the target of a rotation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tasks import Orientation
from wbc.errors import InvalidInput


@given(
    quaternion=st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4).filter(lambda q: np.linalg.norm(q) > 0.1),
    axis=st.integers(0, 2),
)
def test_every_rotation_is_a_target_and_no_mirror_image_is(quaternion: list[float], axis: int):
    R = Rotation.from_quat(quaternion).as_matrix()
    np.testing.assert_array_equal(Orientation("tool", target=R).target, R)
    mirrored = R.copy()
    mirrored[axis] *= -1.0
    with pytest.raises(InvalidInput, match="mirror image"):
        Orientation("tool", target=mirrored)


@pytest.mark.parametrize("columns", [(0, 1, 2), (1, 2, 0), (2, 0, 1), (0, 2, 1), (2, 1, 0), (1, 0, 2)])
@pytest.mark.parametrize("signs", [(1, 1, 1), (-1, -1, 1), (1, -1, -1), (-1, 1, 1), (1, 1, -1), (-1, -1, -1)])
def test_axes_that_change_places_are_a_rotation_where_their_parity_says_so(columns, signs):
    R = np.eye(3)[list(columns)] * signs
    if round(np.linalg.det(R)) == 1:
        Orientation("tool", target=R)
    else:
        with pytest.raises(InvalidInput):
            Orientation("tool", target=R)
