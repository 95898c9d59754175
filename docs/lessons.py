"""Run the tutorials: ``python docs/lessons.py`` writes the output and the pictures of docs/tutorials anew.

The Python blocks of a tutorial run in order as one program, in a process and a folder of its own. A ``text`` block that
stands right after a Python block is what that block prints. A picture is a file that the program saves. ``make docs``
and the tests run the same and refuse output that differs: in words, in numbers by more than 5 %, in times not at all.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType

DOCS = Path(__file__).resolve().parent
PICTURES = DOCS / "figures" / "tutorials"
BLOCK = re.compile(r"^```python\n(?P<code>.*?)^```\n(?:\n```text\n(?P<said>.*?)^```\n)?", re.DOTALL | re.MULTILINE)
PICTURE = re.compile(r"\]\(\.\./figures/tutorials/([\w.-]+)\)")
#: A number that is no part of a name, and whether it is a time, which differs from machine to machine.
NUMBER = re.compile(r"(?<![\w.])[-+−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w.]*\w)(?P<time> µs| times)?")
#: Numbers of physics differ a little between processors: by this share, or by one in the last decimal shown.
NEAR = 0.05


class Changed(Exception):
    """A tutorial does not do what it shows."""


def pages() -> list[Path]:
    """The tutorials."""
    return sorted((DOCS / "tutorials").glob("*.md"))


def run(page: Path, text: str) -> Iterator[str]:
    """Run the blocks of ``text`` here and give what each prints."""
    program = ModuleType("lesson")
    sys.modules[program.__name__] = program  # dataclasses look there
    for found in BLOCK.finditer(text):
        line = text.count("\n", 0, found.start()) + 1
        said = io.StringIO()
        with contextlib.redirect_stdout(said):
            exec(compile("\n" * line + found["code"], str(page), "exec"), vars(program))
        yield said.getvalue()


def filled(text: str, outputs: Sequence[str]) -> str:
    """The text with these outputs below its blocks."""
    left = iter(outputs)

    def block(found: re.Match[str]) -> str:
        said = next(left)
        said = "\n".join(line.rstrip() for line in said.splitlines()) + "\n" if said.strip() else ""
        return f"```python\n{found['code']}```\n" + (f"\n```text\n{said}```\n" if said else "")

    return BLOCK.sub(block, text)


def fresh(page: Path, pictures: Path) -> str:
    """The page with its output of now; its pictures are put into ``pictures``.

    Raises:
        Changed: a block failed, or a picture that is shown was not saved.
    """
    text = page.read_text(encoding="utf-8")
    with TemporaryDirectory() as folder:
        settings = {"MPLBACKEND": "Agg", "MATPLOTLIBRC": str(DOCS / "matplotlibrc"), "PYTHONIOENCODING": "utf-8"}
        paths = os.pathsep.join([str(DOCS.parent), *filter(None, [os.environ.get("PYTHONPATH")])])
        done = subprocess.run(
            [sys.executable, __file__, "--run", str(page)], check=False, cwd=folder, capture_output=True, text=True,
            env={**os.environ, **settings, "PYTHONPATH": paths},
        )  # fmt: skip
        if done.returncode:
            raise Changed(f"{page.name}: {done.stderr}")
        for name in PICTURE.findall(text):
            if not (Path(folder) / name).is_file():
                raise Changed(f"{page.name} shows {name} and does not save it")
            shutil.copy(Path(folder) / name, pictures / name)
    return done.stdout


def differences(old: str, new: str) -> Iterator[str]:
    """The lines of ``new`` that do not say what those of ``old`` say."""
    before, after = old.splitlines(), new.splitlines()
    if len(before) != len(after):
        yield f"{len(after)} lines instead of {len(before)}"
    for a, b in zip(before, after, strict=False):
        same = " ".join(NUMBER.sub("#", a).split()) == " ".join(NUMBER.sub("#", b).split())
        if not same or not all(near(x, y) for x, y in zip(NUMBER.finditer(a), NUMBER.finditer(b), strict=True)):
            yield f"{b!r} instead of {a!r}"


def near(a: re.Match[str], b: re.Match[str]) -> bool:
    """Whether two numbers of an output say the same."""
    if a["time"]:
        return True
    x, y = (float(found[0].replace("−", "-")) for found in (a, b))
    decimals = re.search(r"\.(\d+)$", a[0])
    last = 10.0 ** -len(decimals[1]) if decimals else 0.0
    return abs(x - y) <= max(NEAR * abs(x), 1.001 * last)


def check(page: Path, pictures: Path) -> str:
    """The page with its output of now.

    Raises:
        Changed: it is another one than the page shows.
    """
    text = fresh(page, pictures)
    if found := list(differences(page.read_text(encoding="utf-8"), text)):
        raise Changed(f"{page.name}: " + "; ".join(found) + "; is it right? then run python docs/lessons.py")
    return text


if __name__ == "__main__":
    if sys.argv[1:2] == ["--run"]:
        source = Path(sys.argv[2]).read_text(encoding="utf-8")
        sys.stdout.write(filled(source, list(run(Path(sys.argv[2]), source))))
    else:
        PICTURES.mkdir(parents=True, exist_ok=True)
        for lesson in pages():
            if not sys.argv[1:] or lesson.stem in sys.argv[1:]:
                lesson.write_text(fresh(lesson, PICTURES), encoding="utf-8")
