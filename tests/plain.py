"""Kernels as the Python functions that they are made of: to be called where machine code cannot be, and without it."""

from __future__ import annotations

from types import FunctionType, ModuleType
from typing import Any


def plain(module: ModuleType) -> Any:
    """What a module has, its own kernels as Python functions that call one another as such."""
    found = ModuleType(module.__name__)
    names = vars(found)
    names.update(vars(module))
    for name, value in vars(module).items():
        function = getattr(value, "py_func", None)
        if function is not None and function.__module__ == module.__name__:
            names[name] = FunctionType(function.__code__, names, name)
    return found
