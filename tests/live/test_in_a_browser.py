"""The view as one uses it: a real browser looks at a loop that runs, stops it, pushes the robot and turns a knob."""

from __future__ import annotations

import re
import threading
from collections.abc import Callable
from time import monotonic, sleep
from typing import Any

import numpy as np
import pytest

import wbc
from tests.report.browser import Browser, browser, installed
from wbc.tasks import JointVelocityLimits, Position, Posture

pytest.importorskip("viser")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(installed() is None, reason="no Chromium is installed"),
]
PATIENCE = 60.0  # [s]
FIELD = """(() => {
    const all = [...document.querySelectorAll('label')].filter(l => l.innerText.trim() === LABEL && l.offsetParent);
    let box = all[0];
    while (box && !box.querySelector('input[type=text]')) box = box.parentElement;
    return box ? box.querySelector('input[type=text]') : null;
})()"""


class Page:
    """What a person sees and does."""

    def __init__(self, tab: Browser, url: str) -> None:
        self.tab = tab
        tab.call("Emulation.setDeviceMetricsOverride", width=1400, height=1000, deviceScaleFactor=1, mobile=False)
        tab.call("Page.navigate", url=url)
        self.until(lambda: "solved" in self.text)

    @property
    def text(self) -> str:
        return str(self.tab.run("document.body ? document.body.innerText : ''"))

    @property
    def t(self) -> float:
        return float(re.search(r"t = ([\d.]+) s", self.text)[1])

    def until(self, holds: Callable[[], Any]) -> None:
        end = monotonic() + PATIENCE
        while not holds():
            assert monotonic() < end, f"waited in vain; the page says\n{self.text}"
            sleep(0.05)

    def press(self, name: str) -> None:
        """Click what is called so, a button or the head of a folder."""
        called = f"x => x.offsetParent && x.innerText?.trim() === '{name}'"
        of = f"[...document.querySelectorAll('*')].filter({called}).at(-1)"
        self.until(lambda: self.tab.run(f"!!{of}"))
        self.tab.run(f"{of}.click()")

    def set(self, label: str, value: str) -> None:
        """Type a value into the first field of that label that can be seen."""
        field = FIELD.replace("LABEL", repr(label))
        self.until(lambda: self.tab.run(f"!!{field}"))
        self.tab.run(f"{field}.focus(); {field}.select()")
        self.tab.call("Input.insertText", text=value)
        self.tab.key("Enter", "\r")


@pytest.fixture
def watched(monkeypatch):
    """A function that lets an arm run, watched, for as long as somebody does something with its page.

    In debug mode asyncio refuses each call into its loop from another thread. Otherwise such calls fail now and then.
    """
    monkeypatch.setenv("PYTHONASYNCIODEBUG", "1")

    def watch(does: Callable[[Page, Any], None]) -> Any:
        from wbc.live import View

        robot = wbc.load("arm")
        task = Position("tool", target=[0.4, 0.2, 0.5])
        stack = wbc.Stack([task, Posture(robot.q0, weight=1e-6)], subject_to=[JointVelocityLimits()])
        controller = wbc.Controller(robot, stack, level=wbc.VelocityLevel())
        done, failures = threading.Event(), []

        def drive(view: View) -> None:
            try:
                with browser(str(installed())) as tab:
                    does(Page(tab, view.url), view)
            except BaseException as failure:
                failures.append(failure)
            finally:
                done.set()
                view.paused = False

        pushes: list[tuple[str, list[float], float]] = []
        q, k = robot.q0, 0
        with View(controller, port=8123, pausing=True, push=lambda f, x: pushes.append((f, x.tolist(), k))) as view:
            hand = threading.Thread(target=drive, args=(view,))
            hand.start()
            while not done.is_set():
                q = view.tick(1e-3 * k, q, np.zeros(robot.nv)).q
                k += 1
            hand.join()
            if failures:
                raise failures[0]
            return pushes, task, view.done, q

    return watch


def test_a_pause_stops_the_loop_a_push_acts_for_its_time_and_a_slider_sets_the_gain_of_its_task(watched):
    """A step is one tick, and the loop goes on."""

    def does(page: Page, view: Any) -> None:
        page.press("pause")
        page.until(lambda: "paused" in page.text)
        sleep(0.3)
        before = page.t
        sleep(0.5)
        assert page.t == before
        page.press("one tick")
        page.until(lambda: page.t != before)
        sleep(0.3)
        assert page.t == pytest.approx(before + 1e-3)
        page.press("go on")
        page.until(lambda: page.t > before + 0.2)
        page.set("newtons", "50")
        page.press("push")
        page.until(lambda: any("push of (0, 50, 0) N at 'base'" in line for line in view.done))
        page.press("Position[tool]")
        page.set("kp", "36")
        page.until(lambda: any("Position[tool]: kp = 36" in line for line in view.done))
        page.set("target z + [m]", "0.1")
        page.until(lambda: any("target z + = 0.1 m" in line for line in view.done))
        end = page.t + 2.5
        page.until(lambda: page.t > end)

    pushes, task, _, q = watched(does)
    frames, forces, ticks = zip(*pushes, strict=True)
    assert set(frames) == {"base"} and all(force == [0.0, 50.0, 0.0] for force in forces)
    assert ticks == tuple(range(ticks[0], ticks[0] + 200))  # 0.2 s of 1 ms
    assert task.kp == 36.0 and np.allclose(task.target, [0.4, 0.2, 0.6])
    state = wbc.load("arm").state()
    state.update(0.0, q, np.zeros(7))
    assert np.allclose(state.frame("tool").position, [0.4, 0.2, 0.6], atol=1e-3)
