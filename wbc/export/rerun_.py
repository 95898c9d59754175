"""Rerun's recording, .rrd: the robot beside the plots, on one time."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from wbc import checks
from wbc.export.logs import Log, log
from wbc.files import written
from wbc.report.marks import Mark
from wbc.report.shapes import check_kinds
from wbc.sim.scenario import Progress, silent

if TYPE_CHECKING:
    from wbc.control.recorder import Run
    from wbc.models.model import RobotModel

TIME = "time"
#: What the first view shows beside the robot, if the run has it.
PLOTTED = ("tau", "v", "tick")
MOST_ERRORS = 3


def to_rerun(
    run: Run, path: str | os.PathLike[str], *, robot: RobotModel | None = None, progress: Progress = silent
) -> Path:
    """Write the run as a recording for Rerun's viewer; with ``robot`` its links, meshes, forces and targets too.

    Every column of the run is an entity below ``/run`` with its numbers by name, at the run's own times; ``/world`` is
    the scene. Changes of the status are the text log ``/status``.

    Raises:
        NotSupported: the package rerun-sdk is not installed.
        InvalidInput: a run without ticks, or a place that cannot be written.
    """
    check_kinds(run, robot)
    checks.packages("a recording for Rerun", "rerun", extra="rerun")
    import rerun as rr

    content = log(run, robot)
    with written(path) as aside:
        recording = rr.RecordingStream(f"wbc {run.meta.get('scenario', 'run')}", send_properties=False)
        recording.send_recording_name(str(run.meta.get("scenario", "run")))
        recording.save(aside, default_blueprint=_blueprint(content))
        _series(recording, content, progress)
        if content.scene is not None:
            _scene(recording, content)
        recording.flush()
        recording.disconnect()
    progress(1.0, "writing the recording")
    return Path(path)


def _series(recording: Any, content: Log, progress: Progress) -> None:
    import rerun as rr

    times = [rr.TimeColumn(TIME, duration=content.times)]
    for k, (name, series) in enumerate(content.series.items()):
        progress(k / len(content.series), "writing the recording")
        labels = [f"{n} [{unit}]" if unit else n for n, unit in zip(series.names, series.units, strict=True)]
        entity = rr.escape_entity_path_part(name)
        recording.log(f"run/{entity}", rr.SeriesLines(names=labels), static=True)
        recording.send_columns(f"run/{entity}", times, rr.Scalars.columns(scalars=series.values))
    changed = np.flatnonzero(np.append(True, content.status[1:] != content.status[:-1]))
    at = [rr.TimeColumn(TIME, duration=content.times[changed])]
    recording.send_columns("status", at, rr.TextLog.columns(text=[str(s) for s in content.status[changed]]))


def _scene(recording: Any, content: Log) -> None:
    import rerun as rr

    assert content.scene is not None, "only called with a scene"
    recording.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for k, part in enumerate(content.solid):
        mesh = rr.Mesh3D(
            vertex_positions=part.vertices, triangle_indices=part.faces, albedo_factor=[*part.color, 255],
            vertex_normals=_normals(part.vertices, part.faces),
        )  # fmt: skip
        recording.log(f"world/robot/{rr.escape_entity_path_part(part.link)}/part{k}", mesh, static=True)
    times = [rr.TimeColumn(TIME, duration=content.scene.times)]
    for link, pose in content.poses.items():
        moved = rr.Transform3D.columns(translation=pose[:, :3], quaternion=np.roll(pose[:, 3:], -1, axis=1))
        recording.send_columns(f"world/robot/{rr.escape_entity_path_part(link)}", times, moved)
    for mark in content.marks:
        if not mark.hidden:
            entity = f"world/{rr.escape_entity_path_part(mark.label)}"
            recording.send_columns(entity, times, _mark(mark))


def _mark(mark: Mark) -> Any:
    import rerun as rr

    count, size = mark.points.shape[:2]
    color = [int(mark.color[1:] + "ff", 16)]
    if mark.kind == "arrow":
        ends = mark.points.reshape(-1, 2, 3)
        columns = rr.Arrows3D.columns(
            origins=ends[:, 0], vectors=ends[:, 1] - ends[:, 0], colors=color * len(ends), radii=[0.006] * len(ends)
        )
        return columns.partition([size // 2] * count)
    if mark.kind == "line":
        closed = np.concatenate([mark.points, mark.points[:, :1]], axis=1)
        return rr.LineStrips3D.columns(strips=closed, colors=color * count, radii=[0.003] * count)
    return rr.Points3D.columns(positions=mark.points[:, 0], colors=color * count, radii=[0.02] * count)


def _normals(vertices: Any, faces: Any) -> Any:
    """A normal at each vertex (k, 3), the mean of those of its triangles by their area."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normals, faces[:, k], np.cross(b - a, c - a))
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)


def _blueprint(content: Log) -> Any:
    """The robot on the left, the plots that one looks at first on the right."""
    import rerun as rr
    import rerun.blueprint as rrb

    errors = [name for name in content.series if name.startswith("error.")][:MOST_ERRORS]
    names = [name for name in (*errors, *PLOTTED) if name in content.series]
    plots = [rrb.TimeSeriesView(origin=f"/run/{rr.escape_entity_path_part(n)}", name=n) for n in names]
    robot = [rrb.Spatial3DView(origin="/world", name="robot")] if content.scene is not None else []
    return rrb.Blueprint(rrb.Horizontal(*robot, rrb.Vertical(*plots)), rrb.TimePanel(timeline=TIME))
