"""MJCF before MuJoCo's compiler sees it: one text of what describes a robot, every file looked up, the rest refused.

Each ``<include file="…"/>`` is replaced by what stands in that file, as MuJoCo's parser does it. The file is looked for
beside the main one, then beside the one that includes it, and only in the folders that may be read.

Source: MuJoCo's XML reference, https://mujoco.readthedocs.io/en/stable/XMLreference.html.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import final
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from wbc.errors import ModelError, PathRefused
from wbc.models.folders import Folders
from wbc.models.safe_xml import read_xml, refuse_large

#: Sections that describe a robot, and those that describe a simulation or a scene.
_ROBOT = {"compiler", "default", "asset", "worldbody", "actuator", "equality", "tendon", "keyframe"}
_SCENE = {"option", "size", "visual", "statistic", "custom", "sensor", "contact"}
#: What brings in other models or code, multiplies elements, or is not made of rigid bodies.
_REFUSED = ("attach", "replicate", "composite", "flexcomp", "plugin", "extension", "deformable")
_NOT_A_NUMBER = re.compile(r"(?:^|[\s+-])(?:nan|inf|infinity)(?:$|[\s(])", re.IGNORECASE)
_FILE_FOLDERS = ("meshdir", "assetdir", "texturedir", "strippath")
_ASSET_FILES = ("file", "name", "class", "scale", "inertia", "maxhullvert")


@final
@dataclass
class MjcfSource:
    """The file at ``path``, whose root element is ``root``, on its way to the compiler.

    ``meshes`` are the files by the name of the mesh, ``missing`` those that do not exist, ``left_out`` sentences on
    parts that exist in the file and not in the robot.

    Raises:
        ModelError: an element that is not supported, by its name; a mesh that is missing and a body weighed by it; a
            file to include that is missing, empty, included twice or not plain XML; too much of it all together.
        PathRefused: a mesh or a file to include outside the folders.
    """

    root: Element
    path: Path
    folders: Folders
    meshes: dict[str, Path] = field(default_factory=dict)
    missing: dict[str, None] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._elements, self._included = 0, {self.path.resolve()}
        self._include_into(self.root, self.path.resolve(), depth=1)
        for element in self.root.iter():
            if element.tag in _REFUSED or (element.tag == "model" and element is not self.root):
                raise ModelError(f"{_called(element)} is not supported; give the robot in one file, written out")
            for key, value in element.attrib.items():
                if _NOT_A_NUMBER.search(value):
                    raise ModelError(f"{key} of {_called(element)} is {value[:60]!r}; numbers must be finite")
            if element.get("mass", "").strip().startswith("-"):
                raise ModelError(f"the mass of {_called(element)} is {element.get('mass')!r}; it must not be negative")
        for section in self.root:
            if section.tag not in _ROBOT | _SCENE:
                raise ModelError(f"<{section.tag}> is not supported; a robot is {', '.join(sorted(_ROBOT))}")
        for option in (*self.root.findall("option"), *self.root.findall("option/flag")):  # of these gravity is read
            option.attrib = {key: value for key, value in option.attrib.items() if key == "gravity"}
        self._remove(
            lambda parent, child: (
                (child.tag in _SCENE and child.tag != "option")
                or (parent.tag == "option" and child.tag != "flag")
                or child.tag in ("camera", "light", "layer")
                or (parent.tag == "asset" and child.tag not in ("mesh", "material"))
            )
        )
        self._find_meshes(*self._set_compiler())
        self._remove(self._lacks_file)

    @property
    def text(self) -> str:
        """What the compiler reads."""
        return ElementTree.tostring(self.root, encoding="unicode")

    def _include_into(self, parent: Element, file: Path, depth: int) -> None:
        """Below ``parent``, which stands in ``file``, no include is left."""
        refuse_large(depth, self._elements)
        children: list[Element] = []
        for child in list(parent):
            self._elements += 1
            if child.tag != "include":
                self._include_into(child, file, depth + 1)
                children.append(child)
                continue
            path = self._included_at(child, file)
            inside = read_xml(path)
            self._include_into(inside, path, depth)
            if not len(inside):
                raise ModelError(f"<include> {child.get('file')!r} holds nothing")
            children += inside
        parent[:] = children

    def _included_at(self, include: Element, file: Path) -> Path:
        reference = include.get("file", "")
        if not reference or len(include):
            raise ModelError("an <include> has a file and nothing inside")
        refused: PathRefused | None = None
        beside = Folders(file.parent, (self.folders.home, *self.folders.packages))
        for folders in (self.folders, beside):
            try:
                path = folders.find(reference)
            except PathRefused as cause:
                refused = refused or cause
                continue
            if path is None:
                continue
            if path in self._included:
                raise ModelError(f"<include> {reference!r} is there twice")
            self._included.add(path)
            return path
        raise refused or ModelError(f"<include> {reference!r} does not exist")

    def _set_compiler(self) -> tuple[str, bool]:
        """Every body and shape stays; the folder of the meshes, and whether only the names of their files count."""
        told: dict[str, str] = {}
        for compiler in self.root.findall("compiler"):
            told |= {key: compiler.attrib.pop(key) for key in _FILE_FOLDERS if key in compiler.attrib}
        ElementTree.SubElement(self.root, "compiler", fusestatic="false", discardvisual="false")
        return told.get("meshdir", told.get("assetdir", "")), told.get("strippath") == "true"

    def _remove(self, unwanted: Callable[[Element, Element], bool]) -> None:
        """What is ``unwanted``, told by its parent and itself."""
        for parent in list(self.root.iter()):
            for child in list(parent):
                if unwanted(parent, child):
                    parent.remove(child)

    def _find_meshes(self, folder: str, names_only: bool) -> None:
        """Meshes by absolute paths; nothing else is fetched from a disk."""
        for mesh in self.root.findall("asset/mesh"):
            self._find(mesh, folder, names_only=names_only)
        for default in self.root.iter("mesh"):
            if default.get("file") and default.get("name") not in self.meshes:
                raise ModelError(f"{_called(default)} has a file outside <asset>")
        for material in self.root.iter("material"):
            material.attrib.pop("texture", None)

    def _find(self, mesh: Element, folder: str, *, names_only: bool) -> None:
        file = mesh.get("file", "")
        if not file or not set(mesh.attrib) <= set(_ASSET_FILES):
            odd = sorted(set(mesh.attrib) - set(_ASSET_FILES))
            raise ModelError(f"{_called(mesh)} has {', '.join(odd) if file else 'no file'}, which is not supported")
        file = Path(file).name if names_only else file
        name = mesh.get("name") or Path(file).stem
        path = self.folders.find(f"{folder}/{file}" if folder else file)
        mesh.attrib |= {"name": name, "file": str(path)}
        if path is None:
            self.missing[file] = None
            mesh.set("file", "")
        else:
            self.meshes[name] = path

    def _lacks_file(self, parent: Element, child: Element) -> bool:
        """A mesh that is missing, or a shape that is made of one or of a height field."""
        if child.tag != "geom":
            return child.tag == "mesh" and parent.tag == "asset" and not child.get("file")
        if "hfield" in child.attrib:
            self.left_out.append(f"{_called(child)}, a height field, is left out")
            return True
        name = child.get("mesh")
        if name is None or name in self.meshes:
            return False
        if parent.tag == "body" and parent.find("inertial") is None:
            raise ModelError(f"{_called(parent)} has no <inertial>, and its mesh {name!r} does not exist")
        return True


def _called(element: Element) -> str:
    name = element.get("name")
    return f"<{element.tag}>" if name is None else f"<{element.tag}> {name!r}"
