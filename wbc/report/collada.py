"""COLLADA, as much of it as robot descriptions use: placed triangles and polygons with one colour each.

Source: COLLADA 1.4.1 specification, Khronos Group, https://www.khronos.org/collada/. As other robotics tools do, the
unit is applied and the up axis is not: the pose of a mesh in a robot is said by the robot's description.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from numpy.typing import NDArray

from wbc.errors import ModelError
from wbc.models.safe_xml import parse_xml
from wbc.types import Mat

Placed = tuple[Mat, NDArray[np.int64], tuple[float, float, float] | None]

MAX_DEPTH = 30


def read_collada(path: Path) -> list[Placed]:
    """Each primitive of the scene: vertices (k, 3) [m] in the axes of the file, faces (m, 3), colour 0…1 or None.

    Raises:
        ModelError: not well-formed XML, or not COLLADA.
        ValueError, KeyError, IndexError: COLLADA that refers to what is not there.
    """
    return list(_Document(path).surfaces())


class _Document:
    """The parts of one file by their identifiers."""

    def __init__(self, path: Path) -> None:
        self._root = parse_xml(path.read_text(encoding="utf-8-sig"))
        for element in self._root.iter():
            element.tag = element.tag.rpartition("}")[2]
        if self._root.tag != "COLLADA":
            raise ModelError(f"the file begins with <{self._root.tag[:40]}>; it must be <COLLADA>")
        self._by_id = {element.get("id", ""): element for element in self._root.iter() if element.get("id")}

    def surfaces(self) -> Iterator[Placed]:
        unit = self._root.find("asset/unit")
        scale = float(unit.get("meter", "1")) if unit is not None else 1.0
        instance = self._root.find("scene/instance_visual_scene")
        scene = self._root.find(".//visual_scene") if instance is None else self._target(instance, "url")
        if scene is not None:
            yield from self._nodes(scene, np.diag([scale, scale, scale, 1.0]), 0)

    def _nodes(self, parent: Element, outer: Mat, depth: int) -> Iterator[Placed]:
        if depth > MAX_DEPTH:
            raise ValueError("nodes are nested too deep, or in a circle")
        for node in parent.findall("node"):
            yield from self._node(node, outer, depth)
        for instance in parent.findall("instance_node"):
            yield from self._node(self._target(instance, "url"), outer, depth)

    def _node(self, node: Element, outer: Mat, depth: int) -> Iterator[Placed]:
        place = outer @ _transform(node)
        for instance in node.findall("instance_geometry"):
            materials = {m.get("symbol"): m for m in instance.iter("instance_material")}
            mesh = self._target(instance, "url").find("mesh")
            for primitive in () if mesh is None else mesh:
                if primitive.tag in ("triangles", "polylist", "polygons"):
                    vertices, faces = self._triangles(primitive)
                    flipped = np.linalg.det(place[:3, :3]) < 0
                    placed = vertices @ place[:3, :3].T + place[:3, 3]
                    yield (
                        placed,
                        faces[:, ::-1] if flipped else faces,
                        self._color(materials.get(primitive.get("material"))),
                    )
        yield from self._nodes(node, place, depth + 1)

    def _triangles(self, primitive: Element) -> tuple[Mat, NDArray[np.int64]]:
        inputs = primitive.findall("input")
        stride = 1 + max(int(element.get("offset", "0")) for element in inputs)
        corner = next(element for element in inputs if element.get("semantic") == "VERTEX")
        position = self._target(corner, "source").find("input[@semantic='POSITION']")
        if position is None:
            raise ValueError("vertices without positions")
        vertices = _numbers(self._target(position, "source").find("float_array")).reshape(-1, 3)
        runs = [_indices(p)[int(corner.get("offset", "0")) :: stride] for p in primitive.findall("p")]
        index = np.concatenate([*runs, np.zeros(0, np.int64)])
        if primitive.tag == "triangles":
            return vertices, index.reshape(-1, 3)
        counts = [len(run) for run in runs] if primitive.tag == "polygons" else _indices(primitive.find("vcount"))
        return vertices, _fans(index, np.asarray(counts, dtype=np.int64))

    def _color(self, instance: Element | None) -> tuple[float, float, float] | None:
        if instance is None:
            return None
        effect = self._target(instance, "target").find("instance_effect")
        if effect is None:
            return None
        diffuse = self._target(effect, "url").find(".//diffuse/color")
        if diffuse is None:
            return None
        red, green, blue = _numbers(diffuse)[:3]
        return float(red), float(green), float(blue)

    def _target(self, element: Element, attribute: str) -> Element:
        return self._by_id[element.get(attribute, "").removeprefix("#")]


def _transform(node: Element) -> Mat:
    """The product of a node's transformations in the order in which they stand."""
    total = np.eye(4)
    for element in node:
        step = np.eye(4)
        if element.tag == "matrix":
            step = _numbers(element).reshape(4, 4)
        elif element.tag == "translate":
            step[:3, 3] = _numbers(element)
        elif element.tag == "scale":
            step[:3, :3] = np.diag(_numbers(element))
        elif element.tag == "rotate":
            step[:3, :3] = _rotation(_numbers(element))
        total = total @ step
    return total


def _rotation(axis_and_degrees: Mat) -> Mat:
    from scipy.spatial.transform import Rotation

    axis, angle = axis_and_degrees[:3], np.radians(axis_and_degrees[3])
    return np.asarray(Rotation.from_rotvec(angle * axis / max(float(np.linalg.norm(axis)), 1e-12)).as_matrix())


def _fans(index: NDArray[np.int64], counts: NDArray[np.int64]) -> NDArray[np.int64]:
    """Triangles of convex polygons with so many corners each."""
    starts = np.cumsum(counts) - counts
    faces = [
        np.column_stack([index[first], index[first + k], index[first + k + 1]])
        for k in range(1, int(counts.max(initial=2)) - 1)
        for first in [starts[counts > k + 1]]
    ]
    return np.concatenate([*faces, np.zeros((0, 3), np.int64)])


def _numbers(element: Element | None) -> Mat:
    return np.array((element.text or "").split() if element is not None else [], dtype=np.float64)


def _indices(element: Element | None) -> NDArray[np.int64]:
    return np.array((element.text or "").split() if element is not None else [], dtype=np.int64)
