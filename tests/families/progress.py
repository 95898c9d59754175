"""A long run over random cases: what it has found so far, once a minute, and at the end."""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator
from typing import TypeVar

PERIOD = 60.0

Case = TypeVar("Case")


def told(cases: Iterable[Case], rows: Collection[Counter[str]], *, loud: bool = True) -> Iterator[Case]:
    """The cases, with the sum of ``rows`` as they are then printed every minute."""
    due = time.monotonic() + PERIOD
    for number, case in enumerate(cases, 1):
        yield case
        if loud and time.monotonic() > due:
            total = sum(rows, Counter[str]())
            print(f"after {number}: {dict(sorted(total.items()))}", flush=True)
            due = time.monotonic() + PERIOD


def show(table: dict[str, Counter[str]]) -> int:
    """Print the table; how many verdicts are wrong."""
    words = sorted({word for row in table.values() for word in row})
    total: Counter[str] = sum(table.values(), Counter())
    wide = max(map(len, [*table, "all"]))
    for kind, row in [*sorted(table.items()), ("all", total)]:
        print(f"{kind:{wide}s}  " + "  ".join(f"{word}: {row[word]}" for word in words if row[word]))
    return total["wrong"] + total["uncertified"]


def command(run: Callable[..., dict[str, Counter[str]]], about: str | None, *, ticks: int) -> None:
    """The command line of a family of controllers; the exit status is 1 where a verdict is wrong."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--ticks", type=int, default=ticks)
    parser.add_argument("--first", type=int, default=0, help="case to begin with")
    given = parser.parse_args()
    print(f"seed {given.seed}, cases {given.first} to {given.first + given.count - 1}", flush=True)
    table = run(given.count, given.seed, ticks=given.ticks, verbose=True, first=given.first)
    sys.exit(1 if show(table) else 0)
