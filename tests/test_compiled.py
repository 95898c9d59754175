"""Kept machine code is that of the sources as they are."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numba
import numpy as np
import pytest
from llvmlite.binding import Linkage

import wbc
from tests.test_import_cost import modules_after
from wbc import compiled
from wbc.compile_all import MODULES
from wbc.compiled import Layout, carray, floats, forget_stale, part
from wbc.qp.rows.compiled.linear import factor
from wbc.types import Index, Mat


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
    monkeypatch.setattr(compiled, "_kept", lambda make, **more: make(_nrt=False, **more))  # compiled here and now

    @part
    def solved(at: int) -> None:
        L = carray(floats(at), (3, 3))
        factor(L, 0, 3, 0.0)  # too large to be written into its callers
        factor(L, 0, 2, 0.0)

    made: Any = solved
    functions = list(made._made._library._final_module.functions)
    taken_in = [f for f in functions if f.name.startswith("_ZN3wbc") and not f.is_declaration]
    assert any("factor" in f.name for f in taken_in)
    assert all(f.linkage is Linkage.internal for f in taken_in)
