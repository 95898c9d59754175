"""Make the moving pictures and reports of the gallery: ``python docs/gallery.py``, or ``make gallery``.

The commands are those of docs/gallery.md, run in docs/_build/gallery; what is there already is kept. ``--posters`` also
writes the still pictures of docs/figures/gallery, which are in git.
"""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from time import perf_counter
from typing import NamedTuple

DOCS = Path(__file__).resolve().parent
MADE = DOCS / "_build" / "gallery"
POSTERS = DOCS / "figures" / "gallery"
#: A poster shows the picture this far through the movie.
POSTER = 0.45
BLOCK = re.compile(r"^```sh\n(.*?)^```$", re.DOTALL | re.MULTILINE)


class Entry(NamedTuple):
    """A run of a scenario and its commands, without ``wbc``."""

    name: str
    commands: list[list[str]]

    @property
    def picture(self) -> Path:
        return MADE / f"{self.name}.webp"

    @property
    def report(self) -> Path:
        return MADE / "runs" / self.name / "report.html"

    @property
    def made(self) -> bool:
        """Whether its picture and its report are there."""
        return self.picture.is_file() and self.report.is_file()

    @property
    def page(self) -> str:
        """The name of its report in the site."""
        return f"report-{self.name}.html"

    def linked(self, text: str) -> str:
        """The page of the gallery with a link to the report below the picture of this entry."""
        picture = f"(figures/gallery/{self.name}.webp)\n"
        return text.replace(picture, f'{picture}\n<a href="{self.page}">The live report of this run</a>\n')


def entries() -> Iterator[Entry]:
    """The entries of docs/gallery.md, from their blocks of commands."""
    for block in BLOCK.findall((DOCS / "gallery.md").read_text(encoding="utf-8")):
        commands = [line.split()[1:] for line in block.splitlines()]
        yield Entry(commands[0][1], commands)


def make(entry: Entry) -> None:
    """Run the commands of an entry.

    Raises:
        subprocess.CalledProcessError: a command failed, or a demand of the scenario was not met.
    """
    start = perf_counter()
    for command in entry.commands:
        subprocess.run([sys.executable, "-m", "wbc", *command], cwd=MADE, check=True, stdout=subprocess.DEVNULL)
    size = sum(path.stat().st_size for path in (entry.picture, entry.report)) / 1e6
    print(f"{entry.name}: {perf_counter() - start:.0f} s, {size:.1f} MB", flush=True)


def poster(entry: Entry) -> None:
    """Write one picture of a movie into docs/figures/gallery."""
    from PIL import Image  # only here: the site needs none

    with Image.open(entry.picture) as movie:
        movie.seek(round(POSTER * (getattr(movie, "n_frames", 1) - 1)))
        movie.convert("RGB").save(POSTERS / entry.picture.name, quality=70, method=6)


def main() -> None:
    """Make what is missing."""
    MADE.mkdir(parents=True, exist_ok=True)
    POSTERS.mkdir(parents=True, exist_ok=True)
    for entry in entries():
        if not entry.made:
            make(entry)
        if "--posters" in sys.argv:
            poster(entry)


if __name__ == "__main__":
    main()
