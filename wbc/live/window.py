"""Window: the process that shows a view in the browser, by viser: it draws what the loop hands it, says what was done.

``python -m wbc.live.window NUMBER`` is started by :class:`wbc.live.View`; NUMBER is its line to the loop, a descriptor.
"""

from __future__ import annotations

import asyncio
import logging
import os
import sys
import threading
from collections import defaultdict, deque
from collections.abc import Coroutine
from functools import partial
from itertools import groupby
from multiprocessing.connection import Connection
from time import monotonic, sleep
from typing import Any, final

import numpy as np
import viser

from wbc.control.recorder import Run
from wbc.live.knobs import Knob
from wbc.report.marks import RED, Mark, above_ground, marks, strained
from wbc.report.motion import motion, quaternions
from wbc.report.shapes import view
from wbc.types import Vec

WORDS_EVERY = 0.1  # [s]: nobody reads faster
TRAIL = 60  # so many pictures of the way that a point went
FAR = 1.15  # the camera stands so many sizes of the robot away
DIRECTIONS = {"+x": (1, 0, 0), "−x": (-1, 0, 0), "+y": (0, 1, 0), "−y": (0, -1, 0), "+z": (0, 0, 1), "−z": (0, 0, -1)}
#: A force that is drawn with the mouse lasts so long after the last word of it [s].
HELD = 0.5
SPEEDS = (0.05, 0.1, 0.25, 0.5, 1.0)


