"""The page in a real browser: one cursor, zoom, legends, the robot at the time of a click, keys, phone, dark, print."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from wbc.control.recorder import Run
from wbc.models import load
from wbc.report import run_report, write
from wbc.report.document import Bound, Curve, Plot, Report, Section
from wbc.sim.scenario import Check, Place, ScenarioResult

from .browser import Browser, browser, installed
from .conftest import result_of, standing_run

Image = pytest.importorskip("PIL.Image", reason="the extra `report`, whose matplotlib brings it")

CHROMIUM = installed()
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed to look at the page with"),
]


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The report of a run with a demand that failed at 0.5 s."""
    failed = Check("slip of a foot", 2e-3, "<", 1e-3, "m", Place(0.5, "left_foot", "slip"))
    place = tmp_path_factory.mktemp("page")
    write(run_report(ScenarioResult(standing_run(), False, {}, {}, [failed], robot=load("humanoid"))), place)
    return place / "report.html"


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    """One browser for all tests."""
    assert CHROMIUM is not None
    with browser(CHROMIUM) as running:
        yield running


@pytest.fixture
def tab(chromium: Browser, page: Path) -> Browser:
    """The page, opened anew on a wide window, at the start of the run."""
    chromium.errors.clear()
    chromium.requests.clear()
    chromium.open(page)
    chromium.run("report.go(0)")
    return chromium


def shown(tab: Browser, name: str) -> tuple[float, float, float, float]:
    """Bring a plot into view; left, top, width and height of the area of its curves."""
    box: list[float] = tab.run(
        f"""(() => {{ const u = report.plots.find(p => report.data.plots[p.box.dataset.plot].name === "{name}").u;
        u.over.scrollIntoView({{block: "center", behavior: "instant"}});
        const r = u.over.getBoundingClientRect(); return [r.left, r.top, r.width, r.height]; }})()"""
    )
    tab.settle()
    left, top, width, height = box
    return left, top, width, height


def plot(tab: Browser, name: str, then: str) -> Any:
    """The value of an expression about the plot ``u``."""
    return tab.run(f"(u => {then})(report.plots.find(p => report.data.plots[p.box.dataset.plot].name === '{name}').u)")


def test_the_page_asks_nobody_and_makes_no_error(tab: Browser, page: Path):
    assert tab.errors == []
    assert all(address == page.as_uri() or address.startswith(("data:", "about:")) for address in tab.requests)


@pytest.mark.parametrize("rows", [1, 2])
def test_the_axis_of_time_of_a_short_run_is_as_long_as_the_run(chromium: Browser, rows: int, tmp_path: Path) -> None:
    write(run_report(result_of(standing_run(rows), load("humanoid"))), tmp_path)
    chromium.errors.clear()
    chromium.open(tmp_path / "report.html")
    of_time = "report.plots.filter(p => report.data.plots[p.box.dataset.plot].time).map(p => p.u.scales.x.max)"
    longest = chromium.run(of_time)
    assert longest and max(longest) <= 0.01 * rows + 1e-12 and chromium.errors == []


def test_a_run_that_failed_is_opened_where_it_did(chromium: Browser, page: Path):
    chromium.open(page)
    assert chromium.run("report.clock.t") == pytest.approx(0.5)


def test_one_cursor_goes_through_all_plots(tab: Browser):
    left, top, width, height = shown(tab, "velocities")
    tab.mouse("mouseMoved", left + width / 2, top + height / 2)
    tab.settle()
    here, there = (plot(tab, name, "u.cursor.idx") for name in ("velocities", "positions"))
    assert here == there == pytest.approx(59, abs=2)


def test_a_drag_zooms_every_plot_and_a_double_click_shows_the_whole_run(tab: Browser):
    left, top, width, height = shown(tab, "torques")
    y = top + height / 2
    tab.mouse("mouseMoved", left + 0.25 * width, y)
    tab.mouse("mousePressed", left + 0.25 * width, y)
    for k in range(1, 6):
        tab.mouse("mouseMoved", left + (0.25 + 0.05 * k) * width, y, buttons=1)
    tab.mouse("mouseReleased", left + 0.5 * width, y)
    tab.settle()
    for name in ("torques", "velocities", "slip"):
        low, high = plot(tab, name, "[u.scales.x.min, u.scales.x.max]")
        assert low == pytest.approx(0.3, abs=0.02) and high == pytest.approx(0.6, abs=0.02)
    for count in (1, 2):
        tab.mouse("mousePressed", left + 0.5 * width, y, clickCount=count)
        tab.mouse("mouseReleased", left + 0.5 * width, y, clickCount=count)
    tab.settle()
    assert plot(tab, "slip", "u.scales.x.max") == pytest.approx(1.19)


