"""docs/library.md lists what the library has. Write it anew with ``python tests/test_library.py``."""

from __future__ import annotations

import importlib
import inspect
import re
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "docs"))
sys.path.insert(0, str(Path(__file__).parents[1]))  # when it is run as a program

from tests import test_features

ROOT = Path(__file__).parents[1]
reference = importlib.import_module("reference")
DOCUMENT = ROOT / "docs" / "library.md"
MARK = "<!-- written by tests/test_library.py -->\n"


def test_the_page_lists_what_there_is() -> None:
    text = DOCUMENT.read_text(encoding="utf-8")
    assert text.split(MARK)[1] == reference.catalogue(), "run: python tests/test_library.py"


def test_every_member_is_on_it_with_the_levels_that_it_serves() -> None:
    found = {name for members in reference.members().values() for name, _ in members}
    assert {"Frame", "TorqueLimits", "Sole", "SlotineLi"} <= found and len(found) > 50
    assert all(f"| `{name}` |" in reference.catalogue() for name in found)
    assert set(reference.levels()) <= found


def test_what_a_member_is_is_one_sentence() -> None:
    for members in reference.members().values():
        for name, value in members:
            text = reference.about(name, value)
            assert text.endswith(".") and text[0].isupper() and inspect.getdoc(value), name


def test_a_public_name_is_described_on_one_page() -> None:
    _, modules = reference.pages()
    titles = [title for page in modules.values() for title in re.findall(r"^## (\w+)$", page, re.MULTILINE)]
    assert len(titles) == len(set(titles)) > 100


def test_the_comparison_with_others_is_as_the_code_is() -> None:
    assert test_features.DOCUMENT.read_text(encoding="utf-8") == test_features.written(), "run as above"


if __name__ == "__main__":
    test_features.DOCUMENT.write_text(test_features.written(), encoding="utf-8")
    text = DOCUMENT.read_text(encoding="utf-8")
    DOCUMENT.write_text(text.split(MARK)[0] + MARK + reference.catalogue(), encoding="utf-8")
