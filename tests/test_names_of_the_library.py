"""`wbc.tasks` is the library always, `tasks` where nothing else has that name, and both are the same objects."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Sequence
from importlib.metadata import entry_points
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FOREIGN = "def frame():\n    return 'a job of theirs'\n"


def output_of(script: str, folder: Path, site: Path = ROOT) -> str:
    """What a fresh interpreter in ``folder``, with the packages of ``site``, prints; a failure shows its traceback."""
    paths = os.pathsep.join([str(folder), str(site)])
    run = subprocess.run(
        [sys.executable, "-W", "error", "-c", script],
        cwd=folder, env=os.environ | {"PYTHONPATH": paths}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    return run.stdout.strip()


@pytest.fixture
def beside(tmp_path: Path) -> Path:
    """A working folder that has a module called ``tasks`` of its own."""
    (tmp_path / "tasks.py").write_text(FOREIGN)
    return tmp_path


def each(statements: Sequence[str], script: str) -> str:
    """A program that runs every statement and then ``script``, each time with nothing of ours imported before.

    What they import of others takes most of their time. It is imported once, and each runs in a fork.
    """
    return f"""if True:
        import os, sys
        import numba, numpy, pinocchio, scipy.linalg, scipy.optimize, scipy.sparse, sympy
        for statement in {list(statements)!r}:
            if os.fork() == 0:
                exec(statement + chr(10) + {script!r})
                sys.exit()
            assert os.wait()[1] == 0, statement
    """


def test_the_library_is_found_beside_a_foreign_module_of_its_short_name(beside: Path):
    statements = [
        "from wbc.tasks import Posture, Frame",
        "from wbc.tasks.posture import Posture",
        "import wbc; Posture = wbc.tasks.Posture",
        "import tasks; from wbc.tasks import Posture; assert tasks.frame() == 'a job of theirs'",
        "from wbc.tasks import Posture; import tasks; assert tasks.frame() == 'a job of theirs'",
    ]
    said = output_of(each(statements, "print(Posture.__module__)"), beside)
    assert said.split() == ["wbc.tasks.posture"] * len(statements)


def test_what_completion_shows_are_members_and_their_modules(tmp_path: Path):
    script = """if True:
        import types, wbc.tasks
        for name in (name for name in dir(wbc.tasks) if name[0] != "_"):
            value = getattr(wbc.tasks, name)
            home = value.__name__ if isinstance(value, types.ModuleType) else value.__module__
            assert home.split(".")[0] == "wbc", (name, value)
    """
    output_of(script, tmp_path)


def test_a_controller_and_the_scenarios_work_beside_a_foreign_package(tmp_path: Path):
    (tmp_path / "tasks").mkdir()
    (tmp_path / "tasks" / "__init__.py").write_text(FOREIGN)
    (tmp_path / "tasks" / "posture.py").write_text("raise ImportError('theirs')")
    script = """if True:
        import wbc, tasks
        from wbc.tasks import Posture
        robot = wbc.load("arm")
        controller = wbc.Controller(robot, wbc.Stack([Posture(robot.q0)]), level=wbc.VelocityLevel(), dt=1e-3)
        assert controller.tick(0.0, robot.q0, 0 * robot.q0).status.ok
        from wbc.tasks.scenarios import SCENARIOS
        from wbc.tasks.workloads import WORKLOADS
        assert SCENARIOS and WORKLOADS and tasks.frame()
    """
    output_of(script, tmp_path)


def test_both_names_are_the_same_objects(tmp_path: Path):
    statements = [
        "import tasks, wbc.tasks",
        "import wbc.tasks, tasks",
        "import tasks.limits.box, wbc.tasks",
        "import wbc.tasks.limits.box, tasks.scenarios.arm_reach",
        "from tasks import Posture; import tasks, wbc",
    ]
    script = """if True:
        import sys, tasks, wbc.tasks
        from tasks.scenarios.arm_reach import ArmReach
        import tasks.limits.box, tasks.workloads
        assert tasks is wbc.tasks and tasks.limits.box is wbc.tasks.limits.box
        assert tasks.workloads.WORKLOADS is wbc.tasks.workloads.WORKLOADS
        assert ArmReach is wbc.tasks.scenarios.arm_reach.ArmReach
        short = [name for name in sys.modules if name.partition(".")[0] == "tasks"]
        assert short and all(sys.modules[name] is sys.modules["wbc." + name] for name in short)
    """
    output_of(each(statements, script), tmp_path)


def test_importing_by_short_names_changes_nothing_in_the_long_ones(tmp_path: Path):
    """`tasks.feet` is a function and a file: importing the file again must not hide the function."""
    script = """if True:
        import sys, pkgutil, importlib, wbc.tasks
        for module in pkgutil.walk_packages(wbc.tasks.__path__, "wbc.tasks."):
            importlib.import_module(module.name)
        long = {name: module for name, module in sys.modules.items() if name.startswith("wbc.tasks")}
        before = {name: dict(vars(module)) for name, module in long.items()}
        for name in long:
            importlib.import_module(name.removeprefix("wbc."))
        assert all(vars(long[name]) == before[name] for name in long)
        import tasks
        assert callable(tasks.feet) and len(long) > 100
    """
    output_of(script, tmp_path)


def test_what_is_missing_is_missing_under_both_names(tmp_path: Path):
    script = """if True:
        import wbc.tasks, tasks
        for name in ("tasks.nothing", "wbc.tasks.nothing", "tasks.limits.nothing"):
            try:
                __import__(name)
            except ModuleNotFoundError as error:
                print(error.name)
    """
    assert output_of(script, tmp_path).split() == [
        "wbc.tasks.nothing", "wbc.tasks.nothing", "wbc.tasks.limits.nothing",
    ]  # fmt: skip


def test_a_member_pickles_under_the_name_that_cannot_clash(beside: Path):
    from tasks import Damping

    stored = pickle.dumps(Damping())
    assert output_of(f"import pickle; print(pickle.loads({stored!r}).__class__.__module__)", beside) == (
        "wbc.tasks.damping"
    )


def test_the_wheel_holds_both_packages_side_by_side(beside: Path, tmp_path_factory: pytest.TempPathFactory):
    """An installed wheel is two folders and nothing of the repository around them."""
    site = tmp_path_factory.mktemp("site")
    for package in ("wbc", "tasks"):
        (site / package).symlink_to(ROOT / package)
    script = (
        f"import wbc, tasks\nassert wbc.__file__.startswith({str(site)!r})\nassert tasks.frame() and wbc.tasks.Posture"
    )
    output_of(script, beside, site)


def test_entry_points_name_what_cannot_clash():
    import tomllib

    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    named = {f"{group}:{v}" for group, e in project["entry-points"].items() for v in e.values()}
    assert named
    assert all(":wbc.tasks" in name for name in named)
    assert all(point.load() for group in project["entry-points"] for point in entry_points(group=group))
