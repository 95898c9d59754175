"""A robot on a floor, drawn by MuJoCo's renderer without a window: shadows, forces and targets, as arrays of pixels."""

from __future__ import annotations

import ctypes.util
import os
import sys
from collections.abc import Mapping, Sequence
from importlib import import_module
from itertools import pairwise
from typing import Any, final

import numpy as np
from numpy.typing import NDArray

from wbc.errors import NotSupported
from wbc.models.mujoco_import import import_mujoco
from wbc.report.marks import RED, Mark, above_ground
from wbc.report.shapes import Part
from wbc.types import Mat, Vec

Pixels = NDArray[np.uint8]
Colour = tuple[float, float, float, float]

PAPER: Colour = (0.95, 0.96, 0.975, 1.0)
TILES = ((0.80, 0.83, 0.86), (0.87, 0.89, 0.915))
HALF_FLOOR = 40.0  # half a side of the floor [m]
TILE = 0.5  # a side of a tile [m]
FIELD_OF_VIEW = 40.0  # vertical [deg]
MOST_MARKS = 2000
OPAQUE = 0.8  # marks are seen through the robot, and it through them


@final
class Stage:
    """The parts of a robot, each moved with its link, and the camera before them.

    ``camera``: azimuth and elevation of where it looks [deg] and its distance [m] from what it looks at. The stage
    holds an OpenGL context of this thread until :meth:`close`.

    Raises:
        NotSupported: mujoco is not installed, or this machine has no OpenGL for drawing without a window.
    """

    def __init__(self, solid: Sequence[Part], *, size: tuple[int, int], camera: Vec, extent: float) -> None:
        try:
            self._mj = mj = import_mujoco()
        except ImportError as cause:
            raise NotSupported("a picture is drawn by MuJoCo; from a clone of wbc: pip install '.[export]'") from cause
        width, height = size
        self._context = _opengl(width, height)
        spec = _described(mj, solid, size, extent)
        self._model = model = spec.compile()
        self._data = mj.MjData(model)
        bodies = {part.link: model.body(_body(part.link)) for part in solid}
        self._links = {link: int(body.mocapid[0]) for link, body in bodies.items()}
        self._bodies = {link: int(body.id) for link, body in bodies.items()}
        self._colours = model.geom_rgba.copy()
        self._scene = mj.MjvScene(model, maxgeom=model.ngeom + MOST_MARKS)
        self._drawing = mj.MjrContext(model, mj.mjtFontScale.mjFONTSCALE_100)
        mj.mjr_setBuffer(mj.mjtFramebuffer.mjFB_OFFSCREEN, self._drawing)
        self._window = mj.MjrRect(0, 0, width, height)
        self._options, self._camera = mj.MjvOption(), mj.MjvCamera()
        self._camera.azimuth, self._camera.elevation, self._camera.distance = camera
        self._pixels: Pixels = np.empty((height, width, 3), np.uint8)
        self._thick = 0.008 * extent

    def draw(
        self, poses: Mapping[str, Vec], marks: Sequence[tuple[Mark, Mat]], *, at: Vec, red: Sequence[str] = ()
    ) -> Pixels:
        """The picture (height, width, 3) of links at ``poses``, position and quaternion w x y z (7,) each.

        Each of ``marks`` comes with its points (m, 3) now, a point at the end of the way that it went. The camera looks
        ``at`` (3,); the links in ``red`` are red.
        """
        mj, model, data = self._mj, self._model, self._data
        for link, k in self._links.items():
            data.mocap_pos[k], data.mocap_quat[k] = poses[link][:3], poses[link][3:]
        model.geom_rgba[:] = self._colours
        for link in red:
            model.geom_rgba[model.geom_bodyid == self._bodies.get(link, -1)] = _rgba(RED)
        mj.mj_kinematics(model, data)
        mj.mj_camlight(model, data)
        self._camera.lookat = at
        seen = self._rendered(mj.mjtCatBit.mjCAT_ALL, ())
        if not marks:
            return seen
        over = self._rendered(mj.mjtCatBit.mjCAT_DECOR, marks)
        drawn = over.any(axis=2)
        seen[drawn] = ((1.0 - OPAQUE) * seen[drawn] + OPAQUE * over[drawn]).astype(np.uint8)
        return seen

    def _rendered(self, categories: Any, marks: Sequence[tuple[Mark, Mat]]) -> Pixels:
        mj, scene = self._mj, self._scene
        for flag in (mj.mjtRndFlag.mjRND_SKYBOX, mj.mjtRndFlag.mjRND_HAZE, mj.mjtRndFlag.mjRND_SHADOW):
            scene.flags[flag] = not marks
        mj.mjv_updateScene(self._model, self._data, self._options, None, self._camera, categories, scene)
        for mark, points in marks:
            self._add(mark, points)
        mj.mjr_render(self._window, scene, self._drawing)
        mj.mjr_readPixels(self._pixels, None, self._window, self._drawing)
        return self._pixels[::-1].copy()

    def close(self) -> None:
        """Free what the graphics hold."""
        self._drawing.free()
        self._context.free()

    def _add(self, mark: Mark, points: Mat) -> None:
        kinds, thick = self._mj.mjtGeom, self._thick
        if mark.kind == "arrow":
            for tail, tip in above_ground(points.reshape(-1, 2, 3)):
                self._connect(kinds.mjGEOM_ARROW, 1.1 * thick, tail, tip, mark.color)
        elif mark.kind == "line":
            self._line(np.vstack([points, points[:1]]), 0.35 * thick, mark.color)
        elif np.isfinite(points[-1]).all():
            self._line(points, 0.2 * thick, mark.color)
            self._geometry(kinds.mjGEOM_SPHERE, np.full(3, 1.8 * thick), points[-1], mark.color)

    def _line(self, points: Mat, thick: float, color: str) -> None:
        for start, end in pairwise(points):
            self._connect(self._mj.mjtGeom.mjGEOM_CAPSULE, thick, start, end, color)

    def _connect(self, kind: Any, thick: float, start: Vec, end: Vec, color: str) -> None:
        if np.isfinite([start, end]).all() and np.linalg.norm(end - start) > 1e-4:
            made = self._geometry(kind, np.zeros(3), np.zeros(3), color)
            if made is not None:
                self._mj.mjv_connector(made, kind, thick, start, end)

    def _geometry(self, kind: Any, size: Vec, place: Vec, color: str) -> Any:
        scene = self._scene
        if scene.ngeom >= scene.maxgeom:
            return None
        made = scene.geoms[scene.ngeom]
        self._mj.mjv_initGeom(made, kind, size, place, np.eye(3).ravel(), np.array(_rgba(color), np.float32))
        made.category = self._mj.mjtCatBit.mjCAT_DECOR  # casts no shadow
        scene.ngeom += 1
        return made


