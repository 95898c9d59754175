"""From a URDF file to a :class:`~wbc.models.urdf.Urdf`: every element and number looked at once, here."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from math import inf, isfinite
from pathlib import Path
from typing import Any, cast, final
from xml.etree.ElementTree import Element

import numpy as np

from wbc.errors import ModelError
from wbc.models.folders import Folders
from wbc.models.geometry import IDENTITY, Box, Color, Cylinder, Geometry, Mesh, Origin, Shape, Sphere
from wbc.models.urdf import Inertial, Joint, JointKind, Link, Urdf, gathered

_KINDS = ("fixed", "revolute", "continuous", "prismatic")


def read_urdf(root: Element, path: Path, *, packages: Iterable[str | Path] = ()) -> Urdf:
    """The robot of a URDF file whose root element is ``root``.

    Raises:
        ModelError: it is not a robot; the message says what is wrong.
        PathRefused: a mesh outside the folders.
    """
    if path.suffix == ".xacro" and any("xacro" in element.tag for element in root.iter()):
        raise ModelError(f"macros are not expanded; run xacro {path.name} > {path.stem.removesuffix('.urdf')}.urdf")
    return _Reader(Folders.around(path.parent, packages)).robot(root, path)


@final
@dataclass
class _Reader:
    """The pass over one file: where its meshes may lie, its named colours, meshes not found, what else is left out."""

    folders: Folders
    colors: dict[str, Color] = field(default_factory=dict)
    missing: dict[str, None] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)

    def robot(self, root: Element, path: Path) -> Urdf:
        for material in (*root.findall("material"), *root.iter("material")):  # a name counts wherever it has a colour
            color = _color(material)
            if color is not None:
                self.colors.setdefault(material.get("name", ""), color)
        elements = root.findall("link")
        visuals, collisions = (
            tuple(shape for element in elements for shape in self.shapes(element, role))
            for role in ("visual", "collision")
        )
        return Urdf(
            name=root.get("name", path.stem),
            links=tuple(gathered(_link, elements)),
            joints=tuple(gathered(_joint, root.findall("joint"))),
            visuals=visuals,
            collisions=collisions,
            path=path.resolve(),
            folders=self.folders,
            missing_meshes=tuple(self.missing),
            left_out=tuple(self.left_out),
        )

    def shapes(self, link: Element, role: str) -> Iterable[Geometry]:
        name = _name(link)
        for element in link.findall(role):
            where = f"a {role} of link {name!r}"
            geometry = element.find("geometry")
            shape = None if geometry is None else self.shape(geometry, where)
            if shape is not None:
                yield Geometry(name, shape, _origin(element, where), self.color(element))

    def shape(self, geometry: Element, where: str) -> Shape | None:
        """None for a mesh that is missing and for kinds that are not read."""
        for element in geometry:
            if element.tag == "box":
                return Box(_numbers(element, "size", 3, where, low=0.0))
            if element.tag == "sphere":
                return Sphere(_numbers(element, "radius", 1, where, low=0.0))
            if element.tag == "cylinder":
                return Cylinder(*(_numbers(element, key, 1, where, low=0.0) for key in ("radius", "length")))
            if element.tag == "mesh":
                reference = _attribute(element, "filename", where)
                path = self.folders.find(reference)
                if path is not None:
                    return Mesh(path, _numbers(element, "scale", 3, where, (1.0, 1.0, 1.0)))
                self.missing[reference] = None
            else:
                said = f"it is a <{element.tag}>, not a box, sphere, cylinder or mesh"
                self.left_out.append(f"{where} is left out: {said}")
        return None

    def color(self, visual: Element) -> Color | None:
        material = visual.find("material")
        if material is None:
            return None
        color = _color(material)
        return self.colors.get(material.get("name", "")) if color is None else color


def _link(element: Element) -> Link:
    name = _name(element)
    inertial = element.find("inertial")
    return Link(name, None if inertial is None else _inertial(inertial, f"link {name!r}"))


def _inertial(element: Element, where: str) -> Inertial:
    mass_element, inertia_element = element.find("mass"), element.find("inertia")
    if mass_element is None or inertia_element is None:
        raise ModelError(f"{where} has an <inertial> without <mass> or <inertia>")
    mass = _numbers(mass_element, "value", 1, f"the mass of {where}")
    inertia = tuple(
        _numbers(inertia_element, key, 1, f"the inertia of {where}")
        for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    )
    if mass < 0:
        raise ModelError(f"{where} has a mass of {mass:g} kg; it must not be negative")
    inertial = Inertial(mass, cast("Any", inertia), _origin(element, where))
    moments = np.linalg.eigvalsh(inertial.matrix)
    if moments[0] < -1e-3 * moments[2] - 1e-6:  # less is rounding in the file
        raise ModelError(f"{where} has a principal inertia of {moments[0]:g} kg m²; it must not be negative")
    return inertial


def _joint(element: Element) -> Joint:
    name = _name(element)
    where = f"joint {name!r}"
    kind = _attribute(element, "type", where)
    if kind not in _KINDS:
        base = f", and a base that moves is load(..., base={kind!r})" if kind in ("floating", "planar") else ""
        raise ModelError(f"{where} is {kind!r}; joints may be {', '.join(_KINDS)}{base}")
    parent, child = (_attribute(_only(element, role, where), "link", where) for role in ("parent", "child"))
    axis, limit, dynamics, mimic = map(element.find, ("axis", "limit", "dynamics", "mimic"))
    direction = (1.0, 0.0, 0.0) if axis is None else _numbers(axis, "xyz", 3, f"the axis of {where}", (1.0, 0.0, 0.0))
    if kind != "fixed" and np.linalg.norm(direction) < 1e-6:
        raise ModelError(f"the axis of {where} is zero; it must be a direction")
    if limit is None and kind in ("revolute", "prismatic"):
        raise ModelError(f"{where} is {kind} and has no <limit>")
    return Joint(
        name,
        cast("JointKind", kind),
        parent,
        child,
        _origin(element, where),
        direction,
        **_limits(limit, kind, where),
        damping=0.0 if dynamics is None else _numbers(dynamics, "damping", 1, where, 0.0),
        friction=0.0 if dynamics is None else _numbers(dynamics, "friction", 1, where, 0.0),
        mimics=None if mimic is None else mimic.get("joint", ""),
        mimic_ratio=1.0 if mimic is None else _numbers(mimic, "multiplier", 1, where, 1.0),
        mimic_offset=0.0 if mimic is None else _numbers(mimic, "offset", 1, where, 0.0),
    )


def _limits(element: Element | None, kind: str, where: str) -> Mapping[str, float]:
    """The limits as they stand there: 0 for a missing position, as URDF has it; NaN and inf may be."""
    if element is None or kind == "fixed":
        return {}
    where = f"the limit of {where}"
    limits = {key: _numbers(element, key, 1, where, inf, finite=False) for key in ("velocity", "effort")}
    if kind != "continuous":
        limits |= {key: _numbers(element, key, 1, where, 0.0, finite=False) for key in ("lower", "upper")}
    return limits


def _origin(element: Element, where: str) -> Origin:
    origin = element.find("origin")
    if origin is None:
        return IDENTITY
    zero = (0.0, 0.0, 0.0)
    return Origin(*(_numbers(origin, key, 3, f"an origin of {where}", zero) for key in ("xyz", "rpy")))


def _color(material: Element) -> Color | None:
    color = material.find("color")
    if color is None:
        return None
    rgba = _numbers(color, "rgba", 4, f"material {material.get('name')!r}")
    return cast("Color", tuple(min(max(x, 0.0), 1.0) for x in rgba))


# ---- attributes
def _name(element: Element) -> str:
    return _attribute(element, "name", f"a <{element.tag}>")


def _attribute(element: Element, key: str, where: str) -> str:
    value = element.get(key, "").strip()
    if not value:
        raise ModelError(f"{where} has no {key}")
    return value


def _only(element: Element, tag: str, where: str) -> Element:
    found = element.find(tag)
    if found is None:
        raise ModelError(f"{where} has no <{tag}>")
    return found


def _numbers(
    element: Element, key: str, size: int, where: str, default: Any = None, *, finite: bool = True, low: float = -inf
) -> Any:
    """The numbers of an attribute: one as a float, more as a tuple."""
    if default is not None and key not in element.attrib:
        return default
    text = _attribute(element, key, where)
    try:
        values = tuple(map(float, text.split()))
    except ValueError:
        values = ()
    if len(values) != size or (finite and not all(map(isfinite, values))):
        kind = "finite number" if finite else "number"
        raise ModelError(f"{where}: {key} is {text[:60]!r}; it must be {size} {kind}{'s' if size > 1 else ''}")
    if min(values) < low:
        raise ModelError(f"{where}: {key} is {element.get(key)!r}; it must not be negative")
    return values[0] if size == 1 else values
