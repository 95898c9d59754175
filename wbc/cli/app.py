"""The verbs put together, and what happens to arguments that make no sense."""

from __future__ import annotations

import os
import sys
import warnings
from errno import EDQUOT, ENOSPC
from io import TextIOWrapper
from traceback import print_exc
from typing import Annotated, Any

import typer

from wbc import __version__
from wbc.cli.bench import bench
from wbc.cli.compare import compare
from wbc.cli.console import BAD_INPUT, UNREAD, complain
from wbc.cli.deploy import deploy
from wbc.cli.derive import derive
from wbc.cli.doctor import doctor
from wbc.cli.explain import explain
from wbc.cli.export import export
from wbc.cli.index import index
from wbc.cli.list_ import list_
from wbc.cli.report import report
from wbc.cli.retarget import retarget
from wbc.cli.run import run
from wbc.cli.soak import soak
from wbc.cli.sweep import sweep

app = typer.Typer(
    name="wbc",
    help="Whole-body control by quadratic programming: run scenarios, compare solvers, look at what is installed.",
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",  # in "rich" mode the units in brackets would be read as styles and vanish
    context_settings={"help_option_names": ["-h", "--help"]},
)
for verb in (run, compare, list_, doctor, bench, derive, export, retarget, sweep, explain, soak, deploy):
    app.command(verb.__name__.rstrip("_"))(verb)
report.command("index")(index)
app.add_typer(report)


@app.callback(invoke_without_command=True)
def top(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version.")] = False,
) -> None:
    """Whole-body control by quadratic programming: run scenarios, time them, look at what is installed."""
    if version:
        typer.echo(__version__)
        raise typer.Exit()
    if context.invoked_subcommand is None:
        typer.echo(context.get_help())


def run_app() -> None:
    """Run the command line; what it cannot understand is one sentence on stderr, not a page of help.

    Characters that stdout cannot encode are escaped there.
    """
    # Typer brings a click of its own, or uses the installed one; the base of its public error is right in both.
    usage_error: Any = typer.BadParameter.__base__
    for number, name in ((1, "stdout"), (2, "stderr")):
        if getattr(sys, name) is None:  # closed: the next file to be opened would get its number, and what C prints
            _silence(number)
            setattr(sys, name, open(number, "w", encoding="utf-8"))
    if isinstance(sys.stdout, TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    warnings.formatwarning = lambda message, *_, **__: f"note: {' '.join(str(message).split())}\n"
    try:
        code = app(prog_name="wbc", standalone_mode=False)
        sys.stdout.flush()
    except (BrokenPipeError, SystemExit) as left:
        if not isinstance(left, BrokenPipeError) and not isinstance(left.__context__, BrokenPipeError):
            raise  # a user's own exit
        _silence(1)  # typer and rich exit with 1, which would be a verdict of no
        sys.exit(UNREAD)
    except typer.Abort:  # Ctrl-C outside of a verb
        raise KeyboardInterrupt from None
    except usage_error as error:
        complaint: Any = error
        verb = "wbc" if complaint.ctx is None else complaint.ctx.command_path
        complain(f"{complaint.format_message().rstrip('.')} (see {verb} --help)")
        sys.exit(BAD_INPUT)
    except Exception as cause:  # a bug, ours or the user's: Python's own exit code, 1, would be that of a verdict
        if isinstance(cause, OSError) and cause.errno in (ENOSPC, EDQUOT):
            _silence(1)
            complain(f"{cause.filename or 'the output'} is not whole: {cause.strerror}")
        else:
            print_exc()
        sys.exit(BAD_INPUT)
    sys.exit(code or 0)


def _silence(number: int) -> None:
    """What is written to a file descriptor is lost from here on."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), number)
