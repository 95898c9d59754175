"""What a page's script reads: numbers packed small, and read back as they were."""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np
from hypothesis import example, given
from hypothesis import strategies as st

from wbc.report.document import Clock, Curve, Plot, Report, Section
from wbc.report.packed import STEPS, Arrays, data, kept


@given(n=st.integers(1, 5000), seed=st.integers(0, 100), holes=st.booleans())
def test_thinning_keeps_both_ends_and_both_extremes_of_every_curve(n: int, seed: int, holes: bool):
    values = np.random.default_rng(seed).normal(size=(n, 2))
    if holes and n > 2:
        values[1 : n // 2, 0] = np.nan
    rows = kept(values, 100)
    assert len(rows) <= (n if n <= 100 else 102)
    assert rows[0] == 0 and rows[-1] == n - 1 and np.all(np.diff(rows) > 0)
    assert np.array_equal(np.nanmin(values[rows], axis=0), np.nanmin(values, axis=0))
    assert np.array_equal(np.nanmax(values[rows], axis=0), np.nanmax(values, axis=0))


def unpacked(packed: Any) -> Any:
    """The steps that a page reads, as its script does."""
    low, high = np.frombuffer(base64.b64decode(packed["u16"]), np.uint8).reshape(2, -1).astype(np.uint16)
    folded = low | high << 8
    steps = folded >> 1 ^ np.where(folded & 1, 0xFFFF, 0).astype(np.uint16)
    for _ in range(packed["times"]):
        steps = np.cumsum(steps, dtype=np.uint16)
    return steps


def test_a_smooth_curve_takes_little_room():
    smooth: Any = Arrays()
    smooth.stepped(np.sin(1e-3 * np.arange(10_000.0)))
    (packed,) = smooth.packed
    assert packed["times"] > 0 and len(zlib.compress(base64.b64decode(packed["u16"]))) < 10_000


@example([0.0, 2e-313])
@given(st.lists(st.floats(-1e6, 1e6) | st.just(float("nan")) | st.just(float("inf")), min_size=1, max_size=50))
def test_a_curve_is_read_back_to_a_step_of_its_range(values: list[float]):
    arrays = Arrays()
    packed: Any = arrays.packed[arrays.stepped(np.array(values))]
    steps = unpacked(packed)
    size = packed["high"] - packed["low"]
    for step, value in zip(steps, values, strict=True):
        if np.isfinite(value):
            assert abs(packed["low"] + step * size / STEPS - value) <= 0.51 * size / STEPS + 1e-9
        else:
            assert step == STEPS + 1


def test_on_a_logarithmic_axis_small_values_are_as_exact_as_large_ones():
    fall = 10.0 ** np.linspace(2, -14, 200)
    plot = Plot("fall", "fall", "m", np.arange(200.0), [Curve("e", fall)], log="y")
    found = data(Report("t", "s", None, [Section("S", [plot])], clock=Clock(200.0, 1.0)))
    assert found is not None
    (packed,) = (array["f32"] for array in found["arrays"] if "f32" in array)
    np.testing.assert_allclose(np.frombuffer(base64.b64decode(packed), "<f4"), fall, rtol=1e-6)


def test_an_array_that_stands_twice_is_packed_once():
    t = np.arange(5.0)
    plots = [Plot(name, name, "m", t, [Curve("a", t**2)]) for name in "ab"]
    found = data(Report("t", "s", None, [Section("S", plots)], clock=Clock(5.0, 1.0)))
    assert found is not None and len(found["arrays"]) == 2
    (exact,) = (array["f64"] for array in found["arrays"] if "f64" in array)
    assert np.array_equal(np.frombuffer(base64.b64decode(exact)), t)


def test_a_report_without_plots_has_nothing_for_a_script():
    assert data(Report("t", "s", None, [])) is None


def test_plots_of_one_scale_reach_as_far():
    x = np.arange(3.0)
    plots = [
        Plot("left", "left", "N", x, [Curve("f", np.array([1.0, 2.0, np.nan]))], scale="force"),
        Plot("right", "right", "N", x, [Curve("f", x - 5.0), Curve("hidden", 1e6 * x, shown=False)], scale="force"),
        Plot("other", "other", "m", x, [Curve("x", x)]),
    ]
    packed = data(Report("t", "s", None, [Section("a", plots)]))
    assert packed is not None
    assert [plot["reach"] for plot in packed["plots"]] == [[-5.0, 2.0], [-5.0, 2.0], None]
