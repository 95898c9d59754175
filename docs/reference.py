"""Write the reference from the docstrings: a page for each task, limit, contact, component, and for each module."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Mapping
from enum import Enum
from importlib import import_module
from pathlib import Path
from typing import Any

DOCS = Path(__file__).resolve().parent
#: Modules whose public names have a page, with what they are for.
MODULES: Mapping[str, str] = {
    "wbc": "Robots, stacks, controllers, quadratic programs: the names of everyday use.",
    "wbc.types": "The symbol table, and the status of a solution.",
    "wbc.errors": "Errors of the library.",
    "wbc.models.feet": "The feet of a robot.",
    "wbc.methods": "Control methods, as closed forms and as quadratic programs.",
    "wbc.qp": "Quadratic programs with named rows.",
    "wbc.qp.solvers": "Solvers, by name and with their settings.",
    "wbc.sim.simulate": "A controller and a plant in a loop.",
    "wbc.sim.plant": "Plants: simulated robots.",
    "wbc.sim.mujoco_": "Physics by MuJoCo.",
    "wbc.sim.drives": "Drives that follow positions.",
    "wbc.sim.disturbance": "Pushes, loads and noise.",
    "wbc.sim.scenario": "Scenarios and their verdicts.",
    "wbc.report": "Reports of runs, solvers and comparisons.",
    "wbc.robots": "From joints to the motors of a device.",
    "wbc.testing": "Checks for tasks, limits and methods of your own.",
}
#: Names that are shown of modules that hold helpers too.
SHOWN: Mapping[str, tuple[str, ...]] = {
    "wbc.sim.plant": ("Plant", "IntegratorPlant", "ForwardDynamicsPlant", "Drive"),
    "wbc.sim.mujoco_": ("MujocoPlant", "PhysicsSettings"),
    "wbc.sim.drives": ("PositionDrives",),
}
#: Levels of a row of docs/features.md: "`Frame`, `Position` (v a τ)".
LEVELS = re.compile(r"((?:`\w+`(?:, )?)+) \(([vaτ ]+)\)")
NAMES = {"v": "velocity", "a": "acceleration", "τ": "inverse dynamics"}
#: Classes of the page of ``wbc`` from which members derive.
BASES = ("Task", "LinearTask", "Barrier", "LinearConstraint", "Constraint", "Contact", "Component")
ROLE = re.compile(r":\w+:`~?([\w.]+)`")
PAGE = re.compile(r"\bdocs/(\w)(\w+)\.md")
SECTION = re.compile(r"^(Args|Attributes|Raises|Returns|Yields|Example|Examples|Source|Sources|Signals|Note):\s*(.*)$")


def levels() -> dict[str, str]:
    """The levels that each member serves, as docs/features.md has them, where a test proves them."""
    found = {}
    for members, letters in LEVELS.findall((DOCS / "features.md").read_text(encoding="utf-8")):
        for name in re.findall(r"`(\w+)`", members):
            found[name] = ", ".join(NAMES[letter] for letter in letters.split())
    return found


def prose(text: str) -> str:
    """Text of a docstring as Markdown: code stays, pages are linked, every other sign stands for itself."""
    text = ROLE.sub(lambda m: f"``{m[1].rpartition('.')[2]}``", text)
    parts = re.split(r"(``.+?``)", " ".join(text.split()))
    plain = "".join(
        f"`{part[2:-2]}`" if part.startswith("``") and len(part) > 4 else re.sub(r"([\\*_\[\]<>$`])", r"\\\1", part)
        for part in parts
    )
    return PAGE.sub(lambda m: f"[{m[1].upper()}{m[2]}](../{m[1]}{m[2]}.md)", plain)


def blocks(lines: list[str]) -> Iterator[list[str]]:
    """Runs of lines between empty ones."""
    kept: list[str] = []
    for line in [*lines, ""]:
        if line.strip():
            kept.append(line)
        elif kept:
            yield kept
            kept = []


def body(lines: list[str]) -> Iterator[str]:
    """Paragraphs, indented formulas and examples of a docstring as Markdown."""
    for block in blocks(lines):
        text = inspect.cleandoc("\n".join(["", *block]))
        if text.startswith(">>>"):
            yield f"```pycon\n{text}\n```"
        elif re.match("=+  +=", text):
            yield table(text.splitlines())
        elif all(line.startswith("    ") for line in block) or re.search(r"\S {3,}\S", text):
            yield f"```text\n{text.replace('``', '')}\n```"
        elif text.startswith(("- ", "* ")):
            items = re.split(r"^[-*] ", text, flags=re.MULTILINE)[1:]
            yield "\n".join(f"* {prose(item)}" for item in items)
        else:
            yield prose(text)


def table(lines: list[str]) -> str:
    """A table of a docstring, its columns under runs of equals signs, as a table of Markdown."""
    starts = [found.start() for found in re.finditer("=+", lines[0])]
    rows = []
    for line in lines[1:]:
        if not line.startswith("="):
            ends = [*starts[1:], None]
            rows.append([prose(line[a:b].replace("**", "")) for a, b in zip(starts, ends, strict=True)])
    head, *others = ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows]
    return "\n".join([head, "| :-- " * len(starts) + "|", *others])


def listed(lines: list[str], *, errors: bool) -> str:
    """The arguments of a section ``Args``, or the ``errors`` of ``Raises``, several on a line, as a list."""
    items: list[str] = []
    for line in inspect.cleandoc("\n".join(["", *lines])).splitlines():
        if line.startswith(" ") and items:
            items[-1] += f" {line.strip()}"
        elif line.strip():
            items.append(line)
    if errors:
        items = [
            part for item in items for part in re.split(r"(?<=\.) (?=[A-Z][a-z]\w+(?:, [A-Z]\w+)*(?:: |\.$))", item)
        ]
    return "\n".join(_entry(*item.partition(": ")) for item in items)


def _entry(name: str, _: str, text: str) -> str:
    """An argument or an error with what is said of it; an error alone; or a sentence."""
    if not text and not name.rstrip(".").isidentifier():
        return f"* {prose(name)}"
    return f"* `{name.rstrip('.')}`" + (f": {prose(text)}" if text else "")


def rendered(docstring: str) -> str:
    """A docstring as Markdown."""
    parts: list[str] = []
    kept: list[str] = []
    section, said, goes_on = "", "", False

    def close() -> None:
        if section:
            parts.append(f"**{section}.** {prose(said)}".rstrip() if said else f"**{section}**")
        if section in ("Args", "Attributes", "Raises") and not said:
            parts.append(listed(kept, errors=section == "Raises"))
        else:
            inner = inspect.cleandoc("\n".join(["", *kept])).splitlines() if section else kept
            parts.extend(body(inner))

    for line in docstring.splitlines():
        if found := SECTION.match(line):
            close()
            section, said, kept, goes_on = found[1], found[2], [], bool(found[2])
        elif goes_on and line.strip():
            said += f" {line.strip()}"
        elif section and line and not line.startswith(" "):
            close()
            section, said, kept = "", "", [line]
        else:
            kept.append(line)
            goes_on = False
    close()
    return "\n\n".join(part for part in parts if part)


def signature(name: str, value: Any) -> str:
    """How something is called, without types; of an enumeration its members."""
    if inspect.isclass(value) and issubclass(value, Enum):
        return "\n".join(f"{name}.{entry.name}  # {entry.value}" for entry in value)
    try:
        given = inspect.signature(value)
    except (TypeError, ValueError):
        return name
    bare = [_short(p) for p in given.parameters.values() if p.name not in ("self", "cls")]
    words = str(given.replace(parameters=bare, return_annotation=given.empty))[1:-1].replace("=Ellipsis", "=...")
    line = f"{name}({words})"
    entries = [str(p).replace("=Ellipsis", "=...") for p in bare]
    first = next((i for i, p in enumerate(bare) if p.kind is p.KEYWORD_ONLY), None)
    if first is not None and not any(p.kind is p.VAR_POSITIONAL for p in bare):
        entries.insert(first, "*")
    return line if len(line) < 90 else "\n".join([f"{name}(", *(f"    {entry}," for entry in entries), ")"])


def _short(parameter: inspect.Parameter) -> inspect.Parameter:
    """A parameter without its type, and with three dots for a long default."""
    bare = parameter.replace(annotation=parameter.empty)
    return bare if len(repr(bare.default)) < 60 else bare.replace(default=...)


def member(name: str, value: type, kind: str, serves: str) -> str:
    """The page of a task, limit, contact or component."""
    module = inspect.getmodule(value)
    assert module is not None and value.__doc__
    facts = [f"| kind | {kind} |", f"| import | `from wbc.tasks import {name}` |"]
    if serves:
        facts.append(f"| levels | {serves} |")
    source = module.__name__.removeprefix("wbc.").replace(".", "/")
    facts.append(f"| source | `{source}.py` |")
    above = next(base.__name__ for base in value.__mro__[1:] if base.__name__ in BASES)
    facts.append(
        f"| derived from | [`{above}`](wbc.md#{above.lower()}), which has its equations and further arguments |"
    )
    return "\n".join(
        [
            f"# {name}\n\n{prose(about(name, value))}\n",
            "| | |\n| :-- | :-- |",
            *facts,
            f"\n```python\n{signature(name, value)}\n```\n",
            rendered(inspect.getdoc(value) or ""),
            *settings(value),
            "",
        ]
    )


def settings(value: type) -> Iterator[str]:
    """What may be assigned to a member between ticks, most of it inherited, as a list with a heading."""
    found = {name: getattr(value, name, None) for name in (*inspect.signature(value).parameters, "active")}
    about = {n: inspect.getdoc(p) or "" for n, p in found.items() if isinstance(p, property) and p.fset is not None}
    if about:
        yield "\n**May be assigned between ticks**\n"
        yield from (f"* `{name}`: {prose(text)}" for name, text in about.items())


def module_page(name: str) -> str:
    """The page of a module: what it offers, with signatures, docstrings and methods."""
    module = import_module(name)
    parts = [f"# `{name}`\n\n{MODULES[name]}\n"]
    if name == "wbc.types":
        parts.append(rendered(inspect.getdoc(module) or "") + "\n")
    shown = {title: where for title, value in offered(name, module) if (where := first_page(title, value)) != name}
    for where in dict.fromkeys(shown.values()):
        titles = ", ".join(f"`{title}`" for title in shown if shown[title] == where)
        parts.append(f"On the page of [`{where}`]({where}.md): {titles}.\n")
    for title, value in offered(name, module):
        if title in shown:
            continue
        called = f"```python\n{signature(title, value)}\n```"
        parts.append(f"## {title}\n\n{called}\n\n{rendered(inspect.getdoc(value) or '')}\n")
        if inspect.isclass(value):
            for way, what in own(value):
                parts.append(f"### {title}.{way}\n\n{rendered(inspect.getdoc(what) or '')}\n")
    return "\n".join(parts)


def first_page(title: str, value: Any) -> str:
    """The module whose page describes ``value``: the first one that offers it by this name."""
    return next(name for name in MODULES if (title, value) in offered(name, import_module(name)))


def offered(name: str, module: Any) -> list[tuple[str, Any]]:
    """Public classes and functions of a module, those of its own alone."""
    public = getattr(module, "__all__", None) or [n for n in dir(module) if not n.startswith("_")]
    names = SHOWN.get(name, public)
    values = [(n, getattr(module, n)) for n in names]
    home = name.rpartition(".")[0] if name.endswith("_") else name
    return [
        (n, v)
        for n, v in values
        if (inspect.isclass(v) or inspect.isfunction(v)) and v.__module__.startswith(home) and inspect.getdoc(v)
    ]


def own(value: type) -> list[tuple[str, Any]]:
    """Public methods and properties that a class defines with a docstring; not functions of Python's own modules."""
    return [
        (name, thing)
        for name, thing in vars(value).items()
        if not name.startswith("_")
        and isinstance(thing, property | classmethod | staticmethod) | inspect.isfunction(thing)
        and inspect.getdoc(thing)
        and getattr(thing, "__doc__", None)
        and not inspect.isbuiltin(getattr(thing, "__func__", None))
    ]


