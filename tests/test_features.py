"""docs/features.md compares the library with others. Write it anew with ``python tests/test_library.py``."""

from __future__ import annotations

import inspect
import tomllib
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

import tasks
import wbc
from wbc.models.model import RobotModel
from wbc.stack.component import Component
from wbc.stack.constraint import Constraint
from wbc.stack.contact import Contact
from wbc.stack.hierarchy import Hierarchy
from wbc.stack.task import LinearTask, Objective
from wbc.testing import levels_of, robots

ROOT = Path(__file__).parents[1]
DOCUMENT, DATA = ROOT / "docs" / "features.md", ROOT / "docs" / "features.toml"
PEERS = {"tsid": "TSID", "pink": "Pink", "mink": "mink", "placo": "PlaCo", "opensot": "OpenSoT"}
#: Columns of levels: what a member serves is found by compiling it in a stack.
LEVELS = {"velocity level": "v", "acceleration level": "a", "inverse dynamics": "τ"}
ANSWERS = ("yes", "partly", "no")
INTRODUCTION = """# Features, beside other libraries

This page lists every task, limit, contact, component and hierarchy of the library with its levels (v velocities, a
accelerations, τ torques and forces), beside those of five other libraries. `python tests/test_library.py` writes it
from the code and from `docs/features.toml`; a test compares the two.
"""


def read() -> dict[str, Any]:
    """The data: peers, groups of rows."""
    return tomllib.loads(DATA.read_text(encoding="utf-8"))


def rows(data: dict[str, Any]) -> list[dict[str, Any]]:
    """All rows of all groups."""
    return [row for group in data["group"] for row in group["row"]]


def find(name: str) -> Any:
    """What a name stands for: a member of ``tasks``, or a dotted name of ``wbc``.

    Raises:
        AttributeError: nothing.
    """
    if "." not in name and name != "wbc":
        return getattr(tasks, name)
    found: Any = wbc
    path = name.split(".")
    for i, part in enumerate(path[1:], start=2):
        found = getattr(found, part) if hasattr(found, part) else import_module(".".join(path[:i]))
    return found


def members() -> dict[str, Any]:
    """Everything that can stand in a stack, and the hierarchies, by the name they go by in the data."""
    kinds = (Objective, Constraint, Contact, Component)
    found = {n: m for n, m in vars(tasks).items() if _is_member(m, kinds)}
    hierarchies = {f"wbc.{n}": getattr(wbc, n) for n in dir(wbc) if _is_member(getattr(wbc, n), (Hierarchy,))}
    return found | hierarchies


def _is_member(value: Any, kinds: tuple[type, ...]) -> bool:
    return isinstance(value, type) and issubclass(value, kinds) and not inspect.isabstract(value)


@cache
def levels(name: str) -> str:
    """The levels that a member serves, as the table has them."""
    member = members().get(name)
    if member is None:
        return ""
    if issubclass(member, Hierarchy | Component):
        return "" if issubclass(member, Component) else "v a τ"
    for robot in reversed(robots()):
        samples = member.samples(robot)
        for sample in samples[:1]:
            found = levels_of(sample, robot, contacts=contacts_of(sample, robot))
            return " ".join(LEVELS[level.name] for level in found)
    return ""


def contacts_of(member: Any, robot: RobotModel) -> list[Contact]:
    """What a member on a force speaks of: contacts of its own, or a sole on the last frame."""
    on_force = isinstance(member, LinearTask | Constraint) and getattr(member, "on", "") == "force"
    sole = tasks.Sole(robot.frame_names[-1], half_size=(0.1, 0.05), friction=0.5)
    return list(getattr(member, "contacts", [sole])) if on_force else []


def written() -> str:
    """The page."""
    data = read()
    parts = [INTRODUCTION, data["source"].strip() + "\n"]
    parts += [*(f"- {about}" for about in data["peers"].values()), ""]
    named = {name for row in rows(data) for name in row["here"]}
    for group in data["group"]:
        parts += [f"## {group['title']}\n", f"| | here | {' | '.join(PEERS.values())} |", "| :-- " * 7 + "|"]
        for row in group["row"]:
            cells = [row["what"], _here(row), *(row[peer] for peer in PEERS)]
            parts.append("| " + " | ".join(cells) + " |")
        parts.append("")
    alone = [name for name in members() if name not in named]
    if alone:
        parts += ["## Beside these\n", *(f"- {_here({'here': [name]})}" for name in alone), ""]
    return "\n".join(parts)


def _here(row: dict[str, Any]) -> str:
    """Names, those that serve the same levels together, and the note."""
    groups: dict[str, list[str]] = {}
    for name in row["here"]:
        groups.setdefault(levels(name), []).append(f"`{name}`")
    found = [", ".join(names) + (f" ({served})" if served else "") for served, names in groups.items()]
    return ". ".join(part for part in ("; ".join(found) or "no", row.get("note", "")) if part)


@pytest.mark.parametrize("row", rows(read()), ids=lambda row: row["what"])
def test_a_row_that_others_have_is_here_or_says_why_not(row: dict[str, Any]) -> None:
    assert set(row) <= {"what", "here", "note", *PEERS}
    for peer in PEERS:
        assert row[peer].split()[0] in ANSWERS, f"{peer}: {row[peer]}"
    for name in row["here"]:
        assert find(name) is not None
    assert row["here"] or row["note"].endswith(".")


def test_every_member_is_in_the_table() -> None:
    page = DOCUMENT.read_text(encoding="utf-8")
    missing = [name for name in members() if f"`{name}`" not in page]
    assert not missing and len(members()) > 50


def test_hierarchies_stand_among_the_hierarchies() -> None:
    group = next(group for group in read()["group"] if group["title"] == "Hierarchies")
    named = {name for row in group["row"] for name in row["here"]}
    ours = {name for name, member in members().items() if issubclass(member, Hierarchy)}
    assert ours <= named, "give it its place in docs/features.toml"


def test_kinematic_tasks_serve_every_level() -> None:
    assert levels("Frame") == levels("Gaze") == levels("RelativeFrame") == levels("CentroidalMomentum") == "v a τ"
    assert levels("TorqueLimits") == levels("ContactForce") == "τ" and levels("Impedance") == "a τ"
