"""``wbc explain``: what a saved QP answers, or which of its rows cannot hold together."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.text import Text

from wbc.cli.console import NO, one_sentence, say, table
from wbc.errors import InvalidInput
from wbc.qp.conflict import conflict
from wbc.qp.problem import QP
from wbc.qp.solver import Solution


@one_sentence
def explain(
    file: Annotated[
        Path, typer.Argument(metavar="FILE.npz", help="QPs in any form that wbc saves, or wbc report solvers reads.")
    ],
    solver: Annotated[str, typer.Option(help="QP solver for a QP that has an answer.")] = "pdas",
    index: Annotated[int | None, typer.Option(min=0, help="Which one of a file that holds several, from 0.")] = None,
) -> None:
    """Solve a saved QP and say what holds it, or which rows cannot hold together. Exit code 1: no certified answer."""
    from wbc.qp.solvers import by_name
    from wbc.report.solvers.problems import saved_qps

    chosen = by_name(solver)
    qps = saved_qps(file)
    if index is None and len(qps) > 1:
        raise InvalidInput(f"{file} holds {len(qps)} QPs; --index 0 to {len(qps) - 1} says which one")
    if index is not None and index >= len(qps):
        raise InvalidInput(f"{file} has no QP {index}: it holds {len(qps)}, the first is 0")
    qp = qps[index or 0]
    say(repr(qp))
    if not any(row.label or row.unit for row in qp.rows):
        say("The file names no rows: A[i] are its equalities, C[i] its inequalities, x[i] variables.")
    found = conflict(qp)
    if found is not None:
        say(f"cannot be met. {found}")
        made = table("Rows in conflict: any one of these is enough", "owner", "row", "gives", "unit")
        for row, amount in found.gives:
            made.add_row(Text(row.owner), Text(row.label), f"{amount:+.4g}", Text(row.unit))
        say(made)
        raise typer.Exit(NO)
    solution = chosen.solve(qp)
    say(f"{solution.status}: {solution.status.value}; {solution.certificate}")
    if not solution.status.ok:
        raise typer.Exit(NO)
    _print_active(qp, solution)


def _print_active(qp: QP, solution: Solution) -> None:
    pushing = np.concatenate([solution.y, solution.z, solution.z_box])
    value = np.concatenate([qp.matrix @ solution.x, solution.x])
    active = np.flatnonzero(np.abs(pushing) > 1e-7 * max(1e-3, np.abs(pushing).max(initial=0.0)))
    made = table("Rows that push", "owner", "row", "value", "unit", "multiplier")
    for i in active[np.argsort(-np.abs(pushing[active]))]:
        row = qp.rows[i]
        made.add_row(Text(row.owner), Text(row.label), f"{value[i]:.4g}", Text(row.unit), f"{pushing[i]:+.3g}")
    say(made)
