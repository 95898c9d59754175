"""``wbc report index``: the runs of a folder in one table."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from wbc.cli.console import one_sentence, reported
from wbc.cli.options import Show


@one_sentence
def index(
    folder: Annotated[Path, typer.Argument(help="Where the folders of the runs are.")] = Path("runs"),
    *,
    show: Show = False,
) -> None:
    """The runs of a folder in one table that sorts: verdicts, settings that differ, links to their pages."""
    from wbc.report import save_index

    reported(save_index(folder), show=show)
