"""What a long run has found so far, once a minute."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
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
