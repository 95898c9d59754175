"""Bad inputs, each with what the refusal must say, or with the check that its answer must pass.

Run ``python -m tests.reliability.catalogue`` for a table over every installed solver, each case in its own process.
"""

from __future__ import annotations

import sys
from collections import Counter
from functools import cache

import wbc
from tests.reliability import bad_files, bad_members, bad_problems, bad_states
from tests.reliability.forked import Case, Outcome, forked


@cache
def cases(*, solved: bool | None = None) -> tuple[Case, ...]:
    """The whole catalogue, or what depends on the solver, or what does not."""
    chosen = {True: (bad_states, bad_problems), False: (bad_members, bad_files)}
    modules = [module for kind in ((True, False) if solved is None else (solved,)) for module in chosen[kind]]
    return tuple(
        case._replace(name=f"{module.__name__.rpartition('.')[2]}: {case.name}")
        for module in modules
        for case in module.cases()
    )


def fault(case: Case, outcome: Outcome) -> str:
    """What is wrong with an outcome, or nothing."""
    if outcome.kind == "answered" and case.says is None:
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
        for case in cases(solved=None if k == 0 else True):
            outcome = forked(lambda case=case, solver=solver: case.call(solver))
            kinds[outcome.kind] += 1
            if wrong := fault(case, outcome):
                faults += 1
                print(f"{solver}: {case.name}: {wrong}", flush=True)
        print(f"{solver}: {sum(kinds.values())} cases, {dict(kinds)}", flush=True)
    print(f"{len(cases())} cases, {faults} faults")
    return faults


if __name__ == "__main__":
    sys.exit(min(main(), 100))
