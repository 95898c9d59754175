"""The picture of a projected gradient step: what it shows, and that every step of two joints can be drawn."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

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


UNITS = {"J": [[1.0, 0.5]], "rdot": [0.6], "v_min": [-1.0, -0.8], "v_max": [1.2, 0.9]}


def drawn(scale: float = 1.0, gradient: float = 1.0) -> tuple[Any, list[NDArray[np.float64]]]:
    """The axes of the picture of a step, velocities in other units, and the points of its lines."""
    J, *velocities = UNITS.values()
    rdot, v_min, v_max = (np.multiply(one, scale) for one in velocities)
    step = ProjectedGradientStep.from_gradient(J, rdot, [0.2 * gradient, 1.3 * gradient], v_min=v_min, v_max=v_max)
    axes = step.plot().axes[0]
    lines = [line for line in axes.lines if all(line.get_transform().contains_branch_seperately(axes.transData))]
    return axes, [np.array(line.get_xydata()) for line in lines]


@pytest.mark.parametrize("scale", [1e-3, 1e3])
@pytest.mark.parametrize("gradient", [1e-6, 1e6])
def test_in_other_units_the_picture_is_the_same(scale: float, gradient: float):
    """Of the gradient, which has a unit of its own, only the direction is shown."""
    axes, lines = drawn()
    others, found = drawn(scale, gradient)
    for points, same in zip([axes.viewLim.get_points(), *lines], [others.viewLim.get_points(), *found], strict=True):
        np.testing.assert_allclose(same, scale * points, rtol=1e-9, atol=1e-9 * scale)


def test_the_box_ends_at_the_limits_and_where_there_are_none_out_of_sight():
    axes, _ = drawn()
    np.testing.assert_allclose(axes.patches[0].get_bbox().get_points(), [UNITS["v_min"], UNITS["v_max"]])
    open_ = ProjectedGradientStep([0.5, 0.0], [1.0, 1.0], v_min=[-np.inf, -1.0], v_max=[1.0, np.inf])
    axes = open_.plot().axes[0]
    (left, bottom), (right, top) = axes.patches[0].get_bbox().get_points()
    assert (bottom, right) == (-1.0, 1.0)
    assert left < axes.get_xlim()[0] and axes.get_ylim()[1] < top


def test_what_the_legend_names_can_be_seen():
    axes, _ = drawn()
    assert all(handle.get_alpha() is None or handle.get_alpha() > 0.1 for handle in axes.get_legend().legend_handles)
    assert [side for side, spine in axes.spines.items() if spine.get_visible()] == ["left", "bottom"]


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
