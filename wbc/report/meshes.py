"""Mesh files as triangles: STL, OBJ and COLLADA, read here so that a report needs no further library.

A file that cannot be read gives no triangles: a picture may lack a part, a report may not fail for it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from wbc.errors import ModelError
from wbc.report.collada import read_collada
from wbc.types import Mat

Faces = NDArray[np.int64]
Rgb = tuple[float, float, float]

MAX_BYTES = 50_000_000


class Surface(NamedTuple):
    """Vertices (k, 3) [m], faces (m, 3) as indices, and the file's own colour, 0…1, if it has one."""

    vertices: Mat
    faces: Faces
    color: Rgb | None = None


def read_mesh(path: Path) -> list[Surface]:
    """The surfaces in a mesh file, one for each colour or object; none if it cannot be read."""
    readers = {".stl": _read_stl, ".obj": _read_obj, ".dae": _read_dae}
    reader = readers.get(path.suffix.lower())
    try:
        if reader is None or path.stat().st_size > MAX_BYTES:
            return []
        return [surface for surface in reader(path) if _is_whole(surface)]
    except (OSError, ValueError, KeyError, IndexError, ModelError):
        return []


def _is_whole(surface: Surface) -> bool:
    faces, count = surface.faces, len(surface.vertices)
    return bool(len(faces) and faces.min() >= 0 and faces.max() < count and np.isfinite(surface.vertices).all())


def _read_stl(path: Path) -> list[Surface]:
    """Binary or text; a binary file may well begin with the word "solid", so its size decides."""
    content = path.read_bytes()
    count = int.from_bytes(content[80:84], "little")
    if len(content) == 84 + 50 * count:
        record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
        corners = np.frombuffer(content, record, count, offset=84)["corners"].reshape(-1, 3).astype(np.float64)
    else:
        lines = re.findall(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", content)
        corners = np.array(lines, dtype=np.float64).reshape(-1, 3)
    vertices, index = np.unique(corners, axis=0, return_inverse=True)
    return [Surface(vertices, index.reshape(-1, 3).astype(np.int64))]


def _read_obj(path: Path) -> list[Surface]:
    """Vertices and faces; polygons become fans, materials are not read."""
    vertices: list[list[float]] = []
    faces: list[tuple[int, int, int]] = []
    for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
        word, *rest = line.split()[:100] or [""]
        if word == "v":
            vertices.append([float(x) for x in rest[:3]])
        elif word == "f":
            corners = [int(corner.partition("/")[0]) for corner in rest]
            faces += fan([c - 1 if c > 0 else len(vertices) + c for c in corners])
    return [Surface(np.array(vertices, dtype=np.float64), np.array(faces, dtype=np.int64))]


def _read_dae(path: Path) -> list[Surface]:
    return [Surface(*surface) for surface in read_collada(path)]


def fan(corners: list[int]) -> Iterable[tuple[int, int, int]]:
    """The triangles of a convex polygon."""
    return [(corners[0], b, c) for b, c in pairwise(corners[1:])]
