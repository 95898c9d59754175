"""The engine: does the jobs of a comparison one after the other, and can be stopped and taken up at any moment."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Any

from wbc.report.journal import Journal
from wbc.report.solvers.jobs import TIMED_ONCE, Job, jobs
from wbc.report.solvers.problems import ProblemSet
from wbc.report.solvers.process import Lost, SolverProcess
from wbc.report.solvers.request import Request
from wbc.sim.scenario import Progress

#: The process of a solver is imported and compiled in the time of about so many solves.
STARTING = 3000.0


def work(request: Request, folder: Path, journal: Journal, progress: Progress) -> None:
    """Do what the journal does not have yet. Problem sets lie in ``folder``."""
    sets = {name: ProblemSet.load(folder / file) for name, file in request.files.items()}
    wanted = list(jobs(request, sets))
    total = sum(job.weight for job in wanted) + STARTING * len({job.solver for job in wanted})
    done, started = 0.0, set[str]()
    words = {"solve": "on", "loop": "in the loop of", "torture": "tortured with"}
    with ExitStack() as stack:
        processes = {s.name: stack.enter_context(SolverProcess(s, folder)) for s in request.solvers}
        for job in wanted:
            what, name, solver = job.key[:3]
            progress(done / total, f"{solver} {words[str(what)]} {name}")
            if job.key not in journal.findings:
                process = processes[job.solver]
                if job.items:
                    found: Any = _solve(job, process, request.limit, journal)
                else:
                    found = _ask(job, process, request.limit if job.key[0] == "torture" else request.patience)
                journal.add({"key": list(job.key), "finding": found})
            done += job.weight if job.solver in started else job.weight + STARTING
            started.add(job.solver)
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
