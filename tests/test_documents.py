"""What the documents show runs, and what they name exists.

The python blocks of a document run in order as one program. Documents whose first block begins with the name of a
file, ``# own_limit.py``: each block is written to its file and run as a script, and commands are run. Docstrings: their
examples run as doctests. The tutorials run in tests/test_site.py, which compares their output too.
"""

from __future__ import annotations

import doctest
import importlib
import os
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from functools import cache
from io import StringIO
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import pytest

from wbc.cli import main

ROOT = Path(__file__).parent.parent
README, DOCS = ROOT / "README.md", ROOT / "docs"
PAGES = sorted(path for path in DOCS.rglob("*.md") if "_build" not in path.parts)
DOCUMENTS = [README, ROOT / "CHANGELOG.md", ROOT / "SECURITY.md", *PAGES]
MODULES = sorted(
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    for package in ("wbc", "tasks")
    for path in (ROOT / package).rglob("*.py")
    if path.stem != "__main__"
)

FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
HEADING = re.compile(r"^#{1,6} (.+)$", re.MULTILINE)
LINK = re.compile(r"\]\(([^)\s]+)\)")
NAME = re.compile(r"`(?:import )?((?:wbc|tasks)(?:\.\w+)+)[`(]")
PLACE = re.compile(r"`{1,2}((?:wbc|tasks|tests|docs)/[\w./]*)`")
PART = re.compile(r"`((?:wbc|tasks)/[\w/]+\.py)`, `(\w+)`")
FILE_NAME = re.compile(r"# (\w+\.py)\b")
TARGET = re.compile(r"^([a-z]+):", re.MULTILINE)
OPTIONS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS


class Block(NamedTuple):
    """One fenced block of a document."""

    language: str
    text: str
    line: int


def blocks(text: str, language: str | None = None) -> list[Block]:
    """The fenced blocks of a text, in order."""
    found = [Block(m[1], m[2], text.count("\n", 0, m.start()) + 2) for m in FENCE.finditer(text)]
    return [block for block in found if language in (None, block.language)]


def shows_files(document: Path) -> bool:
    """Whether the Python blocks of a document are files with names of their own."""
    programs = blocks(document.read_text(), "python")
    return bool(programs and FILE_NAME.match(programs[0].text))


FILES = [document for document in DOCUMENTS if shows_files(document)]
PROGRAMS = [document for document in DOCUMENTS if document not in FILES and document.parent.name != "tutorials"]


def commands(text: str) -> Iterator[list[str]]:
    """The words of each command of the ``sh`` blocks, comments left out."""
    for block in blocks(text, "sh"):
        for line in block.text.splitlines():
            if words := line.split("#")[0].split():
                yield words


def anchors(text: str) -> set[str]:
    """The addresses of a document's headings, as code hosts form them."""
    titles = HEADING.findall(FENCE.sub("", text))
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def resolve(name: str) -> Any:
    """The object a dotted name stands for.

    Raises:
        AttributeError: there is none.
    """
    parts = name.split(".")
    found: Any = importlib.import_module(parts[0])
    for i, part in enumerate(parts[1:], start=2):
        if not hasattr(found, part):
            try:
                importlib.import_module(".".join(parts[:i]))
            except ModuleNotFoundError:
                raise AttributeError(name) from None
        found = getattr(found, part)
    return found


