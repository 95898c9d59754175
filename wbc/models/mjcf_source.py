"""MJCF before MuJoCo's compiler sees it: only what describes a robot is left, every file looked up, the rest refused.

Source: MuJoCo's XML reference, https://mujoco.readthedocs.io/en/stable/XMLreference.html.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import final
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from wbc.errors import ModelError
from wbc.models.folders import Folders

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
    """One file on its way to the compiler.

    ``meshes`` are the files by the name of the mesh, ``missing`` those that do not exist, ``left_out`` sentences on
    parts that exist in the file and not in the robot.

    Raises:
        ModelError: an element that is not supported, by its name; a mesh that is missing and a body weighed by it.
        PathRefused: a mesh outside the folders.
    """

    root: Element
    folders: Folders
    meshes: dict[str, Path] = field(default_factory=dict)
    missing: dict[str, None] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        for element in self.root.iter():
            if element.tag in _REFUSED or (element.tag == "model" and element is not self.root):
                raise ModelError(f"{_called(element)} is not supported; give the robot in one file, written out")
            for key, value in element.attrib.items():
                if _NOT_A_NUMBER.search(value):
                    raise ModelError(f"{key} of {_called(element)} is {value[:60]!r}; numbers must be finite")
            if element.get("mass", "").strip().startswith("-"):
                raise ModelError(f"the mass of {_called(element)} is {element.get('mass')!r}; it must not be negative")
        for section in list(self.root):
            if section.tag in _SCENE:
                self.root.remove(section)
            elif section.tag not in _ROBOT:
                raise ModelError(f"<{section.tag}> is not supported; a robot is {', '.join(sorted(_ROBOT))}")
        self._find_meshes(self._set_compiler())
        self._drop_missing()

    @property
    def text(self) -> str:
        """What the compiler reads."""
        return ElementTree.tostring(self.root, encoding="unicode")

    def _set_compiler(self) -> tuple[str, bool]:
        """Every body and shape stays; the folder of the meshes, and whether only the names of their files count."""
        told: dict[str, str] = {}
        for compiler in self.root.findall("compiler"):
            told |= {key: compiler.attrib.pop(key) for key in _FILE_FOLDERS if key in compiler.attrib}
        ElementTree.SubElement(self.root, "compiler", fusestatic="false", discardvisual="false")
        return told.get("meshdir", told.get("assetdir", "")), told.get("strippath") == "true"

    def _find_meshes(self, where: tuple[str, bool]) -> None:
        """Meshes by absolute paths; nothing else is fetched from a disk."""
        folder, names_only = where
        for assets in self.root.findall("asset"):
            for asset in list(assets):
                if asset.tag not in ("mesh", "material"):
                    assets.remove(asset)
                elif asset.tag == "mesh":
                    self._find(asset, folder, names_only=names_only)
        for default in self.root.iter("mesh"):
            if "file" in default.attrib and not self._is_found(default):
                raise ModelError(f"{_called(default)} has a file outside <asset>")
        for material in self.root.iter("material"):
            material.attrib.pop("texture", None)
            for layer in material.findall("layer"):
                material.remove(layer)
        for parent in list(self.root.iter()):
            for child in list(parent):
                if child.tag in ("camera", "light"):
                    parent.remove(child)

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

    def _is_found(self, mesh: Element) -> bool:
        return mesh.get("name") in self.meshes or mesh.get("file") == ""

    def _drop_missing(self) -> None:
        for assets in self.root.findall("asset"):
            for mesh in assets.findall("mesh"):
                if not mesh.get("file"):
                    assets.remove(mesh)
        for parent in list(self.root.iter()):
            for geom in parent.findall("geom"):
                if "hfield" in geom.attrib:
                    self.left_out.append(f"{_called(geom)}, a height field, is left out")
                    parent.remove(geom)
                    continue
                name = geom.get("mesh")
                if name is None or name in self.meshes:
                    continue
                if parent.tag == "body" and parent.find("inertial") is None:
                    raise ModelError(f"{_called(parent)} has no <inertial>, and its mesh {name!r} does not exist")
                parent.remove(geom)


def _called(element: Element) -> str:
    name = element.get("name")
    return f"<{element.tag}>" if name is None else f"<{element.tag}> {name!r}"
