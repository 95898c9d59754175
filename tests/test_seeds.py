"""Random examples: other ones each week, the same ones within a run."""

from __future__ import annotations

import os
import subprocess
import sys
from datetime import date, timedelta
from pathlib import Path

import pytest

from tests.seeds import SEED, generator, seed_of_week

DRAWN = """
from hypothesis import given, strategies as st
from tests.seeds import generator

@given(st.integers(0, 10**9))
def test_that_prints(number):
    print("DRAWN", number)

def test_with_numpy():
    print("DRAWN", generator("family").integers(10**9))

@given(st.integers(0, 10**9))
def test_that_fails(number):
    assert number < 0
"""


def drawn(folder: Path, *options: str, **environment: str) -> tuple[list[str], str]:
    """The numbers that a run of ``DRAWN`` draws, and all that it prints."""
    root = Path(__file__).parent.parent
    (folder / "conftest.py").write_text((root / "tests" / "conftest.py").read_text(encoding="utf-8"))
    (folder / "test_drawn.py").write_text(DRAWN)
    command = [sys.executable, "-m", "pytest", "-s", "-p", "no:cacheprovider", "--rootdir", str(folder), *options]
    settings = {key: value for key, value in os.environ.items() if key not in ("WBC_TEST_SEED", "CI")}
    settings |= {"PYTHONPATH": str(root), **environment}
    done = subprocess.run(
        [*command, str(folder)], cwd=folder, env=settings, capture_output=True, text=True, check=False, timeout=120
    )
    return [line for line in done.stdout.splitlines() if line.startswith("DRAWN")], done.stdout


def test_a_seed_repeats_the_examples_and_another_one_draws_others(tmp_path: Path):
    first, text = drawn(tmp_path, WBC_TEST_SEED="202607")
    assert len(first) > 20 and len(set(first)) > 10
    assert "WBC_TEST_SEED=202607" in text and "@reproduce_failure" in text
    assert drawn(tmp_path, WBC_TEST_SEED="202607")[0] == first
    other = drawn(tmp_path, WBC_TEST_SEED="202608")[0]
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
