"""The same ticks give the same bits in two processes, with one thread and with two, also where code is compiled."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest


@pytest.mark.slow
def test_commands_are_equal_to_the_bit_across_processes(tmp_path: Path) -> None:
    digests = []
    for threads in ("1", "2"):
        rows = tmp_path / f"{threads}.json"
        words = ["soak", "arm-torque", "humanoid", "--ticks", "300", "--json", str(rows)]
        environment = os.environ | {"OMP_NUM_THREADS": threads, "OPENBLAS_NUM_THREADS": threads}
        subprocess.run([sys.executable, "-m", "wbc", *words], check=True, env=environment, capture_output=True)
        digests.append([row["digest"] for row in json.loads(rows.read_text())])
    assert digests[0] == digests[1] and len(set(digests[0])) == 2


@pytest.mark.deep
def test_the_process_that_compiles_gives_the_bits_of_those_that_read_its_code_from_disk(tmp_path: Path) -> None:
    digests = []
    for k in range(2):
        rows = tmp_path / f"{k}.json"
        words = ["soak", "arm-torque", "--ticks", "300", "--json", str(rows)]
        environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "code")}
        subprocess.run([sys.executable, "-m", "wbc", *words], check=True, env=environment, capture_output=True)
        digests.append(json.loads(rows.read_text())[0]["digest"])
    assert digests[0] == digests[1]
