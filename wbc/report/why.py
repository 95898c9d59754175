"""The tasks and active rows of every tick of a run, for the cursor of the page."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, final

import numpy as np

from wbc.report import measure
from wbc.types import Flags, Mat, Vec

if TYPE_CHECKING:
    from wbc.control.recorder import Run


@final
class Part(NamedTuple):
    """A task over the run: norms of its error and of its residual by unit (N,), and its share of the cost (N,) [%]."""

    task: str
    error: dict[str, Vec]
    residual: dict[str, Vec]
    share: Vec


@final
@dataclass(frozen=True, eq=False)
class Why:
    """At times ``t`` (N,): how the tick ended, every task, and the active rows.

    ``rows``: what can be active, with the unit of its bound. ``codes`` (N, k): places in it, NaN for none, the dearest
    first, with their ``bounds`` and ``multipliers`` (N, k).
    """

    t: Vec
    status: Vec
    statuses: list[str]
    parts: list[Part]
    rows: list[tuple[str, str]]
    codes: Mat
    bounds: Mat
    multipliers: Mat


def why(run: Run) -> Why | None:
    """What the run recorded of its reasons; None of a record without them."""
    if "active.row" not in run or not run.rows:
        return None
    errors = {task: measure.errors(run, task) for task in measure.tasks(run)}
    parts = [
        Part(task, {unit: np.linalg.norm(error, axis=1) for unit, error in errors.get(task, {}).items()
                    if np.any(error)},  # a task without a target, such as a gradient, has no error
             _by_unit(run, task), share)
        for task, share in shares(run).items()
    ]  # fmt: skip
    used = max(int(np.isfinite(run["active.row"]).sum(axis=1).max(initial=0)), 1)
    codes, bounds, multipliers = (run[f"active.{name}"][:, :used] for name in ("row", "bound", "multiplier"))
    status = np.asarray(run["status"], dtype=float)
    names = [str(name).lower().replace("_", " ") for name in run.meta["statuses"]]
    rows = [(said, row["unit"]) for said, row in zip(row_names(run), run.meta["active_rows"], strict=True)]
    return Why(measure.times(run), status, names, parts, rows, codes, bounds, multipliers)


def row_names(run: Run) -> list[str]:
    """Every row that was active in the run, and on which side, where the row itself does not say so."""
    names = []
    for row in run.meta.get("active_rows", []):
        said = f"{row['owner']}: {row['label']}" if row["label"] else str(row["owner"])
        names.append(said if "<=" in said else f"{said}, {row['side']} bound")
    return names


def shares(run: Run) -> dict[str, Vec]:
    """The share of each task in what all of them cost (N,) [%], NaN where nothing costs anything."""
    costs = run.matching("cost.")
    total = np.nansum(np.column_stack(list(costs.values())), axis=1) if costs else np.zeros(run.rows)
    return {task: 100.0 * cost / np.where(total > 0.0, total, np.nan) for task, cost in costs.items()}


def held(run: Run) -> dict[str, Flags]:
    """On which ticks (N,) each row was active, the one that was longest first."""
    codes = run["active.row"]
    masks = {name: (codes == k).any(axis=1) for k, name in enumerate(row_names(run))}
    return dict(sorted(masks.items(), key=lambda found: -int(found[1].sum())))


def _by_unit(run: Run, task: str) -> dict[str, Vec]:
    values = np.asarray(run[f"residual.{task}"], dtype=float).reshape(run.rows, -1)
    units = str(run.meta.get("residuals", {}).get(task, "")).split(", ")
    return dict(zip(units, values.T, strict=False))
