"""Shapes for coal, and what of its data a tick reads: placements as views."""

from __future__ import annotations

import re
import warnings
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from wbc.errors import InvalidInput, ModelError
from wbc.models.geometry import Box, Cylinder, Mesh, Shape, Sphere
from wbc.models.views import Shared
from wbc.types import Mat, Vec

#: The unit of a COLLADA file [m].
_UNIT = re.compile(rb"<unit\s[^>]*?\bmeter\s*=\s*[\"']([^\"']*)")
#: The largest mesh file that is read [bytes].
MAX_BYTES = 200_000_000

# Curved shapes get their distance by iteration. To a looser tolerance their normals shake; to this one it fails once in
# a million times, and says so by an absurd number. The penetration depth (EPA) has no floats for more.
TIGHT, _DEPTH_TOLERANCE, _ITERATIONS = 1e-11, 1e-6, 256
#: A distance [m] that is no answer, and the tolerance at which coal is asked again.
_ABSURD, _LOOSE = 1e6, 1e-6


def coal_shape(shape: Shape) -> tuple[Any, Any]:
    """The shape in coal's terms about the middle of its box, and where that middle is: an SE3.

    Raises:
        ModelError: a mesh file that is missing, empty, cut off, too large or not of its format.
        InvalidInput: a mesh that spans no volume.
    """
    from scipy.spatial import ConvexHull, QhullError

    still = pin.SE3.Identity()
    if isinstance(shape, Box):
        return coal.Box(*shape.size), still
    if isinstance(shape, Sphere):
        return coal.Sphere(shape.radius), still
    if isinstance(shape, Cylinder):
        return coal.Cylinder(shape.radius, shape.length), still
    points = mesh_points(shape)
    still.translation = 0.5 * (points.min(axis=0) + points.max(axis=0))
    try:
        outermost = ConvexHull(points).vertices
    except (QhullError, ValueError):  # before coal, which a flat hull kills with the whole process
        raise InvalidInput(f"{shape.path} has no convex hull: its points span no volume") from None
    corners = coal.StdVec_Vec3s()
    for point in points[outermost] - still.translation:
        corners.append(point)
    return coal.ConvexBase.convexHull(corners, False, "Qt"), still


def mesh_points(mesh: Mesh) -> Mat:
    """The points of a mesh file (n, 3) [m], scaled, those of a COLLADA file by its unit too.

    Raises:
        ModelError: a mesh file that is missing, empty, cut off, too large or not of its format.
    """
    why = ""
    try:
        if mesh.path.stat().st_size > MAX_BYTES:
            why = f"it is larger than {MAX_BYTES // 10**6} MB"
        elif _is_cut_off(mesh.path):
            why = "it is STL as text without its end"
        else:
            scale = _unit(mesh.path) * np.array(mesh.scale)
            points = np.array(coal.MeshLoader().load(str(mesh.path), scale).vertices())
            if len(points):
                return points
            why = "it has no points"
    except OSError as cause:
        why = cause.strerror or "the system refuses"
    except (ValueError, RuntimeError) as cause:  # coal says where in its sources; its reader's reason comes last
        why = " ".join(str(cause).split())[-200:] or "it is not of its format"
    raise ModelError(f"the mesh {mesh.path} cannot be read: {why}")


def _unit(path: Path) -> float:
    """The unit of a file [m], which COLLADA has and the reader of coal passes over."""
    told = _UNIT.search(path.read_bytes()) if path.suffix.lower() == ".dae" else None
    return 1.0 if told is None else float(told[1])


def _is_cut_off(path: Path) -> bool:
    """Whether STL as text lacks its last word; other readers take the triangles up to there for the whole."""
    if path.suffix.lower() != ".stl":
        return False
    content = path.read_bytes()
    binary = len(content) >= 84 + 50 * int.from_bytes(content[80:84], "little")
    return not binary and content.lstrip().startswith(b"solid") and b"endsolid" not in content


def memory_of(geometry: Any) -> Any:
    """A pinocchio.GeometryData whose distances depend on placements alone."""
    data = geometry.createData()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # the only way there is to switch the cache off
        for request in data.distanceRequests:
            # A guess from the last call would make distances depend on what was measured before, and fail at times.
            request.enable_cached_gjk_guess = False
    for request in data.distanceRequests:
        request.gjk_tolerance, request.gjk_max_iterations = TIGHT, _ITERATIONS
        request.epa_tolerance, request.epa_max_iterations = _DEPTH_TOLERANCE, _ITERATIONS
    return data


def placements(data: Any) -> Mat:
    """Placements of all shapes (n, 12), a live view: columns of the rotation, then the position."""
    rotations = [_address(placement.rotation) for placement in data.oMg]
    positions = [_address(placement.translation) for placement in data.oMg]
    n = len(rotations)
    expected = [rotations[0] + 96 * i for i in range(n)]
    assert rotations == expected and positions == [at + 72 for at in expected], "one behind the other"
    return np.asarray(Shared(data.oMg[0].rotation, data, shape=(n, 12), strides=(96, 8)))


class Answers:
    """What coal finds of the pairs of a geometry, in memory that it writes; ``of(pair)`` asks it.

    ``lines[pair]``, live views (9,): the direction from the first shape to the second, and the nearest points.
    """

    def __init__(self, geometry: Any, data: Any) -> None:
        self._geometry, self._data = geometry, data
        self._results = list(data.distanceResults)
        self._requests = list(data.distanceRequests)
        self.lines = [_line(one, data) for one in self._results]
        balls, shift = (coal.Sphere(1.0), coal.Sphere(1.0)), coal.Transform3s(np.eye(3), np.array([3.0, 0.0, 0.0]))
        known = coal.DistanceResult()
        coal.distance(balls[0], coal.Transform3s(), balls[1], shift, coal.DistanceRequest(), known)
        assert np.allclose(_line(known, known), [1, 0, 0, 1, 0, 0, 2, 0, 0]), "one behind the other"

    def of(self, pair: int) -> float:
        """The distance of a pair as its shapes are placed; to a looser tolerance where the tight one was too much.

        Where neither is enough, the shapes count as touching.
        """
        result = self._results[pair]
        pin.computeDistance(self._geometry, self._data, pair)
        d: float = result.min_distance
        if -_ABSURD < d < _ABSURD:
            return d
        request = self._requests[pair]
        request.gjk_tolerance = _LOOSE
        pin.computeDistance(self._geometry, self._data, pair)
        request.gjk_tolerance = TIGHT
        d = result.min_distance
        return d if -_ABSURD < d < _ABSURD else 0.0


def _line(result: Any, owner: Any) -> Vec:
    return np.asarray(Shared(result.normal, owner, shape=(9,), strides=(8,)))


def _address(array: Any) -> int:
    return int(array.__array_interface__["data"][0])
