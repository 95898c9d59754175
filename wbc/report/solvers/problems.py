"""Problem sets: QPs that belong together, from a scenario's own ticks, from files, or made to measure growth."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import numpy as np

from wbc.errors import InvalidInput, InvalidProblem
from wbc.npz import read_json, read_npz, write_npz
from wbc.qp.problem import QP, Objective, Row
from wbc.types import Vec

#: Numbers from here on mean "no bound" in many collections.
NO_BOUND = 1e20
_PARTS = ("H", "g", "A", "b", "C", "cl", "cu", "lb", "ub")


@final
@dataclass(frozen=True, eq=False)
class ProblemSet:
    """QPs under one name. ``kind``: "sequence" (ticks of a controller), "files" or "growth" (of growing size).

    ``stretches`` are the runs [start, end) of problems that follow one another: a warm start goes from one to the
    next inside a stretch. Problems from files stand alone, each a stretch of its own. ``period`` is the time between
    ticks [s], ``sizes`` how large the problems of each stretch are, where they grow.
    """

    name: str
    kind: str
    source: str
    qps: Sequence[QP]
    labels: Sequence[str]
    stretches: Sequence[tuple[int, int]]
    period: float | None = None
    sizes: Sequence[int] = ()

    @property
    def modes(self) -> tuple[str, ...]:
        """How it is solved: cold, each in a new session; and warm, one after the other, where problems follow."""
        return ("cold",) if self.kind == "files" else ("cold", "warm")

    def about(self) -> dict[str, Any]:
        """What a report says of the set, in json's types."""
        return {
            "name": self.name,
            "kind": self.kind,
            "source": self.source,
            "labels": list(self.labels),
            "stretches": [list(stretch) for stretch in self.stretches],
            "period": self.period,
            "sizes": list(self.sizes),
            "shapes": [list(qp.shape) for qp in self.qps],
            "tasks": {task.name: task.unit for qp in self.qps for task in qp.tasks},
        }

    def save(self, path: Path) -> None:
        """Write one compressed .npz that :meth:`load` reads back to the same bits."""
        arrays = {f"{i}/{part}": getattr(qp, part) for i, qp in enumerate(self.qps) for part in _PARTS}
        for i, qp in enumerate(self.qps):
            arrays |= {f"{i}/rows of {k}": task.rows for k, task in enumerate(qp.tasks)}
            arrays |= {f"{i}/target of {k}": task.target for k, task in enumerate(qp.tasks)}
        about = {key: value for key, value in self.about().items() if key != "shapes"}
        about["rows"] = _folded([[list(row) for row in qp.rows] for qp in self.qps])
        about["tasks"] = _folded([[[task.name, task.unit] for task in qp.tasks] for qp in self.qps])
        write_npz(path, about=np.array(json.dumps(about)), **arrays)

    @classmethod
    def load(cls, path: Path) -> ProblemSet:
        """Read what :meth:`save` wrote.

        Raises:
            InvalidProblem: not such a file.
        """
        try:
            file = read_npz(path)
            about = read_json(str(path), str(file["about"]))
            rows = [[Row(*row) for row in names] for names in _unfolded(about["rows"])]
            qps = []
            for i, (names, tasks) in enumerate(zip(rows, _unfolded(about["tasks"]), strict=True)):
                part: dict[str, Any] = {part: file[f"{i}/{part}"] for part in _PARTS}
                part["tasks"] = [
                    Objective(name, file[f"{i}/rows of {k}"], file[f"{i}/target of {k}"], unit)
                    for k, (name, unit) in enumerate(tasks)
                ]
                qps.append(QP(part.pop("H"), part.pop("g"), rows=names, **part))
            stretches = [(start, end) for start, end in about["stretches"]]
            labels, period, sizes = (about[key] for key in ("labels", "period", "sizes"))
            return cls(about["name"], about["kind"], about["source"], qps, labels, stretches, period, sizes)
        except (KeyError, ValueError, TypeError, IndexError) as cause:
            raise InvalidProblem(f"{path} is not a problem set saved by this library: {cause}") from cause


def sequence(name: str, qps: Sequence[QP], *, source: str = "given QPs", period: float | None = None) -> ProblemSet:
    """QPs of consecutive ticks as a set of one stretch.

    Raises:
        InvalidInput: there are none.
    """
    if not qps:
        raise InvalidInput(f"{name}: there is no QP to compare solvers on")
    labels = [f"problem {i}" for i in range(len(qps))]
    return ProblemSet(name, "sequence", source, tuple(qps), labels, [(0, len(qps))], period)


