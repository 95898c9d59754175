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
from importlib.machinery import SourceFileLoader
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tasks import *  # noqa: F403

_FOLDER = Path(__file__).parent.parent / "tasks"


# This module becomes the package of that folder: its `__init__.py` runs here, and its files are looked up there.
__file__, __path__ = str(_FOLDER / "__init__.py"), [str(_FOLDER)]
__package__ = __name__
if __spec__ is not None:
    __spec__.submodule_search_locations = __path__
SourceFileLoader(__name__, __file__).exec_module(sys.modules[__name__])
del SourceFileLoader, Path, TYPE_CHECKING, annotations, sys  # not members: completion and * show what is left
