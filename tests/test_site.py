"""The documentation builds as a site: every page, link and heading without a warning, every tutorial as it says."""

from __future__ import annotations

import importlib
import inspect
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
ASKED = re.compile(r"""<(?:script|link|img)[^>]*(?:src|href)=["'](?:https?:)?//""")


sys.path.insert(0, str(ROOT / "docs"))
lessons = importlib.import_module("lessons")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    for package in ("sphinx", "furo", "latex2mathml", "myst_parser", "mujoco", "matplotlib"):
        pytest.importorskip(package, reason='the site needs the extra "docs"')
    copy = tmp_path_factory.mktemp("clone")
    for name in ("docs", "wbc", "tasks"):
        (copy / name).symlink_to(ROOT / name)
    (copy / "docs").unlink()
    shutil.copytree(ROOT / "docs", copy / "docs", ignore=shutil.ignore_patterns("_build"))
    for path in ROOT.glob("*.md"):
        shutil.copy(path, copy)
    done = subprocess.run([sys.executable, "docs/build.py"], cwd=copy, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return copy / "docs" / "_build" / "html"


@pytest.mark.slow
def test_every_page_of_the_documents_is_in_the_menu(site: Path) -> None:
    menu = (site / "index.html").read_text(encoding="utf-8")
    pages = {path.relative_to(ROOT / "docs") for path in (ROOT / "docs").rglob("*.md") if "_build" not in path.parts}
    for page in pages - {Path("index.md")}:
        assert f'href="{page.with_suffix(".html")}"' in menu
    assert 'href="changes.html"' in menu and len(pages) > 30


def test_every_member_of_the_library_has_a_page_with_an_example(site: Path) -> None:
    listed = re.findall(r"^\| `(\w+)` \|", (ROOT / "docs" / "library.md").read_text(encoding="utf-8"), re.MULTILINE)
    for name in listed:
        page = (site / "reference" / f"{name}.html").read_text(encoding="utf-8")
        assert "highlight-pycon" in page, name
    assert len(listed) > 50


def test_the_page_of_a_member_explains_settings_that_it_inherits() -> None:
    reference = importlib.import_module("reference")
    pages, _ = reference.pages()
    for members in reference.members().values():
        for name, member in members:
            page = pages[f"reference/{name}.md"]
            assert re.search(r"derived from \| \[`\w+`\]\(wbc\.md#\w+\)", page), name
            for argument in inspect.signature(member).parameters:
                setting = getattr(member, argument, None)
                if isinstance(setting, property) and setting.fset is not None:
                    assert re.search(rf"^\* `{argument}`: .{{9,}}", page, re.MULTILINE), f"{name}: {argument}"
    assert "* `kd`: Gain on the error's rate" in pages["reference/Position.md"]


def test_the_pages_ask_no_server(site: Path) -> None:
    for page in site.rglob("*.html"):
        assert not ASKED.search(page.read_text(encoding="utf-8")), page.name
    assert ASKED.search('<script src="https://there.org/x.js">')


def test_every_picture_of_a_tutorial_is_shown_and_small() -> None:
    shown = {name for page in lessons.pages() for name in lessons.PICTURE.findall(page.read_text(encoding="utf-8"))}
    assert shown == {path.name for path in lessons.PICTURES.iterdir()} and len(lessons.pages()) >= 6
    assert max(path.stat().st_size for path in lessons.PICTURES.iterdir()) < 100_000


def test_an_entry_of_the_gallery_has_a_poster_and_its_own_command() -> None:
    gallery = importlib.import_module("gallery")
    entries = list(gallery.entries())
    names = [entry.name for entry in entries]
    assert len(set(names)) == len(names) >= 12
    assert {path.stem for path in gallery.POSTERS.iterdir()} == set(names)
    assert sum(path.stat().st_size for path in gallery.POSTERS.iterdir()) < 500_000
    for entry in entries:
        assert f"runs/{entry.name}" in entry.commands[0] and f"{entry.name}.webp" in entry.commands[1]


@pytest.mark.parametrize(
    ("old", "new", "same"),
    [
        ("4.6 mm off", "4.7 mm off", True),
        ("4.6 mm off", "5.2 mm off", False),
        ("0.00 N m", "0.01 N m", True),
        ("0.00 N m", "0.02 N m", False),
        ("median 12 µs", "median 90 µs", True),
        ("43 of 50 certified", "20 of 50 certified", False),
        ("stands 1.2 N", "falls 1.2 N", False),
        ("drift is -1.03439", "drift is 1.03439", False),
        ("one\n", "one\ntwo\n", False),
        ("joint2 moves", "joint3 moves", False),
    ],
)
def test_outputs_of_tutorials_are_compared_by_words_and_numbers(old: str, new: str, same: bool) -> None:
    assert (not list(lessons.differences(old, new))) is same


def test_a_tutorial_that_says_something_else_is_refused(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    for said, right in (("2\n", True), ("3\n", False)):
        page.write_text(f"```python\nprint(1 + 1)\n```\n\n```text\n{said}```\n", encoding="utf-8")
        if right:
            assert lessons.check(page, tmp_path) == page.read_text(encoding="utf-8")
        else:
            with pytest.raises(lessons.Changed, match="'2' instead of '3'"):
                lessons.check(page, tmp_path)
