"""Set up what every test runs under: one BLAS thread, and random examples drawn from the seed of the week."""

from __future__ import annotations

import gc
import os
from collections.abc import Generator

# Before numpy is imported: on few cores the threads of a BLAS only wait for one another.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")
# Figures go to files; no test opens a window.
os.environ.setdefault("MPLBACKEND", "Agg")

import pytest  # noqa: E402
from hypothesis import HealthCheck, settings  # noqa: E402
from hypothesis.internal.conjecture import providers  # noqa: E402

from tests.seeds import SEED  # noqa: E402

# Hypothesis also draws numbers that stand in the modules loaded so far, and these differ between the processes of a
# run. Without them an example depends on the seed and on its test alone. There is no setting for it.
providers._get_local_constants = lambda: providers._local_constants  # none, as it is before modules are read

# derandomize: Hypothesis switches it on where the variable CI is set, and then reads no seed.
settings.register_profile(
    "ci",
    max_examples=25,
    derandomize=False,
    deadline=None,
    database=None,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],  # draws of another week may filter more
)
settings.register_profile(
    "deep",
    max_examples=1000,
    derandomize=False,
    deadline=None,
    database=None,
    print_blob=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],  # draws of another week may filter more
)
settings.load_profile("ci")


@pytest.hookimpl(tryfirst=True)
def pytest_configure(config: pytest.Config) -> None:
    """Hypothesis draws from the seed of the week, unless ``--hypothesis-seed`` names another one."""
    if config.getoption("--hypothesis-seed", None) is None:
        config.option.hypothesis_seed = str(SEED)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Generator[None, object, object]:
    """What is collected stays: it is looked through for garbage neither meanwhile nor while tests run."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files that have slow tests, so that no process is left with one of them at the end."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


def pytest_report_header(config: pytest.Config) -> str:
    """Say which seed the random examples have, and how to draw them again."""
    return f"random examples: seed {SEED}; to draw them again: WBC_TEST_SEED={SEED} python -m pytest ..."
