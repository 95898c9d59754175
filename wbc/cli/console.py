"""What all verbs share: one sentence for bad input, a progress bar, notes for warnings."""

from __future__ import annotations

import functools
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import ParamSpec, TypeVar

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from wbc.errors import SimulationError, WbcError
from wbc.sim.scenario import Progress as Report

NO, BAD_INPUT, INTERRUPTED = 1, 2, 130

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
def progress(text: str) -> Iterator[Report]:
    """A bar on stderr where that is a terminal. It is drawn only when work reports, so it never disturbs a timing."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeElapsedColumn())
    with Progress(
        *columns, console=console, transient=True, auto_refresh=False, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task(text, total=1.0)

        def report(done: float, text: str = text) -> None:
            bar.update(task, completed=done, description=text, refresh=True)

        yield report


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
