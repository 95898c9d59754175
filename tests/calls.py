"""Which test calls which function of ours, found by running every test file once and kept on disk."""

from __future__ import annotations

import json
import os
import re
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from hashlib import sha256
from multiprocessing import get_context
from multiprocessing.context import ForkServerContext
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import pytest
from hypothesis import settings

CACHE = ".pytest_cache/calls"
EXAMPLES = 5  # of every property: which functions it calls is soon known
HUNG = 900.0  # seconds of one test file that waits without computing
FIRST = ("qp", "stack", "control", "methods", "tasks")  # folders of tests near to what is changed
OPTIONS = ("-q", "-p", "no:cacheprovider", "-W", "ignore::pytest.PytestAssertRewriteWarning")


def forked() -> ForkServerContext:
    """Processes that have imported what every test file imports of others, and nothing of ours."""
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(variable, "1")
    context = get_context("forkserver")
    context.set_forkserver_preload(["numpy", "scipy.optimize", "pinocchio", "hypothesis", "pytest"])
    return context


def name_of(code: CodeType, root: str) -> str | None:
    """File and qualified name of a function, without what Python puts in for nested ones; ``None``: not ours."""
    file = os.path.relpath(code.co_filename, root) if os.path.isabs(code.co_filename) else code.co_filename
    if not file.startswith(("wbc/", "tasks/")):
        return None
    return f"{file}:{'.'.join(part for part in code.co_qualname.split('.') if not part.startswith('<'))}"


class Recorder:
    """A pytest plugin: notes the functions that each test calls, and those that setting up calls for all of a file."""

    def __init__(self, root: str, limit: float) -> None:
        self.tests: dict[str, tuple[float, list[str]]] = {}
        self.left = limit
        self.shared: set[str] = set()
        self._root = root
        self._now = self.shared
        self._names: dict[int, str | None] = {}
        self._kept: list[CodeType] = []

    def trace(self, frame: FrameType, event: str, argument: object) -> None:
        """For ``sys.settrace``: a function is called."""
        code = frame.f_code
        key = id(code)
        if key not in self._names:
            self._kept.append(code)  # so that its id stays its own
            self._names[key] = name_of(code, self._root)
        name = self._names[key]
        if name is not None:
            self._now.add(name)

    def pytest_sessionstart(self) -> None:
        """Draw a few examples only."""
        settings.register_profile("calls", parent=settings(), max_examples=EXAMPLES)
        settings.load_profile("calls")

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Iterator[None]:
        """Note what the body of a test calls, and for how long it runs, if it passes and there is time left."""
        if self.left < 0.0:
            pytest.skip("the first tests of this file took too long")
        called: set[str] = set()
        self._now, start = called, time.process_time()
        sys.settrace(self.trace)
        threading.settrace(self.trace)
        try:
            yield
            self.tests[item.nodeid] = time.process_time() - start, sorted(called)
        finally:
            self._now, self.left = self.shared, self.left - (time.process_time() - start)


@dataclass
class Chosen:
    """A pytest plugin: these tests and no others, in this order."""

    tests: list[str]

    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """Select and sort."""
        place = {test: i for i, test in enumerate(self.tests)}
        items[:] = sorted((item for item in items if item.nodeid in place), key=lambda item: place[item.nodeid])


def importers(texts: dict[str, str], files: set[str]) -> set[str]:
    """Of the files with these texts those that import from one of ``files``, also by a relative name."""
    names = [name.removesuffix(".py").split("/") for name in files]
    modules = "|".join(re.escape(".".join(parts)) for parts in [*names, *(["", *parts[-2:]] for parts in names)])
    imports = re.compile(rf"^from (?:{modules}) import ", re.MULTILINE)
    return {name for name, text in texts.items() if imports.search(text)}


def users(root: Path, file: str, function: str) -> list[str]:
    """Files of ours that use a compiled function from Python.

    These are the files that name it, as ``"wbc.tasks.compiled.limit:half_spaces"``; else those that import from its
    module, or from the compiled modules that import from it.
    """
    texts = {str(path.relative_to(root)): path.read_text(encoding="utf-8")
             for folder in ("wbc", "tasks") for path in (root / folder).rglob("*.py")}  # fmt: skip
    kernel = f'.compiled.{Path(file).stem}:{function}"'
    found = [name for name, text in texts.items() if kernel in text]
    seen, modules = {file}, {file}
    while modules and not found:
        using = importers(texts, modules) - seen
        modules = {name for name in using if "/compiled/" in name}
        found, seen = sorted(using - modules), seen | using
    return found


