"""Folders that the files of a robot may lie in. Every file that a robot description refers to is looked up here."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import final
from urllib.parse import unquote, urlsplit

from wbc.errors import ModelError, PathRefused
from wbc.models.safe_xml import read_xml

#: A package is so many folders below the workspace that holds it: workspace/src/repository/package.
_DEEP = 3


@final
@dataclass(frozen=True)
class Folders:
    """``home``, the folder of the URDF, and ``packages``, the folders that ``package://`` stands for.

    A package folder is a package itself (the package has its name or the one in its package.xml) or holds packages, as
    a workspace does: those up to three folders deep are known by their package.xml.
    Files are read inside these folders only, links resolved: a description is a file from somewhere, and must not reach
    the rest of a disk.

    Example:
        >>> from wbc.models.folders import Folders
        >>> folders = Folders.around("robots/my_arm")
        >>> print(folders.find("meshes/base.stl"))
        None
        >>> folders.find("../../secret.stl")
        Traceback (most recent call last):
        wbc.errors.PathRefused: '../../secret.stl' is outside the folders that may be read: ...
    """

    home: Path
    packages: tuple[Path, ...] = ()

    @classmethod
    def around(cls, home: str | Path, packages: Iterable[str | Path] = ()) -> Folders:
        """The folder of a URDF, its ROS package (the nearest folder with a package.xml), and those given."""
        home = Path(home).resolve()
        given = [Path(folder).resolve() for folder in packages]
        own = next((folder for folder in (home, *home.parents) if (folder / "package.xml").is_file()), None)
        return cls(home, tuple(given if own is None else [*given, own]))

    def find(self, reference: str) -> Path | None:
        """The file that a URDF calls ``reference``; None if there is none.

        Raises:
            PathRefused: it is outside the folders, or is not a file reference at all.
        """
        try:
            for candidate in self._candidates(reference):
                path = candidate.resolve()
                if path.is_symlink():  # what Python before 3.13 raises by itself
                    raise RuntimeError("links in a circle")
                if not any(path.is_relative_to(folder) for folder in (self.home, *self.packages)):
                    raise PathRefused(
                        f"{reference!r} is outside the folders that may be read: "
                        f"{', '.join(map(str, (self.home, *self.packages)))}; load(..., packages=[folder]) adds one"
                    )
                if path.is_file():
                    return path
        except (OSError, ValueError, RuntimeError) as cause:  # too long, a NUL byte, links in a circle
            raise PathRefused(f"{reference[:100]!r} is not a path: {cause}") from None
        return None

    def _candidates(self, reference: str) -> Iterator[Path]:
        scheme, host, rest = urlsplit(reference)[:3] if "://" in reference else ("", "", reference)
        if scheme in ("", "file"):
            yield self.home / (unquote(rest) if scheme else rest)
            return
        if scheme != "package":
            raise PathRefused(f"{reference!r} is not a file; meshes are read from paths, file:// and package://")
        package, _, rest = f"{host}/{rest.lstrip('/')}".lstrip("/").partition("/")
        for folder in self.packages:
            if package in (folder.name, _told(folder)):
                yield folder / rest
        for folder in self.packages:
            yield folder / package / rest
        for folder in self._held.get(package, ()):
            yield folder / rest

    @cached_property
    def _held(self) -> dict[str, list[Path]]:
        """The packages that the package folders hold, by the name in their package.xml."""
        found: dict[str, list[Path]] = {}
        for top in self.packages:
            for place, inner, files in os.walk(top):
                folder = Path(place)
                if "package.xml" in files and folder != top:
                    found.setdefault(_told(folder), []).append(folder)
                    inner.clear()
                deep = len(folder.relative_to(top).parts)
                inner[:] = sorted(name for name in inner if not name.startswith(".") and deep < _DEEP)
        return found


def _told(folder: Path) -> str:
    """What the package in a folder is called, by its package.xml; folders of a clone or an archive have other names."""
    try:
        return (read_xml(folder / "package.xml", "package").findtext("name") or "").strip()
    except ModelError:
        return ""
