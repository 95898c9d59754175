"""The engine: does the jobs of a comparison one after the other, and can be stopped and taken up at any moment."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from time import monotonic
from typing import Any, final

from wbc.report.journal import Journal
from wbc.report.solvers.jobs import TIMED_ONCE, Job, Key, jobs
from wbc.report.solvers.problems import ProblemSet
from wbc.report.solvers.process import Lost, SolverProcess
from wbc.report.solvers.request import Request
from wbc.sim.scenario import Progress

_TELL_EVERY = 0.5  # seconds


def work(request: Request, folder: Path, journal: Journal, progress: Progress) -> None:
    """Do what the journal does not have yet. Problem sets lie in ``folder``."""
    sets = {name: ProblemSet.load(folder / file) for name, file in request.files.items()}
    wanted = list(jobs(request, sets))
    clock = _Clock(wanted, progress)
    with ExitStack() as stack:
        processes = {s.name: stack.enter_context(SolverProcess(s, folder)) for s in request.solvers}
        for job in wanted:
            if job.key not in journal.findings:
                clock.tell(job)
                start = monotonic()
                process = processes[job.solver]
                if job.items:
                    found: Any = _solve(job, process, request.limit, journal)
                else:
                    found = _ask(job, process, request.limit if job.key[0] == "torture" else request.patience)
                journal.add({"key": list(job.key), "finding": found})
                clock.took(job, monotonic() - start)
            clock.done(job)
    progress(1.0, "measured")


def _ask(job: Job, process: SolverProcess, limit: float) -> dict[str, Any]:
    try:
        (finding,) = process.ask(job.order, limit)
    except Lost as loss:
        return {"lost": str(loss)}
    return finding


def _solve(job: Job, process: SolverProcess, limit: float, journal: Journal) -> list[dict[str, Any]]:
    """The rows of a job. When a problem costs the process, the next one goes to a new process."""
    left, rows = _still_wanted(job, journal), []
    while left:
        count = 0
        try:
            for row in process.ask({**job.order, "items": left}, limit):
                rows.append(row)
                count += 1
            return rows
        except Lost as loss:
            rows.append({"item": left[count], "status": "LOST", "lost": str(loss)})
            left = left[count + 1 :]
    return rows


def _still_wanted(job: Job, journal: Journal) -> list[int]:
    """All problems in the first round; later only those that came back and are worth timing again."""
    *same, round_ = job.key
    if round_ == 0:
        return list(job.items)
    first = journal.findings[(*same, 0)]["finding"]
    if any(row["status"] == "LOST" for row in first):
        return []
    times = [row["us"][0] for row in first if "us" in row]
    kind = "problem" if len(job.items) == 1 else "stretch"
    return list(job.items) if sum(times) <= TIMED_ONCE[kind] else []


@final
class _Clock:
    """Tells which share of the time is over, from what jobs of the same sort took so far."""

    def __init__(self, wanted: Sequence[Job], progress: Progress) -> None:
        self._progress = progress
        self._left: dict[Key, int] = {}
        for job in wanted:
            self._left[job.sort] = self._left.get(job.sort, 0) + 1
        self._seconds: dict[Key, tuple[float, int]] = {}
        self._finished, self._share = 0.0, 0.0
        self._last = -1e9

    def took(self, job: Job, seconds: float) -> None:
        """A job was done just now."""
        total, count = self._seconds.get(job.sort, (0.0, 0))
        self._seconds[job.sort] = (total + seconds, count + 1)
        self._finished += seconds

    def done(self, job: Job) -> None:
        """A job is done, now or in an earlier life."""
        self._left[job.sort] -= 1

    def tell(self, job: Job) -> None:
        """Report, now and then."""
        if monotonic() - self._last < _TELL_EVERY:
            return
        self._last = monotonic()
        left = self._seconds_left()
        self._share = max(self._share, self._finished / max(self._finished + left, 1e-9))  # a bar never goes back
        what, name, solver = job.key[:3]
        words = {"solve": "on", "loop": "in the loop of", "torture": "tortured with"}
        self._progress(self._share, f"{solver} {words[str(what)]} {name}")

    def _seconds_left(self) -> float:
        """Expected from the mean of the same sort; else of the same kind; else of all."""
        kinds: dict[Any, tuple[float, int]] = {}
        for sort, (total, count) in self._seconds.items():
            for kind in (sort[0], None):
                before = kinds.get(kind, (0.0, 0))
                kinds[kind] = (before[0] + total, before[1] + count)
        left = 0.0
        for sort, number in self._left.items():
            total, count = self._seconds.get(sort) or kinds.get(sort[0]) or kinds.get(None, (0.0, 1))
            left += number * total / count
        return left
