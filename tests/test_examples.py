"""The examples of the documents are short and complete: each says what it is for, runs, and asserts what it shows."""

from __future__ import annotations

import ast
import re
import runpy
from pathlib import Path

import pytest

FOLDER = Path(__file__).parent.parent / "docs" / "examples"
EXAMPLES = sorted(FOLDER.glob("*.py"))
MOST_LINES = 40


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
# Robots of others have gaps that loading tells of.
@pytest.mark.filterwarnings("default::UserWarning")
def test_an_example_runs(example: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys):
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(example), run_name="__main__")
    assert capsys.readouterr().out, "it prints what it shows"


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_example_is_short_says_what_it_is_for_and_proves_it(example: Path):
    source = example.read_text(encoding="utf-8")
    tree = ast.parse(source)
    assert len(source.splitlines()) <= MOST_LINES
    assert "\n" not in (ast.get_docstring(tree, clean=False) or "\n"), "one line at the top says what it is for"
    assert any(isinstance(node, ast.Assert) for node in tree.body), "at its end it asserts what it shows"


def test_the_page_of_examples_lists_every_one_once():
    listed = re.findall(
        r"^\| \[(\w+\.py)\]\(examples/\1\) \|", (FOLDER.parent / "examples.md").read_text(), re.MULTILINE
    )
    assert sorted(listed) == [path.name for path in EXAMPLES] and len(EXAMPLES) > 10
