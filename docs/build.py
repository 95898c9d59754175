"""Build the site into docs/_build/html: ``python docs/build.py``, or ``make docs``, which installs Sphinx first.

The Markdown files in git are complete pages for a code host. What the site adds is made here, once, in
docs/_build/source: a menu from the lists of ``index.md``, the tutorials as they run now, a page for each example and
scenario that is linked, the changelog, the reference, and what ``make gallery`` has left in docs/_build/gallery.
"""

from __future__ import annotations

import re
import shutil
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from os import cpu_count
from pathlib import Path

import gallery  # these three are beside this file
import lessons
import reference

DOCS = Path(__file__).resolve().parent
sys.path.insert(0, str(DOCS.parent))

BUILD = DOCS / "_build"
SOURCE, HTML = BUILD / "source", BUILD / "html"
#: Files outside docs/ that are pages of the site.
OUTSIDE = {"CHANGELOG.md": "changes.md", "SECURITY.md": "security.md"}
LINK = re.compile(r"\]\(([^)\s#]+)(#[^)\s]*)?\)")

#: Links to sources of the repository that are no pages: their text stays.
SOURCES = re.compile(r"\[([^\]\[]+)\]\((?:\.\./)+(?:wbc|tasks|tests)/[^)\s]*\)")


def pages() -> Iterator[Path]:
    """The Markdown files of docs/, by their place in it."""
    return (path.relative_to(DOCS) for path in sorted(DOCS.rglob("*.md")) if "_build" not in path.parts)


def menu(text: str) -> str:
    """The index with a hidden table of contents for each section, from the links of its list."""
    parts = re.split(r"^## (.+)$", text, flags=re.MULTILINE)
    for title, body in zip(parts[1::2], parts[2::2], strict=True):
        entries = "\n".join(place for place, _ in LINK.findall(body) if place.endswith(".md"))
        text += f"\n```{{toctree}}\n:hidden:\n:caption: {title}\n\n{entries}\n```\n"
    return text


def contents(places: list[str]) -> str:
    """A hidden table of contents, which puts pages below the page that it stands on."""
    return "\n```{toctree}\n:hidden:\n\n" + "\n".join(places) + "\n```\n"


def listing(path: Path) -> str:
    """The page of a source file: its first line, and the file."""
    text = path.read_text(encoding="utf-8")
    title, _, code = text.partition("\n")
    title = title.strip('"').rstrip(".")
    block = f"```{{code-block}} python\n:class: listing\n\n{code.strip()}\n```"  # site.css widens pages with a listing
    return f"# {title}\n\nThe file is `{path.relative_to(DOCS.parent)}`.\n\n{block}\n"


def relinked(text: str, page: Path) -> str:
    """A page whose links to files that are pages of the site lead to these pages."""
    up = "../" * (len(page.parts) - 1)

    def place(found: re.Match[str]) -> str:
        link, anchor = found[1], found[2] or ""
        for name, new in OUTSIDE.items():
            if link == f"{up}../{name}":
                return f"]({up}{new}{anchor})"
        if link.endswith(".py") and link.startswith(("examples/", "../tasks/scenarios/")):
            return f"]({link[:-3].removeprefix('../tasks/')}.md)"
        return found[0]

    return SOURCES.sub(r"\1", LINK.sub(place, text))


def inside(text: str) -> str:
    """A file of the repository as a page of the site: links to pages of docs/ stay, those to sources do not."""

    def place(found: re.Match[str]) -> str:
        link = found[2]
        if link in OUTSIDE:
            return f"[{found[1]}]({OUTSIDE[link]})"
        if link.startswith("docs/"):
            return f"[{found[1]}]({link.removeprefix('docs/')})"
        return found[0] if link.startswith("http") else found[1]

    return re.sub(r"\[([^]\[]+)\]\(([^)\s]+)\)", place, text)


def catalogue(text: str, members: list[str], modules: list[str]) -> str:
    """The page of the library with links to the pages of members, and a list of modules."""
    for page in members:
        name = Path(page).stem
        text = text.replace(f"| `{name}` |", f"| [`{name}`]({page}) |")
    rows = [f"| [`{Path(page).stem}`]({page}) | {reference.MODULES[Path(page).stem]} |" for page in modules]
    return "\n".join([text, "## Modules\n", "| | |", "| :-- | :-- |", *rows, contents([*members, *modules])])


def prepare() -> None:
    """Write the pages of the site into docs/_build/source."""
    for made_before in (SOURCE, HTML):
        shutil.rmtree(made_before, ignore_errors=True)
    for folder in ("figures", "examples"):
        shutil.copytree(DOCS / folder, SOURCE / folder)
    made = {str(page): (DOCS / page).read_text(encoding="utf-8") for page in pages()}
    for name, page in OUTSIDE.items():
        made[page] = inside((DOCS.parent / name).read_text(encoding="utf-8"))
    for path in sorted((DOCS / "examples").glob("*.py")):
        made[f"examples/{path.stem}.md"] = listing(path)
    made["examples.md"] += contents([name for name in made if name.startswith("examples/")])
    for name in re.findall(r"\.\./tasks/(scenarios/\w+)\.py", made["gallery.md"]):
        made[f"{name}.md"] = listing(DOCS.parent / "tasks" / f"{name}.py")
    made["gallery.md"] += contents([name for name in made if name.startswith("scenarios/")])
    for entry in gallery.entries():
        if entry.made:
            shutil.copy(entry.picture, SOURCE / "figures" / "gallery")
            made["gallery.md"] = entry.linked(made["gallery.md"])
    with ThreadPoolExecutor(cpu_count()) as pool:
        pictures = SOURCE / "figures" / "tutorials"
        for page, text in zip(
            lessons.pages(), pool.map(lambda p: lessons.check(p, pictures), lessons.pages()), strict=True
        ):
            made[str(page.relative_to(DOCS))] = text
    members, modules = reference.pages()
    made |= members | modules
    made["library.md"] = catalogue(made["library.md"], list(members), list(modules))
    made["index.md"] = menu(relinked(made["index.md"], Path("index.md")))
    for name, text in made.items():
        target = SOURCE / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(relinked(text, Path(name)), encoding="utf-8")


def build() -> int:
    """Prepare the pages and have Sphinx write them; a warning is an error."""
    from sphinx.cmd.build import main

    prepare()
    options = ["-q", "-W", "--keep-going", "-b", "html", "-E", "-c", str(DOCS), "-d", str(BUILD / "cache")]
    status = main([*options, str(SOURCE), str(HTML)])
    for entry in gallery.entries():
        if entry.made:
            shutil.copy(entry.report, HTML / entry.page)
    return status


if __name__ == "__main__":
    sys.exit(build())
