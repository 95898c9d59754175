"""Bad inputs, each with what the refusal must say, or with the check that its answer must pass.

Run ``python -m tests.reliability.catalogue`` for a table over every installed solver, each case in its own process.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache
from typing import NamedTuple

import wbc
from tests.reliability import bad_files, bad_members, bad_problems, bad_states
from tests.reliability.forked import Outcome, forked

Call = Callable[[str], object]


class Case(NamedTuple):
    """``call(solver)``; ``says`` are words of the refusal, None for an answer that has been checked.

    ``either`` cases may be refused, with those words, or answered: it depends on the solver. ``solvers`` says whether
    the solver matters.
    """

    name: str
    call: Call
    says: tuple[str, ...] | None
    either: bool = False
    solvers: bool = False


@cache
def cases() -> tuple[Case, ...]:
    """The whole catalogue."""
    return tuple(_all())


def _all() -> Iterator[Case]:
    for module, solvers in ((bad_states, True), (bad_problems, True), (bad_members, False), (bad_files, False)):
        for name, call, says, either in module.cases():
            yield Case(f"{module.__name__.rpartition('.')[2]}: {name}", call, says, either, solvers)


def fault(case: Case, outcome: Outcome) -> str:
    """What is wrong with an outcome, or nothing."""
    if outcome.kind == "answered" and (case.says is None or case.either):
        return ""
    if outcome.kind == "refused" and case.says is not None:
        missing = [word for word in case.says if word not in outcome.text]
        return f"the refusal does not say {missing}: {outcome.text}" if missing else ""
    return f"{outcome.kind}: {outcome.text}"


def main() -> int:
    """Print a row for each solver; the exit code is the number of faults."""
    faults = 0
    for k, solver in enumerate(wbc.solvers()):
        kinds: Counter[str] = Counter()
        for case in cases():
            if case.solvers or k == 0:
                outcome = forked(lambda case=case, solver=solver: case.call(solver))
                kinds[outcome.kind] += 1
                wrong = fault(case, outcome)
                if wrong:
                    faults += 1
                    print(f"{solver}: {case.name}: {wrong}", flush=True)
        print(f"{solver}: {sum(kinds.values())} cases, {dict(kinds)}", flush=True)
    print(f"{len(cases())} cases, {faults} faults")
    return faults


if __name__ == "__main__":
    sys.exit(min(main(), 100))
