"""Kept machine code is that of the sources as they are."""

from __future__ import annotations

import os
import re
from pathlib import Path

import wbc
from tests.test_import_cost import modules_after
from wbc.compile_all import MODULES
from wbc.compiled import forget_stale


def file_of_age(path: Path, seconds: int) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.touch()
    os.utime(path, (1e9 - seconds, 1e9 - seconds))
    return path


def test_machine_code_is_forgotten_where_a_kernel_that_it_may_have_taken_in_is_newer(tmp_path: Path):
    file_of_age(tmp_path / "stack/compiled/fill.py", 40)
    file_of_age(tmp_path / "qp/compiled/linear.py", 20)  # changed after what calls it was compiled
    file_of_age(tmp_path / "qp/ordinary.py", 0)
    before = file_of_age(tmp_path / "stack/compiled/__pycache__/fill.nbi", 30)
    after = file_of_age(tmp_path / "qp/compiled/__pycache__/linear.nbi", 10)
    forget_stale(tmp_path)
    assert not before.exists() and after.exists()
    file_of_age(tmp_path / "tolerances.py", 5)  # numbers that kernels take in
    forget_stale(tmp_path)
    assert not after.exists()
    forget_stale(tmp_path / "not there")


def test_kernels_of_the_library_are_looked_at_when_compiled_code_is_first_asked_for():
    folders = {path.parent for path in Path(wbc.__file__).parent.rglob("*_kernel.py")}
    assert folders and all(folder.name == "compiled" for folder in folders), "else forget_stale does not see them"


def test_one_command_compiles_every_kernel_and_none_in_both_of_its_processes():
    root = Path(wbc.__file__).parent
    kernels = (path for path in root.rglob("compiled/*.py") if path.name != "__init__.py")
    every = {".".join(path.relative_to(root.parent).with_suffix("").parts): path for path in kernels}
    first, second = (every.keys() & modules_after(f"import {', '.join(modules)}") for modules in MODULES)
    assert first | second == every.keys()
    at_once = re.compile(r"^@(entry|part)$", re.MULTILINE)
    assert not [name for name in first & second if at_once.search(every[name].read_text(encoding="utf-8"))]
    rows = {name for name, path in every.items() if "\n@callee\n" in path.read_text(encoding="utf-8")}
    assert rows and rows <= {module for modules in MODULES for module in modules}, "compiled when asked for, by name"
