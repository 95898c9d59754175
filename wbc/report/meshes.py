"""Mesh files as triangles, read by trimesh and pycollada.

A file that cannot be read gives no triangles: a picture may lack a part, a report may not fail for it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from wbc.models.safe_xml import parse_xml
from wbc.types import Mat

Faces = NDArray[np.int64]
Rgb = tuple[float, float, float]

SUFFIXES = (".stl", ".obj", ".dae")
MAX_BYTES = 50_000_000


class Surface(NamedTuple):
    """Vertices (k, 3) [m], faces (m, 3) as indices, and the file's own colour, 0…1, if it has one."""

    vertices: Mat
    faces: Faces
    color: Rgb | None = None


def read_mesh(path: Path) -> list[Surface]:
    """The surfaces in a mesh file, one for each colour or object; none if it cannot be read.

    As other robotics tools do, the unit of a COLLADA file is applied and its up axis is not: the pose of a mesh in a
    robot is said by the robot's description.
    """
    import trimesh

    try:
        if path.suffix.lower() not in SUFFIXES or path.stat().st_size > MAX_BYTES:
            return []
        if path.suffix.lower() == ".dae":
            parse_xml(path.read_text(encoding="utf-8-sig"))  # refuses entities and what is nested too deep
        scene = trimesh.load_scene(path)
        unit = trimesh.units.unit_conversion(scene.units, "meters") if scene.units else 1.0
        placed = [scene.graph[node] for node in scene.graph.nodes_geometry]
        surfaces = [_surface(scene.geometry[name], unit, matrix) for matrix, name in placed]
    except Exception:  # spoilt files raise errors of every kind in readers
        return []
    return [surface for surface in surfaces if len(surface.faces) and np.isfinite(surface.vertices).all()]


def _surface(mesh: Any, unit: float, matrix: Mat) -> Surface:
    placed = unit * (mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3])
    faces = np.asarray(mesh.faces, dtype=np.int64)
    material = getattr(mesh.visual, "material", None) if mesh.visual.defined else None
    red, green, blue = (1.0, 1.0, 1.0) if material is None else np.asarray(material.main_color)[:3] / 255.0
    color = None if material is None else (float(red), float(green), float(blue))
    return Surface(placed, faces[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0 else faces, color)
