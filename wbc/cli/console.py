"""What all verbs share: one sentence for bad input, a progress bar, notes for warnings, tables."""

from __future__ import annotations

import ctypes
import functools
import os
import re
import sys
import warnings
import webbrowser
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from datetime import datetime
from functools import partial
from itertools import count
from math import ceil
from pathlib import Path
from time import monotonic
from typing import Any, ParamSpec, TypeVar

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn
from rich.table import Table
from rich.text import Text

from wbc.errors import SimulationError, WbcError
from wbc.files import written
from wbc.sim.scenario import Progress as Report

NO, BAD_INPUT, INTERRUPTED, UNREAD = 1, 2, 130, 141

#: How often long work says how far it is where there is no terminal to draw a bar on [s].
SECONDS_PER_LINE = 10.0
#: How long work must have gone on, and what share of it be done, before it says how long the rest will take [s].
SECONDS_TO_GUESS, SHARE_TO_GUESS = 2.0, 0.01

P = ParamSpec("P")
R = TypeVar("R")


def complain(sentence: str) -> None:
    """One line on stderr."""
    print(f"wbc: {' '.join(sentence.split())}", file=sys.stderr)


def one_sentence(verb: Callable[P, R]) -> Callable[P, R]:
    """A verb whose errors are one sentence on stderr and an exit code; bugs keep their traceback."""

    @functools.wraps(verb)
    def guarded(*args: P.args, **kwargs: P.kwargs) -> R:
        try:
            return verb(*args, **kwargs)
        except SimulationError as error:
            complain(str(error))
            raise typer.Exit(NO) from None
        except WbcError as error:
            complain(str(error))
            raise typer.Exit(BAD_INPUT) from None
        except KeyboardInterrupt as interrupt:
            complain(f"interrupted; {str(interrupt) or 'nothing was written'}")
            raise typer.Exit(INTERRUPTED) from None

    return guarded


@contextmanager
def kept(how_to_go_on: str) -> Iterator[None]:
    """Around work that an interrupt does not undo: the sentence about it says how to go on."""
    try:
        yield
    except KeyboardInterrupt:
        raise KeyboardInterrupt(how_to_go_on) from None


@contextmanager
def whole_file(path: Path | None) -> Iterator[Callable[[str], object]]:
    """A function that writes a text file, whole or not at all. The place is tried before any work is done.

    Raises:
        InvalidInput: the file cannot be written there.
    """
    if path is None:
        yield lambda text: None
        return
    with written(path) as aside:
        yield partial(aside.write_text, encoding="utf-8")


@contextmanager
def progress(title: str) -> Iterator[Report]:
    """One bar on stderr with the time that is left where that is a terminal, else a line every ten seconds. Nothing is
    drawn between reports, so that drawing never disturbs a timing."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn())
    with Progress(
        *columns, console=console, transient=True, auto_refresh=False, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task(title, total=1.0)
        start = spoken = monotonic()
        first: float | None = None  # what an earlier life did took no time of this one

        def report(done: float, text: str = "") -> None:
            nonlocal start, spoken, first
            now = monotonic()
            if first is None:  # neither did what came before the first report, such as compiling
                first, start = done, now
            left = (now - start) * (1.0 - done) / (done - first) if done - first >= SHARE_TO_GUESS else 0.0
            rest = f"{remaining(left)} left" if left and now - start > SECONDS_TO_GUESS else ""
            said = ", ".join(part for part in (f"{title}: {text}" if text else title, rest) if part)
            bar.update(task, completed=done, description=said, refresh=True)
            if not console.is_terminal and now - spoken > SECONDS_PER_LINE:
                spoken = now
                print(f"wbc: {said}, {100 * done:.0f} %", file=sys.stderr, flush=True)

        yield report


def remaining(seconds: float) -> str:
    """A rough time: "40 s", "3 min", "2.5 h".

    Example:
        >>> from wbc.cli.console import remaining
        >>> [remaining(x) for x in (7.3, 95.0, 8000.0)]
        ['8 s', '2 min', '2.2 h']
    """
    if seconds < 60:
        return f"{ceil(seconds)} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


@contextmanager
def on_stderr() -> Iterator[None]:
    """Whatever is printed meanwhile, by libraries in C too, goes to stderr: stdout is for the answer alone."""
    sys.stdout.flush()
    kept = os.dup(1)
    try:
        os.dup2(2, 1)
        with redirect_stdout(sys.stderr):
            yield
    finally:
        ctypes.CDLL(None).fflush(None)  # what C has not written yet
        os.dup2(kept, 1)
        os.close(kept)


@contextmanager
def notes(*, told: bool = True) -> Iterator[None]:
    """Collects what libraries warn about, each sentence once; ``told`` on stderr, one a line, if all goes well.

    Deprecations, which are for those who write the libraries, are left out.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        for kind in (DeprecationWarning, PendingDeprecationWarning):
            warnings.simplefilter("ignore", kind)
        yield
    for note in dict.fromkeys(" ".join(str(warning.message).split()) for warning in caught):
        if told:
            print(f"note: {note}", file=sys.stderr)


