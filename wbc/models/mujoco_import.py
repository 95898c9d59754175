"""MuJoCo, imported without its pictures and without its log file: by those who read MJCF, and by the physics."""

from __future__ import annotations

import logging
import os
import sys
from importlib import import_module
from typing import Any

logger = logging.getLogger("wbc.sim.mujoco")


def import_mujoco() -> Any:
    """The module ``mujoco``, its warnings sent to the logger ``wbc.sim.mujoco`` (unless somebody else takes them).

    Nothing is drawn here, so the engine's OpenGL part stays off unless ``MUJOCO_GL`` is set or ``mujoco`` was imported
    before.

    Raises:
        ImportError: the package is not installed.
    """
    if "mujoco" in sys.modules or "MUJOCO_GL" in os.environ:
        module = import_module("mujoco")
    else:
        os.environ["MUJOCO_GL"] = "disable"
        try:
            module = import_module("mujoco")
        finally:
            del os.environ["MUJOCO_GL"]
    if module.get_mju_user_warning() is None:
        # Without a handler the engine appends to MUJOCO_LOG.TXT in whatever folder the program runs.
        module.set_mju_user_warning(_warn)
    return module


def _warn(message: str) -> None:
    logger.warning("%s", message)
