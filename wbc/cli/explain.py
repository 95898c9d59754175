"""``wbc explain``: the active rows at the solution of a saved QP, or the rows that cannot hold together."""

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
    solver: Annotated[str, typer.Option(help="QP solver for a QP that has a solution.")] = "pdas",
    index: Annotated[int | None, typer.Option(min=0, help="Which one of a file that holds several, from 0.")] = None,
) -> None:
    """Solve a saved QP and list its active rows, or the rows that cannot hold together. Exit code 1: no certified
    solution."""
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
        made = table("These rows cannot hold together; one of these changes is enough", "owner", "row", "change")
        for give in found.gives:
            made.add_row(Text(give.row.owner), Text(give.row.label), Text(give.way))
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
    if not active.size:
        say("No row is active.")
        return
    made = table("Active rows, the largest multiplier first", "owner", "row", "value", "unit", "multiplier")
    for i in active[np.argsort(-np.abs(pushing[active]))]:
        row = qp.rows[i]
        made.add_row(Text(row.owner), Text(row.label), f"{value[i]:.4g}", Text(row.unit), f"{pushing[i]:+.3g}")
    say(made)
