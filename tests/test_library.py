"""docs/library.md lists what the library has. Write it anew with ``python tests/test_library.py``."""

from __future__ import annotations

import inspect
import sys
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))  # when it is run as a program

import tasks
from tests import test_features
from wbc.stack.component import Component
from wbc.stack.constraint import Constraint
from wbc.stack.contact import Contact
from wbc.stack.task import LinearTask, Task

DOCUMENT = Path(__file__).parents[1] / "docs" / "library.md"
MARK = "<!-- written by tests/test_library.py -->\n"
KINDS: dict[str, tuple[str, type]] = {
    "Kinematic tasks": (
        "As constraints, in `subject_to`: `task.exactly()`, an equality, `task.within(…)`, an interval; "
        "`task.with_reaction()`, a part of the mechanism, in `contacts`.",
        Task,
    ),
    "Linear tasks": ("On torques or forces, so with `InverseDynamics`.", LinearTask),
    "Limits": ("In `subject_to`.", Constraint),
    "Contacts": ("In `contacts`; `wbc.tasks.feet(robot)` makes those of a robot's own feet.", Contact),
    "Components": ("In `components`: what remembers between ticks.", Component),
}


def written() -> str:
    """The generated part of the page."""
    parts = []
    members = [member for member in vars(tasks).values() if inspect.isclass(member)]
    for title, (where, kind) in KINDS.items():
        rows = [_row(member) for member in members if issubclass(member, kind)]
        if rows:
            parts += [f"\n## {title}\n\n{where}\n", "| | |\n| :-- | :-- |", *rows]
    return "\n".join(parts) + "\n"


def _row(member: Any) -> str:
    first = inspect.getdoc(member).split("\n\n")[0].replace("\n", " ").replace("|", "\\|")
    about = inspect.getmodule(member).__doc__.split("\n")[0].removeprefix(f"{member.__name__}: ")
    return f"| `{member.__name__}` | {about[0].upper()}{about[1:]} {first} |"


def test_the_page_lists_what_there_is() -> None:
    text = DOCUMENT.read_text(encoding="utf-8")
    assert text.split(MARK)[1] == written(), "run: python tests/test_library.py"


def test_every_member_is_on_it() -> None:
    kinds = tuple(kind for _, kind in KINDS.values())
    members = {m.__name__ for m in vars(tasks).values() if inspect.isclass(m) and issubclass(m, kinds)}
    assert {"Frame", "TorqueLimits", "Sole", "SlotineLi"} <= members
    assert all(f"`{name}`" in written() for name in members)


def test_the_comparison_with_others_is_as_the_code_is() -> None:
    assert test_features.DOCUMENT.read_text(encoding="utf-8") == test_features.written(), "run as above"


if __name__ == "__main__":
    text = DOCUMENT.read_text(encoding="utf-8")
    DOCUMENT.write_text(text.split(MARK)[0] + MARK + written(), encoding="utf-8")
    test_features.DOCUMENT.write_text(test_features.written(), encoding="utf-8")