#: Sections of the catalogue: title, where these members go, and whether they are of a base class; the first that is.
KINDS: Mapping[str, tuple[str, str, str]] = {
    "Task": ("Kinematic tasks", "task", "Argument `tasks` of a stack. In `subject_to`, `task.exactly()` is an equality "
             "and `task.within(…)` an interval; in `contacts`, `task.with_reaction()` is a part of the mechanism."),
    "LinearTask": ("Tasks on torques and forces", "task on torques or forces", "Argument `tasks` of a stack."),
    "Constraint": ("Limits", "limit", "Argument `subject_to` of a stack; `constraint.softly()` is a task."),
    "Contact": ("Contacts", "contact", "Argument `contacts` of a stack; `wbc.tasks.feet(robot)` makes those of a "
                "robot's own feet."),
    "Component": ("Components", "component", "Argument `components` of a stack: they have memory between ticks."),
}  # fmt: skip


def members() -> dict[str, list[tuple[str, type]]]:
    """The public members of the library by the names of :data:`KINDS`."""
    import tasks
    from wbc.stack.component import Component
    from wbc.stack.constraint import Constraint
    from wbc.stack.contact import Contact
    from wbc.stack.task import LinearTask, Task

    bases = {"Task": Task, "LinearTask": LinearTask, "Constraint": Constraint, "Contact": Contact,
             "Component": Component}  # fmt: skip
    found: dict[str, list[tuple[str, type]]] = {kind: [] for kind in KINDS}
    for name, value in vars(tasks).items():
        kind = next((k for k, base in bases.items() if inspect.isclass(value) and issubclass(value, base)), None)
        if kind:
            found[kind].append((name, value))
    return found


