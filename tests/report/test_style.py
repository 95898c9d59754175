"""Figures look the same wherever they are drawn."""

from __future__ import annotations

import numpy as np
import pytest

from wbc.report import style


def test_the_same_drawing_gives_the_same_bytes():
    def draw() -> bytes:
        with style.Canvas(height=2.0) as canvas:
            style.curve(canvas.axes[0], np.arange(5.0), np.arange(5.0) ** 2, color=style.BLUE)
            return canvas.figure("f", "a parabola").data

    assert draw() == draw()


def test_drawing_leaves_the_settings_of_matplotlib_alone():
    from matplotlib import rcParams

    before = dict(rcParams)
    with style.Canvas(height=1.0) as canvas:
        canvas.figure("f", "empty", kind="png")
    assert dict(rcParams) == before


@pytest.mark.parametrize(("unit", "shown"), [("m", "mm"), ("rad", "mrad"), ("N m", "N m"), ("", "")])
def test_small_errors_are_shown_in_small_units(unit: str, shown: str):
    factor, text = style.readable(unit)
    assert text == shown and factor == (1e3 if shown != unit else 1.0)
