"""Our own arm, quadruped and humanoid: what they are made of, and the URDF files written from it.

``python -m tests.models.own_robots`` writes the files in ``wbc/models/robots``. Links are unions of boxes, balls and
cylinders of one density; mass is given, centre of mass and inertia follow. Joint angles are zero with everything
straight, and positive in the direction that the joint's name says: a knee flexes, a hip pitch lifts the thigh, a roll
leads outwards on both sides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from math import atan2, dist, hypot, pi
from typing import cast, final
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from wbc.models.catalogue import OWN_ROBOTS
from wbc.models.geometry import Box, Color, Cylinder, Geometry, Origin, Sphere, Triple
from wbc.models.urdf import Inertial, Joint, Link, Urdf
from wbc.types import Mat

SHELL: Color = (0.90, 0.91, 0.93, 1.0)
FRAME: Color = (0.20, 0.22, 0.26, 1.0)
ACCENT: Color = (0.95, 0.45, 0.12, 1.0)
RUBBER: Color = (0.09, 0.09, 0.10, 1.0)

X: Triple = (1.0, 0.0, 0.0)
Y: Triple = (0.0, 1.0, 0.0)
Z: Triple = (0.0, 0.0, 1.0)
BACK_Y: Triple = (0.0, -1.0, 0.0)

Part = tuple[Box | Sphere | Cylinder, Origin, Color]


# ---- shapes
def box(size: Triple, at: Triple, color: Color) -> list[Part]:
    """A box centred at ``at``."""
    return [(Box(size), Origin(at), color)]


def ball(radius: float, at: Triple, color: Color) -> list[Part]:
    """A ball centred at ``at``."""
    return [(Sphere(radius), Origin(at), color)]


def rod(start: Triple, end: Triple, radius: float, color: Color) -> list[Part]:
    """A cylinder from ``start`` to ``end``."""
    (x0, y0, z0), (x1, y1, z1) = start, end
    x, y, z = x1 - x0, y1 - y0, z1 - z0
    middle = ((x0 + x1) / 2, (y0 + y1) / 2, (z0 + z1) / 2)
    direction = (0.0, atan2(hypot(x, y), z), atan2(y, x))
    return [(Cylinder(radius, _digits(dist(start, end))), Origin(middle, direction), color)]


def capsule(start: Triple, end: Triple, radius: float, color: Color) -> list[Part]:
    """A rod with a ball at each end."""
    return rod(start, end, radius, color) + ball(radius, start, color) + ball(radius, end, color)


def _volume_and_inertia(shape: Box | Sphere | Cylinder) -> tuple[float, Mat]:
    """Volume [m³], and inertia about the centre of a body of mass 1 [m²]."""
    match shape:
        case Box((x, y, z)):
            return x * y * z, np.diag([y * y + z * z, x * x + z * z, x * x + y * y]) / 12
        case Sphere(r):
            return 4 / 3 * pi * r**3, 0.4 * r * r * np.eye(3)
        case Cylinder(r, length):
            across = (3 * r * r + length * length) / 12
            return pi * r * r * length, np.diag([across, across, r * r / 2])


def inertial(mass: float, parts: list[Part]) -> Inertial:
    """Of a body of one density; where parts overlap, both count."""
    volumes, inertias = zip(*(_volume_and_inertia(shape) for shape, _, _ in parts), strict=True)
    shares = np.array(volumes) / sum(volumes)
    centres = np.array([origin.xyz for _, origin, _ in parts])
    centre = shares @ centres
    total = np.zeros((3, 3))
    for share, own, at, (_, origin, _) in zip(shares, inertias, centres - centre, parts, strict=True):
        R = origin.rotation
        total += share * (R @ own @ R.T + (at @ at) * np.eye(3) - np.outer(at, at))
    xx, xy, xz, _, yy, yz, _, _, zz = (_digits(mass * x) for x in total.ravel())
    return Inertial(mass, (xx, xy, xz, yy, yz, zz), Origin(cast("Triple", tuple(map(_digits, centre)))))


def _digits(x: float) -> float:
    """Five significant digits, and no dust."""
    return 0.0 if abs(x) < 1e-9 else float(f"{x:.5g}")


# ---- robots
@final
class Builder:
    """Links and joints, collected in order."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._links: list[Link] = []
        self._joints: list[Joint] = []
        self._shapes: list[Geometry] = []

    def link(self, name: str, mass: float, *parts: list[Part]) -> None:
        """A body made of parts."""
        flat = [part for some in parts for part in some]
        self._links.append(Link(name, inertial(mass, flat)))
        self._shapes += [Geometry(name, shape, _tidy(origin), color) for shape, origin, color in flat]

    def joint(
        self, name: str, parent: str, child: str, at: Triple, axis: Triple, *,
        angles: tuple[float, float], effort: float, speed: float,
    ) -> None:  # fmt: skip
        """A revolute joint of ``parent`` at ``at``: angles [rad], effort [N m], speed [rad/s], and some damping."""
        self._joints.append(
            Joint(name, "revolute", parent, child, Origin(at), axis, *angles, speed, effort, damping=effort / 500)
        )

    def frame(self, name: str, parent: str, at: Triple, parts: list[Part] | None = None, mass: float = 0.0) -> None:
        """A frame fixed to ``parent``, with a body or without."""
        if parts:
            self.link(name, mass, parts)
        else:
            self._links.append(Link(name))
        self._joints.append(Joint(f"{name}_mount", "fixed", parent, name, Origin(at)))

    def robot(self) -> Urdf:
        """What has been collected."""
        collisions = tuple(replace(shape, color=None) for shape in self._shapes)
        return Urdf(self.name, tuple(self._links), tuple(self._joints), tuple(self._shapes), collisions)