def saved_qps(path: Path) -> Sequence[QP]:
    """The QPs in a file, one or a whole set, in any format that :func:`from_folder` reads.

    Raises:
        InvalidProblem: another format.
    """
    return ProblemSet.load(path).qps if _is_set(path) else [read_qp(path)]


@final
@dataclass(frozen=True)
class Folder:
    """What a folder holds: sets of QPs, and what could not be read, with the reasons."""

    sets: list[ProblemSet]
    unread: dict[str, str]


def from_folder(folder: Path) -> Folder:
    """Every folder of .npz files at or below ``folder`` as a set of its own; of one file, what is in it.

    Understood are QPs saved by this library; ``P, q, G, h, A, b, lb, ub`` (what is not there is absent) for
    ½ xᵀPx + qᵀx, G x ≤ h, A x = b; and ``P, q, A, l, u`` for l ≤ A x ≤ u. Problem sets of an older comparison
    are sets again.

    Raises:
        InvalidInput: no such folder or file, or nothing in it that can be read.
    """
    if not folder.exists():
        raise InvalidInput(f"there is no file {folder}; give a scenario, a folder of QPs (.npz) or one of its files")
    found: dict[str, list[tuple[str, QP]]] = {}
    sets: list[ProblemSet] = []
    unread: dict[str, str] = {}
    for path in sorted(folder.rglob("*.npz")) if folder.is_dir() else [folder]:
        place = path.parent.relative_to(folder) if folder.is_dir() else Path()
        try:
            if _is_set(path):
                sets.append(ProblemSet.load(path))
            else:
                qp = read_qp(path)
                found.setdefault("/".join((folder.resolve().name, *place.parts)), []).append((path.stem, qp))
        except InvalidProblem as reason:
            unread[(place / path.name).as_posix()] = str(reason).replace(f"{folder}/", "")
    for name, members in found.items():
        labels, qps = zip(*members, strict=True)
        stretches = [(i, i + 1) for i in range(len(qps))]
        sets.append(ProblemSet(name, "files", "files", qps, labels, stretches))
    if not sets:
        raise InvalidInput(f"{folder} holds no QP that can be read; see docs/solvers.md for the formats")
    return Folder(sets, unread)


def read_qp(path: Path) -> QP:
    """One QP from an .npz in any of the formats of :func:`from_folder`.

    Raises:
        InvalidProblem: another format, or not a convex QP.
    """
    try:
        part = read_npz(path)
    except InvalidInput as cause:
        raise InvalidProblem(str(cause)) from cause
    keys = set(part)
    if {"H", "g", "rows"} <= keys:
        return QP.load(path)
    if {"P", "q", "A", "l", "u"} <= keys:
        return _between(part)
    if {"P", "q"} <= keys:
        return QP(
            _symmetric(part["P"]), part["q"], A=part.get("A"), b=part.get("b"), C=part.get("G"),
            cu=_open(part.get("h")), lb=_open(part.get("lb")), ub=_open(part.get("ub")),
        )  # fmt: skip
    raise InvalidProblem(f"{path} holds {', '.join(sorted(keys)[:6]) or 'nothing'}: not a QP in a format known here")


def _between(part: Mapping[str, Any]) -> QP:
    """min ½ xᵀPx + qᵀx with l ≤ A x ≤ u; rows whose sides are equal become equalities."""
    A, lower, upper = part["A"], _open(part["l"]), _open(part["u"])
    assert lower is not None and upper is not None
    equal = lower == upper
    return QP(
        _symmetric(part["P"]), part["q"], A=A[equal], b=upper[equal],
        C=A[~equal], cl=lower[~equal], cu=upper[~equal],
    )  # fmt: skip


def _symmetric(P: Any) -> Any:
    """Some collections hold one triangle, or rounding in one of them."""
    P = np.asarray(P, dtype=np.float64)
    if np.allclose(P, np.triu(P)) and not np.allclose(P, np.diag(P.diagonal())):
        P = P + np.triu(P, 1).T
    return 0.5 * (P + P.T)


def _open(bound: Any) -> Vec | None:
    """Huge numbers as infinity."""
    if bound is None:
        return None
    values = np.array(bound, dtype=np.float64)
    values[np.abs(values) >= NO_BOUND] *= np.inf
    return values


def _is_set(path: Path) -> bool:
    try:
        return "about" in read_npz(path)
    except InvalidInput:
        return False


def _folded(names: list[list[list[str]]]) -> dict[str, Any]:
    """Lists of names, each different one once: the ticks of a controller all have the same."""
    lists: list[Any] = []
    which = []
    for rows in names:
        if rows not in lists:
            lists.append(rows)
        which.append(lists.index(rows))
    return {"lists": lists, "which": which}


def _unfolded(names: dict[str, Any]) -> list[Any]:
    return [names["lists"][k] for k in names["which"]]