def test_two_fingers_zoom_every_plot_about_what_they_are_on(chromium: Browser, page: Path):
    chromium.open(page, width=390, height=844)
    left, top, width, height = shown(chromium, "torques")
    y = top + height / 2

    def touch(kind: str, *shares: float) -> None:
        points = [{"x": left + share * width, "y": y, "id": k} for k, share in enumerate(shares)]
        chromium.call("Input.dispatchTouchEvent", type=kind, touchPoints=points)

    touch("touchStart", 0.4, 0.6)
    for apart in (0.15, 0.2, 0.3):
        touch("touchMove", 0.5 - apart, 0.5 + apart)
    touch("touchEnd")
    chromium.settle()
    for name in ("torques", "slip"):  # what was a fifth of the width is three fifths: the middle third of the run
        low, high = plot(chromium, name, "[u.scales.x.min, u.scales.x.max]")
        assert low == pytest.approx(1.19 / 3, abs=0.02) and high == pytest.approx(1.19 * 2 / 3, abs=0.02)
    assert not chromium.errors


def test_a_click_in_a_legend_shows_a_curve_and_so_does_a_key(tab: Browser):
    shown(tab, "torques")
    last = "u.series[u.series.length - 1].show"
    assert plot(tab, "torques", last) is False
    x, y = plot(
        tab, "torques",
        """(() => { const e = [...u.root.querySelectorAll('.u-series th')].at(-1);
        e.scrollIntoView({block: "nearest", behavior: "instant"});
        const r = e.getBoundingClientRect(); return [r.left + 5, r.top + r.height / 2]; })()""",
    )  # fmt: skip
    tab.click(x, y)
    assert plot(tab, "torques", last) is True
    plot(tab, "torques", "[...u.root.querySelectorAll('.u-series th')].at(-1).focus()")
    tab.key("Enter", "\r")
    assert plot(tab, "torques", last) is False


def test_a_click_on_a_curve_moves_the_robot_there(tab: Browser):
    before = tab.run("document.querySelector('[data-scene]').at()")
    left, top, width, height = shown(tab, "tracking.CenterOfMass")
    tab.click(left + 0.25 * width, top + 0.5 * height)
    assert tab.run("report.clock.t") == pytest.approx(0.3, abs=0.01)
    assert tab.run("Number(document.querySelector('[data-slider]').value)") == pytest.approx(0.3, abs=0.01)
    assert tab.run("document.querySelector('[data-scene]').at()") != before


def test_keys_step_play_and_jump_to_marks(tab: Browser):
    tab.key("ArrowRight")
    assert tab.run("report.clock.t") == pytest.approx(0.01)
    for expected in (0.3, 0.5):  # the push, and the demand that failed
        tab.key("n")
        assert tab.run("report.clock.t") == pytest.approx(expected)
    tab.key("Home")
    tab.key(" ", " ")
    tab.run("new Promise(done => setTimeout(done, 300))")
    assert tab.run("report.clock.playing") and tab.run("report.clock.t") > 0.0
    tab.key(" ", " ")
    assert not tab.run("report.clock.playing")
    shown(tab, "slip")
    tab.key("End")
    assert plot(tab, "slip", "u.cursor.idx") == 119


def test_a_failed_demand_leads_to_its_curve_at_that_time(tab: Browser):
    tab.run("document.querySelector('td [data-at]').click()")
    tab.settle()
    assert tab.run("report.clock.t") == pytest.approx(0.5)
    assert plot(tab, "slip", "u.scales.x.min") == pytest.approx(0.25)
    middle = plot(tab, "slip", "(r => r.top + r.height / 2)(u.over.getBoundingClientRect())")
    assert 200 < middle < 800


def test_the_cursor_says_which_rows_were_active_and_at_what_price(tab: Browser):
    said = "document.querySelector('[data-why]').innerText"
    assert "No constraint is active" in tab.run(said)
    tab.run("report.go(0.4)")
    text = tab.run(said)
    assert "Why, at 0.400 s: solved" in text and "No constraint is active" not in text
    rows = tab.run("[...document.querySelectorAll('[data-why] table:last-child td')].map(cell => cell.textContent)")
    assert rows == ["TorqueLimits: left_knee, upper bound", "40 N m", "7.5 per N m",
                    "friction[left_sole]: fy <= mu fz", "0 N", "2.5 per N"]  # fmt: skip
    assert "0.25 m/s², 0.25 rad/s²" in text and "50 %" in text
    left, top, width, height = shown(tab, "limits")
    tab.click(left + 0.07 / 1.19 * width, top + 0.25 * height)
    assert "Why, at 0.070 s: infeasible" in tab.run(said) and "no certified solution" in tab.run(said)


def test_of_a_tick_without_a_record_of_its_residuals_there_is_a_dash(
    chromium: Browser, changed: Callable[..., Run], tmp_path: Path
):
    run, gone = standing_run(), np.full((120, 1), np.nan)
    write(run_report(result_of(changed(run, **{"residual.CenterOfMass": gone}), load("humanoid"))), tmp_path)
    chromium.open(tmp_path / "report.html")
    cells = chromium.run("[...document.querySelectorAll('[data-why] tr')].map(row => row.cells[2].textContent)")
    assert cells == ["residual", "–", "0.25 m/s², 0.25 rad/s²", "0.25 rad/s²"]