def _tidy(origin: Origin) -> Origin:
    xyz, rpy = (cast("Triple", tuple(map(_digits, values))) for values in (origin.xyz, origin.rpy))
    return Origin(xyz, rpy)


def arm() -> Urdf:
    """Seven joints, 0.98 m from the shoulder to the tool, 15 kg that move. Zero points straight up."""
    b = Builder("arm")
    b.link("base", 6.0, rod((0, 0, 0), (0, 0, 0.04), 0.11, FRAME), rod((0, 0, 0.04), (0, 0, 0.18), 0.075, SHELL))
    b.link(
        "shoulder", 3.5, rod((0, 0, 0), (0, 0, 0.10), 0.07, SHELL), rod((0, -0.09, 0.15), (0, 0.09, 0.15), 0.07, FRAME)
    )
    b.link("upper_arm", 3.0, capsule((0, 0, 0.06), (0, 0, 0.20), 0.06, SHELL))
    b.link(
        "elbow_link",
        2.6,
        rod((0, 0, 0), (0, 0, 0.13), 0.055, SHELL),
        rod((0, -0.075, 0.20), (0, 0.075, 0.20), 0.058, FRAME),
    )
    b.link("forearm", 2.2, capsule((0, 0, 0.05), (0, 0, 0.18), 0.05, SHELL))
    b.link(
        "wrist_link",
        1.8,
        rod((0, 0, 0), (0, 0, 0.12), 0.045, SHELL),
        rod((0, -0.06, 0.19), (0, 0.06, 0.19), 0.048, FRAME),
    )
    b.link("hand_hub", 1.2, rod((0, 0, 0.03), (0, 0, 0.10), 0.042, SHELL))
    b.link("flange", 0.6, rod((0, 0, 0), (0, 0, 0.07), 0.035, ACCENT), rod((0, 0, 0.07), (0, 0, 0.10), 0.045, FRAME))
    b.joint("shoulder_yaw", "base", "shoulder", (0, 0, 0.18), Z, angles=(-2.9, 2.9), effort=120, speed=2.2)
    b.joint("shoulder_pitch", "shoulder", "upper_arm", (0, 0, 0.15), Y, angles=(-1.9, 1.9), effort=120, speed=2.2)
    b.joint("upper_arm_roll", "upper_arm", "elbow_link", (0, 0, 0.20), Z, angles=(-2.9, 2.9), effort=80, speed=2.2)
    b.joint("elbow", "elbow_link", "forearm", (0, 0, 0.20), Y, angles=(-2.4, 2.4), effort=80, speed=2.2)
    b.joint("forearm_roll", "forearm", "wrist_link", (0, 0, 0.19), Z, angles=(-2.9, 2.9), effort=40, speed=2.8)
    b.joint("wrist_pitch", "wrist_link", "hand_hub", (0, 0, 0.19), Y, angles=(-2.0, 2.0), effort=40, speed=2.8)
    b.joint("wrist_roll", "hand_hub", "flange", (0, 0, 0.10), Z, angles=(-3.0, 3.0), effort=20, speed=2.8)
    b.frame("tool", "flange", (0, 0, 0.10))
    return b.robot()


