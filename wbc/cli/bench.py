"""``wbc bench``: time the registered workloads. What a workload is belongs to whoever registers it."""

from __future__ import annotations

import json
import os
import tempfile
from importlib.metadata import entry_points
from pathlib import Path
from typing import Annotated, Any, Protocol

import typer
from rich.console import Console
from rich.text import Text

from wbc.cli.console import notes, one_sentence, progress, tell
from wbc.errors import InvalidInput, UnknownName

GROUP = "wbc.workloads"


class Workload(Protocol):
    """A closed loop that is timed tick by tick; ``progress(done, total)`` is called now and then."""

    title: str

    def __call__(self, *, ticks: int | None, repeats: int, progress: Any, solver: str, fast: bool) -> dict[str, Any]:
        """Run it; one row of figures that json can write."""


class UnknownWorkload(UnknownName):
    """No such workload."""

    kind = "workload"


@one_sentence
def bench(
    names: Annotated[list[str] | None, typer.Argument(metavar="[WORKLOAD]...", help="Default: all of them.")] = None,
    solver: Annotated[str, typer.Option(help="QP solver.")] = "pdas",
    *,
    ticks: Annotated[int | None, typer.Option(min=1, help="Ticks of a run; default: the workload's own.")] = None,
    repeats: Annotated[int, typer.Option(min=1, help="Runs; the least time of each tick counts.")] = 5,
    fast: Annotated[bool, typer.Option("--fast", help="Compiled ticks (extra fast).")] = False,
    json_file: Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Write the rows there.")] = None,
) -> None:
    """Time whole ticks of the controller on the registered workloads."""
    known = workloads()
    chosen = names or list(known)
    for name in chosen:
        if name not in known:
            raise UnknownWorkload(name, known)
    if json_file is not None and not json_file.resolve().parent.is_dir():
        raise InvalidInput(f"{json_file} cannot be written: there is no folder {json_file.resolve().parent}")
    rows = []
    with notes() as found, progress("timing") as step:
        for i, name in enumerate(chosen):

            def one(done: int, total: int, i: int = i, name: str = name) -> None:
                step((i + done / total) / len(chosen), f"timing {name}")

            rows.append(known[name](ticks=ticks, repeats=repeats, progress=one, solver=solver, fast=fast))
    if json_file is not None:
        _write(rows, json_file)
    tell(found)
    _print(rows)


def workloads() -> dict[str, Workload]:
    """Every registered workload by name.

    Raises:
        InvalidInput: an entry point that cannot be loaded.
    """
    found: dict[str, Workload] = {}
    for point in entry_points(group=GROUP):
        try:
            found |= point.load()
        except Exception as cause:
            raise InvalidInput(f"the workloads of {point.value} cannot be loaded: {cause}") from cause
    return found


def _write(rows: list[dict[str, Any]], path: Path) -> None:
    """All rows or none: written aside, then renamed."""
    handle, aside = tempfile.mkstemp(dir=path.resolve().parent, prefix=f".{path.name}-")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write("[\n" + ",\n".join(json.dumps(row) for row in rows) + "\n]\n")
        os.chmod(aside, 0o644)  # mkstemp makes files that nobody else may read
        os.replace(aside, path)
    finally:
        Path(aside).unlink(missing_ok=True)


def _print(rows: list[dict[str, Any]]) -> None:
    from wbc.cli.list_ import table

    made = table("Time of one tick [µs]", "workload", "how", "median", "p99", "max", "failures")
    for row in rows:
        times = row["total_us"]
        made.add_row(
            row["workload"], Text(row["variant"]), f"{times['median']:.1f}", f"{times['p99']:.1f}",
            f"{times['max']:.1f}", str(row["solver_failures"]),
        )  # fmt: skip
    Console(highlight=False).print(made)
