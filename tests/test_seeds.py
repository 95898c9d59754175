"""Random examples: other ones each week, the same ones within a run."""

from __future__ import annotations

import os
import subprocess
import sys
from datetime import date, timedelta
from pathlib import Path
from unittest.mock import ANY

import pytest

from tests.seeds import SEED, generator, seed_of_week

DRAWN = """
import os
from hypothesis import given, strategies as st
from tests.seeds import generator
{extra}

def drew(number):
    with open(os.environ["DRAWN_NUMBERS"], "a") as file:
        file.write(f"{{__name__}} {{number}}\\n")

@given(st.integers(0, 10**9), st.lists(st.floats(0, 1), min_size=20, max_size=20))
def test_that_notes(number, floats):
    drew((number, floats))

def test_with_numpy():
    drew(generator("family").integers(10**9))

@given(st.integers(0, 10**9))
def test_that_fails(number):
    assert number < 0
"""
#: A module whose numbers are in the range of what is drawn, imported when its test runs.
OTHER = "NUMBERS = " + repr([k / 997.0 for k in range(1, 997)])
IMPORTS = "def test_a():\n    import other\n"


def drawn(folder: Path, *options: str, **environment: str) -> tuple[list[str], str]:
    """The numbers that a run of ``DRAWN`` in two files draws, and all that it prints."""
    root, numbers = Path(__file__).parent.parent, folder / "numbers"
    numbers.unlink(missing_ok=True)
    (folder / "conftest.py").write_text((root / "tests" / "conftest.py").read_text(encoding="utf-8"))
    (folder / "other.py").write_text(OTHER)
    for name, extra in (("test_first", IMPORTS), ("test_second", "")):
        (folder / f"{name}.py").write_text(DRAWN.format(extra=extra))
    command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--rootdir", str(folder), *options]
    settings = {key: value for key, value in os.environ.items() if key not in ("WBC_TEST_SEED", "CI")}
    settings = {key: value for key, value in settings.items() if not key.startswith("PYTEST_")}
    settings |= {"PYTHONPATH": f"{root}{os.pathsep}{folder}", "DRAWN_NUMBERS": str(numbers), **environment}
    done = subprocess.run(
        [*command, str(folder)], cwd=folder, env=settings, capture_output=True, text=True, check=False, timeout=120
    )
    return sorted(numbers.read_text().splitlines()), done.stdout


@pytest.mark.slow
def test_a_seed_repeats_the_examples_and_another_one_draws_others(tmp_path: Path):
    """By hand, in CI, and in processes that share the tests: a module that one of them loaded changes nothing."""
    first, text = drawn(tmp_path, WBC_TEST_SEED="202607")
    assert len(first) > 40 and len(set(first)) > 30
    assert "WBC_TEST_SEED=202607" in text and "@reproduce_failure" in text
    assert drawn(tmp_path, WBC_TEST_SEED="202607", CI="true") == (first, ANY)
    assert drawn(tmp_path, "-n", "2", "--dist", "loadfile", WBC_TEST_SEED="202607") == (first, ANY)
    other = drawn(tmp_path, WBC_TEST_SEED="202608", CI="true")[0]  # by hand too, as both drew the same above
    assert len(set(first) & set(other)) < len(set(first)) / 2


@pytest.mark.parametrize("start", [date(2025, 12, 29), date(2026, 12, 28)])
def test_the_seed_changes_on_monday_and_only_then(start: date):
    week = [seed_of_week(start + timedelta(days=days)) for days in range(7)]
    assert len(set(week)) == 1
    assert seed_of_week(start - timedelta(days=1)) < week[0] < seed_of_week(start + timedelta(days=7))


def test_generators_of_different_keys_are_different():
    keys = [("arms", 0), ("arms", 1), ("legs", 0), ("arms", "0"), ()]
    values = {generator(*key).uniform() for key in keys}
    assert len(values) == len(keys)
    assert SEED > 0
