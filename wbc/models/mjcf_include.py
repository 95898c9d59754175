"""MJCF in several files: each ``<include file="…"/>`` replaced by what stands in that file, as MuJoCo's parser does.

A file is looked for beside the main one, then beside the one that includes it, and only in the folders that may be
read. Source: MuJoCo's XML reference, https://mujoco.readthedocs.io/en/stable/XMLreference.html#include.
"""

from __future__ import annotations

from pathlib import Path
from typing import final
from xml.etree.ElementTree import Element

from wbc.errors import ModelError, PathRefused
from wbc.models.folders import Folders
from wbc.models.safe_xml import read_xml, refuse_large


def write_out(root: Element, main: Path, folders: Folders) -> None:
    """Put what other files say into ``root``, the root element of the file ``main``.

    Raises:
        ModelError: a file that is missing, empty, included twice or not plain XML; too much of it all together.
        PathRefused: a file outside the folders.
    """
    _Writing(folders, {main.resolve()}).insert_into(root, main.resolve(), depth=1)


@final
class _Writing:
    def __init__(self, folders: Folders, included: set[Path]) -> None:
        self._folders, self._included = folders, included
        self._elements = 0

    def insert_into(self, parent: Element, file: Path, depth: int) -> None:
        """Below ``parent``, which stands in ``file``, no include is left."""
        refuse_large(depth, self._elements)
        children: list[Element] = []
        for child in list(parent):
            self._elements += 1
            if child.tag != "include":
                self.insert_into(child, file, depth + 1)
                children.append(child)
                continue
            path = self._find(child, file)
            inside = read_xml(path)
            self.insert_into(inside, path, depth)
            if not len(inside):
                raise ModelError(f"<include> {child.get('file')!r} holds nothing")
            children += inside
        parent[:] = children

    def _find(self, include: Element, file: Path) -> Path:
        reference = include.get("file", "")
        if not reference or len(include):
            raise ModelError("an <include> has a file and nothing inside")
        refused: PathRefused | None = None
        beside = Folders(file.parent, (self._folders.home, *self._folders.packages))
        for folders in (self._folders, beside):
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
