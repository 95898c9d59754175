"""Whether the robots of example-robot-data are there."""

from __future__ import annotations

import pytest

from wbc.errors import ModelError
from wbc.models.catalogue import example_robots


def _there() -> bool:
    try:
        example_robots()
    except ModelError:
        return False
    return True


needs_examples = pytest.mark.skipif(not _there(), reason="pip install example-robot-data")
