"""Kept machine code is that of the sources as they are."""

from __future__ import annotations

import ast
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numba
import numpy as np
import pytest
from llvmlite.binding import Linkage
from numba.core import caching

import wbc
from tests.test_import_cost import modules_after
from wbc import compiled
from wbc.compile_all import MODULES
from wbc.compiled import Layout, carray, digest, floats, part
from wbc.qp.rows.compiled import linear
from wbc.qp.rows.compiled.linear import factor
from wbc.types import Index, Mat

ROOT = Path(wbc.__file__).parents[1]
LINEAR, ROWS, FILL = (f"wbc/a/compiled/{name}" for name in ("linear", "rows", "fill"))
TASK, OWN, SHARED = "tasks/compiled/task", "mine/own", "mine/shared"
#: Files of kernels that take in others, the last two those of a user, and numbers that all take in.
FILES = {
    LINEAR: "", ROWS: "from wbc.a.compiled.linear import f", FILL: "from wbc.a.compiled.rows import g",
    TASK: "from wbc.a.compiled.rows import g", OWN: "import wbc.a.compiled.rows as r\nfrom . import (\n    shared,\n)",
    SHARED: "from mine.own import h", "mine/other": "", "wbc/tolerances": "", "wbc/compiled": "",
    "wbc/stack/kernel_rows": "",
}  # fmt: skip


def package(folder: Path, changed: str = "") -> Path:
    """These files, one of them changed."""
    for name, text in FILES.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / f"{name}.py").write_text(f"{text}\n{'x = 1' * (name == changed)}", encoding="utf-8")
    return folder


@pytest.mark.parametrize("changed", FILES)
def test_machine_code_depends_on_every_text_that_it_is_made_of_and_on_no_other(tmp_path: Path, changed: str):
    before, after = package(tmp_path / "before"), package(tmp_path / "after", changed)
    kernels = [LINEAR, ROWS, FILL, TASK, OWN, SHARED]
    other = {
        name for name in kernels
        if digest(before / f"{name}.py", before / "wbc") != digest(after / f"{name}.py", after / "wbc")
    }  # fmt: skip
    of_users = {OWN, SHARED}
    takes_in = {
        FILL: {FILL, *of_users}, ROWS: {ROWS, FILL, TASK, *of_users}, TASK: {TASK, *of_users}, OWN: of_users,
        SHARED: of_users, "mine/other": set[str](),
    }  # fmt: skip
    assert other == takes_in.get(changed, set(kernels))


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is compiled then")
def test_machine_code_of_a_user_is_kept_until_what_it_is_made_of_changes(tmp_path: Path):
    (tmp_path / "of_a_user").mkdir()
    shared, own = tmp_path / "of_a_user/shared.py", tmp_path / "of_a_user/own.py"
    own.write_text(
        "from wbc.compiled import callee\nfrom wbc.stack.compiled.row_kernel import rows\nfrom .shared import GAIN\n\n"
        "@callee\ndef own(at: int) -> int:\n    k = rows(at)\n    k.e[0] = GAIN * k.numbers[0]\n    return 1\n"
    )
    script = """if True:
        import numpy as np
        import wbc
        from wbc.stack.compiled.row_memory import called, kernel_of
        from wbc.stack.kernel_rows import KernelRows
        robot = wbc.load("arm")
        said = KernelRows("of_a_user.own:own", numbers=[3.0], constant=np.zeros((1, robot.nv)))
        print(called(said, 1, robot.state()).e[0], bool(kernel_of(said.kernel)._made.cache_hits))
    """
    paths = os.pathsep.join([str(tmp_path), str(ROOT)])
    environment = {**os.environ, "PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1"}
    said = []
    for gain in (2.0, 2.0, 5.0):
        shared.write_text(f"GAIN = {gain}\n")
        run = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, text=True)
        said.append(run.stdout.split() or run.stderr)
    assert said == [["6.0", "False"], ["6.0", "True"], ["15.0", "False"]]


@pytest.mark.parametrize("kind", ["UserProvidedCacheLocator", "InTreeCacheLocator", "UserWideCacheLocator"])
def test_wherever_machine_code_is_kept_it_is_of_the_sources_as_they_are(monkeypatch, tmp_path: Path, kind: str):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    kinds: Any = caching._SourceFileBackedLocatorMixin.__subclasses__()
    (locator,) = (one for one in kinds if one.__name__.lstrip("_") == kind)
    kernel, other = (locator(f, f.__code__.co_filename) for f in (linear.factor.py_func, modules_after))
    assert kernel.get_source_stamp()[-1] == digest(Path(linear.__file__))
    assert other.get_source_stamp() == caching._SourceFileBackedLocatorMixin.get_source_stamp(other)


def test_machine_code_of_other_types_or_of_a_version_before_is_not_taken(monkeypatch: Any, tmp_path: Path) -> None:
    """As where a disk fills up, or another process writes, between the index and what it speaks of."""

    def kept(version: bytes) -> Any:
        locator = caching.InTreeCacheLocator(linear.factor.py_func, linear.__file__)
        monkeypatch.setattr(compiled, "digest", lambda _: version)
        return caching.IndexDataCacheFile(str(tmp_path), "factor", locator.get_source_stamp())

    def full(*_: object) -> None:
        raise OSError("No space left on device")

    kept(b"old").save("floats", "machine code")
    assert kept(b"old").load("floats") == "machine code"
    monkeypatch.setattr(caching.IndexDataCacheFile, "_save_data", full)
    for version, types in ((b"new", "floats"), (b"old", "integers")):
        with pytest.raises(OSError):
            kept(version).save(types, "other machine code")
        assert kept(version).load(types) is None


