"""Compile every kernel of the library for this processor, in two processes: ``python -m wbc.compile_all``.

The machine code is kept on disk. A program that starts later waits for none of it, as in an image of a container.
"""

from __future__ import annotations

import subprocess
import sys

#: Modules that compile when they are imported: for each process those that need no large kernel of the other.
MODULES = (
    ("wbc.qp.lexicographic.levels", "wbc.qp.rows.core", "wbc.stack.plan"),
    ("wbc.robots.estimator", "wbc.models.near_pairs", "wbc.stack.follower",
     *(f"wbc.stack.compiled.{rows}_kernel" for rows in (
         "direction", "force", "frame", "joint", "limit", "motion", "relative", "wheel"))),
)  # fmt: skip


def main() -> int:
    """Exit code 1 where a process failed."""
    programs = [subprocess.Popen([sys.executable, "-c", f"import {', '.join(modules)}"]) for modules in MODULES]
    return int(any([program.wait() != 0 for program in programs]))


if __name__ == "__main__":
    sys.exit(main())
