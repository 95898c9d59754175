"""The picture of a projected gradient step: what it shows, and that every step of two joints can be drawn."""

from __future__ import annotations

import numpy as np
import pytest

from wbc.errors import NotSupported
from wbc.methods import ProjectedGradientStep


def test_the_picture_shows_box_line_gradient_projection_and_result():
    step = ProjectedGradientStep.from_gradient([[1.0, 0.5]], [0.6], [0.2, 1.3], v_min=[-1, -0.8], v_max=[1, 0.8])
    axes = step.plot().axes[0]
    labels = [text.get_text() for text in axes.get_legend().get_texts()]
    for word in ("limits", "task", "null space", "feasible", "gradient", "projection", "v_task", "result"):
        assert any(word in label for label in labels), word
    assert "joint 2 at its limit" in axes.get_title(loc="left")
    line = next(line for line in axes.lines if line.get_label() == "task, J v = ṙ")
    np.testing.assert_allclose(np.array([1.0, 0.5]) @ line.get_xydata().T, 0.6, atol=1e-9)


@pytest.mark.parametrize(
    "step",
    [
        ProjectedGradientStep([0.0, 0.0], [0.0, 0.0], v_min=[-1, -1], v_max=[1, 1]),
        ProjectedGradientStep([3.0, 0.0], [0.0, 1.0], v_min=[-1, -1], v_max=[1, 1]),
        ProjectedGradientStep([0.5, 0.0], [1.0, 1.0], v_min=[-np.inf, -1], v_max=[1, np.inf]),
        ProjectedGradientStep.from_gradient([[1, 0], [0, 1]], [0.5, 0.5], [1, 1], v_min=[-1, -1], v_max=[1, 1]),
    ],
    ids=["still", "infeasible", "open", "square"],
)
def test_every_step_of_two_joints_can_be_drawn(step: ProjectedGradientStep, tmp_path):
    step.plot().savefig(tmp_path / "step.svg")
    assert (tmp_path / "step.svg").stat().st_size > 5000


def test_only_two_joints_have_a_plane():
    with pytest.raises(NotSupported, match="2 joints"):
        ProjectedGradientStep([0.0], [1.0], v_min=[-1], v_max=[1]).plot()
