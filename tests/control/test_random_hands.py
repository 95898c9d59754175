"""Arms drawn at random that are driven into each other: hands of any form keep the margin, and come to rest."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import wbc
from tests.control.random_pairs_of_arms import MARGIN, meet, pair_of_arms

SEEDS = st.integers(0, 2**32 - 1)


@pytest.mark.parametrize("seed", [0, 1, 27, 53])
def test_hands_that_meet_come_to_rest_at_the_margin(seed: int, tmp_path: Path):
    meeting = meet(pair_of_arms(seed, tmp_path), seed, 6.0)
    assert meeting.ok
    assert meeting.nearest > MARGIN - 1e-3
    assert meeting.fastest < 0.1


@pytest.mark.parametrize("seed", [0, 1, 3, 14, 377])
def test_hands_whose_accelerations_are_decided_keep_the_margin_too(seed: int, tmp_path: Path):
    meeting = meet(pair_of_arms(seed, tmp_path), seed, 1.5, level=wbc.AccelerationLevel())
    assert meeting.ok
    assert meeting.nearest > MARGIN - 1e-3


def check(folder: Path, seed: int) -> None:
    """Hands that slide along each other may do so for a long time, and slow down, but not to and fro."""
    meeting = meet(pair_of_arms(seed, folder), seed, 3.0)
    assert meeting.ok
    assert meeting.nearest > MARGIN - 1e-3
    assert meeting.shaking < 0.02


@pytest.mark.parametrize("seed", [567, 1101, 1265, 1341])
def test_hands_that_slide_along_each_other_do_not_shake(seed: int, tmp_path: Path):
    check(tmp_path, seed)


@settings(max_examples=8)
@given(SEEDS)
def test_hands_that_meet_keep_the_margin_and_do_not_shake(tmp_path_factory: pytest.TempPathFactory, seed: int):
    check(tmp_path_factory.mktemp("arms"), seed)


@pytest.mark.deep
@settings(max_examples=100)
@given(SEEDS)
def test_many_hands_whose_accelerations_are_decided_keep_the_margin(
    tmp_path_factory: pytest.TempPathFactory, seed: int
):
    meeting = meet(pair_of_arms(seed, tmp_path_factory.mktemp("arms")), seed, 3.0, level=wbc.AccelerationLevel())
    assert meeting.ok
    assert meeting.nearest > MARGIN - 1e-3


@pytest.mark.deep
@settings(max_examples=100)
@given(SEEDS)
def test_many_hands_that_meet_keep_the_margin_and_do_not_shake(tmp_path_factory: pytest.TempPathFactory, seed: int):
    check(tmp_path_factory.mktemp("arms"), seed)
