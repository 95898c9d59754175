"""Scaling curves: measured in turns, drawn from the data alone, honest about where a form does not pay."""

from __future__ import annotations

import json
from types import MappingProxyType
from typing import Any

import pytest

from tasks import Posture
from tasks.workloads.chains import chain
from tasks.workloads.scaling import Growing
from tests.report.test_formats import Page
from wbc.errors import InvalidInput
from wbc.report.html import html
from wbc.report.markdown import markdown
from wbc.report.scaling import scaled
from wbc.report.scaling.page import page, plots
from wbc.report.scaling.slope import Slope
from wbc.sim.scenario import find
from wbc.stack.component import Component
from wbc.stack.stack import Stack

KEYS = {"axis", "size", "kind", "form", "tick_us", "p99_us", "variables", "equalities", "rows", "active", "guessed",
        "solved"}  # fmt: skip


class Once(Component):
    """Fails in the twelfth tick of a run."""

    def reset(self, *_: object) -> None:
        self.ticks = 0

    def before(self, *_: object) -> None:
        self.ticks += 1
        assert self.ticks != 12


class Chain(Growing):
    """A chain that keeps its posture."""

    name, summary, parameters, sizes = "joints", "joints of a chain", MappingProxyType({"size": 2}), (2, 4, 8)

    def problem(self, size: int) -> tuple[Any, Stack]:
        return chain(size), Stack([Posture(chain(size).q0)])


AXIS = Chain()


def made(
    times: dict[str, list[float]], *, sizes: tuple[int, ...] = (1, 2, 4, 8), solved: bool = True
) -> dict[str, Any]:
    rows = [
        {"axis": "a", "size": size, "kind": kind, "form": "dual" if kind == "chosen" else "standard", "tick_us": t,
         "p99_us": t, "variables": 1, "equalities": 0, "rows": 0, "active": 0, "guessed": 1.0, "solved": solved}
        for kind, values in times.items() for size, t in zip(sizes, values, strict=True)
    ]  # fmt: skip
    where = {"date": "today", "load": None, "governor": "", "machine": {}, "versions": {}}
    return {"rows": rows, "titles": {"a": "size"}, "settings": {"ticks": 1, "repeats": 1}, "surroundings": where}


def payoff(data: dict[str, Any]) -> str:
    return next(section for section in page(data).sections if "Gain" in section.title).items[0].text


def test_every_size_is_measured_in_both_forms():
    rows = scaled([AXIS], ticks=3, repeats=2)
    assert [(row["size"], row["kind"]) for row in rows] == [(n, k) for n in (2, 4, 8) for k in ("chosen", "standard")]
    for row in rows:
        assert set(row) == KEYS and row["solved"] and 0 < row["tick_us"] <= row["p99_us"]
        assert row["variables"] == row["size"]
    assert {row["form"] for row in rows if row["kind"] == "standard"} == {"standard"}
    assert json.loads(json.dumps(rows, allow_nan=False)) == rows


def test_counts_that_make_no_sense_are_refused():
    for wrong in ({"ticks": 0}, {"repeats": 0}):
        with pytest.raises(InvalidInput):
            scaled([AXIS], **wrong)
    with pytest.raises(InvalidInput, match="no sizes"):
        scaled([find("arm-torque")])


def test_the_exponent_is_that_of_the_larger_half():
    data = made({"chosen": [9.0, 2.0**2, 4.0**2, 8.0**2], "standard": [50.0, 50.0, 50.0, 50.0]})
    table = next(s for s in page(data).sections if s.title == "Curves").items[1]
    exponents = {row[1]: row[2] for row in table.rows}
    assert exponents == {"chosen form": "2.00 ± 0.01", "standard form": "0.00 ± 0.01"}


def test_an_exponent_of_nearly_zero_has_no_sign():
    assert str(Slope(-0.004, 14.4)) == "0.0 ± 14.4"


def test_times_are_logarithmic_though_a_size_is_zero():
    data = made({"chosen": [1.0, 2.0, 3.0, 4.0], "standard": [2.0, 3.0, 4.0, 5e5]}, sizes=(0, 1, 2, 3))
    (plot,) = plots(data["rows"], data["titles"], {"chosen": "chosen form", "standard": "standard form"})
    assert plot.log == "y" and not plot.zero


def test_a_size_of_which_one_tick_failed_is_not_solved():
    class Failing(Chain):
        """Its last tick is solved."""

        def problem(self, size: int) -> tuple[Any, Stack]:
            robot, stack = super().problem(size)
            return robot, Stack(stack.tasks, components=[Once()])

    assert not any(row["solved"] for row in scaled([Failing()], ticks=4, repeats=1))


def test_the_summary_says_times_to_their_digits_and_what_there_is_none_of():
    assert "0 to 2 a: 5.6 to 5.7 µs." in page(made({"chosen": [5.6, 5.7], "standard": [9, 9]}, sizes=(0, 2))).summary
    assert "Fewer than two sizes" in page(made({"chosen": [5.6], "standard": [9]}, sizes=(1,))).summary


def test_where_a_form_does_not_pay_is_said():
    assert "it is slower at 4, 8" in payoff(made({"chosen": [1, 1, 30, 90], "standard": [10, 10, 10, 10]}))
    gains = payoff(made({"chosen": [1, 1, 3, 9.8], "standard": [10, 10, 10, 9.5]}))
    assert gains == "a: the chosen form (dual) is 0.97 to 10.00 times as fast as the standard form."
    assert "no size was solved" in payoff(made({"chosen": [1] * 4, "standard": [1] * 4}, solved=False))


def test_the_same_data_give_the_same_page_and_it_needs_nothing_else():
    data = made({"chosen": [1.0, 2.0, 3.0, 4.0], "standard": [2.0, 3.0, 4.0, 5.0]}, sizes=(0, 1, 2, 3))
    text = html(page(data))
    assert text == html(page(json.loads(json.dumps(data)))) and markdown(page(data)) == markdown(page(data))
    assert text.count("data-plot=") == 1 and all(r.startswith(("data:,", "#")) for r in Page(text).references)