def quadruped() -> Urdf:
    """Four legs of three joints, 0.42 m from hip to foot, 15 kg. Feet are balls of 2 cm."""
    b = Builder("quadruped")
    b.link(
        "trunk",
        7.0,
        box((0.36, 0.17, 0.10), (0, 0, 0), SHELL),
        box((0.06, 0.12, 0.08), (0.21, 0, 0.01), FRAME),
        box((0.04, 0.12, 0.06), (-0.20, 0, 0), FRAME),
        rod((0.235, -0.03, 0.01), (0.235, 0.03, 0.01), 0.02, ACCENT),
    )
    for end, x in (("front", 1), ("rear", -1)):
        for side, y in (("left", 1), ("right", -1)):
            leg = f"{end}_{side}"
            out: Triple = (float(y), 0.0, 0.0)
            b.link(f"{leg}_hip", 0.7, rod((0, 0, 0), (0, y * 0.045, 0), 0.042, FRAME))
            b.link(
                f"{leg}_thigh",
                1.0,
                rod((0, -y * 0.02, 0), (0, y * 0.025, 0), 0.042, ACCENT),
                capsule((0, 0, -0.02), (0, 0, -0.19), 0.020, SHELL),
            )
            b.link(f"{leg}_shank", 0.22, capsule((0, 0, 0), (0, 0, -0.19), 0.012, FRAME))
            b.joint(
                f"{leg}_hip_roll",
                "trunk",
                f"{leg}_hip",
                (x * 0.19, y * 0.05, 0),
                out,
                angles=(-0.8, 0.8),
                effort=30,
                speed=25,
            )
            b.joint(
                f"{leg}_hip_pitch",
                f"{leg}_hip",
                f"{leg}_thigh",
                (0, y * 0.085, 0),
                Y,
                angles=(-1.2, 2.6),
                effort=30,
                speed=25,
            )
            b.joint(
                f"{leg}_knee",
                f"{leg}_thigh",
                f"{leg}_shank",
                (0, 0, -0.21),
                Y,
                angles=(-2.6, -0.4),
                effort=45,
                speed=16,
            )
            b.frame(f"{leg}_foot", f"{leg}_shank", (0, 0, -0.21), ball(0.02, (0, 0, 0), RUBBER), 0.06)
    return b.robot()


