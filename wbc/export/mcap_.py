"""MCAP, the log that Foxglove and PlotJuggler read: JSON messages, the scene in Foxglove's own schemas."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import numpy as np

from wbc import __version__, checks
from wbc.control.recorder import Run
from wbc.errors import InvalidInput
from wbc.export.logs import TICK, Log, Series, log
from wbc.files import written
from wbc.report.marks import Mark
from wbc.report.measure import clock
from wbc.report.shapes import Part, check_kinds
from wbc.sim.scenario import Progress, silent
from wbc.types import Vec

if TYPE_CHECKING:
    from wbc.models.model import RobotModel

WORLD = "world"
SHAFT, HEAD = 0.012, 0.03  # diameters of an arrow [m]
POINT = 0.04  # of a point [m]
LATEST = 1.8e10  # what 64 bits of nanoseconds can tell [s]


def to_mcap(
    run: Run, path: str | os.PathLike[str], *, robot: RobotModel | None = None, progress: Progress = silent
) -> Path:
    """Write the run as an MCAP log; with ``robot`` its links, meshes, forces and targets too.

    Every column of the run is a topic, ``/q``, ``/tau``, ``/error.TASK``, with a message of named numbers for each
    tick; what is one number is in ``/tick``, with the name of the status, and ``/active`` has the multiplier of each
    row that was active. The scene is ``/tf`` (foxglove.FrameTransforms), ``/robot`` and ``/marks``
    (foxglove.SceneUpdate). Times are those of the run, in nanoseconds; those of a run that begins before 0, which the
    format does not have, count from its beginning. A tick whose time is not finite has one between those beside it.

    Raises:
        NotSupported: the package mcap is not installed.
        InvalidInput: a run without ticks, times of centuries, or a place that cannot be written.
    """
    check_kinds(run, robot)
    checks.packages("an MCAP log", "mcap", extra="export")
    from mcap.writer import Writer

    t = clock(run)
    t = t - min(t.min(initial=0.0), 0.0)
    if t.max(initial=0.0) > LATEST:
        raise InvalidInput(f"the run has a tick {t.max():.3g} s from 0; an MCAP log counts at most {LATEST:.3g} s")
    content = log(Run({**run.columns, "t": t}, run.meta), robot)
    with written(path) as aside, aside.open("wb") as file:
        writer: Any = Writer(file)
        writer.start(profile="", library=f"wbc {__version__}")
        topics = _Topics(writer)
        _series(topics, content, progress)
        if content.scene is not None:
            _scene(topics, content, content.scene.times)
        writer.finish()
    progress(1.0, "writing the log")
    return Path(path)


@final
class _Topics:
    """The channels of a log, each made when it is first written to."""

    def __init__(self, writer: Any) -> None:
        self._writer = writer
        self._channels: dict[str, int] = {}

    def add(self, topic: str, schema: str, properties: dict[str, Any]) -> int:
        """The number of a new channel, of messages that are JSON objects with these properties."""
        described = {"title": schema, "type": "object", "properties": properties}
        number = self._writer.register_schema(schema, "jsonschema", json.dumps(described).encode())
        return int(self._writer.register_channel(topic, "json", number))

    def write(self, channel: int, t: float, message: bytes) -> None:
        """A message at a time [s]."""
        now = round(1e9 * t)
        self._writer.add_message(channel, now, message, now)


def _series(topics: _Topics, content: Log, progress: Progress) -> None:
    channels = []
    for name, series in content.series.items():
        properties = {
            n: {"type": "number", "description": unit} for n, unit in zip(series.names, series.units, strict=True)
        }
        if name == "tick":
            properties["status"] = {"type": "string", "description": "the name of the status"}
        channels.append((topics.add(f"/{name}", f"wbc.{name}", properties), _messages(series)))
    ticks = next((k for k, name in enumerate(content.series) if name == TICK), None)
    for i, t in enumerate(content.times):
        if i % 200 == 0:
            progress(i / len(content.times), "writing the log")
        for k, (channel, messages) in enumerate(channels):
            message = next(messages)
            if k == ticks:
                message = f'{message[:-1]}, "status": {json.dumps(str(content.status[i]))}}}'
            topics.write(channel, float(t), message.encode())


def _messages(series: Series) -> Iterator[str]:
    """The message of each tick, numbers to nine digits; what is not finite is null."""
    keys = [json.dumps(name, ensure_ascii=False).replace("%", "%%") for name in series.names]
    form = "{" + ", ".join(f"{key}: %.9g" for key in keys) + "}"
    with_gaps = form.replace(": %.9g", ": %s")
    for row in series.values:
        if np.isfinite(row).all():
            yield form % tuple(row.tolist())
        else:
            yield with_gaps % tuple(f"{x:.9g}" if isfinite(x) else "null" for x in row.tolist())


def _scene(topics: _Topics, content: Log, times: Vec) -> None:
    any_list = {"type": "array", "items": {"type": "object"}}
    tf = topics.add("/tf", "foxglove.FrameTransforms", {"transforms": any_list})
    robot = topics.add("/robot", "foxglove.SceneUpdate", {"deletions": any_list, "entities": any_list})
    drawn = topics.add("/marks", "foxglove.SceneUpdate", {"deletions": any_list, "entities": any_list})
    start = float(times[0])
    world = f"{WORLD}_of_the_robot" if WORLD in content.poses else WORLD  # frames of one name are one
    meshes = [_entity(f"part {k}", start, part.link, triangles=[_mesh(part)]) for k, part in enumerate(content.solid)]
    topics.write(robot, start, _update(meshes))
    for i, t in enumerate(times.tolist()):
        moved = [
            {"timestamp": _time(t), "parent_frame_id": world, "child_frame_id": link, "translation": _xyz(pose[i, :3]),
             "rotation": _xyzw(pose[i, 3:])}
            for link, pose in content.poses.items()
        ]  # fmt: skip
        topics.write(tf, t, json.dumps({"transforms": moved}).encode())
        shown = [mark for mark in content.marks if not mark.hidden]
        topics.write(drawn, t, _update([_entity(mark.label, t, world, **_mark(mark, i)) for mark in shown]))


def _update(entities: list[dict[str, Any]]) -> bytes:
    return json.dumps({"deletions": [], "entities": entities}).encode()


def _entity(name: str, t: float, frame: str, **shapes: Any) -> dict[str, Any]:
    empty: dict[str, list[Any]] = {
        kind: [] for kind in
        ("metadata", "arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")
    }  # fmt: skip
    about = {
        "timestamp": _time(t),
        "frame_id": frame,
        "id": name,
        "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": True,
    }
    return about | empty | shapes


def _mesh(part: Part) -> dict[str, Any]:
    red, green, blue = (c / 255 for c in part.color)
    return {
        "pose": _pose(), "points": [_xyz(np.round(p, 5)) for p in part.vertices], "colors": [],
        "color": {"r": red, "g": green, "b": blue, "a": 1.0}, "indices": part.faces.ravel().tolist(),
    }  # fmt: skip


def _mark(mark: Mark, i: int) -> dict[str, Any]:
    """The shapes of a mark at its moment ``i``."""
    points, color = mark.points[i], _color(mark.color)
    if not np.isfinite(points).all():
        return {}
    if mark.kind == "arrow":
        return {"arrows": [_arrow(tail, tip, color) for tail, tip in points.reshape(-1, 2, 3) if np.any(tail != tip)]}
    if mark.kind == "line":
        corners = [_xyz(p) for p in points]
        return {"lines": [{"type": 1, "pose": _pose(), "thickness": 3.0, "scale_invariant": True, "points": corners,
                           "color": color, "colors": [], "indices": []}]}  # fmt: skip
    return {"spheres": [{"pose": _pose(points[0]), "size": _xyz(np.full(3, POINT)), "color": color}]}


def _arrow(tail: Vec, tip: Vec, color: dict[str, float]) -> dict[str, Any]:
    """An arrow along the x axis of its pose."""
    way = tip - tail
    length = float(np.linalg.norm(way))
    turn = np.array([length + way[0], 0.0, -way[2], way[1]])  # the half turn from x to the way: 1 + x·d, x × d
    turn = turn / np.linalg.norm(turn) if np.linalg.norm(turn) > 1e-9 * length else np.array([0.0, 0.0, 0.0, 1.0])
    head = min(2 * HEAD, 0.5 * length)
    return {
        "pose": {"position": _xyz(tail), "orientation": _xyzw(turn)}, "shaft_length": length - head,
        "shaft_diameter": SHAFT, "head_length": head, "head_diameter": HEAD, "color": color,
    }  # fmt: skip


def _pose(place: Vec | None = None) -> dict[str, Any]:
    return {"position": _xyz(np.zeros(3) if place is None else place), "orientation": _xyzw(np.eye(4)[0])}


def _xyz(values: Vec) -> dict[str, float]:
    return dict(zip("xyz", values.tolist(), strict=True))


def _xyzw(wxyz: Vec) -> dict[str, float]:
    return dict(zip("wxyz", wxyz.tolist(), strict=True))


def _time(t: float) -> dict[str, int]:
    seconds, nanoseconds = divmod(round(1e9 * t), 10**9)
    return {"sec": seconds, "nsec": nanoseconds}


def _color(text: str) -> dict[str, float]:
    return {key: int(text[i : i + 2], 16) / 255 for key, i in zip("rgb", (1, 3, 5), strict=True)} | {"a": 1.0}
