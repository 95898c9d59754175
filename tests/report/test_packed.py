"""What a page's script reads: numbers packed small, and read back as they were."""

from __future__ import annotations

import base64
from typing import Any

import numpy as np
from hypothesis import given
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


@given(st.lists(st.floats(-1e6, 1e6) | st.just(float("nan")) | st.just(float("inf")), min_size=1, max_size=50))
def test_a_curve_is_read_back_to_a_step_of_its_range(values: list[float]):
    arrays = Arrays()
    packed: Any = arrays.packed[arrays.stepped(np.array(values))]
    steps = np.frombuffer(base64.b64decode(packed["u16"]), dtype="<u2")
    size = packed["high"] - packed["low"]
    for step, value in zip(steps, values, strict=True):
        if np.isfinite(value):
            assert abs(packed["low"] + step * size / STEPS - value) <= 0.51 * size / STEPS + 1e-9
        else:
            assert step == STEPS + 1


def test_an_array_that_stands_twice_is_packed_once():
    t = np.arange(5.0)
    plots = [Plot(name, name, "m", t, [Curve("a", t**2)]) for name in "ab"]
    found = data(Report("t", "s", None, [Section("S", plots)], clock=Clock(5.0, 1.0)))
    assert found is not None and len(found["arrays"]) == 2
    (exact,) = (array["f64"] for array in found["arrays"] if "f64" in array)
    assert np.array_equal(np.frombuffer(base64.b64decode(exact)), t)


def test_a_report_without_plots_has_nothing_for_a_script():
    assert data(Report("t", "s", None, [])) is None