def humanoid() -> Urdf:
    """Thirty joints, 1.73 m, 63 kg: legs 6 + 6, waist 2, arms 7 + 7, neck 2. Soles are 22 cm by 10 cm."""
    b = Builder("humanoid")
    b.link(
        "pelvis",
        8.0,
        box((0.16, 0.20, 0.10), (0, 0, 0.02), SHELL),
        rod((0, -0.13, -0.05), (0, 0.13, -0.05), 0.055, FRAME),
    )
    b.link("waist", 1.5, rod((0, 0, -0.02), (0, 0, 0.05), 0.075, FRAME))
    b.link(
        "torso",
        15.5,
        box((0.15, 0.20, 0.14), (0, 0, 0.09), FRAME),
        box((0.20, 0.30, 0.24), (0, 0, 0.27), SHELL),
        rod((0, -0.17, 0.36), (0, 0.17, 0.36), 0.06, SHELL),
        box((0.02, 0.12, 0.06), (0.105, 0, 0.30), ACCENT),
    )
    b.link("neck", 0.7, rod((0, 0, 0), (0, 0, 0.07), 0.04, FRAME))
    b.link(
        "head",
        3.0,
        box((0.15, 0.15, 0.16), (0.01, 0, 0.10), SHELL),
        ball(0.075, (0, 0, 0.17), SHELL),
        box((0.02, 0.13, 0.05), (0.085, 0, 0.12), FRAME),
    )
    b.joint("waist_yaw", "pelvis", "waist", (0, 0, 0.10), Z, angles=(-1.2, 1.2), effort=120, speed=6)
    b.joint("waist_pitch", "waist", "torso", (0, 0, 0.05), Y, angles=(-0.4, 1.0), effort=180, speed=6)
    b.joint("neck_yaw", "torso", "neck", (0, 0, 0.42), Z, angles=(-1.2, 1.2), effort=12, speed=6)
    b.joint("neck_pitch", "neck", "head", (0, 0, 0.07), Y, angles=(-0.6, 0.8), effort=12, speed=6)
    for side, y in (("left", 1), ("right", -1)):
        _leg(b, side, y)
        _arm(b, side, y)
    return b.robot()


def _leg(b: Builder, side: str, y: int) -> None:
    hub, block, thigh, shank, ankle, foot = (
        f"{side}_{part}" for part in ("hip_hub", "hip_block", "thigh", "shank", "ankle", "foot")
    )
    out_roll: Triple = (float(y), 0.0, 0.0)
    out_yaw: Triple = (0.0, 0.0, float(y))
    b.link(hub, 1.2, rod((0, 0, -0.02), (0, 0, 0.05), 0.055, FRAME))
    b.link(block, 1.5, rod((-0.05, 0, 0), (0.05, 0, 0), 0.055, FRAME))
    b.link(
        thigh, 4.5, rod((0, -0.06, 0), (0, 0.06, 0), 0.06, ACCENT), capsule((0, 0, -0.08), (0, 0, -0.32), 0.065, SHELL)
    )
    b.link(
        shank, 2.8, rod((0, -0.055, 0), (0, 0.055, 0), 0.055, FRAME), capsule((0, 0, -0.07), (0, 0, -0.32), 0.05, SHELL)
    )
    b.link(ankle, 0.5, ball(0.045, (0, 0, 0), FRAME))
    b.link(
        foot,
        1.3,
        box((0.22, 0.10, 0.03), (0.03, 0, -0.06), RUBBER),
        box((0.12, 0.08, 0.03), (0, 0, -0.03), SHELL),
    )
    b.joint(f"{side}_hip_yaw", "pelvis", hub, (0, y * 0.09, -0.06), out_yaw, angles=(-0.8, 0.8), effort=90, speed=9)
    b.joint(f"{side}_hip_roll", hub, block, (0, 0, 0), out_roll, angles=(-0.5, 0.8), effort=140, speed=9)
    b.joint(f"{side}_hip_pitch", block, thigh, (0, 0, 0), BACK_Y, angles=(-0.8, 2.0), effort=180, speed=11)
    b.joint(f"{side}_knee", thigh, shank, (0, 0, -0.38), Y, angles=(0.0, 2.3), effort=220, speed=11)
    b.joint(f"{side}_ankle_pitch", shank, ankle, (0, 0, -0.38), BACK_Y, angles=(-0.9, 0.7), effort=120, speed=9)
    b.joint(f"{side}_ankle_roll", ankle, foot, (0, 0, 0), out_roll, angles=(-0.4, 0.4), effort=60, speed=9)
    b.frame(f"{side}_sole", foot, (0.03, 0, -0.075))


