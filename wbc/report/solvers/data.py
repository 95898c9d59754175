"""The raw data of a comparison: everything that was measured, in json's types; the pages are made from it alone."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from wbc.errors import InvalidInput
from wbc.npz import read_json
from wbc.report.journal import Journal
from wbc.report.solvers.jobs import Key
from wbc.report.solvers.problems import ProblemSet
from wbc.report.solvers.request import Request
from wbc.sim.provenance import load

FORMAT = 5
Data = dict[str, Any]


def gathered(request: Request, sets: Mapping[str, ProblemSet], journal: Journal, unread: Mapping[str, str]) -> Data:
    """Everything in the journal, in an order that does not depend on interruptions."""
    findings: dict[Key, Any] = {tuple(found["key"]): found["finding"] for found in journal.findings.values()}
    return {
        "format": FORMAT,
        "surroundings": {**journal.header["surroundings"], "load_after": load()},
        "settings": {
            "rounds": request.rounds, "limit_s": request.limit, "patience_s": request.patience,
            "ticks": request.ticks,
        },
        "solvers": [
            {
                "name": solver.name,
                "offline": solver.offline,
                "repeatable": solver.repeatable,
                "calls": {name: call(solver, tolerance) for name, tolerance in request.classes.items()},
            }
            for solver in request.solvers
        ],
        "classes": dict(request.classes),
        "sets": [found.about() for found in sets.values()],
        "unread": dict(unread),
        "measures": [m for found in sets.values() for m in _measures(request, found, findings)],
        "loops": [_loop(key, value) for key, value in findings.items() if key[0] == "loop"],
        "torture": [
            {"case": key[1], "solver": key[2], "how": key[3], **value}
            for key, value in findings.items() if key[0] == "torture"
        ],
    }  # fmt: skip


def write(data: Data, path: Path) -> None:
    """Write the data, one long line a measure."""
    parts = []
    for key, value in data.items():
        if isinstance(value, list):
            lines = ",\n  ".join(_dumped(item) for item in value)
            parts.append(f" {json.dumps(key)}: [\n  {lines}\n ]" if value else f" {json.dumps(key)}: []")
        else:
            parts.append(f" {json.dumps(key)}: {_dumped(value)}")
    path.write_text("{\n" + ",\n".join(parts) + "\n}\n", encoding="utf-8")


def read(path: Path) -> Data:
    """What :func:`write` wrote.

    Raises:
        InvalidInput: not such a file, or of another version of this library.
    """
    try:
        data = read_json(str(path), path.read_bytes())
        known = data["format"]
    except (OSError, ValueError, KeyError, TypeError) as cause:
        raise InvalidInput(f"{path} is not the data of a comparison: {cause}") from cause
    if known != FORMAT:
        raise InvalidInput(f"{path} has format {known}; this version reads {FORMAT}")
    found: Data = data
    return found


def call(solver: Any, tolerance: float | None) -> str:
    """The exact settings of a solver in a class."""
    asked = solver if tolerance is None else solver.at(tolerance)
    told = getattr(asked, "settings", None)
    text = (
        f"{asked.name}: {', '.join(f'{k} = {v}' for k, v in told.items()) or 'its own'}" if told is not None else asked
    )
    return f"{text}, certified to {asked.tolerance:g}"


def _measures(request: Request, found: ProblemSet, findings: Mapping[Key, Any]) -> Iterable[Data]:
    classes = [name for name in request.classes] if found.kind != "growth" else ["1e-6"]
    for solver in request.solvers:
        for name in classes:
            for mode in found.modes:
                rounds = [
                    [
                        findings.get(("solve", found.name, solver.name, name, mode, c, r), [])
                        for r in range(request.rounds)
                    ]
                    for c in range(len(found.stretches))
                ]
                yield {"set": found.name, "solver": solver.name, "class": name, "mode": mode, **_columns(rounds)}


def _columns(stretches: Sequence[Sequence[Sequence[Data]]]) -> Data:
    """One list a quantity, one entry a problem: findings of the first round, times of the fastest, and of each."""
    rows: list[Data] = []
    best: list[list[float | None]] = []
    each: list[list[float | None]] = []
    for rounds in stretches:
        rows += rounds[0]
        for i, row in enumerate(rounds[0]):
            found = [r[i].get("us") if i < len(r) and "us" in row else None for r in rounds]
            each.append([times[0] if times else None for times in found])
            best.append(min((times for times in found if times), default=[None, None, None]))
    kkt = [row.get("kkt") or [None, None, None] for row in rows]
    return {
        "status": [row["status"] for row in rows],
        "lost": {str(i): row["lost"] for i, row in enumerate(rows) if "lost" in row},
        "total_us": [times[0] for times in best],
        "rounds_us": [list(times) for times in zip(*each, strict=True)],
        "build_us": [times[1] for times in best],
        "solve_us": [times[2] for times in best],
        "primal": [r[0] for r in kkt],
        "dual": [r[1] for r in kkt],
        "gap": [r[2] for r in kkt],
        "own": [row.get("own") for row in rows],
        "active": [row.get("active") for row in rows],
        "changed": [row.get("changed") for row in rows],
        "iterations": [row.get("iterations") for row in rows],
        "violation": _by_name(rows, "violation"),
        "bounds": _by_name(rows, "bounds"),
    }


def _by_name(rows: Sequence[Data], what: str) -> Data:
    names = dict.fromkeys(name for row in rows for name in row.get(what, {}))
    return {name: [row.get(what, {}).get(name) for row in rows] for name in names}


def _loop(key: Key, finding: Data) -> Data:
    lost = finding.get("lost")
    shown = {"error": lost} if lost else finding
    return {"scenario": key[1], "solver": key[2], "class": key[3], **shown}


def _dumped(value: Any) -> str:
    return json.dumps(value, allow_nan=False, ensure_ascii=False, separators=(",", ":"))
