"""Long runs over random cases: what they have found so far, once a minute, and at the end."""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator
from typing import Any, NamedTuple, TypeVar

import numpy as np

import wbc
from tests.families import oracle

PERIOD = 60.0

Case = TypeVar("Case")
Ticks = Iterator[tuple[wbc.Controller, wbc.Command, str]]


def told(cases: Iterable[Case], rows: Collection[Counter[str]], *, loud: bool = True) -> Iterator[Case]:
    """The cases, with the sum of ``rows`` as they are then printed every minute."""
    due = time.monotonic() + PERIOD
    for number, case in enumerate(cases, 1):
        yield case
        if loud and time.monotonic() > due:
            total = sum(rows, Counter[str]())
            print(f"after {number}: {dict(sorted(total.items()))}", flush=True)
            due = time.monotonic() + PERIOD


def show(table: dict[str, Counter[str]], words: Iterable[str] = ()) -> int:
    """Print the table; how many verdicts are wrong."""
    words = words or sorted({word for row in table.values() for word in row})
    total: Counter[str] = sum(table.values(), Counter())
    wide = max(map(len, [*table, "all"]))
    for kind, row in [*sorted(table.items()), ("all", total)]:
        print(f"{kind:{wide}s}  " + "  ".join(f"{word}: {row[word]}" for word in words if row[word]), flush=True)
    return total["wrong"] + total["uncertified"]


def followed(control: wbc.Controller, q: Any, v: Any, kind: str, ticks: int) -> Ticks:
    """The controller, each of its commands, and what it is; the robot does what is commanded."""
    for tick in range(ticks):
        decided = control.tick(1e-3 * tick, q, v)
        yield control, decided, kind
        q, v = decided.q, decided.v
        if not np.isfinite(q).all() or np.abs(v).max() > 1e3:
            return


class Family(NamedTuple):
    """Controllers of one kind: the ticks of each case, every how many of them the optimum is judged, and by what."""

    ticked: Callable[[int, int], Ticks]
    every: int = 1
    judge: Callable[..., oracle.Verdict] = oracle.judge

    def run(
        self, count: int, seed: int, *, ticks: int, verbose: bool = False, first: int = 0
    ) -> dict[str, Counter[str]]:
        """Verdicts by kind, of cases ``first`` to ``first + count`` of this seed."""
        table: dict[str, Counter[str]] = {}
        for k in told(range(first, first + count), table.values(), loud=verbose):
            for tick, (control, decided, kind) in enumerate(self.ticked(seed * 1_000_003 + k, ticks)):
                word, why = self.judge(control, decided, optimum=tick % self.every == 0)
                table.setdefault(kind, Counter())[word] += 1
                if verbose and (word in ("wrong", "uncertified") or "feasible" in word):
                    print(f"{seed * 1_000_003 + k} tick {tick} {kind}: {word}: {why}", flush=True)
        return table

    def command(self, about: str | None, *, ticks: int) -> None:
        """The command line of a family of controllers; the exit status is 1 where a verdict is wrong."""
        parser = _parser(about, 1000)
        parser.add_argument("--ticks", type=int, default=ticks)
        given = parser.parse_args()
        print(f"seed {given.seed}, cases {given.first} to {given.first + given.count - 1}", flush=True)
        table = self.run(given.count, given.seed, ticks=given.ticks, verbose=True, first=given.first)
        sys.exit(1 if show(table) else 0)


class Answered(NamedTuple):
    """A problem of a family, the solver asked, its status, and what is wrong with the answer."""

    family: str
    index: int
    solver: str
    status: str
    wrong: str


def command_of_problems(
    cases: Callable[..., Iterator[Answered]], head: tuple[str, ...], about: str | None, *, count: int
) -> None:
    """The command line of families of problems: a table for each solver; the exit status is 1 where one is wrong."""
    parser = _parser(about, count)
    parser.add_argument("--solver", nargs="+", default=["pdas"])
    parser.add_argument("--show", type=int, default=5, help="cases to name, of each kind")
    asked = parser.parse_args()
    tables: dict[str, dict[str, Counter[str]]] = {solver: {} for solver in asked.solver}
    total, named = Counter[str](), Counter[str]()
    for case in told(cases(asked.count, asked.seed, asked.solver, first=asked.first), [total]):
        column = case.status.lower() if case.status.lower() in head else "failed"
        for row in (tables[case.solver].setdefault(case.family, Counter()), total):
            row.update([column, *(["wrong"] if case.wrong else [])])
        kind = case.solver + ("wrong" if case.wrong else column)
        if (case.wrong or column == "failed") and named[kind] < asked.show:
            named[kind] += 1
            print(f"  {case.solver} {case.family} {case.index}: {case.status} {case.wrong}", flush=True)
    for solver, table in tables.items():
        print(f"\n{solver}, seed {asked.seed}")
        show(table, head)
    sys.exit(int(total["wrong"] > 0))


def _parser(about: str | None, count: int) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("--count", type=int, default=count)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="case to begin with")
    return parser