@dataclass
class Calls:
    """What each test file calls: its seconds before the first test, and per test its seconds and functions."""

    files: dict[str, dict[str, Any]] = field(default_factory=dict)
    root: Path = Path()

    def _callers(self, wanted: Any) -> list[tuple[float, str, list[str]]]:
        result = []
        for file, entry in self.files.items():
            names = entry["names"]
            numbers = {i for i, name in enumerate(names) if wanted(name)}
            everywhere = not numbers.isdisjoint(entry["shared"])
            tests = sorted(
                (seconds, test)
                for test, (seconds, called) in entry["tests"].items()
                if everywhere or not numbers.isdisjoint(called)
            )
            if tests:
                result.append((entry["seconds"] + sum(s for s, _ in tests), file, [test for _, test in tests]))
        return sorted(result)

    def plan(self, file: str, function: str, patience: float) -> Iterator[tuple[str, list[str], float]]:
        """Test files with the tests that call this function, the fastest first, for ``patience`` seconds at most.

        What is no function's own (a constant of a module, a default of a class) belongs to all functions around it;
        what is only called compiled belongs to the files that use it, and then to all that is called of its folder.
        """
        parts = function.split(".") if function else []
        names = [".".join(parts[:i]) for i in range(len(parts), 0, -1)]
        found: list[tuple[float, str, list[str]]] = []
        for name in names:
            found = self._callers(lambda called, own=f"{file}:{name}": called == own or called.startswith(own + "."))
            if found:
                break
        found = found or self._callers(lambda called: called.startswith(file + ":") and not called.endswith(":"))
        if not found:
            methods = re.compile(
                rf"(?:{'|'.join(map(re.escape, users(self.root, file, function)))}):(?:.*\.)?[a-z_]\w*"
            )
            found = self._callers(methods.fullmatch)  # whoever imports a file runs the bodies of its classes
            known = {test_file for _, test_file, _ in found}
            folder = self._callers(lambda called: called.startswith(os.path.dirname(file) + "/"))
            found += [entry for entry in folder if entry[1] not in known]
        for seconds, test_file, tests in found:
            patience -= seconds
            yield test_file, tests, seconds
            if patience < 0.0:
                return


def _record(root: str, file: str, target: str, limit: float) -> None:
    """In a process of its own: run one test file and write what its tests call."""
    os.chdir(root)
    sys.path[:0] = [root]
    recorder = Recorder(root, limit)
    start = time.process_time()
    with open(os.devnull, "w", encoding="utf-8") as nowhere, redirect_stdout(nowhere), redirect_stderr(nowhere):
        sys.settrace(recorder.trace)
        threading.settrace(recorder.trace)
        pytest.main([*OPTIONS, file], plugins=[recorder])
        sys.settrace(None)
    inside = sum(seconds for seconds, _ in recorder.tests.values())
    names = sorted(recorder.shared.union(*(called for _, called in recorder.tests.values())))
    number = {name: i for i, name in enumerate(names)}
    entry = {
        "hash": _hash(Path(file)), "names": names, "seconds": time.process_time() - start - inside,
        "shared": [number[name] for name in recorder.shared],
        "tests": {test: (seconds, [number[name] for name in called])
                  for test, (seconds, called) in recorder.tests.items()},
    }  # fmt: skip
    Path(target).write_text(json.dumps(entry), encoding="utf-8")


def _hash(path: Path) -> str:
    return sha256(path.read_bytes()).hexdigest()


def map_of(
    root: Path, cache: Path, *, jobs: int, limit: float = 60.0, hung: float = HUNG, tests: str = "tests"
) -> Calls:
    """The map of all test files below ``tests``; files that are new or have changed are run.

    ``limit`` is in seconds of processor time: what comes after them in a test file is left out. A file that has not
    ended after ``hung`` seconds is left out as a whole.
    """
    context = forked()
    cache.mkdir(parents=True, exist_ok=True)

    def entry(file: str) -> dict[str, Any] | None:
        kept = cache / f"{file.replace('/', '.')}.json"
        try:
            known: dict[str, Any] = json.loads(kept.read_text(encoding="utf-8"))
            if known["hash"] == _hash(root / file):
                return known
        except (OSError, ValueError):
            pass
        print(f"which functions does {file} call?", file=sys.stderr, flush=True)
        child = context.Process(target=_record, args=(str(root), file, str(kept), limit))
        child.start()
        child.join(hung)
        if child.exitcode is None:
            print(f"{file} does not end", file=sys.stderr, flush=True)
            child.kill()
            child.join()
        return json.loads(kept.read_text(encoding="utf-8")) if child.exitcode == 0 else None

    paths = sorted(
        (root / tests).rglob("test_*.py"), key=lambda path: (path.parts[len(root.parts) + 1] not in FIRST, path)
    )
    files = [str(path.relative_to(root)) for path in paths]
    with ThreadPoolExecutor(jobs) as pool:
        return Calls({file: found for file, found in zip(files, pool.map(entry, files), strict=True) if found}, root)
