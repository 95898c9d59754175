"""The robot as triangles: every shape of a model read, coloured, and thinned to a budget.

A robot without any shape gets capsules from joint to joint, so that a report always has somebody to look at.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from numpy.typing import ArrayLike

from wbc import checks
from wbc.control.recorder import Run
from wbc.errors import NotSupported
from wbc.models.chain import Chain
from wbc.models.collision import Obstacle
from wbc.models.geometry import Box, Cylinder, Geometry, Mesh, Sphere
from wbc.models.model import RobotModel
from wbc.models.pinocchio_ import PinocchioModel
from wbc.models.planar import JointLimits, PlanarRobot
from wbc.report.meshes import Faces, Rgb, read_mesh
from wbc.types import Mat, Vec

Color = tuple[int, int, int]

#: Red, green, blue, opacity.
_OBSTACLE = (0.78, 0.36, 0.30, 1.0)
VIEW = (1.15, -0.92, 0.42)
LIGHT: Color = (214, 219, 226)
DARK: Color = (74, 85, 104)


@final
@dataclass(frozen=True, eq=False)
class Part:
    """Triangles that move with the frame ``link``: vertices (k, 3) [m] in its axes, faces (m, 3), one colour 0…255."""

    link: str
    vertices: Mat
    faces: Faces
    color: Color


def parts(robot: RobotModel) -> list[Part]:
    """The whole robot, one part per link and colour: what it shows, else what it collides with, else its skeleton.

    Empty for a robot that is not made of links in space.
    """
    if isinstance(robot, PlanarRobot):
        return planar(robot)
    if not isinstance(robot, PinocchioModel):
        return []
    return _read_all(robot.visuals) or _read_all(robot.collisions) or skeleton(robot)


def obstacle_parts(obstacles: Sequence[Obstacle]) -> list[Part]:
    """What stands in the world, each obstacle under its own name."""
    return _read_all([Geometry(obstacle.name, obstacle.shape, color=_OBSTACLE) for obstacle in obstacles])


def thinned(solid: Sequence[Part], budget: int) -> list[Part]:
    """At most ``budget`` triangles: vertices are merged in ever larger cells of one grid until they fit."""
    cell, coarse = 1e-3, list(solid)
    while sum(len(part.faces) for part in coarse) > budget:
        coarse = [Part(part.link, *clustered(part.vertices, part.faces, cell), part.color) for part in solid]
        cell *= 1.3
    return coarse


def planar(robot: PlanarRobot) -> list[Part]:
    """A planar chain: a rod for every link that turns, and a block on a rail for every one that slides."""
    lengths = [value for name, value in robot.parameters.items() if name.startswith("l")]
    size = max([*lengths, 0.5])
    radius, found = 0.05 * size, []
    for i, joint in enumerate(robot.chain.joints, start=1):
        axis = np.array([0.0, 1.0, 0.0] if joint == "Py" else [1.0, 0.0, 0.0])
        if joint == "R":
            length = robot.parameters[f"l{i}"]
            found.append(_part(f"link{i}", LIGHT, _along(axis, 0.5 * length * axis, capsule(radius, length))))
            continue
        rail, block = capsule(0.3 * radius, 4.0 * size), _box((4.0 * radius, 4.0 * radius, 3.0 * radius))
        found.append(_part(f"link{i - 1}" if i > 1 else "base", DARK, _along(axis, np.zeros(3), rail)))
        found.append(_part(f"link{i}", LIGHT, block))
    return found


@final
class _Described(PlanarRobot):
    """A planar robot that is made to be drawn, without the coefficients of adaptive control."""

    @property
    def coefficients(self) -> Vec:
        raise NotSupported("a planar robot of a record has no coefficients")

    def regressor(self, q: ArrayLike, v: ArrayLike, v_reference: ArrayLike, a: ArrayLike) -> Mat:
        raise NotSupported("a planar robot of a record has no regressor")


def check_kinds(run: Run, robot: RobotModel | None, name: str = "run") -> None:
    """That these are a run, called ``name`` by who gave it, and a robot or None.

    Raises:
        InvalidInput: something else.
    """
    checks.instance(name, run, Run, "a wbc.Run, such as wbc.Recorder.run() gives")
    if robot is not None:
        checks.instance("robot", robot, RobotModel, "a robot from wbc.load(...)")


def described(name: str, planar: Mapping[str, Any], limits: JointLimits) -> PlanarRobot:
    """The planar robot that a record describes: ``chain``, ``parameters`` and ``gravity`` of its metadata.

    Raises:
        InvalidInput, KeyError: the metadata describes no chain.
    """
    return _Described(
        name, Chain.parse(planar["chain"]), planar["parameters"], gravity=planar["gravity"], limits=limits
    )


def skeleton(robot: PinocchioModel) -> list[Part]:
    """A robot without shapes: in every link a capsule from its own joint to each of the next, and a box for a sole."""
    reach = sum(float(np.linalg.norm(joint.origin.xyz)) for joint in robot.urdf.joints) / 10.0
    radius = min(max(0.12 * reach, 0.01), 0.05)
    bones = []
    for joint in robot.urdf.joints:
        along = np.array(joint.origin.xyz)
        length = float(np.linalg.norm(along))
        if length > 0.5 * radius:
            bone = _along(along / length, along / 2, capsule(radius, length))
            bones.append(_part(joint.parent, LIGHT, bone))
    for frame, foot in robot.feet.items():
        if foot.half_size is not None:
            sole = _box((2 * foot.half_size[0], 2 * foot.half_size[1], 0.02))
            sole.apply_translation(np.array(foot.origin) + np.array([0.0, 0.0, 0.01]))
            bones.append(_part(frame, DARK, sole))
    return bones


def view(robot: RobotModel) -> tuple[float, float, float]:
    """Where one stands to look at the robot, from its middle, in sizes of the scene: above one that is planar."""
    return (0.0, -0.05, 1.3) if isinstance(robot, PlanarRobot) else VIEW


# ---- primitives, centred at the origin, round ones along z
def _box(size: tuple[float, float, float]) -> Any:
    from trimesh.creation import box

    return box(extents=size)


def capsule(radius: float, length: float) -> Any:
    """A capsule, a mesh of trimesh; ``length`` is between the centres of its ends."""
    from trimesh import creation

    return creation.capsule(height=length, radius=radius, count=(12, 24))


def _along(direction: Vec, middle: Vec, mesh: Any) -> Any:
    """The mesh, turned from z to a unit vector and moved to ``middle``."""
    from trimesh.geometry import align_vectors

    turned: Any = align_vectors  # trimesh carries no types for it
    transform = turned([0.0, 0.0, 1.0], direction)
    transform[:3, 3] = middle
    return mesh.apply_transform(transform)


def _part(link: str, color: Color, *meshes: Any) -> Part:
    from trimesh.util import concatenate

    whole: Any = concatenate(list(meshes))
    return Part(link, np.array(whole.vertices), np.array(whole.faces), color)


# ---- shapes of a model, colours, thinning
def _read_all(geometries: Sequence[Geometry]) -> list[Part]:
    grouped: dict[tuple[str, Color], list[Any]] = defaultdict(list)
    for geometry in geometries:
        for mesh, color in _meshes(geometry):
            grouped[geometry.link, _color(color, geometry)].append(mesh.apply_transform(geometry.origin.matrix))
    return [_part(link, color, *meshes) for (link, color), meshes in grouped.items()]


def _meshes(geometry: Geometry) -> list[tuple[Any, Rgb | None]]:
    """Meshes of trimesh in the axes of the geometry, each with its own colour, if it has one."""
    from trimesh import Trimesh, creation

    match geometry.shape:
        case Box(size):
            return [(_box(size), None)]
        case Sphere(radius):
            return [(creation.icosphere(subdivisions=2, radius=radius), None)]
        case Cylinder(radius, length):
            return [(creation.cylinder(radius=radius, height=length, sections=24), None)]
        case Mesh(path, scale):
            read = [(Trimesh(s.vertices, s.faces, process=False), s.color) for s in read_mesh(path)]
            return [(mesh.apply_transform(np.diag([*scale, 1.0])), color) for mesh, color in read]


def _color(own: Rgb | None, geometry: Geometry) -> Color:
    """What the mesh says, else what the robot's description says, else a light grey."""
    said = own or geometry.color
    if said is None:
        return LIGHT
    red, green, blue = (round(255 * min(max(float(c), 0.0), 1.0)) for c in said[:3])
    return red, green, blue


def clustered(vertices: Mat, faces: Faces, cell: float) -> tuple[Mat, Faces]:
    """All vertices in one cell of a grid [m] become their mean; triangles that collapse or repeat are dropped."""
    cells = np.floor(vertices / cell).astype(np.int64)
    cells -= cells.min(axis=0, initial=0)
    _, rows, high = cells.max(axis=0, initial=0) + 1  # one number a cell: sorting numbers is much faster than rows
    _, index = np.unique((cells[:, 0] * rows + cells[:, 1]) * high + cells[:, 2], return_inverse=True)
    count = np.bincount(index).astype(float)
    means = np.column_stack([np.bincount(index, weights=vertices[:, k]) / count for k in range(3)])
    merged = index[faces]
    merged = merged[(merged[:, 0] != merged[:, 1]) & (merged[:, 1] != merged[:, 2]) & (merged[:, 2] != merged[:, 0])]
    low, middle, last = np.sort(merged, axis=1).T
    _, side = np.unique(low * len(means) + middle, return_inverse=True)
    _, first = np.unique(side * len(means) + last, return_index=True)
    return means, merged[np.sort(first)]
