"""Curves are thinned for a figure, but never lose a peak."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from wbc.report import style


@given(n=st.integers(1, 5000), seed=st.integers(0, 100), holes=st.booleans())
def test_thinning_keeps_both_ends_and_both_extremes(n: int, seed: int, holes: bool):
    t, y = np.arange(n) * 0.1, np.random.default_rng(seed).normal(size=n)
    if holes and n > 2:
        y[1 : n // 2] = np.nan
    thin_t, thin_y = style.thinned(t, y, points=100)
    assert len(thin_t) == len(thin_y) <= max(n if n <= 100 else 102, 1)
    assert thin_t[0] == t[0] and thin_t[-1] == t[-1] and np.all(np.diff(thin_t) > 0)
    assert (np.nanmin(thin_y), np.nanmax(thin_y)) == (np.nanmin(y), np.nanmax(y))


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