@final
class Window:
    """The scene, and the controls beside it.

    What browsers are shown is changed in viser's event loop alone: viser wakes its senders by an ``asyncio.Event``,
    which no other thread may set.
    """

    def __init__(self, line: Any, setup: dict[str, Any]) -> None:
        self._line, self._setup, self._lock = line, setup, threading.Lock()
        self._robot, self._links = setup["robot"], sorted({part.link for part in setup["solid"]})
        self._weight = self._robot.weight
        self._shown: dict[str, Any] = {}
        self._visible: dict[str, bool] = {}
        self._trails: dict[str, deque[Vec]] = defaultdict(lambda: deque(maxlen=TRAIL))
        self._red: set[str] = set()
        self._words_due = 0.0
        self._server = viser.ViserServer(host="127.0.0.1", port=setup["port"], label="wbc", verbose=False)
        self._in_loop(self._build())
        self._server.on_client_connect(self._greet)
        self._server.on_client_disconnect(lambda _: self.say("clients", len(self._server.get_clients())))

    def say(self, *words: Any) -> None:
        """Tell the loop."""
        with self._lock:
            self._line.send(words)

    def run(self) -> None:
        """Draw until the loop hangs up."""
        self.say("at", f"http://localhost:{self._server.get_port()}")
        while True:
            message = self._line.recv()
            while "row" not in message:
                if "ended" in message:
                    self._in_loop(self._write(self._status, f"**{message['ended']}**"))
                    sleep(0.5)  # for the word to get there
                    return
                self._in_loop(self._write(self._refused, f"**refused:** {message['refused']}"))
                message = self._line.recv()
            due = monotonic() + self._setup["period"]
            self._in_loop(self._show(message))
            sleep(max(0.0, due - monotonic()))
            self.say("next")

    def _in_loop(self, work: Coroutine[Any, Any, None]) -> None:
        """Have viser's event loop do something, and wait until it is done."""
        asyncio.run_coroutine_threadsafe(work, self._server.get_event_loop()).result()

    async def _build(self) -> None:
        self._server.gui.configure_theme(control_width="medium", show_logo=False, show_share_button=False)
        self._server.gui.main_panel.dock_right()
        self._build_scene()
        self._build_controls()

    async def _write(self, where: Any, markdown: str) -> None:
        where.content = markdown

    async def _show(self, message: dict[str, Any]) -> None:
        with self._server.atomic():
            self._draw(message["row"], message["pushed"])
        if message["paused"] or monotonic() >= self._words_due:  # a pause has one picture
            self._words_due = monotonic() + WORDS_EVERY
            self._tell(message)

    # ---- the scene
    def _build_scene(self) -> None:
        scene = self._server.scene
        scene.set_up_direction("+z")
        scene.configure_default_lights(enabled=True, cast_shadow=True)
        scene.add_grid(
            "/floor", width=20, height=20, cell_size=0.5, section_size=1.0, cell_color=(215, 220, 226),
            section_color=(190, 198, 207), plane_opacity=1.0, plane_color=(242, 244, 247), shadow_opacity=0.35,
        )  # fmt: skip
        self._frames = {link: scene.add_frame(f"/robot/{k}", show_axes=False) for k, link in enumerate(self._links)}
        number = {link: k for k, link in enumerate(self._links)}
        self._meshes: dict[str, list[tuple[Any, tuple[int, int, int]]]] = defaultdict(list)
        for k, part in enumerate(self._setup["solid"]):
            mesh = scene.add_mesh_simple(
                f"/robot/{number[part.link]}/{k}", part.vertices.astype(np.float32), part.faces.astype(np.uint32),
                color=part.color, flat_shading=True, side="double",
            )  # fmt: skip
            self._meshes[part.link].append((mesh, part.color))
            if part.link in self._setup["frames"]:
                mesh.on_drag("left", modifier="cmd/ctrl")(partial(self._pulled, part.link))

    def _pulled(self, link: str, event: Any) -> None:
        """A link that is drawn with the mouse: half a metre pulls with the robot's weight, as arrows have it."""
        way = np.subtract(event.end_position, event.start_position)
        force = np.zeros(3) if event.phase == "end" else self._weight / 0.5 * way
        self.say("push", link, force.tolist(), 0.0 if event.phase == "end" else HELD)

    def _draw(self, row: dict[str, Any], pushed: list[str]) -> None:
        meta = self._setup["meta"] | {"disturbances": [f"push at {frame!r}" for frame in pushed]}
        columns = {name: np.asarray(value)[None] for name, value in row.items() if np.ndim(value) < 2}
        run = Run(columns, meta)
        moving = motion(run, self._robot, np.array([0]), self._links, self._setup["obstacles"])
        for link, (position, rotation) in moving.links.items():
            self._frames[link].position, self._frames[link].wxyz = position[0], quaternions(rotation)[0]
        self._paint(set(strained(run, self._robot)))
        for mark in marks(moving, self._robot):
            if mark.name not in self._visible:
                self._add_switch(mark)
            self._draw_mark(mark, mark.points[0] if self._visible[mark.name] else np.zeros((0, 3)))
        if "push" in self._shown and not any(mark.label == "push" for mark in marks(moving, self._robot)):
            self._shown["push"].visible = False

    def _paint(self, red: set[str]) -> None:
        for link in red ^ self._red:
            for mesh, color in self._meshes[link]:
                mesh.color = _rgb(RED) if link in red else color
        self._red = red

    def _draw_mark(self, mark: Mark, points: Vec) -> None:
        scene, name, color = self._server.scene, f"/marks/{mark.label}", _rgb(mark.color)
        there = len(points) > 0 and bool(np.isfinite(points).all())
        if mark.kind == "point":
            if there:
                self._trails[mark.label].append(points[0])
            pairs = np.array(self._trails[mark.label])[:, None].repeat(2, axis=1).reshape(-1, 3)[1:-1].reshape(-1, 2, 3)
            if mark.label not in self._shown:
                self._shown[mark.label] = scene.add_icosphere(name, radius=0.02, color=color)
                self._shown[f"{mark.label}, trail"] = scene.add_line_segments(
                    f"{name}, trail", np.zeros((1, 2, 3)), color, thickness=2.0, thickness_units="screen"
                )
            ball, trail = self._shown[mark.label], self._shown[f"{mark.label}, trail"]
            ball.visible, trail.visible = there, there and len(pairs) > 0
            if there:
                ball.position = points[0]
                if len(pairs):
                    trail.points = pairs.astype(np.float32)
            return
        line = mark.kind == "line"
        ends = np.stack([points, np.roll(points, -1, 0)], axis=1) if line else above_ground(points.reshape(-1, 2, 3))
        ends = ends[np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) > 1e-3] if there else ends[:0]
        if mark.label not in self._shown:
            some = np.array([[[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]])
            self._shown[mark.label] = (
                scene.add_arrows(name, some, color, shaft_radius=0.008, head_radius=0.02, head_length=0.05)
                if not line
                else scene.add_line_segments(name, some, color, thickness=3.0, thickness_units="screen")
            )
        handle = self._shown[mark.label]
        handle.visible = len(ends) > 0
        if len(ends):
            handle.points = ends.astype(np.float32)

    def _add_switch(self, mark: Mark) -> None:
        self._visible[mark.name] = not mark.hidden
        with self._marks:
            box = self._server.gui.add_checkbox(mark.name, not mark.hidden)

        def switch(_: Any) -> None:
            self._visible[mark.name] = box.value

        box.on_update(switch)

    async def _greet(self, client: Any) -> None:
        """A browser that has come: the camera where that of the report stands."""
        places = np.array([frame.position for frame in self._frames.values()])
        middle = 0.5 * (places.min(axis=0) + places.max(axis=0))
        size = max(float(np.linalg.norm(np.ptp(places, axis=0))), 0.5)
        client.camera.position = middle + FAR * size * np.array(view(self._robot))
        client.camera.look_at = middle
        self.say("clients", len(self._server.get_clients()))

    # ---- the controls
    def _build_controls(self) -> None:
        gui = self._server.gui
        self._status = gui.add_markdown("waiting for the first tick")
        self._refused = gui.add_markdown("")
        if self._setup["pausing"]:
            self._pause = gui.add_button("pause")
            self._paused = False
            self._pause.on_click(self._press_pause)
            step = gui.add_button("one tick")
            step.on_click(self._press_step)
            speed = gui.add_dropdown("speed", tuple(f"{s:g}" for s in SPEEDS), initial_value="1")
            speed.on_update(lambda _: self.say("speed", float(speed.value)))
        if self._setup["frames"]:
            self._build_push()
        with gui.add_folder("active rows"):
            self._rows = gui.add_markdown("none")
        self._marks = gui.add_folder("show", expand_by_default=False)
        numbered = list(enumerate(self._setup["knobs"]))
        for task, knobs in groupby(numbered, key=lambda item: item[1].task):
            with gui.add_folder(task, expand_by_default=False):
                for number, knob in knobs:
                    self._add_knob(number, knob)

    def _build_push(self) -> None:
        gui, frames = self._server.gui, self._setup["frames"]
        with gui.add_folder("push"):
            frame = gui.add_dropdown("link", tuple(frames), hint="or draw a link with the mouse, Ctrl held")
            way = gui.add_dropdown("direction", tuple(DIRECTIONS), initial_value="+y")
            most = max(1.0, round(self._weight))
            newtons = gui.add_slider("newtons", 0.0, most, most / 100, round(0.2 * most))
            seconds = gui.add_slider("seconds", 0.05, 2.0, 0.05, 0.2)
            button = gui.add_button("push", color="red")
        button.on_click(
            lambda _: self.say("push", frame.value, [newtons.value * x for x in DIRECTIONS[way.value]], seconds.value)
        )

    def _add_knob(self, number: int, knob: Knob) -> None:
        gui = self._server.gui
        label = f"{knob.what} [{knob.unit}]" if knob.unit else knob.what
        handle: Any = (
            gui.add_checkbox(label, knob.value > 0.5)
            if knob.what == "active"
            else gui.add_slider(label, knob.low, knob.high, knob.step, knob.value)
        )

        async def turn(_: Any) -> None:
            self._refused.content = ""
            self.say("set", number, float(handle.value))

        handle.on_update(turn)

    async def _press_pause(self, _: Any) -> None:
        self._set_paused(not self._paused)
        self.say("pause", self._paused)

    async def _press_step(self, _: Any) -> None:
        self._set_paused(True)
        self.say("step")

    def _set_paused(self, paused: bool) -> None:
        self._paused = paused
        self._pause.label = "go on" if paused else "pause"

    def _tell(self, message: dict[str, Any]) -> None:
        row, period = message["row"], 1e6 * float(self._setup["meta"]["dt"])
        lines = [f"**t = {float(row['t']):.3f} s**, {'paused' if message['paused'] else message['status']}"]
        if np.isfinite(row["tick_us"]):
            worst = f", worst {message['worst']:.0f}" if np.isfinite(message["worst"]) else ""
            lines.append(f"tick {float(row['tick_us']):.0f} µs{worst}, of {period:g} µs")
        if np.isfinite(message["speed"]) and not message["paused"]:
            lines.append(f"{message['speed']:.2f} times real time")
        self._status.content = "  \n".join(lines)
        rows = [
            f"- {owner}: {label}, {'≤' if upper else '≥'} {bound:.4g} {unit}, {price:.3g}"
            for owner, label, unit, upper, bound, price in message["active"]
        ]
        more = message["count"] - len(rows)
        self._rows.content = "\n".join([*rows, *([f"- and {more} more"] if more > 0 else [])]) or "none"


def _rgb(color: str) -> tuple[int, int, int]:
    return int(color[1:3], 16), int(color[3:5], 16), int(color[5:7], 16)


def main(descriptor: int) -> None:
    """Show what comes down the line until it is hung up; the loop goes first."""
    os.nice(10)
    logging.getLogger("websockets").setLevel(logging.CRITICAL)  # a browser that goes away is no error
    line: Any = Connection(descriptor)
    try:
        Window(line, line.recv()).run()
    except (EOFError, OSError):
        pass
    os._exit(0)  # viser's threads need not be waited for


if __name__ == "__main__":
    main(int(sys.argv[1]))
