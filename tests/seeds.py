"""One seed for the random examples of a run: the ISO year and week, so that each week tries other examples.

The environment variable ``WBC_TEST_SEED`` names another seed: it repeats a run of the past. Hypothesis gets the seed
from ``tests/conftest.py``; a test that draws with numpy asks :func:`generator`.

Example:
    >>> import numpy as np
    >>> from tests.seeds import generator
    >>> bool(generator("arms", 3).uniform() == generator("arms", 3).uniform())
    True
"""

from __future__ import annotations

import os
from datetime import UTC, date, datetime
from hashlib import sha256

import numpy as np


def seed_of_week(day: date) -> int:
    """The ISO year and week of ``day`` as one number: 202607 is the seventh week of 2026."""
    year, week, _ = day.isocalendar()
    return 100 * year + week


SEED = int(os.environ.get("WBC_TEST_SEED", "") or seed_of_week(datetime.now(UTC).date()))
os.environ["WBC_TEST_SEED"] = str(SEED)  # processes that a test starts draw the same, also over midnight


def generator(*key: object) -> np.random.Generator:
    """A numpy generator for one test.

    Args:
        key: what tells this generator from others of the run: the name of a family, the number of a case. The same
            seed and key give the same numbers on every machine.
    """
    digest = sha256(repr((SEED, *key)).encode()).digest()
    return np.random.default_rng(int.from_bytes(digest[:8], "big"))
