"""Each deliberate slip in the methods makes a test fail; without slips the tests pass."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.mutations import ROOT, Mutation, copied, mutations, passes, survives

ALL = mutations()
METHODS = (
    "fault_fraction", "force_distribution", "momentum_residual", "null_space_saturation", "parameter_update",
    "projected_gradient", "weighted_torque",
)  # fmt: skip


@pytest.fixture(scope="module")
def workshop(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the project that may be broken."""
    folder = tmp_path_factory.mktemp("workshop")
    copied(folder)
    return folder


def test_each_method_has_at_least_three_slips_that_stand_in_its_sources():
    for mutation in ALL:
        assert (ROOT / mutation.file).read_text(encoding="utf-8").count(mutation.old) == 1, mutation
    files = [mutation.file for mutation in ALL]
    for method in METHODS:
        assert files.count(f"wbc/methods/{method}.py") >= 3, method


@pytest.mark.deep
@pytest.mark.parametrize("test", sorted({mutation.test for mutation in ALL}))
def test_without_a_slip_the_tests_pass(workshop: Path, test: str):
    assert passes(workshop, test)


@pytest.mark.deep
@pytest.mark.parametrize("mutation", ALL, ids=str)
def test_each_slip_is_noticed(workshop: Path, mutation: Mutation):
    assert not survives(workshop, mutation)
