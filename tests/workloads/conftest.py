"""What the tests of workloads may need: the robots, and figures measured with other libraries."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from wbc.errors import ModelError
from wbc.models.catalogue import example_robots


@pytest.fixture(scope="session", autouse=True)
def robots() -> None:
    """Skips where the extra ``robots`` is not installed."""
    try:
        example_robots()
    except ModelError as missing:
        pytest.skip(str(missing))


@pytest.fixture(scope="session")
def peers() -> Path:
    """The folder in which other libraries were measured on the same workloads, if there is one."""
    folder = Path(os.environ.get("WBC_PEERS", "peers"))
    if not (folder / "results.json").is_file():
        pytest.skip("no results of other libraries; set WBC_PEERS to their folder")
    return folder
