"""``wbc soak``: very many ticks of scenarios, each command judged."""

from __future__ import annotations

import json
from typing import Annotated, Any

import typer
from rich.text import Text

from wbc.cli.console import NO, notes, one_sentence, progress, say, table, whole_file
from wbc.cli.options import JsonFile, SolverName
from wbc.errors import InvalidInput
from wbc.sim.scenario import find, scenarios, trials
from wbc.sim.soak import KINDS, Findings
from wbc.sim.soak import soak as soaked


@one_sentence
def soak(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[SCENARIO]...", help="Default: those that are made for it.")
    ] = None,
    *,
    kind: Annotated[str, typer.Option(help=f"{', '.join(KINDS)}.")] = "valid",
    ticks: Annotated[int, typer.Option(min=1, help="Ticks of each.")] = 10_000,
    solver: SolverName = "pdas",
    seed: Annotated[int, typer.Option(help="Of the random numbers.")] = 0,
    json_file: JsonFile = None,
) -> None:
    """Let controllers run for very many ticks and judge each command. Exit code 1: one was not as promised."""
    chosen = [find(name) for name in names] if names else [*scenarios("soaks").values()]
    if not chosen:  # a verdict on nothing would read like a good one
        raise InvalidInput("no soak is registered: install the project (again), or name a scenario")
    rows: list[dict[str, Any]] = []
    with whole_file(json_file) as write, notes(told=False), progress("soaking") as step:
        for scenario, one in trials(step, chosen):
            found = soaked(scenario, solver=solver, ticks=ticks, kind=kind, seed=seed, progress=one)
            rows.append({"subject": scenario.name, "solver": solver, "seed": seed, "ok": found.ok, **_row(found)})
        write(json.dumps(rows, indent=1) + "\n")
    _print(kind, rows)
    raise typer.Exit(0 if all(row["ok"] for row in rows) else NO)


def _row(found: Findings) -> dict[str, Any]:
    return {**vars(found), "solved_share": found.solved_share, "seconds": round(found.seconds, 1)}


def _print(kind: str, rows: list[dict[str, Any]]) -> None:
    made = table(f"Soak: {kind}", "subject", "ticks", "solved", "raised", "not finite", "limits exceeded", "memory",
                 numbers=True)  # fmt: skip
    for row in rows:
        made.add_row(
            Text(f"{row['subject']}, {row['solver']}"),
            f"{row['ticks']:,}",
            f"{100 * row['solved_share']:.3f} %",
            *(str(count) for count in (sum(row["exceptions"].values()), row["not_finite"], row["beyond"])),
            f"{row['grown_bytes'] / 1e6:+.1f} MB",
        )
    say(made)
    for row in rows:
        lines = [f"\n{row['subject']}: ticks by where their command came from"]
        lines += [f"  {level}: {count:,}" for level, count in row["fallback_levels"].items()]
        lines += ["  largest excess over each limit, negative within it"] if row["worst"] else []
        lines += [f"  {name}: {value:+.2g}" for name, value in row["worst"].items()]
        say(*lines, *(f"  {count} times {text}" for text, count in row["exceptions"].items()))
