"""`make kernels` runs what this processor can and `make test` has not run, and fails where one run fails."""

from __future__ import annotations

import pytest

from tests import kernels

OLD = ["fpu", "sse2", "pni"]
USUAL = [*OLD, "avx", "fma", "avx2"]
WIDE = [*USUAL, "avx512f", "avx512dq", "avx512cd", "avx512bw", "avx512vl"]


@pytest.mark.parametrize(
    ("flags", "can"),
    [
        ([], []), (OLD, ["Prescott"]), (USUAL, ["Prescott", "Haswell"]), (WIDE[:-1], ["Prescott", "Haswell"]),
        (WIDE, ["Prescott", "Haswell", "SkylakeX"]),
    ],
)  # fmt: skip
def test_flags_of_the_processor_decide_what_it_can_run(flags: list[str], can: list[str]):
    assert kernels.runnable(flags) == can


@pytest.mark.parametrize("native", ["Prescott", "Haswell", "SkylakeX"])
def test_what_runs_anyway_is_not_run_twice_and_numba_runs_once_for_any_processor(native: str):
    runs = kernels.runs(["Prescott", "Haswell", "SkylakeX"], {native})
    families = [run.environment["OPENBLAS_CORETYPE"] for run in runs]
    assert sorted([*families, native]) == ["Haswell", "Prescott", "SkylakeX"]
    assert [run for run in runs if "NUMBA_CPU_NAME" in run.environment] == runs[-1:]
    assert [run for run in runs if run.folders == kernels.FOLDERS] == runs[-1:]


def test_numba_runs_for_any_processor_also_where_nothing_is_known_of_openblas():
    (run,) = kernels.runs([], set())
    assert run.environment == kernels.GENERIC