def about(name: str, value: type) -> str:
    """What a member is, in a sentence: the first line of its module."""
    module = inspect.getmodule(value)
    assert module is not None and module.__doc__
    text = module.__doc__.splitlines()[0].removeprefix(f"{name}: ")
    return text[0].upper() + text[1:]


def catalogue() -> str:
    """A table of all members for docs/library.md."""
    serves, short = levels(), {", ".join(NAMES.values()): "all"}
    parts = []
    for kind, found in members().items():
        title, _, where = KINDS[kind]
        leveled = any(name in serves for name, _ in found)  # of components no level is tried
        rows = [
            f"| `{name}` | {about(name, value)} |"
            + (f" {short.get(serves.get(name, ''), serves.get(name, ''))} |" if leveled else "")
            for name, value in found
        ]
        head = ["| | | levels |", "| :-- | :-- | :-- |"] if leveled else ["| | |", "| :-- | :-- |"]
        parts += [f"\n## {title}\n\n{where}\n", *head, *rows]
    return "\n".join(parts) + "\n"


def pages() -> tuple[dict[str, str], dict[str, str]]:
    """Every page of the reference by its file name: those of members, those of modules."""
    serves = levels()
    found = {
        f"reference/{name}.md": member(name, value, KINDS[kind][1], serves.get(name, ""))
        for kind, those in members().items()
        for name, value in those
    }
    return dict(sorted(found.items())), {f"reference/{name}.md": module_page(name) for name in MODULES}
