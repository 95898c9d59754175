"""``wbc export`` as a user types it."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.report.conftest import reaching_run


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    reaching_run().save(tmp_path / "run")
    return tmp_path / "run"


def test_a_log_is_written_and_its_size_said(wbc, recorded: Path, tmp_path: Path):
    pytest.importorskip("mcap")
    answer = wbc("export", recorded, "--mcap", "run.mcap")
    assert answer.code == 0 and answer.out.startswith("run.mcap: ") and answer.out.endswith(" MB\n")
    assert (tmp_path / "run.mcap").read_bytes().startswith(b"\x89MCAP")


@pytest.mark.parametrize(
    ("words", "about"),
    [
        ((), "--gif"),
        (("--gif", "run.webp"), "must end in .gif"),
        (("--gif", "run.gif", "--camera", "1"), "azimuth"),
        *(
            (("--gif", "run.gif", "--size", size), f"--size {size}: give width and height")
            for size in (
                "640",
                "640x",
                "x480",
                "640x480x3",
                "640*480",
                "a x b",
                "-1x5",
                "6e2x4e2",
                "640.5x480",
            )
        ),
        (("--gif", "run.gif", "--robot", "humanoid"), "other joints"),
        (("--mcap", "nowhere/run.mcap"), "cannot be written"),
    ],
)
def test_what_makes_no_sense_is_one_sentence(wbc, recorded: Path, tmp_path: Path, words, about):
    answer = wbc("export", recorded, *words)
    assert answer.code == 2 and about in answer.err and answer.err.count("\n") == 1 and not answer.out
    assert {path.name for path in tmp_path.iterdir()} == {"run"}
