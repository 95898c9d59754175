"""The motion as one self-contained 3-D page: robot, floor, contact forces, pushes, play bar; works offline.

The page is recorded by viser's scene serialiser. Its server is bound to this machine only, on a free port, says
nothing, and is stopped before anything else happens.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from typing import TYPE_CHECKING, Any

import numpy as np

from wbc.errors import NotSupported
from wbc.report.motion import Motion, motion, quaternions
from wbc.report.shapes import Part, thinned
from wbc.types import Index

if TYPE_CHECKING:
    from wbc.control.recorder import Run
    from wbc.models.collision import Obstacle
    from wbc.models.model import RobotModel

FRAMES_PER_SECOND = 25.0
MAX_FRAMES = 1500  # a minute; a longer run is shown with fewer frames a second
BUDGET = 60_000  # triangles of the whole robot
VIEW = np.array([1.15, -0.92, 0.42])  # where the camera stands, from the middle, in sizes of the scene
STILL = 1e-5  # a link that moved less than this (m, or of its quaternion) since it was last shown stays

FORCE, PUSH = (47, 143, 91), (197, 61, 61)


def replay(
    run: Run, robot: RobotModel, solid: Sequence[Part], *, title: str = "", obstacles: Sequence[Obstacle] = ()
) -> str:
    """The page's HTML: the run of ``robot``, drawn as ``solid``, in its own time at 25 frames a second.

    ``solid`` has parts of the robot's links and of ``obstacles``.

    Raises:
        NotSupported: viser is not installed.
    """
    rows, pause = _frames(run)
    solid = thinned(solid, BUDGET)
    moving = motion(run, robot, rows, sorted({part.link for part in solid}), obstacles)
    turned = {link: quaternions(rotation) for link, (_, rotation) in moving.links.items()}
    with _server(title) as server:
        _stage(server, moving)
        links = _robot(server, solid, moving)
        forces, push = _arrows(server, moving)
        recording = server.get_scene_serializer()
        shown: dict[str, Any] = {}
        for i in range(len(rows)):
            for link, handle in links.items():
                pose = np.concatenate([moving.links[link][0][i], turned[link][i]])
                if link not in shown or np.abs(pose - shown[link]).max() > STILL:
                    handle.position, handle.wxyz = pose[:3], pose[3:]
                    shown[link] = pose
            if forces is not None:
                forces.points = moving.forces[i].astype(np.float32)
            if push is not None:
                pushed = bool(np.any(moving.pushes[i, 0] != moving.pushes[i, 1]))
                push.visible = pushed
                if pushed:
                    push.points = moving.pushes[i : i + 1].astype(np.float32)
            recording.insert_sleep(pause)
        return str(recording.as_html())


def _frames(run: Run) -> tuple[Index, float]:
    """Rows of the run to show and the time [s] between them."""
    dt = float(run.meta["dt"])
    step = max(1, round(1.0 / (FRAMES_PER_SECOND * dt)), -(-run.rows // MAX_FRAMES))
    return np.arange(0, run.rows, step), step * dt


@contextmanager
def _server(title: str) -> Iterator[Any]:
    try:
        import viser
    except ImportError as cause:
        raise NotSupported("the 3-D replay needs viser; pip install 'wbc-qp[report]'") from cause

    with redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host="127.0.0.1", port=0, label=title or None, verbose=False)
        try:
            yield server
        finally:
            server.stop()


def _stage(server: Any, moving: Motion) -> None:
    """Floor and camera."""
    middle, size = moving.extent
    server.scene.set_up_direction("+z")
    server.scene.add_grid(
        "/floor", width=8.0, height=8.0, cell_size=0.25, section_size=1.0, cell_color=(222, 226, 230),
        section_color=(190, 197, 205), position=(round(middle[0]), round(middle[1]), 0.0),
    )  # fmt: skip
    server.initial_camera.position = tuple(middle + size * VIEW)
    server.initial_camera.look_at = tuple(middle)
    server.initial_camera.fov = 0.75


def _robot(server: Any, solid: Sequence[Part], moving: Motion) -> dict[str, Any]:
    """The meshes under one movable node for each link."""
    nodes = {link: f"/robot/{k}" for k, link in enumerate(moving.links)}
    handles = {link: server.scene.add_frame(node, show_axes=False) for link, node in nodes.items()}
    for k, part in enumerate(solid):
        server.scene.add_mesh_simple(
            f"{nodes[part.link]}/{k}", part.vertices.astype(np.float32), part.faces.astype(np.uint32),
            color=part.color, flat_shading=True, side="double",
        )  # fmt: skip
    return handles


def _arrows(server: Any, moving: Motion) -> tuple[Any, Any]:
    """Arrows for the contact forces and for the push; None for what the run does not have."""
    _, extent = moving.extent
    size = {"shaft_radius": 0.008 * extent, "head_radius": 0.02 * extent, "head_length": 0.04 * extent}
    forces = push = None
    if moving.forces.shape[1]:
        forces = server.scene.add_arrows("/forces", moving.forces[0].astype(np.float32), FORCE, **size)
    if np.any(moving.pushes[:, 0] != moving.pushes[:, 1]):
        push = server.scene.add_arrows("/push", moving.pushes[:1].astype(np.float32), PUSH, visible=False, **size)
    return forces, push
