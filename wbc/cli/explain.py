"""``wbc explain``: what a saved QP answers, or which of its rows cannot hold together."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.text import Text

from wbc.cli.console import NO, one_sentence, table
from wbc.qp.conflict import conflict
from wbc.qp.problem import QP
from wbc.qp.solver import Solution


@one_sentence
def explain(
    file: Annotated[Path, typer.Argument(metavar="FILE.npz", help="A QP written by explain(save=...) or qp.save.")],
    solver: Annotated[str, typer.Option(help="QP solver for a QP that has an answer.")] = "pdas",
) -> None:
    """Solve a saved QP and say what holds it, or which rows cannot hold together. Exit code 1: no certified answer."""
    from wbc.qp.solvers import by_name

    chosen = by_name(solver)
    qp = QP.load(file)
    console = Console(highlight=False)
    console.print(Text(repr(qp)))
    found = conflict(qp)
    if found is not None:
        console.print(Text(f"cannot be met. {found}"), soft_wrap=True)
        made = table("Rows in conflict: any one of these is enough", "owner", "row", "gives", "unit")
        for row, amount in found.gives:
            made.add_row(Text(row.owner), Text(row.label), f"{amount:+.4g}", Text(row.unit))
        console.print(made)
        raise typer.Exit(NO)
    solution = chosen.solve(qp)
    console.print(Text(f"{solution.status}: {solution.status.value}; {solution.certificate}"), soft_wrap=True)
    if not solution.status.ok:
        raise typer.Exit(NO)
    _print_active(console, qp, solution)


def _print_active(console: Console, qp: QP, solution: Solution) -> None:
    pushing = np.concatenate([solution.y, solution.z, solution.z_box])
    value = np.concatenate([qp.matrix @ solution.x, solution.x])
    active = np.flatnonzero(np.abs(pushing) > 1e-7 * max(1e-3, np.abs(pushing).max(initial=0.0)))
    made = table("Rows that push", "owner", "row", "value", "unit", "multiplier")
    for i in active[np.argsort(-np.abs(pushing[active]))]:
        row = qp.rows[i]
        made.add_row(Text(row.owner), Text(row.label), f"{value[i]:.4g}", Text(row.unit), f"{pushing[i]:+.3g}")
    console.print(made)
