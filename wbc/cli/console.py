"""What all verbs share: one sentence for bad input, a progress bar, notes for warnings, tables."""

from __future__ import annotations

import ctypes
import functools
import os
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from time import monotonic
from typing import ParamSpec, TypeVar

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn
from rich.table import Table
from rich.text import Text

from wbc.errors import InvalidInput, SimulationError, WbcError
from wbc.sim.scenario import Progress as Report

NO, BAD_INPUT, INTERRUPTED = 1, 2, 130

#: How often long work says how far it is where there is no terminal to draw a bar on [s].
SECONDS_PER_LINE = 10.0

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
def whole_file(path: Path | None) -> Iterator[Callable[[str], None]]:
    """A function that writes a text file, whole or not at all. The place is tried before any work is done.

    Raises:
        InvalidInput: the file cannot be written there.
    """
    if path is None:
        yield lambda text: None
        return
    target = path.resolve()
    try:
        handle, aside = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}-")
    except OSError as cause:
        raise InvalidInput(f"{path} cannot be written: {cause.strerror}") from cause

    def write(text: str) -> None:
        Path(aside).write_text(text, encoding="utf-8")
        Path(aside).chmod(0o644)  # mkstemp makes files that nobody else may read
        os.replace(aside, target)

    try:
        os.close(handle)
        yield write
    finally:
        Path(aside).unlink(missing_ok=True)


@contextmanager
def progress(text: str) -> Iterator[Report]:
    """A bar on stderr where that is a terminal, else a line every ten seconds. Nothing is drawn between reports, so
    that drawing never disturbs a timing."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    with Progress(
        *columns, console=console, transient=True, auto_refresh=False, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task(text, total=1.0)
        spoken = monotonic()

        def report(done: float, text: str = text) -> None:
            nonlocal spoken
            bar.update(task, completed=done, description=text, refresh=True)
            if not console.is_terminal and monotonic() - spoken > SECONDS_PER_LINE:
                spoken = monotonic()
                print(f"wbc: {text}, {100 * done:.0f} %", file=sys.stderr, flush=True)

        yield report


@contextmanager
def on_stderr() -> Iterator[None]:
    """Whatever is printed meanwhile, by libraries in C too, goes to stderr: stdout is for the answer alone."""
    sys.stdout.flush()
    try:
        kept = os.dup(1)
    except OSError:  # closed: nothing can be printed there
        yield
        return
    try:
        os.dup2(2, 1)
        with redirect_stdout(sys.stderr):
            yield
    finally:
        ctypes.CDLL(None).fflush(None)  # what C has not written yet
        os.dup2(kept, 1)
        os.close(kept)


@contextmanager
def notes() -> Iterator[list[str]]:
    """Collects what libraries warn about, each sentence once, for the end of a verb that went well."""
    found: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("default")
        yield found
    found += dict.fromkeys(" ".join(str(warning.message).split()) for warning in caught)


def tell(found: list[str]) -> None:
    """Notes on stderr, one a line."""
    for note in found:
        print(f"note: {note}", file=sys.stderr)


def table(title: str, *columns: str) -> Table:
    """A plain table with a title."""
    made = Table(title=Text(title, style="bold"), title_justify="left", box=None, pad_edge=False)
    for column in columns:
        made.add_column(column, overflow="fold")
    return made
