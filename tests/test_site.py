"""The documentation builds as a site: every page, link and heading without a warning."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
ASKED = re.compile(r"""<(?:script|link|img)[^>]*(?:src|href)=["'](?:https?:)?//""")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    for package in ("sphinx", "furo", "latex2mathml", "myst_parser"):
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


def test_the_pages_ask_no_server(site: Path) -> None:
    for page in site.rglob("*.html"):
        assert not ASKED.search(page.read_text(encoding="utf-8")), page.name
    assert ASKED.search('<script src="https://there.org/x.js">')