def _body(link: str) -> str:
    """What the body of a link is called: not as MuJoCo calls its own world."""
    return f"link {link}"


def _described(mj: Any, solid: Sequence[Part], size: tuple[int, int], extent: float) -> Any:
    """The stage as MuJoCo describes it: a floor of tiles, two lights, a body without weight for every link."""
    spec = mj.MjSpec()
    spec.visual.global_.offwidth, spec.visual.global_.offheight = size
    spec.visual.global_.fovy = FIELD_OF_VIEW
    spec.visual.quality.shadowsize, spec.visual.quality.offsamples = 4096, 4
    spec.visual.map.znear, spec.visual.map.zfar = 0.02, 60.0
    spec.visual.map.fogstart, spec.visual.map.fogend, spec.visual.map.haze = 3.0, 12.0, 0.4
    spec.visual.rgba.haze = spec.visual.rgba.fog = PAPER
    spec.visual.headlight.ambient, spec.visual.headlight.diffuse = np.full(3, 0.38), np.full(3, 0.25)
    spec.visual.headlight.specular = np.zeros(3)
    spec.stat.extent = max(extent, 0.5)
    spec.add_texture(
        name="sky", type=mj.mjtTexture.mjTEXTURE_SKYBOX, builtin=mj.mjtBuiltin.mjBUILTIN_GRADIENT,
        rgb1=PAPER[:3], rgb2=PAPER[:3], width=64, height=64,
    )  # fmt: skip
    spec.add_texture(
        name="tiles", type=mj.mjtTexture.mjTEXTURE_2D, builtin=mj.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=TILES[0], rgb2=TILES[1], width=256, height=256,
    )  # fmt: skip
    floor = spec.add_material(name="floor", texrepeat=[1.0 / TILE, 1.0 / TILE], texuniform=True)
    floor.textures[mj.mjtTextureRole.mjTEXROLE_RGB] = "tiles"
    spec.add_material(name="body", specular=0.25, shininess=0.35)
    world = spec.worldbody
    world.add_geom(type=mj.mjtGeom.mjGEOM_PLANE, size=[HALF_FLOOR, HALF_FLOOR, 1.0], material="floor")
    world.add_light(
        type=mj.mjtLightType.mjLIGHT_DIRECTIONAL, pos=[1.5, -2.0, 4.0], dir=[-0.4, 0.5, -1.0], castshadow=True,
        diffuse=[0.55, 0.55, 0.55], specular=[0.25, 0.25, 0.25],
    )  # fmt: skip
    world.add_light(
        type=mj.mjtLightType.mjLIGHT_DIRECTIONAL, pos=[-3.0, -3.0, 3.0], dir=[0.6, 0.6, -0.5], castshadow=False,
        diffuse=[0.22, 0.23, 0.25], specular=[0.0, 0.0, 0.0],
    )  # fmt: skip
    bodies: dict[str, Any] = {}
    for k, part in enumerate(solid):
        if part.link not in bodies:
            bodies[part.link] = world.add_body(name=_body(part.link), mocap=True)
        if len(part.vertices) < 4:  # MuJoCo takes no triangle for a mesh
            continue
        mesh = spec.add_mesh(
            name=f"part{k}", uservert=part.vertices.ravel(), userface=part.faces.ravel(),
            inertia=mj.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        )  # fmt: skip
        mesh.needsdf = False
        bodies[part.link].add_geom(
            type=mj.mjtGeom.mjGEOM_MESH, meshname=f"part{k}", material="body", contype=0, conaffinity=0,
            rgba=[*(0.9 * c / 255 for c in part.color), 1.0],
        )  # fmt: skip
    return spec


