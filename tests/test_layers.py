"""The shape of the sources: which layer may import which, and what every file keeps to.

Sources are parsed, never imported, so an import inside a function counts as much as one at the top.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
SOURCES = sorted(p.relative_to(ROOT) for package in ("wbc", "tasks") for p in (ROOT / package).rglob("*.py"))

BASE = {
    "arguments", "checks", "compiled", "errors", "files", "friction", "npz", "packing", "plugins", "tolerances",
    "types",
}  # fmt: skip
OPTIMISATION_AND_ROBOTS = BASE | {"qp", "models"}
LOOP = OPTIMISATION_AND_ROBOTS | {"methods", "stack"}

#: Each part of ``wbc`` and the other parts it may import. Both sides of layer 1 stand apart: qp and models never meet.
ARROWS = {
    "errors": set(),
    "types": {"errors"},
    "arguments": {"errors"},
    "checks": {"errors", "tolerances", "types"},
    "compiled": {"errors"},
    "tolerances": set(),
    "friction": {"errors", "types", "checks"},
    "files": {"errors", "checks"},
    "npz": {"errors", "files"},
    "packing": {"errors", "npz"},
    "plugins": {"errors"},
    "short_name": set(),
    "qp": BASE,
    "models": BASE,
    "robots": LOOP | {"control", "sim", "tasks"},
    "methods": BASE | {"qp"},
    "stack": OPTIMISATION_AND_ROBOTS | {"methods"},
    "control": LOOP,
    "testing": LOOP,
    "sim": LOOP | {"control"},
    "report": LOOP | {"control", "sim"},
    "export": LOOP | {"control", "sim", "report"},
    "live": LOOP | {"control", "sim", "report"},
    "tasks": set(),
    "sweep": LOOP | {"control", "sim", "report"},
    "motion": LOOP | {"control", "report", "sim", "tasks"},
    "cli": LOOP | {"control", "sim", "report", "export", "live", "motion", "robots", "sweep", "testing"},
    "__main__": {"cli"},
    "compile_all": {"compiled"},
}

#: What a task, limit or component may import: it never sees a QP. Scenarios and workloads may import anything.
TASKS_SEE = {"stack", "methods", "models"} | BASE
FREE = {"scenarios", "workloads"}
#: What gives names to what stands elsewhere.
OPEN = {Path("wbc/__init__.py"), Path("wbc/tasks.py"), Path("tasks/__init__.py")}

MAX_LINES = 500
UNFINISHED = re.compile(r"\b(TODO|FIXME|XXX|NotImplementedError)\b")


def imported_modules(source: str, module: str) -> Iterator[str]:
    """Every name a source imports, in full; ``from wbc import checks`` is ``wbc.checks``."""
    package = module.split(".")
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            start = package[: len(package) - node.level] if node.level else []
            base = ".".join([*start, *([node.module] if node.module else [])])
            yield from (f"{base}.{alias.name}" for alias in node.names)


def circle(sources: Mapping[Path, str]) -> list[str]:
    """Files that import one another, the first also at the end; [] where there are none.

    Imports inside functions and those for the type checker count too.
    """
    inside = {path: ".".join(path.with_suffix("").parts) for path in sources}
    modules = {module.removesuffix(".__init__") for module in inside.values()}
    imports: dict[str, set[str]] = {}
    for path, source in sources.items():
        names = set(imported_modules(source, inside[path]))
        # A name is a file's, or stands in one.
        named = {name if name in modules else name.rpartition(".")[0] for name in names}
        module = inside[path].removesuffix(".__init__")
        imports[module] = named & modules - {module}
    try:
        TopologicalSorter(imports).prepare()
    except CycleError as found:
        return list(found.args[1])
    return []


def forbidden_imports(path: Path, source: str) -> list[str]:
    """The arrows of one file that the table does not have, as sentences."""
    parts = path.with_suffix("").parts
    home, part = parts[0], parts[1]
    if path in OPEN or (home == "tasks" and part in FREE):
        return []
    allowed = {"__version__"} | (ARROWS.get(part, set()) | {part} if home == "wbc" else TASKS_SEE)
    faults = []
    for name in imported_modules(source, ".".join(parts)):
        top, _, rest = name.partition(".")
        target = rest.split(".")[0]
        if top == "tasks" and (home == "wbc" or target in FREE):
            faults.append(f"{path} imports {name}")
        elif top == "wbc" and target not in allowed:
            faults.append(f"{path} imports {name}")
    return faults


def undocumented(path: Path, source: str) -> list[str]:
    """Public classes and functions without a docstring; a method may inherit that of its base class."""
    faults = []
    for node in ast.parse(source).body:
        if not isinstance(node, ast.ClassDef | ast.FunctionDef) or node.name.startswith("_"):
            continue
        members: list[ast.AST] = [node]
        if isinstance(node, ast.ClassDef) and {ast.unparse(base) for base in node.bases} <= {"ABC", "object"}:
            members += [m for m in node.body if isinstance(m, ast.FunctionDef) and not m.name.startswith("_")]
        for member in members:
            setter = any(ast.unparse(d).endswith(".setter") for d in member.decorator_list)
            if not ast.get_docstring(member) and not setter:
                faults.append(f"{path}:{member.lineno} {member.name} has no docstring")
    return faults


def unfinished(path: Path, source: str) -> list[str]:
    """Marks of work that was left for later."""
    lines = enumerate(source.splitlines(), start=1)
    return [f"{path}:{i} {m.group()}" for i, line in lines if (m := UNFINISHED.search(line))]


def read(path: Path) -> str:
    """The text of one source of the project."""
    return (ROOT / path).read_text(encoding="utf-8")


def test_there_are_sources_to_check():
    assert {path.parts[0] for path in SOURCES} == {"wbc", "tasks"}


def test_every_part_of_the_framework_stands_in_the_table():
    parts = {path.with_suffix("").parts[1] for path in SOURCES if path.parts[0] == "wbc"} - {"__init__"}
    assert parts <= set(ARROWS)


def test_the_table_has_no_cycle():
    remaining = dict(ARROWS)
    while remaining:
        leaves = [part for part, sees in remaining.items() if not sees & set(remaining)]
        assert leaves, f"these import one another: {sorted(remaining)}"
        for part in leaves:
            del remaining[part]


def test_imports_run_one_way():
    assert [fault for path in SOURCES for fault in forbidden_imports(path, read(path))] == []


def test_no_files_import_one_another():
    assert circle({path: read(path) for path in SOURCES}) == []


def test_no_file_is_longer_than_one_can_read():
    assert [f"{p}: {n} lines" for p in SOURCES if (n := len(read(p).splitlines())) > MAX_LINES] == []


def test_nothing_is_left_for_later():
    assert [fault for path in SOURCES for fault in unfinished(path, read(path))] == []


def test_public_classes_and_functions_are_documented():
    assert [fault for path in SOURCES for fault in undocumented(path, read(path))] == []


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("wbc/qp/problem.py", "from wbc.models.model import RobotModel"),
        ("wbc/models/model.py", "import wbc.qp.problem"),
        ("wbc/models/model.py", "def f():\n    from wbc import qp"),
        ("wbc/models/model.py", "from ..qp import problem"),
        ("wbc/stack/plan.py", "from wbc.control.controller import Controller"),
        ("wbc/stack/plan.py", "import wbc"),
        ("wbc/cli/run.py", "import tasks"),
        ("wbc/cli/run.py", "from tasks.scenarios import SCENARIOS"),
        ("wbc/cli/run.py", "from wbc.tasks.scenarios import SCENARIOS"),
        ("wbc/errors.py", "from wbc.types import Vec"),
        ("tasks/posture.py", "if True:\n    from wbc.qp.problem import QP"),
        ("tasks/posture.py", "from wbc import Controller"),
        ("tasks/limits/torque.py", "from ..scenarios import SCENARIOS"),
    ],
)
def test_an_arrow_against_the_layers_is_found(path: str, source: str):
    assert len(forbidden_imports(Path(path), source)) == 1


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("wbc/qp/problem.py", "from wbc import checks\nfrom .certificate import Certificate"),
        ("wbc/stack/plan.py", "from wbc.qp.problem import QP\nfrom wbc.models.model import RobotModel"),
        ("wbc/cli/run.py", "def f():\n    from wbc.report import html"),
        ("tasks/posture.py", "import numpy\nfrom wbc.stack.task import Task\nfrom .position import Position"),
        ("tasks/scenarios/arm.py", "import wbc\nfrom .. import Posture\nfrom wbc.qp.problem import QP"),
        ("tasks/workloads.py", "import wbc"),
        ("wbc/__init__.py", "from wbc.control.controller import Controller"),
    ],
)
def test_an_arrow_along_the_layers_passes(path: str, source: str):
    assert forbidden_imports(Path(path), source) == []


@pytest.mark.parametrize(
    ("there", "back"),
    [
        ("from wbc.qp.rows import RowProblem", "import wbc.qp.problem"),
        ("from .rows import RowProblem", "from ..qp import problem"),
        ("def f():\n    from wbc.qp import rows", "if TYPE_CHECKING:\n    from wbc.qp.problem import QP"),
        ("class QP:\n    import wbc.qp.rows", "def f():\n    from ..qp.problem import QP"),
    ],
)
def test_files_that_import_one_another_are_found(there: str, back: str):
    problem, rows = Path("wbc/qp/problem.py"), Path("wbc/qp/rows.py")
    other = {Path("wbc/qp/__init__.py"): "from .problem import QP", Path("wbc/errors.py"): ""}
    found = circle({problem: there, rows: back} | other)
    assert found[0] == found[-1]
    assert set(found) == {"wbc.qp.problem", "wbc.qp.rows"}
    assert circle({problem: there, rows: "import wbc.errors\nimport wbc.qp.rows"} | other) == []


def test_a_circle_through_a_package_is_found():
    sources = {
        Path("wbc/qp/__init__.py"): "from .problem import QP",
        Path("wbc/qp/problem.py"): "from wbc.qp import QP",
    }
    assert set(circle(sources)) == {"wbc.qp", "wbc.qp.problem"}


def test_the_other_checks_find_what_they_look_for():
    source = "class Task:\n    def fill(self): ...\ndef solve(): ...\ndef _own(): raise NotImplementedError  # TODO\n"
    assert len(undocumented(Path("bad.py"), source)) == 3
    assert len(unfinished(Path("bad.py"), source)) == 1
