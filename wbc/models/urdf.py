"""A URDF becomes checked, frozen data; only that data, written anew, goes on to other libraries.

Whoever loads a robot from somewhere gets one sentence about what is wrong with it, not a crash in a parser.
Reading is in :mod:`wbc.models.urdf_reader`. Source: the URDF specification, http://wiki.ros.org/urdf/XML.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from graphlib import CycleError, TopologicalSorter
from math import inf, isnan
from pathlib import Path
from typing import Literal, TypeVar, final
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from wbc.errors import ModelError, PathRefused, UnknownJoint
from wbc.models.folders import Folders
from wbc.models.geometry import IDENTITY, Geometry, Origin, Triple, lengths
from wbc.models.poses import NamedPose
from wbc.types import Mat

_T = TypeVar("_T")
_R = TypeVar("_R")

JointKind = Literal["fixed", "revolute", "continuous", "prismatic"]

#: What stands in a written URDF where a limit is infinite; parsers do not read "inf".
_HUGE = 1e30
#: What a robot on a plane moves along, along and about.
_XYZ: tuple[Triple, ...] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
#: No length [m], mass [kg] or inertia [kg m²] of a robot is larger; products of larger ones overflow.
LARGEST = 1e9


@final
@dataclass(frozen=True)
class Inertial:
    """Mass [kg], and inertia (xx, xy, xz, yy, yz, zz) [kg m²] about the centre of mass, in the axes of ``origin``."""

    mass: float
    inertia: tuple[float, float, float, float, float, float]
    origin: Origin = IDENTITY

    @property
    def matrix(self) -> Mat:
        """The inertia (3, 3)."""
        xx, xy, xz, yy, yz, zz = self.inertia
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def six(inertia: Mat) -> tuple[float, float, float, float, float, float]:
    """Of a symmetric matrix (3, 3) what :class:`Inertial` has."""
    xx, xy, xz, yy, yz, zz = map(float, inertia[np.triu_indices(3)])
    return xx, xy, xz, yy, yz, zz


@final
@dataclass(frozen=True)
class Link:
    """A rigid body."""

    name: str
    inertial: Inertial | None = None


@final
@dataclass(frozen=True)
class Joint:
    """``child`` moves against ``parent`` about or along ``axis``; ``origin`` is the joint in the parent.

    Limits in rad or m, per s, N m or N; ±inf: none. They are the file's own, even where they make no sense. A joint
    that ``mimics`` another is meant to be at mimic_ratio · other + mimic_offset. ``armature`` is the inertia of a rotor
    [kg m², kg], ``reference`` the position in which a file draws the joint; MJCF has them, URDF has no word for either.
    """

    name: str
    kind: JointKind
    parent: str
    child: str
    origin: Origin = IDENTITY
    axis: Triple = (1.0, 0.0, 0.0)
    lower: float = -inf
    upper: float = inf
    velocity: float = inf
    effort: float = inf
    damping: float = 0.0
    friction: float = 0.0
    mimics: str | None = None
    mimic_ratio: float = 1.0
    mimic_offset: float = 0.0
    armature: float = 0.0
    reference: float = 0.0

    @property
    def moves(self) -> bool:
        """Whether it is a joint of the robot, and not a rivet."""
        return self.kind != "fixed"


@final
@dataclass(frozen=True)
class Loop:
    """A joint that the tree has not: links ``frame`` and ``to`` coincide, in position and, of a weld, in rotation."""

    name: str
    frame: str
    to: str
    weld: bool


@final
@dataclass(frozen=True)
class Urdf:
    """A robot: links and joints that form one tree, and what it looks like.

    ``base`` is where a description puts a base that is free to move, None where it says nothing of that kind;
    ``poses`` are its named configurations, ``loops`` what closes its tree; ``left_out`` are sentences on parts of a
    file that are not in here.

    Raises:
        ModelError: names given twice, a joint called "universe", unknown links, a link with two parents, a loop, two
            trees, nothing that moves, a length, mass or inertia beyond ``LARGEST``.
    """

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    visuals: tuple[Geometry, ...] = ()
    collisions: tuple[Geometry, ...] = ()
    path: Path | None = None
    folders: Folders | None = None
    missing_meshes: tuple[str, ...] = ()
    base: Origin | None = None
    left_out: tuple[str, ...] = ()
    poses: Mapping[str, NamedPose] = field(default_factory=dict)
    loops: tuple[Loop, ...] = ()

    def __post_init__(self) -> None:
        _refuse_twice("links", [link.name for link in self.links])
        _refuse_twice("joints", [joint.name for joint in self.joints])
        if any(joint.name == "universe" for joint in self.joints):
            raise ModelError("a joint is called 'universe', which is Pinocchio's name for the world; rename it")
        _check_tree([link.name for link in self.links], self.joints)
        if not any(joint.moves for joint in self.joints):
            raise ModelError("no joint moves; a robot has at least one")
        _refuse_large(self)

    def with_rigid(self, joints: Iterable[str]) -> Urdf:
        """The same robot with some joints fixed at zero.

        Raises:
            UnknownJoint: one of them does not exist.
        """
        names = set(joints)
        known = {joint.name for joint in self.joints}
        for name in sorted(names - known):
            raise UnknownJoint(name, known)
        return replace(self, joints=tuple(replace(j, kind="fixed") if j.name in names else j for j in self.joints))

    def with_frames(self, mounts: Sequence[Joint]) -> Urdf:
        """The same robot with a link that weighs nothing at the end of each of some fixed joints."""
        links = tuple(Link(joint.child) for joint in mounts)
        return replace(self, links=self.links + links, joints=self.joints + tuple(mounts))

    @property
    def root(self) -> str:
        """The link that no joint carries."""
        return next(link.name for link in self.links if all(joint.child != link.name for joint in self.joints))

    def on_world(self) -> Urdf:
        """The same robot, fixed where the description draws its free base; without one, as it is."""
        if self.base is None or self.base == IDENTITY:
            return self
        name = unused("world_mount", [joint.name for joint in self.joints])
        mount = Joint(name, "fixed", "world", self.root, self.base)
        return replace(self, links=(Link("world"), *self.links), joints=(mount, *self.joints))

    def on_plane(self) -> Urdf:
        """The same robot on three joints without limits, ``base_x``, ``base_y`` [m] and ``base_yaw`` [rad], as high as
        the description draws a free base."""
        names = ("base_x", "base_y", "base_yaw")
        carriers = ("plane", "base_x_link", "base_y_link")
        height = Origin((0.0, 0.0, 0.0 if self.base is None else self.base.xyz[2]))
        joints = tuple(
            Joint(name, "continuous" if name == "base_yaw" else "prismatic", parent, child, origin, axis)
            for name, parent, child, origin, axis in zip(
                names, carriers, (*carriers[1:], self.root), (height, IDENTITY, IDENTITY), _XYZ, strict=True
            )
        )
        return replace(self, links=(*map(Link, carriers), *self.links), joints=(*joints, *self.joints))

    def off_plane(self) -> Urdf:
        """The robot of which ``on_plane`` made this one."""
        return replace(self, links=self.links[3:], joints=self.joints[3:])

    def oddities(self) -> list[str]:
        """What is not wrong enough to refuse the robot: limits that nobody can keep, mimic joints, missing meshes."""
        found = []
        for joint in filter(lambda j: j.moves, self.joints):
            if not joint.lower < joint.upper:
                wrong = ": it cannot move" if joint.lower == joint.upper else ""
                wrong = ": the lower is above the upper" if joint.lower > joint.upper else wrong
                limits = f"[{joint.lower:g}, {joint.upper:g}]{wrong}"
                found.append(f"the position limits of joint {joint.name!r} are {limits}")
            for what, value in (("velocity", joint.velocity), ("effort", joint.effort)):
                if not value > 0:
                    found.append(f"the {what} limit of joint {joint.name!r} is {value:g}")
        alike = [joint for joint in self.joints if joint.moves and joint.mimics is not None]
        if alike:
            more = f" and {len(alike) - 1} more mimic others" if alike[1:] else ""
            found.append(
                f"joint {alike[0].name!r} mimics {alike[0].mimics!r}{more}; here each moves on its own until "
                "wbc.tasks.mimic_joints(robot) couples them"
            )
        missing = self.missing_meshes
        if missing:
            more = f" and {len(missing) - 1} more are missing" if missing[1:] else ""
            found.append(f"there is no mesh {missing[0]!r}{more}")
        return found + list(self.left_out)

    def text(self, *, continuous: Literal["continuous", "revolute"] = "continuous") -> str:
        """The robot as URDF: its links, joints, inertias, limits, damping and friction, and nothing else.

        URDF has no word for ``armature`` and ``base``: whoever reads the text adds them.

        Numbers are written in full, so that reading gives the same bits. ``continuous="revolute"`` writes joints
        without end as revolute ones with limits of ±1e30 rad, which have one position instead of a sine and a cosine.
        Speed and effort limits that make no sense are written as 0, which other readers accept.
        """
        robot = Element("robot", name=self.name)
        for link in self.links:
            element = SubElement(robot, "link", name=link.name)
            _write_inertial(element, link.inertial)
        for joint in self.joints:
            kind = continuous if joint.kind == "continuous" else joint.kind
            _write_joint(SubElement(robot, "joint", name=joint.name, type=kind), joint, bounded=kind != "continuous")
        ElementTree.indent(robot)
        return ElementTree.tostring(robot, encoding="unicode")


def gathered(read: Callable[[_T], _R], items: Iterable[_T]) -> list[_R]:
    """``read`` of each item; what is wrong with any of them is one error.

    Raises:
        ModelError: the sentences on all that ``read`` refuses. PathRefused: the first of these.
    """
    found: list[_R] = []
    wrong: list[str] = []
    for item in items:
        try:
            found.append(read(item))
        except PathRefused:
            raise
        except ModelError as error:
            wrong.append(str(error))
    if wrong:
        raise ModelError("; ".join(wrong))
    return found


def unused(name: str, taken: Container[str]) -> str:
    """A name that this library gives to a part of a robot, followed by as many _ as make it another than the file's.

    Example:
        >>> from wbc.models.urdf import unused
        >>> unused("arm_mount", ["arm_mount", "elbow"])
        'arm_mount_'
    """
    while name in taken:
        name += "_"
    return name


def _refuse_twice(what: str, names: Sequence[str]) -> None:
    name, count = Counter(names).most_common(1)[0] if names else ("", 0)
    if count > 1:
        raise ModelError(f"{count} {what} are called {name!r}")


def _refuse_large(robot: Urdf) -> None:
    sizes: list[tuple[str, str, tuple[float, ...]]] = [
        (f"an origin of joint {joint.name!r}", "m", joint.origin.xyz) for joint in robot.joints
    ]
    for link in robot.links:
        if (inertial := link.inertial) is not None:
            sizes.append((f"the mass of link {link.name!r}", "kg", (inertial.mass,)))
            sizes.append((f"the inertia of link {link.name!r}", "kg m²", inertial.inertia))
            sizes.append((f"an origin of link {link.name!r}", "m", inertial.origin.xyz))
    for geometry in (*robot.visuals, *robot.collisions):
        size = (*geometry.origin.xyz, *lengths(geometry.shape))
        sizes.append((f"a shape of link {geometry.link!r}", "m", size))
    wrong = [
        f"{what} has {max(map(abs, values)):g} {unit}"
        for what, unit, values in sizes
        if not all(abs(value) <= LARGEST for value in values)
    ]
    if wrong:
        raise ModelError(f"{'; '.join(wrong)}; robots have at most {LARGEST:g}")


def _check_tree(links: Sequence[str], joints: Sequence[Joint]) -> None:
    """One root, one parent for every other link, no loop."""
    known = set(links)
    strange = [
        f"joint {joint.name!r} has the {role} {link!r}, which is not a link"
        for joint in joints
        for role, link in (("parent", joint.parent), ("child", joint.child))
        if link not in known
    ]
    if strange:
        raise ModelError("; ".join(strange))
    parents: dict[str, str] = {}
    for joint in joints:
        if joint.child in parents:
            raise ModelError(f"link {joint.child!r} has two parents: {parents[joint.child]!r} and {joint.parent!r}")
        parents[joint.child] = joint.parent
    roots = [link for link in links if link not in parents]
    if len(roots) > 1:
        raise ModelError(f"links {roots[0]!r} and {roots[1]!r} both have no parent; a robot is one tree")
    try:
        TopologicalSorter({child: [parent] for child, parent in parents.items()}).prepare()
    except CycleError as cause:
        raise ModelError(f"link {min(cause.args[1])!r} is its own ancestor; a robot has no loops") from None


def _write_inertial(link: Element, inertial: Inertial | None) -> None:
    if inertial is None:
        return
    element = SubElement(link, "inertial")
    _write_origin(element, inertial.origin)
    SubElement(element, "mass", value=repr(inertial.mass))
    keys = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    SubElement(element, "inertia", {key: repr(x) for key, x in zip(keys, inertial.inertia, strict=True)})


def _write_joint(element: Element, joint: Joint, *, bounded: bool) -> None:
    _write_origin(element, joint.origin)
    SubElement(element, "parent", link=joint.parent)
    SubElement(element, "child", link=joint.child)
    if not joint.moves:
        return
    SubElement(element, "axis", xyz=_numbers(joint.axis))
    limit = {"effort": _limit(max(0.0, joint.effort)), "velocity": _limit(max(0.0, joint.velocity))}
    if bounded:
        limit = {"lower": _limit(joint.lower), "upper": _limit(joint.upper), **limit}
    SubElement(element, "limit", limit)
    SubElement(element, "dynamics", damping=repr(joint.damping), friction=repr(joint.friction))


def _write_origin(element: Element, origin: Origin) -> None:
    SubElement(element, "origin", xyz=_numbers(origin.xyz), rpy=_numbers(origin.rpy))


def _numbers(values: Iterable[float]) -> str:
    return " ".join(map(repr, values))


def _limit(value: float) -> str:
    return "0.0" if isnan(value) else repr(min(max(value, -_HUGE), _HUGE))