@contextmanager
def working(title: str) -> Iterator[Report]:
    """Long work: its progress meanwhile, and what libraries warn about behind it."""
    with notes(), progress(title) as step:
        yield step


def place(out: Path | None, name: str) -> Path:
    """The folder of results: ``out``, or a new one in ``runs`` that has the time in its name."""
    if out is not None:
        return out
    stem = f"{re.sub(r'[^A-Za-z0-9._-]+', '-', name).strip('-.') or 'run'}-{datetime.now():%Y%m%d-%H%M%S}"
    folders = (Path("runs") / (f"{stem}-{k}" if k > 1 else stem) for k in count(1))
    return next(folder for folder in folders if not folder.exists())


def table(title: str, *columns: str, numbers: bool = False) -> Table:
    """A plain table with a title. ``numbers``: no cell is ever broken into lines."""
    made = Table(title=Text(title, style="bold"), title_justify="left", box=None, pad_edge=False)
    for column in columns:
        made.add_column(column, overflow="fold", no_wrap=numbers)
    return made


def say(*things: str | Table) -> None:
    """Text and tables on stdout. In a pipe a row is a line, its cells apart by tabs, and nothing is wrapped or padded.
    In a terminal that is too narrow for a table of numbers every row is a block of lines."""
    console = Console(highlight=False)
    for thing in things:
        if isinstance(thing, str):
            console.print(Text(thing), soft_wrap=not console.is_terminal)
        elif not console.is_terminal:
            print("\n".join([_plain(thing.title), *("\t".join(row) for row in _rows(thing))]).strip("\n"))
        elif thing.columns[0].no_wrap and _width(thing) > console.width:
            heads, *rows = _rows(thing)
            console.print(thing.title)
            for row in rows:
                console.print(Text("\n  ".join([row[0], *map(": ".join, zip(heads[1:], row[1:], strict=True))])))
        else:
            console.print(thing)


def reported(page: Path, *, show: bool = False) -> None:
    """Where a report is, as an address that terminals open on a click; ``show``: opened in a browser."""
    place = page.resolve()
    line = Text("report: ").append(str(place), style=f"link {place.as_uri()}")
    Console(highlight=False).print(line, soft_wrap=True)
    if show:
        webbrowser.open(place.as_uri())


def _width(made: Table) -> int:
    return sum(2 + max(map(len, column)) for column in zip(*_rows(made), strict=True)) - 2


def _rows(made: Table) -> list[list[str]]:
    columns = [[_plain(column.header), *map(_plain, column.cells)] for column in made.columns]
    return [list(row) for row in zip(*columns, strict=True)]


def _plain(cell: Any) -> str:
    return " ".join(str(cell or "").split())
