"""The same ticks give the same bits in two processes, with one thread and with two."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest


@pytest.mark.slow
@pytest.mark.parametrize("name", ["arm-torque", "humanoid"])
def test_commands_are_equal_to_the_bit_across_processes(name: str, tmp_path):
    digests = set()
    for threads in ("1", "2"):
        rows = tmp_path / f"{threads}.json"
        words = ["soak", name, "--ticks", "300", "--json", str(rows)]
        environment = os.environ | {"OMP_NUM_THREADS": threads, "OPENBLAS_NUM_THREADS": threads}
        subprocess.run([sys.executable, "-m", "wbc", *words], check=True, env=environment, capture_output=True)
        digests.add(json.loads(rows.read_text())[0]["digest"])
    assert len(digests) == 1
