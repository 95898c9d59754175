"""``wbc bench``: time scenarios, by default those that are workloads."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial
from math import inf
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.text import Text

from wbc.cli.console import one_sentence, say, table, whole_file, working
from wbc.cli.options import JsonFile, SolverName
from wbc.cli.peers import Peers
from wbc.sim.bench import bench as timed
from wbc.sim.scenario import find, scenarios, trials

_ROUNDS = 2


@one_sentence
def bench(
    names: Annotated[list[str] | None, typer.Argument(metavar="[SCENARIO]...", help="Default: the workloads.")] = None,
    solver: SolverName = "pdas",
    *,
    ticks: Annotated[int | None, typer.Option(min=1, help="Ticks of a run; default: the scenario's own.")] = None,
    hierarchy: Annotated[
        str, typer.Option(help="weighted, strict or scaled; other libraries run weighted.")
    ] = "weighted",
    pause: Annotated[float, typer.Option(min=0.0, help="Sleep this long [s] before each tick: cold memory.")] = 0.0,
    repeats: Annotated[int, typer.Option(min=1, help="Runs; the least time of each tick counts.")] = 5,
    peers: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Run the scripts of other libraries there too.")
    ] = None,
    environments: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Where their environments are: v, and vNAME for one library.")
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """Time whole ticks of the controller on workloads, or on any scenario."""
    chosen = [find(name) for name in names] if names else [*scenarios("workloads").values()]
    found_peers = None if peers is None else Peers(peers, environments)
    rows: list[dict[str, Any]] = []
    with whole_file(json_file) as write, working("timing") as step:
        for scenario, one in trials(step, chosen):
            run = partial(
                timed, scenario, ticks, repeats, progress=one, solver=solver, hierarchy=hierarchy, pause=pause
            )
            rows += [run()] if found_peers is None else _in_turns(found_peers, scenario.name, run, repeats, pause)
        write("[\n" + ",\n".join(json.dumps(row) for row in rows) + "\n]\n")
    _print(rows)


def _in_turns(
    peers: Peers, name: str, run: Callable[[], dict[str, Any]], repeats: int, pause: float
) -> list[dict[str, Any]]:
    """We and every peer, one after the other, twice; the better row of each counts."""
    ways: list[Callable[[], dict[str, Any]]] = [
        run,
        *(partial(peers.row, peer, name, repeats, pause) for peer in peers.names(name)),
    ]
    rounds = [[way() for way in ways] for _ in range(_ROUNDS)]
    rows = [min(tries, key=_median) for tries in zip(*rounds, strict=True)]
    theirs = {row["peer"]: _median(row) for row in rows if not _is_ours(row) and "total_us" in row}
    for row in rows:
        if _is_ours(row):
            row["ratio_to"] = {peer: round(_median(row) / median, 3) for peer, median in theirs.items()}
    return rows


def _median(row: dict[str, Any]) -> float:
    return float(row["total_us"]["median"]) if "total_us" in row else inf


def _print(rows: list[dict[str, Any]]) -> None:
    made = table("Time of one tick [µs]", "workload", "how", "median", "p99", "max", "failures", numbers=True)
    for row in rows:
        how = row.get("variant", "") if _is_ours(row) else row["peer"] + ", measured before" * row.get("stored", False)
        if "total_us" not in row:
            made.add_row(row["workload"], Text(f"{how}, did not run"))
            continue
        times = (f"{row['total_us'][kind]:.1f}" for kind in ("median", "p99", "max"))
        made.add_row(row["workload"], Text(how), *times, str(row.get("solver_failures", "")))
    say(made)
    ours = [row for row in rows if _is_ours(row) and "split_us" in row]
    if ours:
        say("", _split(ours), "", _how_solved(ours))
    compared = [row for row in ours if row.get("ratio_to")]
    if compared:
        say("", _ratios(compared))


def _is_ours(row: dict[str, Any]) -> bool:
    return bool(row.get("peer", "wbc") == "wbc")


def _split(rows: list[dict[str, Any]]) -> Any:
    parts = ("update", "fill", "solve", "decode", "rest")
    made = table("Where the time of a tick goes [µs]", "workload", *parts, numbers=True)
    for row in rows:
        made.add_row(row["workload"], *(f"{row['split_us'][part]:.1f}" for part in parts))
    return made


def _how_solved(rows: list[dict[str, Any]]) -> Any:
    made = table("Ticks by how their active set was found, and what a tick costs", "workload", "guessed", "repaired",
                 "finite method", "over bare model calls", numbers=True)  # fmt: skip
    for row in rows:
        counts = (str(row["counts"][how]) for how in ("first", "repaired", "fallback"))
        made.add_row(
            row["workload"],
            *counts,
            f"{row['total_over_pinocchio']:.1f} times" if "total_over_pinocchio" in row else "",
        )
    return made


def _ratios(rows: list[dict[str, Any]]) -> Any:
    made = table("Median, as a ratio to the libraries of the same sitting", "workload", "how", "ratio to")
    for row in rows:
        ratios = ", ".join(f"{peer} {ratio:.2f}" for peer, ratio in row["ratio_to"].items())
        made.add_row(row["workload"], Text(row["variant"]), ratios)
    return made
