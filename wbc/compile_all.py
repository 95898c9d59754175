"""Compile every kernel of the library for this processor, in two processes: ``python -m wbc.compile_all``.

The machine code is kept on disk. A program that starts later waits for none of it, as in an image of a container.
Modules with kernels of your own: ``python -m wbc.compile_all MODULE ...``.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from importlib import import_module

from wbc.compiled import callee

#: Modules of kernels, or that import them: for each process those that need no large kernel of the other.
MODULES = (
    ("wbc.qp.lexicographic.solver", "wbc.qp.rows.core", "wbc.stack.plan"),
    ("wbc.control.measured", "wbc.robots.estimator", "wbc.models.compiled.whole", "wbc.models.near_pairs",
     *(f"wbc.tasks.compiled.{rows}" for rows in (
         "direction", "follow", "force", "frame", "joint", "limit", "motion"))),
)  # fmt: skip


def compiled(modules: Sequence[str]) -> list[int]:
    """Compile what these modules have, or read it from disk; where the kernels stand that others call by address."""
    values = [value for name in modules for value in vars(import_module(name)).values()]
    return [value.place for value in values if isinstance(value, callee)]


def main(modules: Sequence[str] = ()) -> int:
    """Compile these modules; without any all, each group in a process of its own. Exit code 1 where one failed."""
    if modules:
        compiled(modules)
        return 0
    groups = [subprocess.Popen([sys.executable, "-m", "wbc.compile_all", *group]) for group in MODULES]
    return int(any([group.wait() != 0 for group in groups]))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