def _opengl(width: int, height: int) -> Any:
    """A current OpenGL context without a window: ``MUJOCO_GL`` says which (egl, osmesa, glfw, cgl), else the first that
    this machine has."""
    kind = os.environ.get("MUJOCO_GL", "").lower()
    if kind not in ("egl", "osmesa", "glfw", "cgl"):
        kind = next(iter(_offered()), "")
    try:
        if not kind:
            raise RuntimeError("no EGL, no OSMesa and no display")
        context = import_module(f"mujoco.{kind}").GLContext(width, height)
        context.make_current()
        return context
    except Exception as cause:
        why = " ".join(str(cause).split()) or type(cause).__name__
        raise NotSupported(
            f"a picture needs OpenGL, which does not work here ({why}): "
            "on Debian or Ubuntu, apt install libegl1 libgl1-mesa-dri, or libosmesa6 and set MUJOCO_GL=osmesa"
        ) from cause


def _offered() -> list[str]:
    """Ways to OpenGL that this machine has, the best first."""
    if sys.platform == "darwin":
        return ["cgl"]
    found = [kind for kind, library in (("egl", "EGL"), ("osmesa", "OSMesa")) if ctypes.util.find_library(library)]
    return [*found, *(["glfw"] if os.environ.get("DISPLAY") or sys.platform == "win32" else [])]


def _rgba(color: str) -> Colour:
    red, green, blue = (int(color[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return red, green, blue, 1.0
