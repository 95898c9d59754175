"""``wbc soak``: very many ticks, each command judged. What is put to soak belongs to whoever registers it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.text import Text

from wbc.cli.console import NO, notes, one_sentence, progress, say, table, whole_file
from wbc.errors import InvalidInput
from wbc.plugins import registered
from wbc.sim.scenario import member
from wbc.sim.soak import KINDS, Findings, Subject
from wbc.sim.soak import soak as soaked


@one_sentence
def soak(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[SUBJECT]...", help="Names, or module:NAME. Default: all.")
    ] = None,
    *,
    kind: Annotated[str, typer.Option(help=f"{', '.join(KINDS)}.")] = "valid",
    ticks: Annotated[int, typer.Option(min=1, help="Ticks of each subject.")] = 10_000,
    solver: Annotated[str, typer.Option(help="QP solver.")] = "pdas",
    seed: Annotated[int, typer.Option(help="Of the random numbers.")] = 0,
    json_file: Annotated[Path | None, typer.Option("--json", metavar="FILE", help="Write the rows there.")] = None,
) -> None:
    """Let controllers run for very many ticks and judge each command. Exit code 1: one was not as promised."""
    chosen = [member(name, Subject, "soak") for name in names or registered(Subject)]
    if not chosen:  # a verdict on nothing would read like a good one
        raise InvalidInput("no soak is registered: install the project (again), or name module:NAME")
    rows: list[dict[str, Any]] = []
    with whole_file(json_file) as write, notes(), progress("soaking") as step:
        for i, subject in enumerate(chosen):

            def one(done: float, i: int = i, name: str = subject.name) -> None:
                step((i + done) / len(chosen), f"soaking {name}")

            found = soaked(subject, solver=solver, ticks=ticks, kind=kind, seed=seed, progress=one)
            rows.append({"subject": subject.name, "solver": solver, "seed": seed, **_row(found)})
        write(json.dumps(rows, indent=1) + "\n")
    _print(kind, rows)
    raise typer.Exit(0 if all(row["ok"] for row in rows) else NO)


def _row(found: Findings) -> dict[str, Any]:
    return {
        "ok": found.ok, "kind": found.kind, "ticks": found.ticks, "exceptions": dict(found.exceptions),
        "not_finite": found.not_finite, "beyond": found.beyond, "worst": found.worst, "rungs": dict(found.rungs),
        "statuses": dict(found.statuses), "first_rung": found.first_rung, "uncertified": found.uncertified,
        "restarts": found.restarts, "seconds": round(found.seconds, 1), "grown_bytes": found.grown_bytes,
        "digest": found.digest,
    }  # fmt: skip


def _print(kind: str, rows: list[dict[str, Any]]) -> None:
    made = table(f"Soak: {kind}", "subject", "ticks", "solved", "raised", "not finite", "limits exceeded", "memory",
                 numbers=True)  # fmt: skip
    for row in rows:
        made.add_row(
            Text(f"{row['subject']}, {row['solver']}"),
            f"{row['ticks']:,}",
            f"{100 * row['first_rung']:.3f} %",
            *(str(count) for count in (sum(row["exceptions"].values()), row["not_finite"], row["beyond"])),
            f"{row['grown_bytes'] / 1e6:+.1f} MB",
        )
    say(made)
    for row in rows:
        lines = [f"\n{row['subject']}: ticks by where their command came from"]
        lines += [f"  {rung}: {count:,}" for rung, count in row["rungs"].items()]
        lines += ["  least room to a limit (-), or worst excess (+)"] if row["worst"] else []
        lines += [f"  {name}: {value:+.0e}" for name, value in row["worst"].items()]
        say(*lines, *(f"  {count} times {text}" for text, count in row["exceptions"].items()))
