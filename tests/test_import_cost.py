"""`import wbc` stays light: what is heavy is imported where it is used."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
SOLVERS = {"clarabel", "daqp", "highspy", "osqp", "piqp", "proxsuite", "qpsolvers", "quadprog", "scs"}
TOOLS = {"dask", "distributed", "jinja2", "matplotlib", "mujoco", "numba", "rich", "sympy", "typer"}
ROBOTS = {"example_robot_data", "pinocchio"}


def modules_after(statement: str) -> set[str]:
    """Names of the modules that a fresh interpreter has loaded after one statement."""
    script = f"import sys\n{statement}\nprint(*sorted(sys.modules))"
    return set(
        subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True).stdout.split()
    )


@pytest.mark.parametrize("statement", ["import wbc", "import tasks", "import wbc; wbc.solvers()"])
def test_imports_load_no_solver_and_no_tool(statement: str):
    assert modules_after(statement) & (SOLVERS | TOOLS) == set()


def test_import_wbc_loads_no_robot_library():
    assert modules_after("import wbc") & ROBOTS == set()


def test_who_ranks_nothing_waits_for_no_kernel_of_levels():
    found = modules_after("import wbc.control.controller, wbc.stack.hierarchy")
    assert "wbc.qp.rows.compiled.linear" in found
    assert not [name for name in found if name.startswith("wbc.qp.lexicographic.compiled")]


def test_a_heavy_import_would_be_seen():
    assert "rich" in modules_after("import wbc, rich")


@pytest.mark.parametrize("package", sorted({path.parent.name for path in ROOT.glob("wbc/*/__init__.py")} - {"cli"}))
def test_import_wbc_is_enough_for_every_package(package: str):
    subprocess.run([sys.executable, "-c", f"import wbc; wbc.{package}"], cwd=ROOT, check=True)
