"""A package of ``wbc`` by its short name: ``tasks`` is ``wbc.tasks``, where no foreign module is called ``tasks``.

One package under two names is loaded once, by the long one.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import final


@final
class _ShortName(MetaPathFinder, Loader):
    """Imports of ``short.x`` give the module ``wbc.short.x``, once ``short`` is that package and no foreign one."""

    def __init__(self, short: str) -> None:
        self._short = short

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        ours = sys.modules.get(self._short) is sys.modules[f"wbc.{self._short}"]
        return ModuleSpec(fullname, self) if ours and fullname.startswith(f"{self._short}.") else None

    def create_module(self, spec: ModuleSpec) -> None:
        return None

    def exec_module(self, module: ModuleType) -> None:
        sys.modules[module.__name__] = import_module(f"wbc.{module.__name__}")


def hand_over(short: str) -> None:
    """Called by a package that runs as ``short``: from now on it is ``wbc.short``, with all that is in it."""
    long = import_module(f"wbc.{short}").__name__
    for name, module in list(sys.modules.items()):
        if name == long or name.startswith(f"{long}."):
            sys.modules[name.removeprefix("wbc.")] = module
    sys.meta_path.insert(0, _ShortName(short))