@pytest.mark.parametrize("width", [390, 940, 1400])
def test_the_page_is_as_wide_as_the_window(chromium: Browser, page: Path, width: int):
    chromium.open(page, width=width, height=844)
    assert chromium.run("document.documentElement.scrollWidth") == width
    assert chromium.run("Math.min(...[...document.querySelectorAll('figure img')].map(one => one.clientWidth))") > 600
    assert not chromium.errors


def test_the_names_of_hidden_curves_and_of_constraints_can_be_read(tab: Browser):
    """Hidden ones are not faint, and the cursor is not drawn over the others."""
    shown(tab, "torques")
    faint = "[...document.querySelectorAll('.u-off th')].filter(one => getComputedStyle(one).opacity < 1).length"
    assert tab.run("document.querySelectorAll('.u-off').length") > 0 and tab.run(faint) == 0
    assert plot(tab, "limits", "[...u.over.children].findLastIndex(one => one.className === 'head') < "
                "[...u.over.children].findIndex(one => one.className === 'strip')")  # fmt: skip


@pytest.mark.parametrize("width", [1180, 1400, 1800])
def test_beside_a_robot_every_section_has_its_link_in_sight_and_below_the_links(
    chromium: Browser, page: Path, width: int
):
    chromium.open(page, width=width, height=844)
    assert chromium.run("(nav => nav.scrollWidth <= nav.clientWidth)(document.querySelector('nav'))")
    hidden = """[...document.querySelectorAll('main section[id]')].filter(section => {
        section.scrollIntoView({behavior: 'instant'});
        const nav = document.querySelector('nav').getBoundingClientRect();
        return section.getBoundingClientRect().top < nav.bottom;
    }).map(section => section.id)"""
    assert chromium.run(hidden) == []


def test_the_contents_stay_in_sight(tab: Browser):
    tab.run("scrollTo({top: document.body.scrollHeight, behavior: 'instant'})")
    tab.settle()
    assert tab.run("document.querySelector('nav').getBoundingClientRect().top") == 0
    tab.run("scrollTo({top: 0, behavior: 'instant'})")


def test_the_page_is_dark_where_that_is_wished(chromium: Browser, page: Path):
    chromium.open(page, dark=True)
    dark = chromium.run("getComputedStyle(document.body).backgroundColor")
    chromium.open(page)
    light = chromium.run("getComputedStyle(document.body).backgroundColor")
    assert dark == "rgb(18, 22, 27)" and light == "rgb(246, 247, 249)"


def test_folds_are_open_while_the_page_is_printed(tab: Browser, tmp_path: Path):
    folded = "document.querySelectorAll('details:not([open])').length"
    before = tab.run(folded)
    tab.run("window.dispatchEvent(new Event('beforeprint'))")
    assert before > 2 and tab.run(folded) == 0
    tab.run("window.dispatchEvent(new Event('afterprint'))")
    assert tab.run(folded) == before
    tab.printed(tmp_path / "page.pdf")
    assert (tmp_path / "page.pdf").read_bytes().startswith(b"%PDF")


def test_the_floor_is_there_where_the_camera_is_near(tab: Browser, tmp_path: Path):
    left, top, width, height = tab.run(
        """(() => { const box = document.querySelector('[data-scene]');
        box.scrollIntoView({block: "start", behavior: "instant"});
        const r = box.getBoundingClientRect(); return [r.left, r.top, r.width, r.height]; })()"""
    )
    for _ in range(8):
        tab.call("Input.dispatchMouseEvent", type="mouseWheel", x=left + width / 2, y=top + height / 2,
                 deltaX=0, deltaY=-120)  # fmt: skip
    tab.settle()
    tab.picture(tmp_path / "near.png")
    with Image.open(tmp_path / "near.png") as picture:
        box = (int(left) + 8, int(top + 0.5 * height), int(left + 0.2 * width), int(top + height) - 8)
        beside = np.asarray(picture.convert("L").crop(box))
    assert np.count_nonzero(beside < 215) > 20  # the middle line, darker than the others, passes behind the camera


@pytest.mark.parametrize("count", [5, 40])
def test_a_logarithmic_axis_has_numbers_and_bounds_of_one_name_have_one_mark(
    chromium: Browser, tmp_path: Path, count: int
):
    """Of few dots those of the dots, of many, which would stand on each other, round ones."""
    x = np.geomspace(0.317, 731.0, count)
    bounds = [Bound(0.5, "threshold"), Bound(-0.5, ""), Bound(2.0, "answer", "x")]
    plot = Plot("dots", "Dots", "m", x, [Curve("a", np.sin(x))], bounds, over="size", log="x", dots=True)
    write(Report("Dots", "", None, [Section("Dots", [plot])]), tmp_path)
    chromium.open(tmp_path / "report.html")
    assert chromium.run("[...document.querySelectorAll('.bounds span')].map(s => s.textContent)") == [
        "threshold", "answer",
    ]  # fmt: skip
    assert "threshold: 0.5, -0.5; answer: 2" in (tmp_path / "report.md").read_text()
    numbers = chromium.run("document.querySelector('.uplot').parentElement.plot.axes[0]._values.filter(Boolean)")
    assert len(numbers) >= 4 and ("1" in numbers) is (count > 10)