def _arm(b: Builder, side: str, y: int) -> None:
    cap, block, upper_arm, forearm, hub, wrist, palm = (
        f"{side}_{part}"
        for part in ("shoulder_cap", "shoulder_block", "upper_arm", "forearm", "wrist_hub", "wrist", "palm")
    )
    out_roll: Triple = (float(y), 0.0, 0.0)
    out_yaw: Triple = (0.0, 0.0, float(y))
    b.link(cap, 0.9, rod((0, -y * 0.02, 0), (0, y * 0.05, 0), 0.055, FRAME))
    b.link(block, 0.8, ball(0.055, (0, 0, 0), ACCENT))
    b.link(upper_arm, 1.4, capsule((0, 0, -0.06), (0, 0, -0.23), 0.045, SHELL))
    b.link(
        forearm,
        1.0,
        rod((0, -0.045, 0), (0, 0.045, 0), 0.045, FRAME),
        capsule((0, 0, -0.05), (0, 0, -0.14), 0.04, SHELL),
    )
    b.link(hub, 0.5, rod((0, 0, 0.02), (0, 0, -0.06), 0.036, SHELL))
    b.link(wrist, 0.2, ball(0.034, (0, 0, 0), FRAME))
    b.link(palm, 0.6, box((0.09, 0.035, 0.10), (0, 0, -0.07), SHELL), box((0.08, 0.03, 0.07), (0, 0, -0.155), FRAME))
    b.joint(f"{side}_shoulder_pitch", "torso", cap, (0, y * 0.19, 0.36), BACK_Y, angles=(-1.0, 2.8), effort=60, speed=9)
    b.joint(f"{side}_shoulder_roll", cap, block, (0, y * 0.05, 0), out_roll, angles=(-0.2, 2.2), effort=60, speed=9)
    b.joint(f"{side}_shoulder_yaw", block, upper_arm, (0, 0, 0), out_yaw, angles=(-1.6, 1.6), effort=35, speed=9)
    b.joint(f"{side}_elbow", upper_arm, forearm, (0, 0, -0.28), BACK_Y, angles=(0.0, 2.4), effort=45, speed=9)
    b.joint(f"{side}_forearm_yaw", forearm, hub, (0, 0, -0.18), out_yaw, angles=(-1.8, 1.8), effort=15, speed=9)
    b.joint(f"{side}_wrist_pitch", hub, wrist, (0, 0, -0.07), BACK_Y, angles=(-0.8, 0.8), effort=15, speed=9)
    b.joint(f"{side}_wrist_roll", wrist, palm, (0, 0, 0), out_roll, angles=(-0.6, 0.6), effort=15, speed=9)
    b.frame(f"{side}_hand", palm, (0, 0, -0.12))


ROBOTS: dict[str, Callable[[], Urdf]] = {"arm": arm, "quadruped": quadruped, "humanoid": humanoid}


def text(name: str) -> str:
    """The URDF of one of our robots, as the file has it."""
    note = "<!-- Written by tests/models/own_robots.py; change it there. -->"
    return f'<?xml version="1.0"?>\n{note}\n{with_shapes(ROBOTS[name]())}\n'


def with_shapes(urdf: Urdf) -> str:
    """A robot as URDF with what it looks like."""
    root = ElementTree.fromstring(urdf.text())
    for link in root.findall("link"):
        for role, shapes in (("visual", urdf.visuals), ("collision", urdf.collisions)):
            for geometry in (shape for shape in shapes if shape.link == link.get("name")):
                _write_shape(SubElement(link, role), geometry)
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode")


def _write_shape(element: Element, geometry: Geometry) -> None:
    origin = geometry.origin
    SubElement(element, "origin", xyz=_numbers(origin.xyz), rpy=_numbers(origin.rpy))
    inside = SubElement(element, "geometry")
    match geometry.shape:
        case Box(size):
            SubElement(inside, "box", size=_numbers(size))
        case Sphere(radius):
            SubElement(inside, "sphere", radius=repr(radius))
        case Cylinder(radius, length):
            SubElement(inside, "cylinder", radius=repr(radius), length=repr(length))
    if geometry.color is not None:
        name = "#" + "".join(f"{round(255 * x):02x}" for x in geometry.color)
        SubElement(SubElement(element, "material", name=name), "color", rgba=_numbers(geometry.color))


def _numbers(values: Iterable[float]) -> str:
    return " ".join(map(repr, values))


if __name__ == "__main__":
    for name in ROBOTS:
        (OWN_ROBOTS / f"{name}.urdf").write_text(text(name), encoding="utf-8")
