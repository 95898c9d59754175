"""What a scenario shows of its own, in files beside the record: sections and obstacles, read back to the bit."""

from __future__ import annotations

import gzip
import json
import zlib
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, final

import numpy as np

from wbc.errors import InvalidInput
from wbc.models.collision import Obstacle
from wbc.models.geometry import Box, Cylinder, Sphere
from wbc.npz import MAX_BYTES, read_json
from wbc.report.coded import Codec
from wbc.report.document import (
    Address,
    Bar,
    Bound,
    Curve,
    Figure,
    Link,
    Map,
    Marked,
    Plot,
    Section,
    Strip,
    Table,
    Text,
)
from wbc.types import Mat, Vec

SECTIONS_FILE, OBSTACLES_FILE = "sections.json.gz", "obstacles.json.gz"


@final
class Placed(NamedTuple):
    """An obstacle and where it was: positions (N, 3) [m] and rotations (N, 3, 3) at ``t`` (N,) [s], one if it rests."""

    name: str
    shape: Box | Sphere | Cylinder
    t: Vec
    positions: Mat
    rotations: Mat


CODEC = Codec(
    (Address, Bar, Bound, Box, Curve, Cylinder, Figure, Link, Map, Marked, Placed, Plot, Section, Sphere, Strip, Table,
     Text)
)  # fmt: skip


def keep_sections(sections: Sequence[Section], folder: Path) -> None:
    """Write ``sections`` into ``folder``; nothing where there are none."""
    _keep(sections, folder / SECTIONS_FILE)


def kept_sections(folder: Path) -> list[Section]:
    """What :func:`keep_sections` wrote there.

    Raises:
        InvalidInput: it is something else.
    """
    return _kept(folder / SECTIONS_FILE, Section, "sections")


def keep_obstacles(obstacles: Sequence[Obstacle], t: Vec, folder: Path) -> None:
    """Write where ``obstacles`` are at the times ``t`` (N,) [s] into ``folder``; those that are meshes are left out."""
    placed = []
    for one in obstacles:
        if isinstance(one.shape, Box | Sphere | Cylinder):
            times = np.asarray(t if one.moves else t[:1], dtype=np.float64)
            poses = [one.at(float(time)) for time in times]
            positions, rotations = (np.array([getattr(p, what) for p in poses]) for what in ("translation", "rotation"))
            placed.append(Placed(one.name, one.shape, times, positions, rotations))
    _keep(placed, folder / OBSTACLES_FILE)


def kept_obstacles(folder: Path) -> list[Obstacle]:
    """What :func:`keep_obstacles` wrote there: obstacles that are where they were at the nearest time.

    Raises:
        InvalidInput: it is something else.
    """
    path = folder / OBSTACLES_FILE
    found = _kept(path, Placed, "obstacles")
    for one in found:
        n = len(one.t)
        if not n or np.shape(one.positions) != (n, 3) or np.shape(one.rotations) != (n, 3, 3):
            raise InvalidInput(f"{path} cannot be read: {one.name!r} has not one pose for each of its times")
    return [Obstacle(one.name, one.shape, partial(_pose, one)) for one in found]


def _pose(placed: Placed, t: float) -> Any:
    import pinocchio as pin

    k = int(np.argmin(np.abs(placed.t - t)))
    return pin.SE3(placed.rotations[k], placed.positions[k])


def _keep(items: Sequence[Any], path: Path) -> None:
    if items:
        text = json.dumps(CODEC.plain(items), ensure_ascii=False, allow_nan=False)
        path.write_bytes(gzip.compress(text.encode(), mtime=0))


def _kept(path: Path, kind: Any, what: str) -> list[Any]:
    if not path.is_file():
        return []
    try:
        with gzip.open(path) as file:
            text = file.read(MAX_BYTES)
        found = list(CODEC.whole(read_json(str(path), text)))
    except (OSError, EOFError, zlib.error, TypeError, KeyError, ValueError, AttributeError) as cause:
        raise InvalidInput(f"{path} cannot be read: {cause}") from cause
    if not found or not all(isinstance(one, kind) for one in found):
        raise InvalidInput(f"{path} cannot be read: it holds no {what}")
    return found
