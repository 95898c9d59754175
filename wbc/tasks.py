"""The library of members under the name that cannot clash: ``wbc.tasks`` is the folder ``tasks/`` beside ``wbc/``.

A module called ``tasks`` of the user's own hides the folder from ``import tasks``; ``from wbc.tasks import Posture``
finds it all the same. Whichever name is used, a class is one object, and its module is called ``wbc.tasks...``.

Example:
    >>> import tasks
    >>> import wbc.tasks
    >>> tasks.Posture is wbc.tasks.Posture
    True
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec, SourceFileLoader
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tasks import *  # noqa: F403

_FOLDER = Path(__file__).parent.parent / "tasks"


class _ShortName(MetaPathFinder, Loader):
    """Imports of ``tasks.x`` give the module ``wbc.tasks.x``, once ``tasks`` is this module and no foreign one."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        short = fullname.startswith("tasks.") and sys.modules.get("tasks") is sys.modules[__name__]
        return ModuleSpec(fullname, self) if short else None

    def create_module(self, spec: ModuleSpec) -> None:
        return None

    def exec_module(self, module: ModuleType) -> None:
        sys.modules[module.__name__] = import_module(f"wbc.{module.__name__}")


def _take_the_short_name() -> None:
    """Have ``tasks`` and ``tasks.x`` be ``wbc.tasks`` and ``wbc.tasks.x``: what is loaded, and what will be."""
    for name, module in list(sys.modules.items()):
        if name == __name__ or name.startswith(f"{__name__}."):
            sys.modules[name.removeprefix("wbc.")] = module
    sys.meta_path.insert(0, _ShortName())


# This module becomes the package of that folder: its `__init__.py` runs here, and its files are looked up there.
__file__, __path__ = str(_FOLDER / "__init__.py"), [str(_FOLDER)]
__package__ = __name__
if __spec__ is not None:
    __spec__.submodule_search_locations = __path__
SourceFileLoader(__name__, __file__).exec_module(sys.modules[__name__])