def run(words: list[str], folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a command of the environment the tests run in."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    return subprocess.run(words, cwd=folder, env={**os.environ, "PATH": path}, capture_output=True, text=True)


@pytest.mark.parametrize("document", PROGRAMS, ids=lambda path: path.name)
def test_the_blocks_of_a_document_run_as_one_program(document: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    program = ModuleType(f"shown_in_{document.stem}")
    monkeypatch.setitem(sys.modules, program.__name__, program)  # dataclasses look there
    for block in blocks(document.read_text(), "python"):
        # Padded, so that a failure names the line of the document.
        exec(compile("\n" * (block.line - 1) + block.text, str(document), "exec"), vars(program))


def test_readme_concepts_and_guides_show_programs():
    shown = [README, DOCS / "start.md", *(DOCS / "concepts").glob("*.md")]
    assert all(blocks(document.read_text(), "python") for document in shown) and len(shown) > 8
    assert len(FILES) >= 8
    assert len(README.read_text().splitlines()) <= 150


@pytest.mark.slow
@pytest.mark.parametrize("document", FILES, ids=lambda path: path.name)
def test_the_files_of_a_document_run(document: Path, tmp_path: Path):
    for block in blocks(document.read_text()):
        if block.language == "python":
            name = FILE_NAME.match(block.text)
            assert name, f"a file begins with its name, not with {block.text.splitlines()[0]!r}"
            (tmp_path / name[1]).write_text(block.text)
            result = run(["python", "-W", "error", name[1]], tmp_path)
            assert result.returncode == 0, result.stderr
        for words in commands(f"```sh\n{block.text}```\n" if block.language == "sh" else ""):
            result = run(words, tmp_path)
            assert result.returncode == 0, f"{' '.join(words)}\n{result.stdout}{result.stderr}"


@pytest.mark.parametrize("module", MODULES)
def test_the_examples_of_docstrings_run(module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    said: list[str] = []
    runner = doctest.DocTestRunner(optionflags=OPTIONS)
    for example in doctest.DocTestFinder(exclude_empty=True).find(importlib.import_module(module)):
        runner.run(example, out=said.append)
    assert runner.failures == 0, "".join(said)


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_links_between_documents_lead_somewhere(document: Path):
    for link in LINK.findall(FENCE.sub("", document.read_text())):
        if link.startswith(("https://", "http://")):
            continue
        place, _, anchor = link.partition("#")
        target = document.parent / place if place else document
        assert target.exists(), f"{document.name} links to {link}"
        assert not anchor or anchor in anchors(target.read_text()), f"{document.name} links to {link}"


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_names_in_documents_exist(document: Path):
    groups = set(tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"])
    text = FENCE.sub("", document.read_text())
    for name in set(NAME.findall(text)) - groups:
        resolve(name)
    assert [place for place in PLACE.findall(text) if not (ROOT / place).exists()] == []
    for place, name in PART.findall(text):
        assert re.search(rf"\b(?:def|class) {name}\b", (ROOT / place).read_text()), f"{place} has no {name}"


def test_docstrings_name_files_that_exist():
    sources = (path for package in ("wbc", "tasks") for path in (ROOT / package).rglob("*.py"))
    named = {(path.name, place) for path in sources for place in PLACE.findall(path.read_text())}
    assert [(name, place) for name, place in named if not (ROOT / place).exists()] == []


@cache
def help_of(*verbs: str) -> str:
    """What a command of ours says of itself; nothing where there is no such command."""
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(StringIO()) as said, redirect_stderr(StringIO()):
        patch.setattr(sys, "argv", ["wbc", *verbs, "--help"])
        with pytest.raises(SystemExit) as end:
            main()
    return "" if end.value.code else said.getvalue()


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_commands_in_documents_exist(document: Path):
    targets = set(TARGET.findall((ROOT / "Makefile").read_text()))
    for words in commands(document.read_text()):
        if words[0] == "make":
            assert [w for w in words[1:] if "=" not in w and w not in targets] == []
        elif words[0] == "wbc":
            options = [w.partition("=")[0] for w in words if w.startswith("--")]
            verbs = words[1:3] if words[1] in ("report", "derive") else words[1:2]
            said = help_of(*verbs)
            assert said, f"{document.name}: {' '.join(words)}"
            assert [option for option in options if option not in said] == []
        else:
            assert words[0] in ("git", "cd", "pip", "python3", "source"), f"{document.name}: {' '.join(words)}"


def test_what_is_not_there_is_found():
    text = (
        "# A `b`\n[x](README.md#a-b) `wbc.Nothing` and `wbc.types.Status` `wbc.load(...)`\n```sh\nmake run # now\n```\n"
    )
    assert anchors(text) == {"a-b"}
    assert LINK.findall(text) == ["README.md#a-b"]
    assert NAME.findall(text) == ["wbc.Nothing", "wbc.types.Status", "wbc.load"]
    assert list(commands(text)) == [["make", "run"]]
    assert resolve("wbc.types.Status.SOLVED").ok
    with pytest.raises(AttributeError):
        resolve("wbc.types.Nothing")
    assert "--set" in help_of("run") and not help_of("runn")