def imported(folder: Path, most: int | None = None) -> dict[str, int]:
    """Sizes of the files of a kernel that a process keeps there, where no file may be larger than ``most`` bytes."""
    quota = "" if most is None else f"import resource\nresource.setrlimit(resource.RLIMIT_FSIZE, ({most}, {most}))\n"
    code, where = f"{quota}import wbc.control.compiled.measured_kernel", {**os.environ, "NUMBA_CACHE_DIR": str(folder)}
    subprocess.run([sys.executable, "-B", "-c", code], check=True, env=where)
    return {path.name: path.stat().st_size for path in folder.rglob("*.nb?")}


@pytest.mark.skipif(numba.config.DISABLE_JIT, reason="nothing is kept then")
def test_what_cannot_be_kept_or_read_is_compiled(tmp_path: Path) -> None:
    """A quota of 2 kB leaves room for the index of a kernel and none for its machine code."""
    assert {name[-3:] for name in imported(tmp_path, 2048)} == {"nbi"}
    assert not imported(tmp_path / "other", 0)
    whole = imported(tmp_path)
    for path in tmp_path.rglob("*.nb?"):
        os.truncate(path, path.stat().st_size // 2)
    anew = imported(tmp_path)
    assert anew.keys() == whole.keys() and all(anew[name] > size // 2 for name, size in whole.items())


def test_kernels_take_in_nothing_that_their_machine_code_is_not_compared_with():
    """Names in functions of kernels come from files of kernels, or from those that all of them are compared with."""
    seen = ("wbc.compiled", "wbc.tolerances", "wbc.stack.kernel_rows", "wbc.types")  # types are in no machine code
    for path in (path for package in ("wbc", "tasks") for path in (ROOT / package).rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        kernels = [
            node for node in tree.body if isinstance(node, ast.FunctionDef)
            and {getattr(one, "id", "") for one in node.decorator_list}
            & {"kernel", "small_kernel", "entry", "part", "callee"}
        ]  # fmt: skip
        if not kernels:
            continue
        assert path.parent.name == "compiled" or path == Path(compiled.__file__)
        unseen = {
            name.asname or name.name
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom) and (node.level or (node.module or "").startswith("wbc"))
            and ".compiled." not in (node.module or "") and node.module not in seen
            for name in node.names
        }  # fmt: skip
        used = {one.id for node in kernels for line in node.body for one in ast.walk(line) if isinstance(one, ast.Name)}
        assert not used & unseen, path


def test_one_command_compiles_every_kernel_and_none_in_both_of_its_processes():
    every = {
        ".".join([name, *path.relative_to(ROOT / package).with_suffix("").parts]): path
        for package, name in {"wbc": "wbc", "tasks": "wbc.tasks"}.items()
        for path in (ROOT / package).rglob("compiled/*.py") if path.name != "__init__.py"
    }  # fmt: skip
    first, second = (every.keys() & modules_after(f"import {', '.join(modules)}") for modules in MODULES)
    assert first | second == every.keys()
    at_once = re.compile(r"^@(entry|part)$", re.MULTILINE)
    assert not [name for name in first & second if at_once.search(every[name].read_text(encoding="utf-8"))]
    rows = {name for name, path in every.items() if "\n@callee\n" in path.read_text(encoding="utf-8")}
    assert rows and rows <= {module for modules in MODULES for module in modules}, "compiled when asked for, by name"


class Numbers(NamedTuple):
    matrix: Annotated[Mat, "sizes[0], 2"]
    sizes: Annotated[Index, "1"]


@pytest.mark.parametrize("matrix", [np.zeros((2, 2), order="F"), np.zeros((2, 4))[:, ::2], np.zeros((3, 2))])
def test_numbers_that_a_kernel_would_read_otherwise_are_refused(matrix: Any):
    layout, sizes = Layout(Numbers), np.array([2])
    assert layout.arrays(sizes, matrix=np.zeros((2, 2))).sizes is sizes
    with pytest.raises(AssertionError, match=r"^matrix "):
        layout.arrays(sizes, matrix=matrix)


@pytest.mark.skipif(numba.config.DISABLE_JIT or numba.config.BOUNDSCHECK, reason="a part is then no code of its own")
def test_a_kernel_that_others_take_in_is_their_own_copy(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of copies with one name the loader keeps the first: last digits would depend on what was loaded before."""
    monkeypatch.setattr(
        compiled, "_kept", lambda make, function, **more: make(_nrt=False, **more)(function)
    )  # compiled here and now

    @part
    def solved(at: int, n: int) -> None:
        L = carray(floats(at), (n, n))
        factor(L, 0, n, 0.0)  # of any size: too large to be written into its callers
        factor(L, 0, n - 1, 0.0)

    made: Any = solved
    functions = list(made._made._library._final_module.functions)
    taken_in = [f for f in functions if f.name.startswith("_ZN3wbc") and not f.is_declaration]
    assert any("factor" in f.name for f in taken_in)
    assert all(f.linkage is Linkage.internal for f in taken_in)
